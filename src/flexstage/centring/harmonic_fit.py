"""Fitted harmonics over the turn, of one head or of several, with uncertainty."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.centring.least_squares import (
    HarmonicProblem,
    Noise,
    NormalEquations,
    evaluated,
    from_spectrum,
    from_turns,
)
from flexstage.centring.turns import Turns
from flexstage.quantities.estimate import Estimate


def length_estimate(
    vector: ArrayLike,
    covariance: ArrayLike,
    unit: str,
    *,
    degrees_of_freedom: float = math.inf,
) -> Estimate:
    r"""Return the length of a measured vector of two parts, with a 95 % interval.

    The interval begins at 0 if the vector may be zero.

    Noise makes a short vector longer: its length has Rice's distribution (Rice 1944, Bell System
    Technical Journal 23), and ``|v|^2 / u^2`` a noncentral chi-squared distribution with 2 degrees
    of freedom and the parameter A^2 / u^2. The ends of the interval are the lengths A for which the
    measured length is at its 2.5 % ends, averaged over the likely variances if u was estimated. Far
    from zero that is Student's interval.

    Validity
    --------
    Near zero, parts with about equal uncertainty: for others, the uncertainty along the vector is
    used. The interval of a length of about zero contains it in 97.5 % of all cases.

    Examples
    --------
    >>> length = length_estimate((0.3e-6, -0.1e-6), 0.04e-12 * np.eye(2), "m")
    >>> low, high = length.interval()
    >>> print(f"{1e6 * length.value:.2f} um, {1e6 * low:.2f} to {1e6 * high:.2f} um")
    0.32 um, 0.00 to 0.66 um
    """
    # length, in standard uncertainties, from which its distribution is practically normal
    far = 8.0
    v = np.asarray(vector, dtype=np.float64)
    cov = np.asarray(covariance, dtype=np.float64)
    length = math.hypot(v[0], v[1])
    # a zero vector has no direction: the mean over all directions is used
    along = v / length if length > 0.0 else np.array([1.0, 1.0]) / math.sqrt(2.0)
    u = math.sqrt(max(float(along @ cov @ along), 0.0))
    bounds = None
    if u > 0.0 and length < far * u:
        bounds = _rice_interval(length, u, degrees_of_freedom)
    return Estimate.of(length, u, unit, degrees_of_freedom=degrees_of_freedom, bounds=bounds)


def direction_estimate(
    vector: ArrayLike,
    covariance: ArrayLike,
    *,
    degrees_of_freedom: float = math.inf,
) -> Estimate:
    r"""Return the direction of a measured vector of two parts, with a 95 % interval.

    It is from the first part towards the second [rad], between -pi and pi; the interval is a full
    turn if the vector may be zero.

    The part of the vector across its true direction is normal with mean 0, so that the direction is
    known to within ``arcsin(t u / |v|)``, with Student's t (the method of Fieller 1954, Journal of
    the Royal Statistical Society B 16, for the tangent).

    Validity
    --------
    Compare a direction with the interval modulo a turn. For parts with different uncertainty, that
    across the measured direction is used.

    Examples
    --------
    >>> phase = direction_estimate((3e-6, 4e-6), 0.01e-12 * np.eye(2))
    >>> print(f"{np.degrees(phase.value):.2f} +- {np.degrees(phase.expanded):.2f} deg")
    53.13 +- 2.25 deg
    """
    v = np.asarray(vector, dtype=np.float64)
    cov = np.asarray(covariance, dtype=np.float64)
    length = math.hypot(v[0], v[1])
    value = math.atan2(v[1], v[0])
    if length == 0.0:
        u = math.pi / math.sqrt(3.0)
        bounds = (value - math.pi, value + math.pi)
        return Estimate.of(value, u, "rad", bounds=bounds)
    across = np.array([-v[1], v[0]]) / length
    u = math.sqrt(max(float(across @ cov @ across), 0.0)) / length
    # an unknown direction has a uniform distribution over the turn
    standard, freedom = min(u, math.pi / math.sqrt(3.0)), degrees_of_freedom
    plain = Estimate.of(value, standard, "rad", degrees_of_freedom=freedom)
    half = Estimate.of(value, u, "rad", degrees_of_freedom=freedom).expanded
    reach = math.asin(half) if half < 1.0 else math.pi
    return replace(plain, bounds=(value - reach, value + reach)) if half > 0.1 else plain


def _rice_interval(length: float, u: float, dof: float) -> tuple[float, float]:
    likely = _likely_variances(dof)
    low = _root(lambda a: _share_below(length / u, a, likely) - 0.975, length / u)
    high = _root(lambda a: _share_below(length / u, a, likely) - 0.025, length / u)
    # where even none at all would give more, the interval would shrink to a point
    return u * low, u * max(high, 1.0)


def _likely_variances(dof: float) -> Array:
    """Return variances, all equally likely, where their estimate is 1."""
    from scipy.special import chdtri

    # parts of the distribution of a variance that a probability is averaged over.
    most_shares = 60

    if not math.isfinite(dof) or dof > 1e4:
        return np.ones(1)
    # the better it is known the fewer values stand for it
    shares = min(most_shares, max(8, math.ceil(1200.0 / dof)))
    return dof / np.asarray(chdtri(dof, (np.arange(shares) + 0.5) / shares))


def _share_below(length: float, a: float, variances: Array) -> float:
    """Return the probability of a length below the measured one, if the true length is a."""
    from scipy.special import chdtr, chndtr

    square = length**2 / variances
    share = chndtr(square, 2.0, a * a / variances) if a > 0.0 else chdtr(2.0, square)
    return float(np.mean(share))


def _root(excess: Callable[[float], float], scale: float) -> float:
    """Return the zero of a decreasing function from 0 on; 0 if it is negative there."""
    from scipy.optimize import brentq

    if excess(0.0) <= 0.0:
        return 0.0
    high = scale + 5.0
    while excess(high) > 0.0:
        high *= 2.0
    root: Any = brentq(excess, 0.0, high, xtol=1e-6)
    return float(root)


_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Harmonic:
    """One harmonic: a cos(n theta) + b sin(n theta) = A cos(n theta - phase)."""

    order: int
    """Number of periods per turn, n."""
    cosine: Estimate
    """Amplitude a of the cosine."""
    sine: Estimate
    """Amplitude b of the sine."""
    amplitude: Estimate
    """Amplitude A; near zero its interval is not symmetric."""
    phase: Estimate
    """Phase from the cosine towards the sine [rad]."""
    covariance: Array
    """Covariance of a and b, shape (2, 2)."""

    def less(self, earlier: "Harmonic") -> "Harmonic":
        """Return the difference from the same harmonic of an earlier record."""

        def part(new: Estimate, old: Estimate) -> Estimate:
            before = (replace(c, name=f"{c.name}, before") for c in old.components)
            value = new.value - old.value
            return replace(new, value=value, components=(*new.components, *before))

        cosine, sine = part(self.cosine, earlier.cosine), part(self.sine, earlier.sine)
        freedom = min(self.cosine.degrees_of_freedom, earlier.cosine.degrees_of_freedom)
        return _harmonic(self.order, cosine, sine, self.covariance + earlier.covariance, freedom)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlier:
    """Rejected sample."""

    index: int
    """Number in the record, from 0."""
    angle: float
    """Angle [rad]."""
    value: float
    """Value, in the unit of the record."""
    residual: float
    """Deviation from the fit of the other samples, in the same unit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HarmonicFit:
    """Harmonics of a record over the turn."""

    harmonics: tuple[Harmonic, ...]
    """In rising order."""
    offset: Estimate
    """The mean."""
    drift: Estimate | None
    """Change per turn; None if it was not fitted."""
    covariance: Array
    """Covariance of a and b of all harmonics, in that order, shape (2 k, 2 k)."""
    residual: Array
    """Residual of each sample, including outliers, shape (n,)."""
    residual_rms: float
    """Residual standard deviation of the samples without outliers, with the degrees of freedom of
    the fit.
    """
    samples: int
    """Number of samples without outliers."""
    turns: float
    """Number of turns of the samples."""
    outliers: tuple[Outlier, ...]
    """Rejected samples."""
    noise: str
    """Source of the uncertainty: "white" residuals, the spectrum of "correlated" ones, or the
    scatter of "turns".
    """
    unit: str
    """Unit of the values."""
    notes: tuple[str, ...]
    """Remarks on the fit."""
    spectra: Noise | None = None
    """Spectra of the noise of one turn; None if they are not known, and for several turns."""
    with_all: "HarmonicFit | None" = None
    """Fit of all samples if more than 1 % of them were rejected; the covariance and the intervals
    then cover both fits.
    """
    resolution: float = 0.0
    """Step of the values; 0 if it is unknown."""

    @property
    def noise_rms(self) -> float:
        """Standard deviation of the noise of a value, at least that of its resolution."""
        return max(self.residual_rms, self.resolution / math.sqrt(12.0))

    @property
    def orders(self) -> tuple[int, ...]:
        """Orders of the harmonics."""
        return tuple(h.order for h in self.harmonics)

    def harmonic(self, order: int) -> Harmonic:
        """Return the harmonic of an order."""
        for harmonic in self.harmonics:
            if harmonic.order == order:
                return harmonic
        raise RecordError(
            f"there is no harmonic of order {order}: the fitted orders are "
            f"{', '.join(map(str, self.orders)) or 'none'}"
        )

    def evaluate(self, angle: ArrayLike) -> Array:
        """Return offset and harmonics, without drift, at other angles [rad]."""
        turns = np.atleast_1d(np.asarray(angle, dtype=np.float64)) / _TURN
        parts = [p for h in self.harmonics for p in (h.cosine.value, h.sine.value)]
        c = np.array([self.offset.value, *parts])[:, None]
        return evaluated(turns, c, self.orders, drift=False)[:, 0]


