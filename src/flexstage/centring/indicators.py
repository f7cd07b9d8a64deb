"""Eccentricity and form of a scale's rim from indicators or microscopes that look at it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.first_order import Combined, Eccentricity, centre_from, combined
from flexstage.centring.geometry import exact_run_out
from flexstage.centring.harmonic_fit import Harmonic, HarmonicFit, scale_harmonic
from flexstage.centring.harmonics import fit_harmonics
from flexstage.errors import ModelError, RecordError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IndicatorReadings:
    """What an indicator or a microscope read on the rim, or a centring circle, over a turn."""

    angle: Array
    """Angle of the table [rad], shape (n,), wrapped or not."""
    displacement: Array
    """How far out the rim is, from any zero [m], shape (n,)."""
    indicator_angle: float = 0.0
    """Where the indicator stands in the room [rad], as heads do."""
    uncertainty: Array | None = None
    """Standard uncertainty of each sample against the others [m], shape (n,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunOut:
    """Eccentricity and form of a rim."""

    eccentricity: Eccentricity
    """Where the centre of the rim is."""
    form: tuple[Harmonic, ...]
    """How far out the rim is over the angle in the scale, from order 2 on, without what
    eccentricity adds [m]; order 2 is its ellipticity.
    """
    notes: tuple[str, ...]
    """What a reader should know."""


def run_out(
    readings: Sequence[IndicatorReadings] | IndicatorReadings,
    *,
    radius: float | None = None,
    orders: int | Sequence[int] | None = None,
    drift: bool | None = None,
    robust: bool = True,
) -> RunOut:
    """Find eccentricity and form of a rim from what indicators read over a turn.

    The once-per-turn harmonic is the eccentricity, exactly; with a radius, what the eccentricity of
    a round rim adds to the harmonics of order 2 and more is taken from the form. Two indicators
    that are not opposite tell a circular motion of the axis against the sense of turning.

    Parameters
    ----------
    readings : sequence of IndicatorReadings or IndicatorReadings
        Records of the indicators, at any angles.
    radius : float, optional
        Radius of the rim [m].
    orders : int or sequence of int, optional
        Highest harmonic, or all that are fitted; 1 must be among them.
    drift : bool, optional
        Whether to fit a drift; from about two turns on where not given.
    robust : bool
        Whether to look for outliers, and set them aside.

    Returns
    -------
    RunOut
        Eccentricity and form.

    Validity
    --------
    A circular motion of the axis that turns with the table looks the same as eccentricity. Motion
    of the axis of other orders counts as form, where there is one indicator. The rim's centre is
    not that of the lines unless both were made in one setting.

    Raises
    ------
    RecordError
        The readings of an indicator cannot be fitted; there are none.
    ModelError
        The radius is not positive, the axis would be outside the rim, or order 1 is not fitted.

    Examples
    --------
    >>> theta = np.arange(360) * np.pi / 180
    >>> pair = [
    ...     IndicatorReadings(
    ...         angle=theta,
    ...         displacement=exact_run_out(theta, (12e-6, 5e-6), 40e-3, indicator_angle=alpha),
    ...         indicator_angle=alpha,
    ...     )
    ...     for alpha in (0.3, 0.3 + np.pi / 2)
    ... ]
    >>> print(f"{1e6 * run_out(pair, radius=40e-3).eccentricity.amplitude.value:.3f} um")
    13.000 um
    """
    given = [readings] if isinstance(readings, IndicatorReadings) else list(readings)
    if not given:
        raise RecordError("a run-out needs the readings of one indicator or more, got none")
    if radius is not None and not 0.0 < radius < math.inf:
        raise ModelError(f"the radius of a rim must be positive and finite, got {radius!r} m")
    angles = np.array([r.indicator_angle for r in given])
    values = [np.asarray(r.displacement, dtype=np.float64) for r in given]
    fits, found = _fitted(given, values, angles, orders, drift, robust)
    if radius is not None:
        for r, y in zip(given, values, strict=True):
            if y.shape != np.shape(r.angle):
                raise RecordError(
                    f"an indicator must have one reading for each angle, got {y.size} readings"
                )
        e = found.vector
        beyond = [
            exact_run_out(r.angle, e, radius, indicator_angle=r.indicator_angle)
            - _first_order(r.angle, e, r.indicator_angle)
            for r in given
        ]
        less = [y - b for y, b in zip(values, beyond, strict=True)]
        fits, found = _fitted(given, less, angles, orders, drift, robust)
    centre = centre_from(found, fits, radius or 1.0, (0.0, 0.0, 0.0), radial=True)
    shared = sorted(set.intersection(*(set(f.orders) for f in fits)) - {1})
    return RunOut(
        eccentricity=centre,
        form=tuple(scale_harmonic(fits, angles, n) for n in shared),
        notes=tuple(dict.fromkeys((*centre.notes, *(note for f in fits for note in f.notes)))),
    )


def _first_order(angle: Array, e: Array, alpha: float) -> Array:
    beta = np.asarray(angle, dtype=np.float64) + alpha
    return e[0] * np.cos(beta) + e[1] * np.sin(beta)


def _fitted(
    given: Sequence[IndicatorReadings],
    values: Sequence[Array],
    angles: Array,
    orders: int | Sequence[int] | None,
    drift: bool | None,
    robust: bool,
) -> tuple[list[HarmonicFit], Combined]:
    fits = [
        fit_harmonics(
            r.angle,
            y,
            orders=orders,
            uncertainty=r.uncertainty,
            drift=drift,
            robust=robust,
            unit="m",
        )
        for r, y in zip(given, values, strict=True)
    ]
    if any(1 not in f.orders for f in fits):
        raise ModelError("order 1 must be among those fitted: it is what eccentricity shows in")
    first = np.asarray(given[0].angle, dtype=np.float64)
    together = all(r.uncertainty is None and np.array_equal(r.angle, first) for r in given)
    return fits, combined(fits, angles, first if together else None, radial=True)
