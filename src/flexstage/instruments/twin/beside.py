"""Motions beside an axis as polynomials of the position, so that a loop can follow them."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexstage.experiment.virtual import MOTIONS, GuideErrors
from flexstage.hysteresis.compiled import compiled
from flexstage.instruments.twin.device import ChannelDescription

__all__ = ["beside_channels", "kinds_of", "neighbour", "polynomial", "readings_beside", "sources"]

Array = NDArray[np.float64]

#: Coefficients of a polynomial: those of the curves of guides, of order 5.
TERMS = 6
_ANGLES = ("roll", "pitch", "yaw")


def polynomial(guide: GuideErrors, motion: str, low: float) -> Array:
    """Return a curve of a guide as a polynomial of the position from where the stage is relaxed.

    Parameters
    ----------
    guide : GuideErrors
        Errors of the guide over its stroke.
    motion : str
        One of its motions, or ``along``.
    low : float
        Position of the low end of the stroke [m].

    Returns
    -------
    numpy.ndarray
        Coefficients from the constant up, which is such that the motion is zero where the stage is
        relaxed, shape (6,).

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
    """Return the axis whose direction is across another one; None where there is no other.

    Parameters
    ----------
    axes : sequence of str
        All axes.
    axis : str
        One of them.

    Returns
    -------
    str or None
        The first of the others.
    """
    return next((name for name in axes if name != axis), None)


def beside_channels(axes: Sequence[str]) -> tuple[ChannelDescription, ...]:
    """Return the sensors of a stage: those of the axes, then those beside each of them.

    Parameters
    ----------
    axes : sequence of str
        Names of the axes.

    Returns
    -------
    tuple of ChannelDescription
        The sensors, numbered from 1.
    """
    names = [(axis, "m") for axis in axes]
    names += [(f"{a}.{m}", "rad" if m in _ANGLES else "m") for a in axes for m in MOTIONS]
    return tuple(
        ChannelDescription(number=i, name=name, unit=unit)
        for i, (name, unit) in enumerate(names, start=1)
    )


def kinds_of(channels: Sequence[ChannelDescription]) -> list[str]:
    """Return the kind of sensor of each channel.

    Parameters
    ----------
    channels : sequence of ChannelDescription
        The sensors.

    Returns
    -------
    list of str
        ``along``, ``beside`` or ``angle``.
    """
    return [
        "angle" if c.unit == "rad" else ("beside" if "." in c.name else "along") for c in channels
    ]


def sources(
    axes: Sequence[str], guides: Mapping[str, GuideErrors], low: Mapping[str, float]
) -> tuple[NDArray[np.int64], Array]:
    """Return which position each sensor beside an axis follows, and by which polynomial.

    Parameters
    ----------
    axes : sequence of str
        Names of the axes.
    guides : Mapping
        Errors of the guide of each axis.
    low : Mapping
        Low end of each axis's stroke [m].

    Returns
    -------
    tuple of numpy.ndarray
        Number of the axis, shape (c,), and coefficients, shape (c, 6).
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

    Parameters
    ----------
    source : numpy.ndarray
        Axis that each of them follows, shape (c,).
    rows : numpy.ndarray
        Polynomials of its position, shape (c, 6).
    position : numpy.ndarray
        Positions [m], shape (axes, n).
    drift : numpy.ndarray
        Motion by temperature of all sensors, those of the axes first, shape (axes + c, n).
    noise : numpy.ndarray
        What the sensors add, shape (axes + c, n).
    gain : numpy.ndarray
        Reading over motion [1], shape (axes + c,).
    step : numpy.ndarray
        Smallest steps, shape (axes + c,).
    reading : numpy.ndarray
        Readings, shape (axes + c, n); the last c rows are written.
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