def satterthwaite(variances: Sequence[float], freedoms: Sequence[float]) -> float:
    """Return the degrees of freedom of a sum of independent variances."""
    total = sum(variances)
    if total == 0.0:
        return min(freedoms)
    inverse = sum((s / total) ** 2 / n for s, n in zip(variances, freedoms, strict=True))
    # exact readings have no noise to know
    return 1.0 / inverse if inverse > 0.0 else math.inf


def scale_harmonic(
    fits: Sequence[HarmonicFit], angles: NDArray[np.float64], order: int
) -> Harmonic:
    """Return the mean of the harmonics of several heads, over the scale angle.

    The heads are at `angles` [rad]; their harmonics are over the angle of the table.

    A head at alpha reads the scale at theta + alpha: its harmonic is turned by n alpha.

    Validity
    --------
    Heads with independent noise. The mean includes motion of the axis and errors of the reference
    of that order, the less the more heads there are.

    Examples
    --------
    >>> from flexstage.centring import fit_harmonics
    >>> theta = np.arange(50) * np.pi / 25
    >>> fits = [fit_harmonics(theta, np.cos(2.0 * (theta + a)), orders=3) for a in (0.3, 1.9)]
    >>> print(f"{scale_harmonic(fits, np.array([0.3, 1.9]), 2).cosine.value:.3f}")
    1.000
    """
    harmonics = [f.harmonic(order) for f in fits]
    parts, covariances = [], []
    for h, alpha in zip(harmonics, angles, strict=True):
        c, s = math.cos(order * alpha), math.sin(order * alpha)
        turn = np.array([[c, -s], [s, c]])
        parts.append(turn @ np.array([h.cosine.value, h.sine.value]))
        covariances.append(turn @ h.covariance @ turn.T)
    mean = np.mean(parts, axis=0)
    covariance = np.sum(covariances, axis=0) / len(parts) ** 2
    shares = [float(np.trace(v)) for v in covariances]
    freedom = satterthwaite(shares, [h.cosine.degrees_of_freedom for h in harmonics])
    return harmonic_of(order, mean, covariance, freedom, fits[0].unit)


