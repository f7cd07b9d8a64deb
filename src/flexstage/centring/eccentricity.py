"""Eccentricity of a scale from the errors of its heads over a turn, or from indicators."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

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
    satterthwaite,
)
from flexstage.centring.harmonics import fit_harmonics, fit_many
from flexstage.centring.least_squares import Noise, densities, noise_amplitudes
from flexstage.centring.turns import find_turns
from flexstage.quantities.estimate import Component, Estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EccentricityEstimate:
    """Eccentricity and other parts of the once-per-turn harmonics."""

    vector: Array
    """Eccentricity, in the unit of the harmonics, shape (2,)."""
    covariance: Array
    """Covariance of the vector, shape (2, 2)."""
    degrees_of_freedom: float
    """Degrees of freedom of the covariance."""
    common: Estimate | None
    """Amplitude of the part common to all heads; None if it cannot be separated."""
    counter_motion: Estimate | None
    """Radius of the axis motion against the sense of rotation; None if it cannot be separated."""
    notes: tuple[str, ...]
    """Remarks on the result."""


def combine_heads(
    fits: Sequence[HarmonicFit], angles: Array, table: Array | None, *, radial: bool = False
) -> EccentricityEstimate:
    """Combine the once-per-turn harmonics of heads or indicators by weighted least squares.

    `angles` are those of the heads in the room [rad]. `table` is the angle of the table at each
    sample [rad] if all were sampled together: disturbances of several heads are then separated from
    those of one. `radial` ones are indicators along the radius, not heads that read angles.
    """
    # probability of the differences of heads below which their noise does not explain them
    chance = 0.005
    harmonics = [f.harmonic(1) for f in fits]
    together = table is not None and len(fits) > 1
    c = np.array([p for h in harmonics for p in (h.cosine.value, h.sine.value)])
    v = _covariance(fits, table)
    eccentric, counter = _head_functions(angles, radial)
    # all indicators move together only if the rim grows and shrinks, which it does not
    common = np.tile(np.eye(2), (len(fits), 1))
    extra = {"counter": counter} if radial else {"common": common, "counter": counter}
    design, columns = _design(eccentric, extra, v)
    weighted = _inverse(v)
    inverse = np.linalg.inv(design.T @ weighted @ design)
    estimator = inverse @ design.T @ weighted
    x, cov = estimator @ c, estimator @ v @ estimator.T
    spectra = _spectra(fits, table)
    if spectra:
        freedom = float(densities(spectra, _FIRST)[1][0])
    else:
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
                "uncertainty is increased by this factor; check the angles of heads and table"
            )
    by_turns = all(f.noise == "turns" and f.with_all is None for f in fits)
    if table is not None and together and by_turns:
        cov, freedom = _by_turns(fits, table, estimator, cov, freedom)
    lengths = {
        name: length_estimate(
            x[i : i + 2], cov[i : i + 2, i : i + 2], fits[0].unit, degrees_of_freedom=freedom
        )
        for name, i in columns.items()
    }
    return EccentricityEstimate(
        vector=x[:2],
        covariance=cov[:2, :2],
        degrees_of_freedom=freedom,
        common=lengths.get("common"),
        counter_motion=lengths.get("counter"),
        notes=tuple(notes),
    )


def _head_functions(angles: Array, radial: bool) -> tuple[Array, Array]:
    """Return cosine and sine of each head for two motions in x and in y, shape (2 m, 2) each.

    They are eccentricity, and a motion of the axis against the sense of rotation.
    """
    c, s = np.cos(angles), np.sin(angles)
    # a head reads x sin(theta + alpha) - y cos(theta + alpha), an indicator the part along it
    eccentric = [[c, s], [-s, c]] if radial else [[s, -c], [c, s]]
    counter = [[c, s], [s, -c]] if radial else [[s, -c], [-c, -s]]
    first, second = (
        np.moveaxis(np.array(rows), 2, 0).reshape(-1, 2) for rows in (eccentric, counter)
    )
    return first, second


def _design(eccentric: Array, extra: dict[str, Array], v: Array) -> tuple[Array, dict[str, int]]:
    """Return the functions that the heads can separate, and the first column of each."""
    # factor by which a part may increase the uncertainty of eccentricity before it is omitted
    most_growth = 3.0
    weighted = _inverse(v)
    base = _spread(eccentric, weighted)
    design, columns = eccentric, {}
    for name, block in extra.items():
        wider = np.hstack((design, block))
        if wider.shape[1] > wider.shape[0] or np.linalg.cond(wider) > 1e6:
            continue
        if _spread(wider, weighted) <= most_growth * base:
            columns[name] = design.shape[1]
            design = wider
    return design, columns


def _inverse(v: Array) -> Array:
    # a common disturbance of the heads makes it singular
    return np.asarray(np.linalg.pinv(v, hermitian=True), dtype=np.float64)


def _spread(design: Array, weighted: Array) -> float:
    return math.sqrt(float(np.trace(np.linalg.inv(design.T @ weighted @ design)[:2, :2])))


def _covariance(fits: Sequence[HarmonicFit], table: Array | None) -> Array:
    """Return the covariance of cosine and sine of all heads, shape (2 m, 2 m)."""
    m = len(fits)
    blocks = [f.harmonic(1).covariance for f in fits]
    spectra = _spectra(fits, table)
    if spectra:
        one = [densities([n], _FIRST)[0][0][0] for n in spectra]
        together = [d[0] for d in densities(spectra, _FIRST)[0]]
        blocks = [b * t / o for b, t, o in zip(blocks, together, one, strict=True)]
    elif table is not None and m > 1 and all(f.noise_rms > 0.0 for f in fits):
        # all heads together show the correlation of noise best: by chance one would weigh too much
        pooled = np.mean([b / f.noise_rms**2 for b, f in zip(blocks, fits, strict=True)], axis=0)
        blocks = [f.noise_rms**2 * pooled for f in fits]
    shared = np.eye(m)
    if table is not None and m > 1:
        parts, least = _residual_parts(fits, table)
        size = np.sqrt(np.einsum("ij,ij->i", parts, parts))
        if size.min() > 0.0:
            correlation = parts @ parts.T / np.outer(size, size)
            count = parts.shape[1]
            limit = 4.0 / math.sqrt(count)
            mutual = np.abs(correlation - np.diag(np.diag(correlation)))
            # the correlation of heads with independent noise is chance and is ignored
            shared = correlation if mutual.max() > limit and count > least else shared
    roots = [_root(block) for block in blocks]
    out = np.zeros((2 * m, 2 * m))
    for i in range(m):
        for j in range(m):
            out[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = shared[i, j] * roots[i] @ roots[j].T
    # exact readings have no noise, and equal weights
    scale = float(np.trace(out)) / (2 * m)
    return out + (1e-9 * scale or np.finfo(float).tiny ** 0.5) * np.eye(2 * m)


#: Frequency of order 1 [cycles per turn].
_FIRST = np.ones(1)


def _spectra(fits: Sequence[HarmonicFit], table: Array | None) -> list[Noise]:
    """Return the spectra of the noise of heads that were sampled together in one turn."""
    spectra = [f.spectra for f in fits if f.spectra is not None]
    return spectra if table is not None and 1 < len(fits) == len(spectra) else []


def _residual_parts(fits: Sequence[HarmonicFit], table: Array) -> tuple[Array, int]:
    """Return what shows the correlation of heads, shape (heads, k), and the least k for that."""
    spectra = _spectra(fits, table)
    if spectra:
        # in one turn errors of the scale look like noise, except at the orders about the first
        near = noise_amplitudes(spectra)
        return np.hstack((near.real, near.imag)), 16
    residuals, turns = np.stack([f.residual for f in fits]), find_turns(table)
    for f in fits:
        residuals[:, [o.index for o in f.outliers]] = 0.0
    if 1 < turns.full < MANY_TURNS:
        # errors of the scale repeat in every turn: noise is what lies between their frequencies
        part = np.fft.rfft(residuals[:, : round(turns.full / turns.count * table.size)])
        part = part[:, np.arange(part.shape[1]) % turns.full > 0]
        residuals = np.hstack((part.real, part.imag))
    return residuals, 10 * len(fits)


def _pooled_freedom(fits: Sequence[HarmonicFit]) -> float:
    """Degrees of freedom of the mean of the relative variances of all heads."""
    harmonics = [f.harmonic(1) for f in fits]
    relative = [
        float(np.trace(h.covariance)) / (f.noise_rms**2 or 1.0)
        for h, f in zip(harmonics, fits, strict=True)
    ]
    return satterthwaite(relative, [h.cosine.degrees_of_freedom for h in harmonics])


def _least_freedom(fits: Sequence[HarmonicFit], estimator: Array, v: Array) -> float:
    """Degrees of freedom of the combination, from the share of each head in it."""
    shares = []
    for i in range(0, v.shape[0], 2):
        part = estimator[:2, i : i + 2]
        shares.append(float(np.trace(part @ v[i : i + 2, i : i + 2] @ part.T)))
    return satterthwaite(shares, [f.harmonic(1).cosine.degrees_of_freedom for f in fits])


def _root(block: Array) -> Array:
    values, vectors = np.linalg.eigh(block)
    return vectors @ np.diag(np.sqrt(np.maximum(values, 0.0))) @ vectors.T


def _by_turns(
    fits: Sequence[HarmonicFit], table: Array, estimator: Array, cov: Array, freedom: float
) -> tuple[Array, float]:
    """Return the covariance of the combined heads from the scatter of single turns."""
    turns = find_turns(table)
    starts = np.array(turns.bounds[:-1])
    if starts.size < MANY_TURNS:
        return cov, freedom
    waves = (np.cos(turns.angle), np.sin(turns.angle))
    parts = np.empty((starts.size, 2 * len(fits)))
    for j, f in enumerate(fits):
        residual = f.residual.copy()
        residual[[o.index for o in f.outliers]] = 0.0
        for i, wave in enumerate(waves):
            parts[:, 2 * j + i] = 2.0 / residual.size * np.add.reduceat(residual * wave, starts)
    deviations = parts @ estimator.T
    count = starts.size
    scatter = deviations.T @ deviations * count / (count - 1)
    factors = np.ones(cov.shape[0])
    for i in range(0, cov.shape[0], 2):
        variance = np.trace(cov[i : i + 2, i : i + 2])
        factors[i : i + 2] = math.sqrt(np.trace(scatter[i : i + 2, i : i + 2]) / variance)
    return cov * np.outer(factors, factors), 2.0 * (count - 1.0)


def _chance(ratio: float, free: int, freedom: float) -> float:
    from scipy.special import chdtrc, fdtrc

    if not math.isfinite(freedom):
        return float(chdtrc(free, ratio * free))
    return float(fdtrc(free, max(freedom, 1.0), ratio))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Eccentricity:
    """Centre of a scale, in the frame that turns with the table."""

    x: Estimate
    """Coordinate x of the centre [m]."""
    y: Estimate
    """Coordinate y of the centre [m]."""
    amplitude: Estimate
    """Distance of the centre from the axis [m]."""
    phase: Estimate
    """Direction of the centre, from x towards y [rad]."""
    covariance: Array
    """Covariance of x and y [m^2], shape (2, 2)."""
    radius: float
    """Radius at which the scale is read [m]."""
    common: Estimate | None
    """Amplitude of the once-per-turn error common to all heads, as of the reference [rad]; None if
    the heads cannot separate it from eccentricity.
    """
    counter_motion: Estimate | None
    """Radius of the once-per-turn motion of the axis against the sense of rotation [m]; None if the
    heads cannot separate it.
    """
    fits: tuple[HarmonicFit, ...]
    """Fit of each head, without the terms that exact geometry adds to the first order."""
    notes: tuple[str, ...]
    """Remarks on the result."""

    @property
    def vector(self) -> Array:
        """Coordinates x and y [m], shape (2,)."""
        return np.array([self.x.value, self.y.value])


def _centre_from(
    estimate: EccentricityEstimate,
    fits: Sequence[HarmonicFit],
    radius: float,
    uncertainties: tuple[float, float, float],
    *,
    radial: bool = False,
) -> Eccentricity:
    """Return the eccentricity that follows from the once-per-turn harmonics.

    It is read at `radius` [m]. `uncertainties` are standard uncertainties: of the scale's
    once-per-turn error [rad], or of the rim's [m], of the radius [m], and of the angle of the heads
    [rad]. Harmonics of indicators are `radial`, displacements [m] and not angles.
    """
    graduation, u_radius, u_heads = uncertainties
    factor = 1.0 if radial else radius
    v = factor * estimate.vector
    noise = factor**2 * estimate.covariance
    grid = factor * graduation
    length = math.hypot(v[0], v[1])
    # the run-out of a rim is the eccentricity, whatever its radius
    scale = 0.0 if radial else u_radius / radius

    def with_type_b(plain: Estimate, along: float, across: float, lines: float) -> Estimate:
        others = (
            Component(name="graduation", uncertainty=lines, kind="B"),
            Component(name="radius", uncertainty=abs(along), kind="B"),
            Component(name="head angle", uncertainty=abs(across), kind="B"),
        )
        return plain.plus(*(c for c in others if c.uncertainty > 0.0))

    parts = []
    for i in (0, 1):
        u = math.sqrt(noise[i, i])
        plain = Estimate.of(float(v[i]), u, "m", degrees_of_freedom=estimate.degrees_of_freedom)
        parts.append(with_type_b(plain, scale * v[i], u_heads * v[1 - i], grid))
    freedom = estimate.degrees_of_freedom
    amplitude = length_estimate(v, noise, "m", degrees_of_freedom=freedom)
    phase = direction_estimate(v, noise, degrees_of_freedom=freedom)
    swing = min(math.pi, grid / length) if length > 0.0 else 0.0
    across = np.array([-v[1], v[0]])
    return Eccentricity(
        x=parts[0],
        y=parts[1],
        amplitude=with_type_b(amplitude, scale * length, 0.0, grid),
        phase=with_type_b(phase, 0.0, u_heads, swing),
        covariance=noise
        + (grid) ** 2 * np.eye(2)
        + scale**2 * np.outer(v, v)
        + u_heads**2 * np.outer(across, across),
        radius=radius,
        common=estimate.common,
        counter_motion=None
        if estimate.counter_motion is None
        else replace(estimate.counter_motion.times(factor), unit="m"),
        fits=tuple(fits),
        notes=_notes(estimate, graduation, len(fits), radial),
    )


def _notes(
    estimate: EccentricityEstimate, graduation: float, heads: int, radial: bool
) -> tuple[str, ...]:
    notes = list(estimate.notes)
    if radial:
        if estimate.counter_motion is None:
            notes.append(
                ("one indicator" if heads == 1 else "indicators at these angles")
                + " cannot separate once-per-turn motion of the axis from eccentricity"
            )
        return tuple(notes)
    if graduation == 0.0:
        notes.append(
            "the result includes the once-per-turn graduation error of the scale: heads cannot "
            "separate it from eccentricity"
        )
    if estimate.common is None:
        which = "one head" if heads == 1 else "heads at these angles"
        notes.append(
            f"{which} cannot separate a once-per-turn error of the reference from eccentricity"
        )
    return tuple(notes)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeadReadings:
    """Readings of a head, or of an indicator on the rim, over a turn or several."""

    angle: Array
    """True angle of the table [rad], shape (n,), wrapped or not."""
    error: Array
    """Angle reading minus true angle [rad]; for an indicator, the radial position of the rim or a
    centring circle, from any zero [m]; shape (n,).
    """
    head_angle: float = 0.0
    """Angle of the head in the room [rad]; see `flexstage.centring.geometry` for the sense."""
    name: str = ""
    """Name of the column."""
    file: str = ""
    """Source file."""
    step: float = 0.0
    """Step of a code [rad]; 0 if the readings are no codes."""
    resolution: float | None = None
    """Step of the readings, in their unit; None if it follows from the readings."""

    @property
    def least_outlier(self) -> float:
        """Deviation up to which a reading next to codes that are never read is no outlier."""
        return _CODES * self.step


#: Steps of a code by which a reading may deviate next to codes that are never read.
_CODES = 8.0


def with_resolution(heads: Sequence[HeadReadings]) -> list[HeadReadings]:
    """Return readings with their resolution; rounding can leave no residual that shows it."""
    return [
        h if h.resolution is not None else replace(h, resolution=max(h.step, common_step(h.error)))
        for h in heads
    ]


def fit_head(
    head: HeadReadings, *, orders: int | Sequence[int] | None, robust: bool, unit: str
) -> HarmonicFit:
    """Fit the harmonics of one head, with its resolution and the step of its codes."""
    return fit_harmonics(
        head.angle,
        head.error,
        orders=orders,
        robust=robust,
        unit=unit,
        least_outlier=head.least_outlier,
        resolution=head.resolution or 0.0,
    )


def common_step(values: ArrayLike) -> float:
    """Return the largest step of which all differences of a few values are multiples.

    It is 0 if there is none, and for more than a few hundred values, whose residuals show it.

    Examples
    --------
    >>> print(f"{common_step([1.5, -0.5, 3.0, 2.0]):.3f} {common_step([0.0, 1.0, 2.0**0.5]):.3f}")
    0.500 0.000
    """
    # most values; rounding errors, and the least step, over the span of the values
    most, rounding, least = 400, 1e-9, 1e-6
    y = np.asarray(values, dtype=np.float64)
    if not 1 < y.size <= most or not np.isfinite(y).all():
        return 0.0
    span = float(np.ptp(y))
    limit = rounding * span
    # Euclid's algorithm, with remainders of either sign
    step = 0.0
    for part in np.unique(y - y.min()):
        a, b = float(part), step
        while b > limit:
            a, b = b, abs(math.remainder(a, b))
        if a > limit:
            step = a
        if 0.0 < step < least * span:
            return 0.0
    return step


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

    The once-per-turn harmonic of each head, fitted together with others, gives the eccentricity to
    first order, by weighted least squares over the heads. The terms that exact geometry adds are
    then subtracted from the readings, and the fit is repeated until it converges (Gauss-Newton,
    with the slope of the first order). Two heads at different angles separate an error common to
    all heads from eccentricity, three also a circular motion of the axis against the sense of
    rotation.

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
        Whether to find and reject outliers.
    graduation_uncertainty : float
        Standard uncertainty of the scale's own once-per-turn error, of its cosine and of its sine
        [rad].
    radius_uncertainty : float
        Standard uncertainty of the radius [m].
    head_angle_uncertainty : float
        Standard uncertainty of the angle of all heads together [rad].

    Returns
    -------
    Eccentricity
        The eccentricity, with uncertainty.

    Validity
    --------
    A once-per-turn graduation error of the scale has the same effect in all heads as eccentricity,
    and so has a circular motion of the axis that turns with the table: no number of heads separates
    them, but a move that cancels the sum removes the errors. One head cannot separate a
    once-per-turn error of the reference either. Other axis motion, and harmonics beyond those
    fitted, count as noise.

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
    uncertainties = (graduation_uncertainty, radius_uncertainty, head_angle_uncertainty)
    if not all(0.0 <= u < math.inf for u in uncertainties):
        raise ModelError(f"uncertainties must be 0 or more and finite, got {uncertainties}")
    # the beginning of a long record is enough for the first iteration
    short = _beginnings(heads)
    fits, estimate = _fitted(short, orders, robust)
    all_samples = short == heads
    e = radius * estimate.vector
    for _ in range(60):
        if not math.hypot(*e) < radius:
            raise ModelError(
                f"the readings place the axis outside the scale, {math.hypot(*e):g} m from its "
                f"centre at a radius of {radius:g} m: check radius and units"
            )
        beyond = 0.5 * (math.hypot(*e) / radius) ** 2
        if all_samples and beyond <= 1e-3 * math.sqrt(float(np.trace(estimate.covariance))) + 1e-15:
            break
        fits, estimate = _fitted(_less_geometry(heads, complex(*e) / radius, kind), orders, robust)
        all_samples = True
        last, e = e, radius * estimate.vector
        u = radius * math.sqrt(float(np.trace(estimate.covariance)))
        # the terms beyond the first order change by this share of the change of eccentricity
        share = math.hypot(*e) / radius
        if share * math.hypot(*(e - last)) <= max(1e-14 * radius, 0.02 * u):
            break
    return _centre_from(estimate, fits, radius, uncertainties)


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
    return with_resolution(heads)


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
    """Return the readings without the terms that exact geometry adds to the first order."""
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
) -> tuple[list[HarmonicFit], EccentricityEstimate]:
    """Fit the harmonics of heads, or of indicators where `radial`, and combine those of order 1."""
    first, unit = heads[0].angle, "m" if radial else "rad"
    together = all(h.angle is first or np.array_equal(h.angle, first) for h in heads)
    # records of heads are long: one pass for all of them
    if together and not radial and len({h.resolution for h in heads}) == 1:
        columns = np.column_stack([h.error for h in heads])
        fits = list(
            fit_many(
                first,
                columns,
                orders=orders,
                robust=robust,
                unit=unit,
                least_outlier=max(h.least_outlier for h in heads),
                resolution=heads[0].resolution or 0.0,
            )
        )
    else:
        fits = [fit_head(h, orders=orders, robust=robust, unit=unit) for h in heads]
    if any(1 not in f.orders for f in fits):
        raise ModelError("order 1 must be among those fitted: it contains the eccentricity")
    angles = np.array([h.head_angle for h in heads])
    return fits, combine_heads(fits, angles, first if together else None, radial=radial)


def run_out(
    readings: Sequence[HeadReadings] | HeadReadings,
    *,
    radius: float | None = None,
    orders: int | Sequence[int] | None = None,
    robust: bool = True,
) -> Eccentricity:
    """Find eccentricity and form of a rim from the readings of indicators over a turn.

    The once-per-turn harmonic is exactly the eccentricity; with a radius, the contribution of the
    eccentricity of a round rim to the harmonics of order 2 and more is subtracted from the form.
    Two indicators that are not opposite separate a circular motion of the axis against the sense of
    rotation.

    Parameters
    ----------
    readings : sequence of HeadReadings or HeadReadings
        Records of the indicators, at any angles.
    radius : float, optional
        Radius of the rim [m].
    orders : int or sequence of int, optional
        Highest harmonic, or all that are fitted; 1 must be among them.
    robust : bool
        Whether to find and reject outliers.

    Returns
    -------
    Eccentricity
        Centre of the rim. Its fits contain the form, from order 2 on, without the contribution of
        eccentricity [m]; order 2 is ellipticity.

    Validity
    --------
    A circular motion of the axis that turns with the table has the same effect as eccentricity.
    With one indicator, motion of the axis of other orders counts as form. The centre of the rim is
    not that of the lines unless both were machined in one setup.

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
    indicators = _listed(readings, "a run-out", "indicator", "reading")
    if radius is not None:
        require_radius(radius)
    fits, estimate = _fitted(indicators, orders, robust, radial=True)
    if radius is not None:
        without_eccentricity = []
        for r in indicators:
            exact = exact_run_out(r.angle, estimate.vector, radius, indicator_angle=r.head_angle)
            beta = r.angle + r.head_angle
            first = estimate.vector[0] * np.cos(beta) + estimate.vector[1] * np.sin(beta)
            without_eccentricity.append(replace(r, error=r.error - (exact - first)))
        fits, estimate = _fitted(without_eccentricity, orders, robust, radial=True)
    return _centre_from(estimate, fits, radius or 1.0, (0.0, 0.0, 0.0), radial=True)
