"""Motions beside an axis as polynomials of the position, so that a loop can follow them."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.experiment.virtual.imperfections import MOTIONS, GuideErrors
from flexstage.hysteresis.compiled import compiled
from flexstage.instruments.twin.device import ChannelDescription

#: Coefficients of a polynomial: those of the curves of guides, of order 5.
TERMS = 6
_ANGLES = ("roll", "pitch", "yaw")


def polynomial(guide: GuideErrors, motion: str, low: float) -> Array:
    """Return a curve of a guide as a polynomial of the position from where the stage is relaxed.

    `low` is the position of the low end of the stroke [m]. Coefficients from the constant up, which
    is such that the motion is zero where the stage is relaxed, shape (6,).

    Examples
    --------
    >>> guide = GuideErrors(stroke=60e-6, coefficients={"across": np.array([0.0, 0.0, 1e-7])})
    >>> c = polynomial(guide, "across", 5e-6)
    >>> print(f"{np.polynomial.polynomial.polyval(35e-6, c) * 1e9:.1f} nm")
    -204.2 nm
    """
    out = np.zeros(TERMS)
    given = guide.coefficients.get(motion)
    if given is not None:
        series = np.polynomial.Legendre(given, domain=[low, low + guide.stroke])
        powers = series.convert(kind=np.polynomial.Polynomial).coef
        out[: powers.size] = powers
        out[0] = 0.0
    return out


def neighbour(axes: Sequence[str], axis: str) -> str | None:
    """Return the axis whose direction is across another one; None where there is no other."""
    return next((name for name in axes if name != axis), None)


def beside_channels(axes: Sequence[str]) -> tuple[ChannelDescription, ...]:
    """Return the sensors of a stage: those of the axes, then those beside each of them."""
    names = [(axis, "m") for axis in axes]
    names += [(f"{a}.{m}", "rad" if m in _ANGLES else "m") for a in axes for m in MOTIONS]
    return tuple(
        ChannelDescription(number=i, name=name, unit=unit)
        for i, (name, unit) in enumerate(names, start=1)
    )


def kinds_of(channels: Sequence[ChannelDescription]) -> list[str]:
    """Return the kind of sensor of each channel: ``along``, ``beside`` or ``angle``."""
    return [
        "angle" if c.unit == "rad" else ("beside" if "." in c.name else "along") for c in channels
    ]


def sources(
    axes: Sequence[str], guides: Mapping[str, GuideErrors], low: Mapping[str, float]
) -> tuple[NDArray[np.int64], Array]:
    """Return which position each sensor beside an axis follows, and by which polynomial.

    Number of the axis, shape (c,), and coefficients, shape (c, 6); `low` is the low end of each
    axis's stroke [m].
    """
    source, rows = [], []
    for number, axis in enumerate(axes):
        other = neighbour(axes, axis)
        for motion in MOTIONS:
            row = polynomial(guides[axis], motion, low[axis])
            at = number
            if motion == "across" and other is not None:
                # the platform moves across this axis as it moves along the other one
                at, row = axes.index(other), np.eye(TERMS)[1]
            source.append(at)
            rows.append(row)
    return np.array(source, dtype=np.int64), np.array(rows)


@compiled
def readings_beside(
    source: NDArray[np.int64],
    rows: Array,
    position: Array,
    drift: Array,
    noise: Array,
    gain: Array,
    step: Array,
    reading: Array,
) -> None:
    """Write what the sensors beside the axes read.

    `position` has the shape (axes, n); drift, noise and reading (axes + c, n) and gain and step
    (axes + c,), the sensors of the axes first: only the last c rows of the reading are written.
    """
    axes, n = position.shape
    for c in range(source.size):
        row, p, to = rows[c], position[source[c]], axes + c
        # the positions of the axes have their drift in them already
        own = 0.0 if row[1] == 1.0 else 1.0
        for k in range(n):
            x = p[k]
            value = row[5]
            for i in range(4, -1, -1):
                value = value * x + row[i]
            value = gain[to] * (value + own * drift[to, k]) + noise[to, k]
            if step[to] > 0.0:
                value = step[to] * np.round(value / step[to])
            reading[to, k] = value
