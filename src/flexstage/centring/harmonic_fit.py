"""Harmonics over the turn as they were fitted, of one head or of several, with uncertainty."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.centring.least_squares import (
    HarmonicProblem,
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

    Its interval begins at 0 where the vector could as well be none.

    Noise makes a short vector longer: its length has Rice's distribution (Rice 1944, Bell System
    Technical Journal 23), and ``|v|^2 / u^2`` that of chi squared, not central, with 2 degrees of
    freedom and the parameter A^2 / u^2. The ends of the interval are the lengths A for which what
    was found is at the 2.5 % ends of it, averaged over the variances that are likely where u was
    itself estimated. Far from zero that is Student's interval.

    Validity
    --------
    Near zero, parts that are about equally uncertain: of others, the uncertainty along the vector
    is taken. The interval of a length of about zero holds it in 97.5 % of all cases.

    Examples
    --------
    >>> length = length_estimate((0.3e-6, -0.1e-6), 0.04e-12 * np.eye(2), "m")
    >>> low, high = length.interval()
    >>> print(f"{1e6 * length.value:.2f} um, {1e6 * low:.2f} to {1e6 * high:.2f} um")
    0.32 um, 0.00 to 0.66 um
    """
    # beyond this many standard uncertainties a length is as good as normal.
    far = 8.0
    v = np.asarray(vector, dtype=np.float64)
    cov = np.asarray(covariance, dtype=np.float64)
    length = math.hypot(v[0], v[1])
    # a vector that is none has no direction: the mean over all of them stands for it
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

    It is from the first part towards the second [rad], between -pi and pi; the interval is the
    whole turn where the vector could as well be none.

    The part of the vector across its true direction is normal with mean 0, so that the direction is
    known to within ``arcsin(t u / |v|)``, with Student's t (the way of Fieller 1954, Journal of the
    Royal Statistical Society B 16, for the tangent).

    Validity
    --------
    Compare a direction with the interval modulo a turn. Of parts with unlike uncertainty, that
    across the measured direction is taken.

    Examples
    --------
    >>> phase = direction_estimate((3e-6, 4e-6), 0.01e-12 * np.eye(2))
    >>> print(f"{np.degrees(phase.value):.2f} +- {np.degrees(phase.expanded):.2f} deg")
    53.13 +- 2.25 deg
    """
    from dataclasses import replace

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
    # of a direction that is not known, that of equal chances all round
    known, freedom = min(u, math.pi / math.sqrt(3.0)), degrees_of_freedom
    plain = Estimate.of(value, known, "rad", degrees_of_freedom=freedom)
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


def _share_below(found: float, a: float, variances: Array) -> float:
    """Return how often a length is less than what was found, where the true one is a."""
    from scipy.special import chdtr, chndtr

    square = found**2 / variances
    share = chndtr(square, 2.0, a * a / variances) if a > 0.0 else chdtr(2.0, square)
    return float(np.mean(share))


def _root(excess: Callable[[float], float], scale: float) -> float:
    """Return where a function that falls is zero, from 0 on; 0 where it begins below."""
    from scipy.optimize import brentq

    if excess(0.0) <= 0.0:
        return 0.0
    high = scale + 5.0
    while excess(high) > 0.0:
        high *= 2.0
    found: Any = brentq(excess, 0.0, high, xtol=1e-6)
    return float(found)


_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Harmonic:
    """One harmonic: a cos(n theta) + b sin(n theta) = A cos(n theta - phase)."""

    order: int
    """How often it repeats itself in a turn, n."""
    cosine: Estimate
    """Amplitude a of the cosine."""
    sine: Estimate
    """Amplitude b of the sine."""
    amplitude: Estimate
    """A; near zero its interval is not symmetric."""
    phase: Estimate
    """From the cosine towards the sine [rad]."""
    covariance: Array
    """Of a and b, shape (2, 2)."""

    def less(self, earlier: "Harmonic") -> "Harmonic":
        """Return how it differs from the same harmonic of an earlier record."""

        def part(own: Estimate, other: Estimate) -> Estimate:
            before = (replace(c, name=f"{c.name}, before") for c in other.components)
            value = own.value - other.value
            return replace(own, value=value, components=(*own.components, *before))

        cosine, sine = part(self.cosine, earlier.cosine), part(self.sine, earlier.sine)
        freedom = min(self.cosine.degrees_of_freedom, earlier.cosine.degrees_of_freedom)
        return _harmonic(self.order, cosine, sine, self.covariance + earlier.covariance, freedom)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlier:
    """A sample that was set aside."""

    index: int
    """Its number in the record, from 0."""
    angle: float
    """Its angle [rad]."""
    value: float
    """Its value, in the unit of the record."""
    residual: float
    """How far it is from what the others say, in the same unit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HarmonicFit:
    """Harmonics of a record over the turn."""

    harmonics: tuple[Harmonic, ...]
    """In rising order."""
    offset: Estimate
    """The mean."""
    drift: Estimate | None
    """Change in a turn; None where it was not fitted."""
    covariance: Array
    """Of a and b of all harmonics, in that order, shape (2 k, 2 k)."""
    residual: Array
    """What is left of each sample, outliers too, shape (n,)."""
    residual_rms: float
    """Root of the mean square of what is left of the samples that were kept, for the number of
    those less that of the coefficients.
    """
    samples: int
    """Number of samples that were kept."""
    turns: float
    """How many turns they go over."""
    outliers: tuple[Outlier, ...]
    """Samples that were set aside."""
    noise: str
    """What the uncertainty rests on: residuals that do not know of each other, their spectrum, or
    how turns differ.
    """
    unit: str
    """Unit of the values."""
    notes: tuple[str, ...]
    """What a reader should know."""
    with_all: "HarmonicFit | None" = None
    """The fit of all samples where more than a hundredth of them were set aside; the covariance and
    the intervals then cover both.
    """

    @property
    def orders(self) -> tuple[int, ...]:
        """Orders of the harmonics."""
        return tuple(h.order for h in self.harmonics)

    def harmonic(self, order: int) -> Harmonic:
        """Return the harmonic of an order."""
        for found in self.harmonics:
            if found.order == order:
                return found
        raise RecordError(
            f"there is no harmonic of order {order}: those fitted are "
            f"{', '.join(map(str, self.orders)) or 'none'}"
        )

    def evaluate(self, angle: ArrayLike) -> Array:
        """Return offset and harmonics, without drift, at other angles [rad]."""
        turns = np.atleast_1d(np.asarray(angle, dtype=np.float64)) / _TURN
        parts = [p for h in self.harmonics for p in (h.cosine.value, h.sine.value)]
        c = np.array([self.offset.value, *parts])[:, None]
        return evaluated(turns, c, self.orders, drift=False)[:, 0]