def harmonic_of(
    order: int, vector: Array, covariance: Array, freedom: float, unit: str
) -> Harmonic:
    """Return a harmonic from its a and b, whose only uncertainty is noise."""

    def part(i: int) -> Estimate:
        u = math.sqrt(covariance[i, i])
        return Estimate.of(float(vector[i]), u, unit, degrees_of_freedom=freedom)

    return _harmonic(order, part(0), part(1), covariance, freedom)


def _harmonic(
    order: int, cosine: Estimate, sine: Estimate, covariance: Array, freedom: float
) -> Harmonic:
    vector, unit = (cosine.value, sine.value), cosine.unit
    return Harmonic(
        order=order,
        cosine=cosine,
        sine=sine,
        amplitude=length_estimate(vector, covariance, unit, degrees_of_freedom=freedom),
        phase=direction_estimate(vector, covariance, degrees_of_freedom=freedom),
        covariance=covariance,
    )


#: Number of turns from which their scatter gives the noise, whatever its spectrum.
MANY_TURNS = 8
_CORRELATED = (
    "the residuals are correlated, which increases the uncertainty of low orders: fit more orders "
    "if they contain harmonics, or measure more turns if they drift"
)
_UNKNOWN = (
    "one turn does not tell slow noise from errors of the scale of low orders, and the intervals "
    "allow for both, but not for a drift slower than a turn: measure eight turns or more, or more "
    "samples"
)
_ONE_TURN = (
    "one turn does not show a drift slower than a turn, and the intervals leave it out: record two "
    "turns or more"
)


