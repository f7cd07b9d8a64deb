"""Eccentricity of a scale from what heads err over a turn, or indicators on its rim."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.centring.geometry import (
    ScaleKind,
    beyond_first_order,
    exact_run_out,
    require_kind,
    require_radius,
)
from flexstage.centring.harmonic_fit import (
    MANY_TURNS,
    HarmonicFit,
    direction_estimate,
    length_estimate,
)
from flexstage.centring.harmonics import fit_harmonics, fit_many
from flexstage.centring.turns import find_turns
from flexstage.quantities.estimate import Component, Estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Combined:
    """Eccentricity and what else the once-per-turn harmonics hold."""

    vector: Array
    """Eccentricity, in the unit of the harmonics, shape (2,)."""
    covariance: Array
    """Of it, shape (2, 2)."""
    degrees_of_freedom: float
    """Of the covariance."""
    common: Estimate | None
    """Amplitude of what all share; None where it cannot be told."""
    counter_motion: Estimate | None
    """Radius of the motion of the axis against the sense of turning; None where it cannot be told.
    """
    notes: tuple[str, ...]
    """What a reader should know."""


def combined(
    fits: Sequence[HarmonicFit], angles: Array, table: Array | None, *, radial: bool = False
) -> Combined:
    """Combine the once-per-turn harmonics of heads or indicators by weighted least squares.

    They stand at `angles` in the room [rad]. `table` is the angle of the table at each sample [rad]
    where all were sampled together: what disturbs several at once is then told from what disturbs
    one. `radial` ones are indicators that look along the radius, not heads that read angles.
    """
    # chance of heads that differ as much, below which their noise does not explain it.
    chance = 0.005
    found = [f.harmonic(1) for f in fits]
    together = table is not None and len(fits) > 1
    c = np.array([p for h in found for p in (h.cosine.value, h.sine.value)])
    v = _covariance(fits, table)
    own, counter = _seen_by_heads(angles, radial)
    # all indicators at once move only with a rim that grows and shrinks, which none does
    common = np.tile(np.eye(2), (len(fits), 1))
    extra = {"counter": counter} if radial else {"common": common, "counter": counter}
    design, kept = _design(own, extra, v)
    weighted = _inverse(v)
    inverse = np.linalg.inv(design.T @ weighted @ design)
    estimator = inverse @ design.T @ weighted
    x, cov = estimator @ c, estimator @ v @ estimator.T
    freedom = _pooled_freedom(fits) if together else _least_freedom(fits, estimator, v)
    notes: list[str] = []
    free = c.size - x.size
    if free > 0:
        left = c - design @ x
        ratio = float(left @ weighted @ left) / free
        if _chance(ratio, free, freedom) < chance:
            cov, freedom = cov * ratio, float(free)
            notes.append(
                f"the heads differ by {math.sqrt(ratio):.1f} times what their noise explains: the "
                "uncertainty is larger by that; check their angles and that of the axis"
            )
    by_turns = all(f.noise == "turns" and f.with_all is None for f in fits)
    if table is not None and together and by_turns:
        cov, freedom = _by_turns(fits, table, estimator, cov, freedom)
    lengths = {
        name: length_estimate(
            x[i : i + 2], cov[i : i + 2, i : i + 2], fits[0].unit, degrees_of_freedom=freedom
        )
        for name, i in kept.items()
    }
    return Combined(
        vector=x[:2],
        covariance=cov[:2, :2],
        degrees_of_freedom=freedom,
        common=lengths.get("common"),
        counter_motion=lengths.get("counter"),
        notes=tuple(notes),
    )


def _seen_by_heads(angles: Array, radial: bool) -> tuple[Array, Array]:
    """Return cosine and sine that two motions in x and in y give each head, shape (2 m, 2) each.

    They are eccentricity, and a motion of the axis that turns, seen from the table, twice as fast
    forward.
    """
    c, s = np.cos(angles), np.sin(angles)
    # a head sees x sin(theta + alpha) - y cos(theta + alpha), an indicator the part along it
    own = [[c, s], [-s, c]] if radial else [[s, -c], [c, s]]
    counter = [[c, s], [s, -c]] if radial else [[s, -c], [-c, -s]]
    first, second = (np.moveaxis(np.array(rows), 2, 0).reshape(-1, 2) for rows in (own, counter))
    return first, second


def _design(own: Array, extra: dict[str, Array], v: Array) -> tuple[Array, dict[str, int]]:
    """Return the functions that the heads can tell apart, and where each begins."""
    # times that a part may make the eccentricity more uncertain before it is left out.
    most_growth = 3.0
    weighted = _inverse(v)
    base = _spread(own, weighted)
    design, kept = own, {}
    for name, block in extra.items():
        wider = np.hstack((design, block))
        if wider.shape[1] > wider.shape[0] or np.linalg.cond(wider) > 1e6:
            continue
        if _spread(wider, weighted) <= most_growth * base:
            kept[name] = design.shape[1]
            design = wider
    return design, kept


def _inverse(v: Array) -> Array:
    # heads that are disturbed together make it singular
    return np.asarray(np.linalg.pinv(v, hermitian=True), dtype=np.float64)


def _spread(design: Array, weighted: Array) -> float:
    return math.sqrt(float(np.trace(np.linalg.inv(design.T @ weighted @ design)[:2, :2])))


def _covariance(fits: Sequence[HarmonicFit], table: Array | None) -> Array:
    """Return the covariance of cosine and sine of all heads, shape (2 m, 2 m)."""
    m = len(fits)
    blocks = [f.harmonic(1).covariance for f in fits]
    if table is not None and m > 1 and all(f.residual_rms > 0.0 for f in fits):
        # how noise lasts is found better from all heads: by chance one would weigh too much
        pooled = np.mean([b / f.residual_rms**2 for b, f in zip(blocks, fits, strict=True)], axis=0)
        blocks = [f.residual_rms**2 * pooled for f in fits]
    shared = np.eye(m)
    if table is not None and m > 1:
        keep = np.ones(table.size, dtype=bool)
        for f in fits:
            keep[[o.index for o in f.outliers]] = False
        whole = bool(keep.all())
        left = np.stack([f.residual if whole else f.residual[keep] for f in fits])
        size = np.sqrt(np.einsum("ij,ij->i", left, left))
        if size.min() > 0.0:
            likeness = left @ left.T / np.outer(size, size)
            count = left.shape[1]
            limit = 4.0 / math.sqrt(count)
            apart = np.abs(likeness - np.diag(np.diag(likeness)))
            # of heads with noise of their own, likeness is chance and is left out
            shared = likeness if apart.max() > limit and count > 10 * m else shared
    roots = [_root(block) for block in blocks]
    out = np.zeros((2 * m, 2 * m))
    for i in range(m):
        for j in range(m):
            out[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = shared[i, j] * roots[i] @ roots[j].T
    # exact readings have no noise, and all weigh the same
    scale = float(np.trace(out)) / (2 * m)
    return out + (1e-9 * scale or np.finfo(float).tiny ** 0.5) * np.eye(2 * m)


def _pooled_freedom(fits: Sequence[HarmonicFit]) -> float:
    """Degrees of freedom of the mean of the relative variances of all heads."""
    found = [f.harmonic(1) for f in fits]
    relative = [
        float(np.trace(h.covariance)) / (f.residual_rms**2 or 1.0)
        for h, f in zip(found, fits, strict=True)
    ]
    return _satterthwaite(relative, [h.cosine.degrees_of_freedom for h in found])


def _least_freedom(fits: Sequence[HarmonicFit], estimator: Array, v: Array) -> float:
    """Degrees of freedom of what is combined, from the share that each head has in it."""
    shares = []
    for i in range(0, v.shape[0], 2):
        part = estimator[:2, i : i + 2]
        shares.append(float(np.trace(part @ v[i : i + 2, i : i + 2] @ part.T)))
    return _satterthwaite(shares, [f.harmonic(1).cosine.degrees_of_freedom for f in fits])


def _satterthwaite(variances: Sequence[float], freedoms: Sequence[float]) -> float:
    total = sum(variances)
    if total == 0.0:
        return min(freedoms)
    inverse = sum((s / total) ** 2 / n for s, n in zip(variances, freedoms, strict=True))
    # exact readings have no noise to know
    return 1.0 / inverse if inverse > 0.0 else math.inf


def _root(block: Array) -> Array:
    values, vectors = np.linalg.eigh(block)
    return vectors @ np.diag(np.sqrt(np.maximum(values, 0.0))) @ vectors.T


def _by_turns(
    fits: Sequence[HarmonicFit], table: Array, estimator: Array, cov: Array, freedom: float
) -> tuple[Array, float]:
    """Return the covariance that the scatter of single turns gives what is combined from heads."""
    turns = find_turns(table)
    starts = np.array(turns.bounds[:-1])
    if starts.size < MANY_TURNS:
        return cov, freedom
    waves = (np.cos(turns.angle), np.sin(turns.angle))
    parts = np.empty((starts.size, 2 * len(fits)))
    for j, f in enumerate(fits):
        left = f.residual.copy()
        left[[o.index for o in f.outliers]] = 0.0
        for i, wave in enumerate(waves):
            parts[:, 2 * j + i] = 2.0 / left.size * np.add.reduceat(left * wave, starts)
    pulls = parts @ estimator.T
    count = starts.size
    scatter = pulls.T @ pulls * count / (count - 1)
    grown = np.ones(cov.shape[0])
    for i in range(0, cov.shape[0], 2):
        own = np.trace(cov[i : i + 2, i : i + 2])
        grown[i : i + 2] = math.sqrt(np.trace(scatter[i : i + 2, i : i + 2]) / own)
    return cov * np.outer(grown, grown), 2.0 * (count - 1.0)


def _chance(ratio: float, free: int, freedom: float) -> float:
    from scipy.special import chdtrc, fdtrc

    if not math.isfinite(freedom):
        return float(chdtrc(free, ratio * free))
    return float(fdtrc(free, max(freedom, 1.0), ratio))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Eccentricity:
    """Where the centre of a scale is, in the frame that turns with the table."""

    x: Estimate
    """Its coordinate x [m]."""
    y: Estimate
    """Its coordinate y [m]."""
    amplitude: Estimate
    """Its distance from the axis [m]."""
    phase: Estimate
    """Its direction, from x towards y [rad]."""
    covariance: Array
    """Of x and y [m^2], shape (2, 2)."""
    radius: float
    """Radius at which the scale is read [m]."""
    common: Estimate | None
    """Amplitude of the once-per-turn error that all heads share, as of the reference [rad]; None
    where the heads cannot tell it from eccentricity.
    """
    counter_motion: Estimate | None
    """Radius of the once-per-turn motion of the axis against the sense of turning [m]; None where
    the heads cannot tell.
    """
    fits: tuple[HarmonicFit, ...]
    """Of each head, less what exact geometry adds to the first order."""
    notes: tuple[str, ...]
    """What a reader should know."""

    @property
    def vector(self) -> Array:
        """Coordinates x and y [m], shape (2,)."""
        return np.array([self.x.value, self.y.value])


def _centre_from(
    found: Combined,
    fits: Sequence[HarmonicFit],
    radius: float,
    given: tuple[float, float, float],
    *,
    radial: bool = False,
) -> Eccentricity:
    """Return the eccentricity that once-per-turn harmonics stand for.

    It is read at `radius` [m]. `given` are standard uncertainties: of the scale's once-per-turn
    error [rad], or of the rim's [m], of the radius [m], and of the angle of the heads [rad].
    Harmonics of indicators are `radial`, displacements [m] and not angles.
    """
    graduation, own_radius, turned = given
    factor = 1.0 if radial else radius
    v = factor * found.vector
    noise = factor**2 * found.covariance
    grid = factor * graduation
    length = math.hypot(v[0], v[1])
    # the run-out of a rim is the eccentricity, whatever its radius
    scale = 0.0 if radial else own_radius / radius

    def with_others(plain: Estimate, along: float, across: float, own: float) -> Estimate:
        others = (
            Component(name="graduation", uncertainty=own, kind="B"),
            Component(name="radius", uncertainty=abs(along), kind="B"),
            Component(name="head angle", uncertainty=abs(across), kind="B"),
        )
        return plain.plus(*(c for c in others if c.uncertainty > 0.0))

    parts = []
    for i in (0, 1):
        own = math.sqrt(noise[i, i])
        plain = Estimate.of(float(v[i]), own, "m", degrees_of_freedom=found.degrees_of_freedom)
        parts.append(with_others(plain, scale * v[i], turned * v[1 - i], grid))
    freedom = found.degrees_of_freedom
    amplitude = length_estimate(v, noise, "m", degrees_of_freedom=freedom)
    phase = direction_estimate(v, noise, degrees_of_freedom=freedom)
    swing = min(math.pi, grid / length) if length > 0.0 else 0.0
    across = np.array([-v[1], v[0]])
    return Eccentricity(
        x=parts[0],
        y=parts[1],
        amplitude=with_others(amplitude, scale * length, 0.0, grid),
        phase=with_others(phase, 0.0, turned, swing),
        covariance=noise
        + (grid) ** 2 * np.eye(2)
        + scale**2 * np.outer(v, v)
        + turned**2 * np.outer(across, across),
        radius=radius,
        common=found.common,
        counter_motion=None
        if found.counter_motion is None
        else replace(found.counter_motion.times(factor), unit="m"),
        fits=tuple(fits),
        notes=_notes(found, graduation, len(fits), radial),
    )


def _notes(found: Combined, graduation: float, heads: int, radial: bool) -> tuple[str, ...]:
    notes = list(found.notes)
    if radial:
        if found.counter_motion is None:
            notes.append(
                "a once-per-turn motion of the axis counts as eccentricity, with "
                + ("one indicator" if heads == 1 else "indicators at these angles")
            )
        return tuple(notes)
    if graduation == 0.0:
        notes.append(
            "a once-per-turn error of the scale's own graduation counts as eccentricity: heads "
            "cannot tell them apart"
        )
    if found.common is None:
        also = "one head" if heads == 1 else "heads at these angles"
        notes.append(f"a once-per-turn error of the reference counts as eccentricity, with {also}")
    return tuple(notes)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeadReadings:
    """What a head, or an indicator on the rim, read over a turn or several."""

    angle: Array
    """True angle of the table [rad], shape (n,), wrapped or not."""
    error: Array
    """Angle read less true angle [rad]; of an indicator, how far out the rim or a centring circle
    is, from any zero [m]; shape (n,).
    """
    head_angle: float = 0.0
    """Where the head stands in the room [rad]; see `flexstage.centring.geometry` for the sense."""
    name: str = ""
    """Name of its column."""
    file: str = ""
    """File that it is from."""


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
    heads = _listed(readings, "an eccentricity", "head", "error")
    require_radius(radius)
    require_kind(kind)
    given = (graduation_uncertainty, radius_uncertainty, head_angle_uncertainty)
    if not all(0.0 <= u < math.inf for u in given):
        raise ModelError(f"uncertainties must be 0 or more and finite, got {given}")
    # of a long record its beginning is enough to begin with
    short = _beginnings(heads)
    fits, found = _fitted(short, orders, robust)
    whole = short == heads
    e = radius * found.vector
    for _ in range(60):
        if not math.hypot(*e) < radius:
            raise ModelError(
                f"the readings would have the axis outside the scale, {math.hypot(*e):g} m from "
                f"its centre at a radius of {radius:g} m: check radius and units"
            )
        beyond = 0.5 * (math.hypot(*e) / radius) ** 2
        if whole and beyond <= 1e-3 * math.sqrt(float(np.trace(found.covariance))) + 1e-15:
            break
        fits, found = _fitted(_less_geometry(heads, complex(*e) / radius, kind), orders, robust)
        whole = True
        last, e = e, radius * found.vector
        known = radius * math.sqrt(float(np.trace(found.covariance)))
        # what is beyond the first order changes by this share of what the eccentricity does
        share = math.hypot(*e) / radius
        if share * math.hypot(*(e - last)) <= max(1e-14 * radius, 0.02 * known):
            break
    return _centre_from(found, fits, radius, given)


def _listed(
    readings: Sequence[HeadReadings] | HeadReadings, what: str, head: str, value: str
) -> list[HeadReadings]:
    """Return the readings of one head or more, each with a value for each angle."""
    heads = [readings] if isinstance(readings, HeadReadings) else list(readings)
    if not heads:
        raise RecordError(f"{what} needs the readings of one {head} or more, got none")
    for i, h in enumerate(heads):
        if h.angle.shape != h.error.shape or h.angle.ndim != 1:
            raise RecordError(
                f"{head} {i + 1} must have one {value} for each angle, got shapes {h.error.shape} "
                f"and {h.angle.shape}"
            )
    return heads


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
) -> list[HeadReadings]:
    """Return the readings without what exact geometry adds to the first order."""
    out = []
    angle, wave = None, np.empty(0, dtype=np.complex128)
    for h in heads:
        # heads that share their angles share their sines
        if h.angle is not angle:
            angle, wave = h.angle, np.exp(1j * h.angle)
        outward = wave * complex(math.cos(h.head_angle), math.sin(h.head_angle))
        out.append(replace(h, error=h.error - beyond_first_order(outward, relative, kind)))
    return out


def _fitted(
    heads: Sequence[HeadReadings],
    orders: int | Sequence[int] | None,
    robust: bool,
    *,
    radial: bool = False,
) -> tuple[list[HarmonicFit], Combined]:
    """Fit the harmonics of heads, or of indicators where `radial`, and combine those of order 1."""
    first, unit = heads[0].angle, "m" if radial else "rad"
    together = all(h.angle is first or np.array_equal(h.angle, first) for h in heads)
    # records of heads are long: one pass for all of them
    if together and not radial:
        columns = np.column_stack([h.error for h in heads])
        fits = list(fit_many(first, columns, orders=orders, robust=robust, unit=unit))
    else:
        fits = [
            fit_harmonics(h.angle, h.error, orders=orders, robust=robust, unit=unit) for h in heads
        ]
    if any(1 not in f.orders for f in fits):
        raise ModelError("order 1 must be among those fitted: it is what eccentricity shows in")
    stands = np.array([h.head_angle for h in heads])
    return fits, combined(fits, stands, first if together else None, radial=radial)


def run_out(
    readings: Sequence[HeadReadings] | HeadReadings,
    *,
    radius: float | None = None,
    orders: int | Sequence[int] | None = None,
    robust: bool = True,
) -> Eccentricity:
    """Find eccentricity and form of a rim from what indicators read over a turn.

    The once-per-turn harmonic is the eccentricity, exactly; with a radius, what the eccentricity of
    a round rim adds to the harmonics of order 2 and more is taken from the form. Two indicators
    that are not opposite tell a circular motion of the axis against the sense of turning.

    Parameters
    ----------
    readings : sequence of HeadReadings or HeadReadings
        Records of the indicators, at any angles.
    radius : float, optional
        Radius of the rim [m].
    orders : int or sequence of int, optional
        Highest harmonic, or all that are fitted; 1 must be among them.
    robust : bool
        Whether to look for outliers, and set them aside.

    Returns
    -------
    Eccentricity
        Where the centre of the rim is. Its fits hold the form, from order 2 on, without what
        eccentricity adds [m]; order 2 is ellipticity.

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
    ...     HeadReadings(
    ...         angle=theta,
    ...         error=exact_run_out(theta, (12e-6, 5e-6), 40e-3, indicator_angle=alpha),
    ...         head_angle=alpha,
    ...     )
    ...     for alpha in (0.3, 0.3 + np.pi / 2)
    ... ]
    >>> print(f"{1e6 * run_out(pair, radius=40e-3).amplitude.value:.3f} um")
    13.000 um
    """
    given = _listed(readings, "a run-out", "indicator", "reading")
    if radius is not None:
        require_radius(radius)
    fits, found = _fitted(given, orders, robust, radial=True)
    if radius is not None:
        less = []
        for r in given:
            exact = exact_run_out(r.angle, found.vector, radius, indicator_angle=r.head_angle)
            beta = r.angle + r.head_angle
            first = found.vector[0] * np.cos(beta) + found.vector[1] * np.sin(beta)
            less.append(replace(r, error=r.error - (exact - first)))
        fits, found = _fitted(less, orders, robust, radial=True)
    return _centre_from(found, fits, radius or 1.0, (0.0, 0.0, 0.0), radial=True)