def scale_harmonic(
    fits: Sequence[HarmonicFit], angles: NDArray[np.float64], order: int
) -> Harmonic:
    """Return the mean of the harmonics of several heads, over the angle in the scale.

    The heads stand at `angles` [rad]; their harmonics are over the angle of the table.

    Each head at alpha sees the scale at theta + alpha: its harmonic is turned by n alpha.

    Validity
    --------
    Heads whose noise is their own. Motion of the axis and errors of the reference of that order are
    in it, less so the more heads there are.

    Examples
    --------
    >>> from flexstage.centring import fit_harmonics
    >>> theta = np.arange(50) * np.pi / 25
    >>> fits = [fit_harmonics(theta, np.cos(2.0 * (theta + a)), orders=3) for a in (0.3, 1.9)]
    >>> print(f"{scale_harmonic(fits, np.array([0.3, 1.9]), 2).cosine.value:.3f}")
    1.000
    """
    found = [f.harmonic(order) for f in fits]
    parts, covariances = [], []
    for h, alpha in zip(found, angles, strict=True):
        c, s = math.cos(order * alpha), math.sin(order * alpha)
        turn = np.array([[c, -s], [s, c]])
        parts.append(turn @ np.array([h.cosine.value, h.sine.value]))
        covariances.append(turn @ h.covariance @ turn.T)
    mean = np.mean(parts, axis=0)
    covariance = np.sum(covariances, axis=0) / len(parts) ** 2
    shares = np.array([float(np.trace(v)) for v in covariances])
    freedoms = np.array([h.cosine.degrees_of_freedom for h in found])
    total = float(shares.sum())
    freedom = float(total**2 / np.sum(shares**2 / freedoms)) if total > 0.0 else math.inf
    return harmonic_of(order, mean, covariance, freedom, fits[0].unit)


def harmonic_of(
    order: int, vector: Array, covariance: Array, freedom: float, unit: str
) -> Harmonic:
    """Return a harmonic from its a and b, which only noise makes uncertain."""

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


#: From so many turns on their scatter tells the noise, whatever it is like.
MANY_TURNS = 8
_LASTING = (
    "what is left lasts from sample to sample, and makes the low orders more uncertain: fit more "
    "orders if there are harmonics in it, or measure more turns if it is drift",
)


def described(
    problem: HarmonicProblem,
    equations: NormalEquations,
    c: Array,
    residual: Array,
    keep: NDArray[np.bool_] | None,
    turns: Turns,
    unit: str,
) -> HarmonicFit:
    """Return the harmonics of one column, with uncertainty and notes.

    `c` are its coefficients, shape (p,), `residual` what they leave of all samples, shape (n,), and
    `keep` which samples were kept, all where None.
    """
    # share of the variance of white noise from which a record says that its noise lasts.
    wide = 6.0
    kept = residual if keep is None else residual[keep]
    free = kept.size - c.size
    if free < 1:
        raise RecordError(
            f"{kept.size} samples without outliers are too few for {c.size} coefficients: fit "
            "fewer orders"
        )
    square = float(kept @ kept) / free
    white = square * np.linalg.inv(equations.gram.sum(axis=0))
    # in the order of the samples; none where they were set aside
    left = residual if keep is None else np.where(keep, residual, 0.0)
    factors, freedom, noise = _noise_of_residuals(
        problem, equations, c, white, left, square, turns, free
    )
    grown = np.sqrt(factors)
    covariance = white * np.outer(grown, grown)
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
        residual_rms=math.sqrt(square),
        samples=int(kept.size),
        turns=turns.count,
        outliers=_named(problem, residual, keep, turns),
        noise=noise,
        unit=unit,
        notes=_notes(problem, white, square, turns, kept.size)
        + (_LASTING if noise == "correlated" and float(factors[first:].max()) > wide else ()),
    )