def distinct_notes(notes: Iterable[str]) -> tuple[str, ...]:
    """Return each note once, and what one turn does not show in one of them."""
    distinct = tuple(dict.fromkeys(notes))
    wider = any(note.startswith(_UNKNOWN) or note.endswith(f"; {_ONE_TURN}") for note in distinct)
    return tuple(note for note in distinct if not (wider and note == _ONE_TURN))


def fit_result(
    problem: HarmonicProblem,
    equations: NormalEquations,
    c: Array,
    residual: Array,
    keep: NDArray[np.bool_] | None,
    turns: Turns,
    unit: str,
) -> HarmonicFit:
    """Return the harmonics of one column, with uncertainty and notes.

    `c` are its coefficients, shape (p,), `residual` the residuals of all samples, shape (n,), and
    `keep` the mask of samples without outliers, None for all.
    """
    inliers = residual if keep is None else residual[keep]
    free = inliers.size - c.size
    if free < 1:
        raise RecordError(
            f"{inliers.size} samples without outliers are too few for {c.size} coefficients: fit "
            "fewer orders"
        )
    rms = float(inliers @ inliers) / free
    # rounded values can leave no residual: their step has at least a uniform distribution
    square = max(rms, problem.resolution**2 / 12.0)
    white = square * equations.unit_covariance()
    # in the order of the samples, with zeros for outliers
    series = residual if keep is None else np.where(keep, residual, 0.0)
    factors, freedom, noise, spectra = _noise_of_residuals(
        problem, equations, c, white, series, square, turns, free
    )
    roots = np.sqrt(factors)
    covariance = white * np.outer(roots, roots)
    first = problem.first
    harmonics = tuple(
        harmonic_of(
            order,
            c[first + 2 * i : first + 2 * i + 2],
            covariance[first + 2 * i : first + 2 * i + 2, first + 2 * i : first + 2 * i + 2],
            float(freedom[first + 2 * i]),
            unit,
        )
        for i, order in enumerate(problem.orders)
    )
    offset, drift = _nuisance(problem, c, covariance, freedom, unit)
    return HarmonicFit(
        harmonics=harmonics,
        offset=offset,
        drift=drift,
        covariance=covariance[first:, first:],
        residual=residual,
        residual_rms=math.sqrt(rms),
        samples=int(inliers.size),
        turns=turns.count,
        outliers=_outliers(problem, residual, keep, turns),
        noise=noise,
        spectra=spectra if turns.full == 1 else None,
        resolution=problem.resolution,
        unit=unit,
        notes=_notes(problem, white, square, turns, inliers.size)
        + _noise_notes(noise, factors[first:], freedom[first:], one_turn=not problem.drift),
    )


def _noise_notes(noise: str, factors: Array, freedom: Array, *, one_turn: bool) -> tuple[str, ...]:
    """Return a note on low orders less certain than for white noise, or on what one turn hides."""
    from scipy.special import stdtrit

    # variance over that of white noise from which a note reports it
    wide = 6.0
    if noise == "correlated" and float(factors.max()) > wide:
        return (f"{_CORRELATED}; {_ONE_TURN}" if one_turn else _CORRELATED,)
    if noise == "turns" or not one_turn:
        return ()
    reach = float(np.max(np.sqrt(factors) * stdtrit(freedom, 0.975))) / 1.96
    return (_UNKNOWN if noise == "correlated" or reach > math.sqrt(wide) else _ONE_TURN,)


def covering_both(fit: HarmonicFit, with_all: HarmonicFit) -> HarmonicFit:
    """Return a fit without outliers, whose intervals also cover that of all samples."""
    covariance = fit.covariance.copy()
    harmonics = []
    for i, (robust, other) in enumerate(zip(fit.harmonics, with_all.harmonics, strict=True)):
        robust_vector = np.array([robust.cosine.value, robust.sine.value])
        shift = math.hypot(
            robust_vector[0] - other.cosine.value, robust_vector[1] - other.sine.value
        )
        worst = max(float(np.linalg.eigvalsh(h.covariance)[-1]) for h in (robust, other))
        # the least coverage factor of 95 % extends to the interval of the other fit
        both = (math.sqrt(worst) + shift / 1.9599) ** 2 * np.eye(2)
        part = slice(2 * i, 2 * i + 2)
        covariance[part, part] = both
        freedom = min(robust.cosine.degrees_of_freedom, other.cosine.degrees_of_freedom)
        wider = harmonic_of(robust.order, robust_vector, both, freedom, fit.unit)
        # near zero the interval of a length is not symmetric
        ends = np.array([h.amplitude.interval() for h in (wider, other)])
        bounds = (float(ends[:, 0].min()), float(ends[:, 1].max()))
        harmonics.append(replace(wider, amplitude=replace(wider.amplitude, bounds=bounds)))
    rejected = len(fit.outliers)
    note = (
        f"{rejected} of {fit.samples + rejected} samples were rejected as outliers: they may be "
        "sharp errors of the scale; the intervals also cover the fit with all samples"
    )
    return replace(
        fit,
        harmonics=tuple(harmonics),
        covariance=covariance,
        notes=(*fit.notes, note),
        with_all=with_all,
    )


