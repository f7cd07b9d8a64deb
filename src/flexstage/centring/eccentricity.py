"""Eccentricity of a scale from what reading heads err over a turn."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.first_order import Combined, Eccentricity, centre_from, combined
from flexstage.centring.geometry import ScaleKind, beyond_first_order, require_kind, require_radius
from flexstage.centring.harmonic_fit import HarmonicFit
from flexstage.centring.harmonics import fit_harmonics, fit_many
from flexstage.centring.turns import find_turns
from flexstage.errors import ModelError, RecordError

#: Times that the exact geometry is put in place of the first order.
_ROUNDS = 60
#: Samples from which a record is long.
_LONG = 20_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeadReadings:
    """What a head read over a turn or several, against a reference."""

    angle: Array
    """True angle of the table [rad], shape (n,), wrapped or not."""
    error: Array
    """Angle read less true angle [rad], shape (n,)."""
    head_angle: float = 0.0
    """Where the head stands in the room [rad]; see `flexstage.centring.geometry` for the sense."""
    uncertainty: Array | None = None
    """Standard uncertainty of each sample against the others [rad], shape (n,)."""
    name: str = ""
    """What the head is called."""


def eccentricity(
    readings: Sequence[HeadReadings] | HeadReadings,
    *,
    radius: float,
    kind: ScaleKind = "disc",
    orders: int | Sequence[int] | None = None,
    drift: bool | None = None,
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
    drift : bool, optional
        Whether to fit a drift; from about two turns on where not given.
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
    _require(heads, radius)
    require_kind(kind)
    given = (graduation_uncertainty, radius_uncertainty, head_angle_uncertainty)
    if not all(0.0 <= u < math.inf for u in given):
        raise ModelError(f"uncertainties must be 0 or more and finite, got {given}")
    alphas = np.array([h.head_angle for h in heads])
    # of a long record its beginning is enough to begin with
    short = _beginnings(heads)
    found = _fitted(short, [h.error for h in short], alphas, orders, drift, robust)
    whole = short == heads
    e = radius * found[1].vector
    for _ in range(_ROUNDS):
        if not math.hypot(*e) < radius:
            raise ModelError(
                f"the readings would have the axis outside the scale, {math.hypot(*e):g} m from "
                f"its centre at a radius of {radius:g} m: check radius and units"
            )
        beyond = 0.5 * (math.hypot(*e) / radius) ** 2
        if whole and beyond <= 1e-3 * math.sqrt(float(np.trace(found[1].covariance))) + 1e-15:
            break
        less = _less_geometry(heads, complex(*e) / radius, kind)
        found = _fitted(heads, less, alphas, orders, drift, robust)
        whole = True
        last, e = e, radius * found[1].vector
        known = radius * math.sqrt(float(np.trace(found[1].covariance)))
        # what is beyond the first order changes by this share of what the eccentricity does
        share = math.hypot(*e) / radius
        if share * math.hypot(*(e - last)) <= max(1e-14 * radius, 0.02 * known):
            break
    return centre_from(found[1], found[0], radius, given)


def _require(heads: Sequence[HeadReadings], radius: float) -> None:
    if not heads:
        raise RecordError("an eccentricity needs the readings of one head or more, got none")
    require_radius(radius)
    for i, head in enumerate(heads):
        if head.angle.shape != head.error.shape or head.angle.ndim != 1:
            raise RecordError(
                f"head {i + 1} must have one error for each angle, got shapes {head.error.shape} "
                f"and {head.angle.shape}"
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
        out.append(
            h
            if last == 0
            else HeadReadings(
                angle=h.angle[part],
                error=h.error[part],
                head_angle=h.head_angle,
                uncertainty=None if h.uncertainty is None else h.uncertainty[part],
                name=h.name,
            )
        )
    return out


def _second_turn(angle: Array) -> int:
    """Return how many samples the first two turns have; 0 where there is no need to know."""
    if angle.size < _LONG:
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
    heads: Sequence[HeadReadings],
    errors: Sequence[Array],
    alphas: Array,
    orders: int | Sequence[int] | None,
    drift: bool | None,
    robust: bool,
) -> tuple[list[HarmonicFit], Combined]:
    first = heads[0]
    together = all(
        h.uncertainty is None and (h.angle is first.angle or np.array_equal(h.angle, first.angle))
        for h in heads
    )
    if together:
        fits = list(
            fit_many(
                first.angle, np.column_stack(errors), orders=orders, drift=drift, robust=robust
            )
        )
    else:
        fits = [
            fit_harmonics(
                h.angle, y, orders=orders, uncertainty=h.uncertainty, drift=drift, robust=robust
            )
            for h, y in zip(heads, errors, strict=True)
        ]
    if any(1 not in f.orders for f in fits):
        raise ModelError("order 1 must be among those fitted: it is what eccentricity shows in")
    return fits, combined(fits, alphas, first.angle if together else None)