def covering_both(fit: HarmonicFit, with_all: HarmonicFit) -> HarmonicFit:
    """Return a fit without outliers, whose intervals cover that of all samples as well."""
    covariance = fit.covariance.copy()
    harmonics = []
    for i, (own, other) in enumerate(zip(fit.harmonics, with_all.harmonics, strict=True)):
        shift = math.hypot(own.cosine.value - other.cosine.value, own.sine.value - other.sine.value)
        worst = max(float(np.linalg.eigvalsh(h.covariance)[-1]) for h in (own, other))
        # two standard uncertainties reach as far as two of the other from where that is
        both = (math.sqrt(worst) + 0.5 * shift) ** 2 * np.eye(2)
        part = slice(2 * i, 2 * i + 2)
        covariance[part, part] = both
        wider = harmonic_of(
            own.order, np.array([own.cosine.value, own.sine.value]), both,
            min(own.cosine.degrees_of_freedom, other.cosine.degrees_of_freedom), fit.unit,
        )  # fmt: skip
        # near zero the interval of a length is not symmetric
        ends = np.array([h.amplitude.interval() for h in (wider, other)])
        bounds = (float(ends[:, 0].min()), float(ends[:, 1].max()))
        harmonics.append(replace(wider, amplitude=replace(wider.amplitude, bounds=bounds)))
    set_aside = len(fit.outliers)
    note = (
        f"{set_aside} samples of {fit.samples + set_aside} were set aside: so many may be sharp "
        "errors of the scale; the intervals cover the fit with all samples as well"
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
    left: Array,
    square: float,
    turns: Turns,
    free: int,
) -> tuple[Array, Array, str]:
    """Return factors on the variance, degrees of freedom, and what they rest on."""
    first, size = problem.first, c.size
    if float(np.trace(white)) == 0.0:
        return np.ones(size), np.full(size, float(free)), "white"
    if equations.gram.shape[0] >= MANY_TURNS:
        factors, freedom = from_turns(equations, c, white, first)
        # where an order begins is chance: its cosine and sine are equally disturbed
        pooled = 0.5 * (factors[first::2] + factors[first + 1 :: 2])
        factors[first:] = np.repeat(pooled, 2)
        degrees = np.full(size, freedom)
        degrees[first:] *= 2.0
        return factors, degrees, "turns"
    if turns.direction == 0:
        return np.ones(size), np.full(size, float(free)), "white"
    per_sample = turns.count / problem.u.size
    orders = np.repeat(np.array(problem.orders, dtype=np.float64), 2) * per_sample
    lowest = np.full(first, 0.5 / problem.u.size)
    whole = math.floor(turns.count + 0.5 * per_sample)
    if whole > 1:
        left = left[: round(whole / per_sample)]
    found = from_spectrum(
        left,
        np.concatenate((lowest, orders)),
        [*([per_sample] if problem.drift else []), *orders],
        per_sample if whole > 1 else None,
    )
    if found is None:
        return np.ones(size), np.full(size, float(free)), "white"
    density, known, is_white = found
    factors = density / square
    if whole == 1:
        # that of residuals is a little less than that of what they are residuals of
        factors = factors * (left.size / free) ** 2
    return factors, np.minimum(known, free), "white" if is_white else "correlated"


def _nuisance(
    problem: HarmonicProblem, c: Array, covariance: Array, freedom: Array, unit: str
) -> tuple[Estimate, Estimate | None]:
    def estimate(value: float, variance: float, i: int) -> Estimate:
        u, own = math.sqrt(variance), float(freedom[i])
        return Estimate.of(float(value), u, unit, degrees_of_freedom=own)

    if not problem.drift:
        return estimate(c[0], covariance[0, 0], 0), None
    at = np.array([1.0, problem.middle])
    offset = estimate(float(at @ c[:2]), float(at @ covariance[:2, :2] @ at), 0)
    return offset, estimate(c[1], covariance[1, 1], 1)


def _named(
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
    kept: int,
) -> tuple[str, ...]:
    notes = []
    if turns.direction == 0:
        notes.append("the angles are in no order: noise is taken to be white")
    own = np.diag(white)[problem.first :]
    worst = math.sqrt(float(own.max()) * kept / (2.0 * square)) if square > 0.0 else 1.0
    if worst > 1.5:
        notes.append(
            f"uneven samples make a harmonic up to {worst:.1f} times as uncertain as even ones "
            f"would; {turns.coverage:.2f} of a turn has samples"
        )
    return tuple(notes)