def _noise_of_residuals(
    problem: HarmonicProblem,
    equations: NormalEquations,
    c: Array,
    white: Array,
    residual: Array,
    square: float,
    turns: Turns,
    free: int,
) -> tuple[Array, Array, str, Noise | None]:
    """Return factors on the variance, degrees of freedom, their source, and the spectrum."""
    first, size = problem.first, c.size
    if float(np.trace(white)) == 0.0:
        return np.ones(size), np.full(size, float(free)), "white", None
    if equations.gram.shape[0] >= MANY_TURNS:
        factors, freedom = from_turns(equations, c, white, first)
        # the phase of an order is arbitrary: noise disturbs its cosine and sine equally
        pooled = 0.5 * (factors[first::2] + factors[first + 1 :: 2])
        factors[first:] = np.repeat(pooled, 2)
        degrees = np.full(size, freedom)
        degrees[first:] *= 2.0
        return factors, degrees, "turns", None
    plain = np.ones(size), np.full(size, float(free)), "white", None
    if turns.direction == 0:
        return plain
    per_sample = turns.count / problem.u.size
    orders = np.repeat(np.array(problem.orders, dtype=np.float64), 2) * per_sample
    lowest = np.full(first, 0.5 / problem.u.size)
    harmonics = None
    if turns.full > 1 or problem.readings is not None:
        residual = residual[: round(turns.full / per_sample)]
    if turns.full == 1 and turns.count > 0.99:
        others = c.copy()
        others[:first] = 0.0
        if problem.orders[0] == 1:
            others[first : first + 2] = 0.0
        u = problem.u[: residual.size]
        harmonics = evaluated(u, others[:, None], problem.orders, drift=problem.drift)[:, 0]
    noise = from_spectrum(
        residual,
        np.concatenate((lowest, orders)),
        [*([per_sample] if problem.drift else []), *orders],
        per_sample,
        turns.full,
        harmonics,
    )
    if noise is None:
        return plain
    density, freedom, is_white, spectra = noise
    density = np.maximum(density, problem.resolution**2 / 12.0)
    return density / square, freedom, "white" if is_white else "correlated", spectra


def _nuisance(
    problem: HarmonicProblem, c: Array, covariance: Array, freedom: Array, unit: str
) -> tuple[Estimate, Estimate | None]:
    def estimate(value: float, variance: float, i: int) -> Estimate:
        u = math.sqrt(variance)
        return Estimate.of(float(value), u, unit, degrees_of_freedom=float(freedom[i]))

    if not problem.drift:
        return estimate(c[0], covariance[0, 0], 0), None
    at = np.array([1.0, problem.middle])
    offset = estimate(float(at @ c[:2]), float(at @ covariance[:2, :2] @ at), 0)
    return offset, estimate(c[1], covariance[1, 1], 1)


def _outliers(
    problem: HarmonicProblem, residual: Array, keep: NDArray[np.bool_] | None, turns: Turns
) -> tuple[Outlier, ...]:
    if keep is None:
        return ()
    return tuple(
        Outlier(
            index=int(i),
            angle=float(turns.angle[i]),
            value=float(problem.y[i, 0]),
            residual=float(residual[i]),
        )
        for i in np.flatnonzero(~keep)
    )


def _notes(
    problem: HarmonicProblem,
    white: Array,
    square: float,
    turns: Turns,
    samples: int,
) -> tuple[str, ...]:
    notes = []
    if turns.direction == 0:
        notes.append("the angles are not in sequence: the noise is assumed to be white")
    variances = np.diag(white)[problem.first :]
    worst = math.sqrt(float(variances.max()) * samples / (2.0 * square)) if square > 0.0 else 1.0
    if worst > 1.5:
        few_again = problem.drift and turns.full == 1
        notes.append(
            f"{'a drift' if few_again else 'non-uniform sampling'} increases the uncertainty of "
            f"harmonics up to {worst:.1f} times; the samples cover "
            f"{turns.count if few_again else turns.coverage:.2f} of a turn"
        )
    return tuple(notes)
