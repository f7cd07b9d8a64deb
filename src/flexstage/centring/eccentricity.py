"""Eccentricity of a scale from what reading heads err over a turn, or indicators on its rim."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.first_order import Combined, Eccentricity, centre_from, combined
from flexstage.centring.geometry import (
    ScaleKind,
    beyond_first_order,
    exact_run_out,
    require_kind,
    require_radius,
)
from flexstage.centring.harmonic_fit import Harmonic, HarmonicFit, scale_harmonic
from flexstage.centring.harmonics import fit_harmonics, fit_many
from flexstage.centring.turns import find_turns
from flexstage.errors import ModelError, RecordError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeadReadings:
    """What a head read over a turn or several, against a reference."""

    angle: Array
    """True angle of the table [rad], shape (n,), wrapped or not."""
    error: Array
    """Angle read less true angle [rad], shape (n,)."""
    head_angle: float = 0.0
    """Where the head stands in the room [rad]; see `flexstage.centring.geometry` for the sense."""


def eccentricity(
    readings: Sequence[HeadReadings] | HeadReadings,
    *,
    radius: float,
    kind: ScaleKind = "disc",
    orders: int | Sequence[int] | None = None,
    robust: bool = True,
    graduation_uncertainty: float = 0.0,
    radius_uncertainty: float = 0.0,
    head_angle_uncertainty: float = 0.0,
) -> Eccentricity:
    """Find the eccentricity of a scale from the errors of its heads.

    The once-per-turn harmonic of each head, fitted beside others, gives the eccentricity to first
    order, by weighted least squares over the heads; what exact geometry adds to that is then taken
    from the readings, and the fit repeated until it stays (Gauss and Newton, with the slope of the
    first order). From two heads at different angles
    on, an error that all of them share is told from eccentricity, and from three on a circular
    motion of the axis against the sense of turning.

    Parameters
    ----------
    readings : sequence of HeadReadings or HeadReadings
        Records of the heads, at any angles.
    radius : float
        Of a disc, the distance of the heads from the axis; of a drum, the radius of its rim [m].
    kind : {"disc", "drum"}
        Radial lines on a face, or lines along the axis on a rim.
    orders : int or sequence of int, optional
        Highest harmonic, or all that are fitted; 1 must be among them. 1 to 12 if not given, or
        fewer as samples allow.
    robust : bool
        Whether to look for outliers, and set them aside.
    graduation_uncertainty : float
        Standard uncertainty of the scale's own once-per-turn error, of its cosine and of its sine
        [rad].
    radius_uncertainty : float
        Standard uncertainty of the radius [m].
    head_angle_uncertainty : float
        Standard uncertainty of where the heads stand, all turned together [rad].

    Returns
    -------
    Eccentricity
        The eccentricity, with uncertainty.

    Validity
    --------
    A once-per-turn error of the scale's own graduation looks the same in all heads as eccentricity,
    and so does a circular motion of the axis that turns with the table: no number of heads tells
    them apart, and a move that makes the sum vanish takes the errors away all the same. One head
    cannot tell a once-per-turn error of the reference either. Axis motion that a stage cannot
    follow, and harmonics beyond those fitted, count as noise.

    Raises
    ------
    RecordError
        The readings of a head cannot be fitted; there are none.
    ModelError
        The radius is not positive, the axis would be outside the scale, or order 1 is not fitted.

    Examples
    --------
    >>> from flexstage.centring import exact_error
    >>> theta = np.arange(720) * np.pi / 360
    >>> rng = np.random.default_rng(4)
    >>> heads = [
    ...     HeadReadings(
    ...         angle=theta,
    ...         error=exact_error(theta, (40e-6, -30e-6), 50e-3, head_angle=alpha)
    ...         + rng.normal(0.0, 5e-6, theta.size),
    ...         head_angle=alpha,
    ...     )
    ...     for alpha in (0.2, 1.7, 3.5, 4.6)
    ... ]
    >>> found = eccentricity(heads, radius=50e-3)
    >>> e = found.amplitude
    >>> print(f"{1e6 * e.value:.3f} +- {1e6 * e.expanded:.3f} um")
    50.001 +- 0.013 um
    """
    heads = [readings] if isinstance(readings, HeadReadings) else list(readings)
    if not heads:
        raise RecordError("an eccentricity needs the readings of one head or more, got none")
    require_radius(radius)
    _require_alike([(h.angle, h.error) for h in heads], "head", "error")
    require_kind(kind)
    given = (graduation_uncertainty, radius_uncertainty, head_angle_uncertainty)
    if not all(0.0 <= u < math.inf for u in given):
        raise ModelError(f"uncertainties must be 0 or more and finite, got {given}")
    alphas = np.array([h.head_angle for h in heads])
    # of a long record its beginning is enough to begin with
    short = _beginnings(heads)
    found = _fitted([h.angle for h in short], [h.error for h in short], alphas, orders, robust)
    whole = short == heads
    e = radius * found[1].vector
    for _ in range(60):
        if not math.hypot(*e) < radius:
            raise ModelError(
                f"the readings would have the axis outside the scale, {math.hypot(*e):g} m from "
                f"its centre at a radius of {radius:g} m: check radius and units"
            )
        beyond = 0.5 * (math.hypot(*e) / radius) ** 2
        if whole and beyond <= 1e-3 * math.sqrt(float(np.trace(found[1].covariance))) + 1e-15:
            break
        less = _less_geometry(heads, complex(*e) / radius, kind)
        found = _fitted([h.angle for h in heads], less, alphas, orders, robust)
        whole = True
        last, e = e, radius * found[1].vector
        known = radius * math.sqrt(float(np.trace(found[1].covariance)))
        # what is beyond the first order changes by this share of what the eccentricity does
        share = math.hypot(*e) / radius
        if share * math.hypot(*(e - last)) <= max(1e-14 * radius, 0.02 * known):
            break
    return centre_from(found[1], found[0], radius, given)


def _require_alike(columns: Sequence[tuple[Array, Array]], what: str, value: str) -> None:
    for i, (angle, values) in enumerate(columns):
        if angle.shape != values.shape or angle.ndim != 1:
            raise RecordError(
                f"{what} {i + 1} must have one {value} for each angle, got shapes {values.shape} "
                f"and {angle.shape}"
            )


def _beginnings(heads: Sequence[HeadReadings]) -> list[HeadReadings]:
    """Return about the first two turns of long records; short ones as they are."""
    out = []
    angle, last = None, 0
    for h in heads:
        # heads that share their angles share their turns
        if h.angle is not angle:
            angle, last = h.angle, _second_turn(h.angle)
        part = slice(0, last)
        out.append(h if last == 0 else replace(h, angle=h.angle[part], error=h.error[part]))
    return out


def _second_turn(angle: Array) -> int:
    """Return how many samples the first two turns have; 0 where there is no need to know."""
    if angle.size < 20_000:
        return 0
    turns = find_turns(angle)
    return turns.bounds[2] if turns.direction != 0 and len(turns.bounds) > 3 else 0


def _less_geometry(
    heads: Sequence[HeadReadings], relative: complex, kind: ScaleKind
) -> list[Array]:
    """Return the errors without what exact geometry adds to the first order."""
    out = []
    angle, wave = None, np.empty(0, dtype=np.complex128)
    for h in heads:
        # heads that share their angles share their sines
        if h.angle is not angle:
            angle, wave = h.angle, np.exp(1j * h.angle)
        outward = wave * complex(math.cos(h.head_angle), math.sin(h.head_angle))
        out.append(h.error - beyond_first_order(outward, relative, kind))
    return out


def _fitted(
    angles: Sequence[Array],
    values: Sequence[Array],
    stands: Array,
    orders: int | Sequence[int] | None,
    robust: bool,
    *,
    radial: bool = False,
) -> tuple[list[HarmonicFit], Combined]:
    """Fit the harmonics of heads, or of indicators where `radial`, and combine those of order 1."""
    first, unit = angles[0], "m" if radial else "rad"
    together = all(a is first or np.array_equal(a, first) for a in angles)
    # records of heads are long: one pass for all of them
    if together and not radial:
        fits = list(
            fit_many(first, np.column_stack(values), orders=orders, robust=robust, unit=unit)
        )
    else:
        fits = [
            fit_harmonics(a, y, orders=orders, robust=robust, unit=unit)
            for a, y in zip(angles, values, strict=True)
        ]
    if any(1 not in f.orders for f in fits):
        raise ModelError("order 1 must be among those fitted: it is what eccentricity shows in")
    return fits, combined(fits, stands, first if together else None, radial=radial)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IndicatorReadings:
    """What an indicator or a microscope read on the rim, or a centring circle, over a turn."""

    angle: Array
    """Angle of the table [rad], shape (n,), wrapped or not."""
    displacement: Array
    """How far out the rim is, from any zero [m], shape (n,)."""
    indicator_angle: float = 0.0
    """Where the indicator stands in the room [rad], as heads do."""


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
    if radius is not None:
        require_radius(radius)
    _require_alike([(r.angle, r.displacement) for r in given], "indicator", "reading")
    stands = np.array([r.indicator_angle for r in given])
    angles = [r.angle for r in given]
    values = [r.displacement for r in given]
    fits, found = _fitted(angles, values, stands, orders, robust, radial=True)
    if radius is not None:
        beyond = [
            exact_run_out(r.angle, found.vector, radius, indicator_angle=r.indicator_angle)
            - _first_order(r.angle, found.vector, r.indicator_angle)
            for r in given
        ]
        less = [y - b for y, b in zip(values, beyond, strict=True)]
        fits, found = _fitted(angles, less, stands, orders, robust, radial=True)
    centre = centre_from(found, fits, radius or 1.0, (0.0, 0.0, 0.0), radial=True)
    shared = sorted(set.intersection(*(set(f.orders) for f in fits)) - {1})
    return RunOut(
        eccentricity=centre,
        form=tuple(scale_harmonic(fits, stands, n) for n in shared),
        notes=tuple(dict.fromkeys((*centre.notes, *(note for f in fits for note in f.notes)))),
    )


def _first_order(angle: Array, e: Array, alpha: float) -> Array:
    beta = np.asarray(angle, dtype=np.float64) + alpha
    return e[0] * np.cos(beta) + e[1] * np.sin(beta)
