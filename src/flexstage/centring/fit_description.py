"""From the coefficients of a fit to harmonics with uncertainty, and what a reader should know."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.centring.harmonic_fit import HarmonicFit, harmonic_of
from flexstage.centring.normal_equations import HarmonicProblem, NormalEquations
from flexstage.centring.outliers import Outlier
from flexstage.centring.residual_noise import from_spectrum, from_turns
from flexstage.centring.turns import Turns
from flexstage.errors import RecordError
from flexstage.estimate import Estimate

#: From so many turns on their scatter tells the noise, whatever it is like.
MANY_TURNS = 8
#: Share of the variance of white noise from which a record says that its noise lasts.
_WIDE = 6.0
_LASTING = (
    "what is left lasts from sample to sample, and makes the low orders more uncertain: fit more "
    "orders if there are harmonics in it, or measure more turns if it is drift",
)


def described(
    problem: HarmonicProblem,
    equations: NormalEquations,
    c: Array,
    residual: Array,
    weights: Array | None,
    keep: NDArray[np.bool_] | None,
    turns: Turns,
    unit: str,
) -> HarmonicFit:
    """Return the harmonics of one column, with uncertainty and notes.

    `c` are its coefficients, shape (p,), `residual` what they leave of all samples, shape (n,), and
    `keep` which samples were kept, all where None.
    """
    kept = residual if keep is None else residual[keep]
    w = None if weights is None else (weights if keep is None else weights[keep])
    free = kept.size - c.size
    if free < 1:
        raise RecordError(
            f"{kept.size} samples without outliers are too few for {c.size} coefficients: fit "
            "fewer orders"
        )
    scaled = kept if w is None else kept * np.sqrt(w)
    square = float(scaled @ scaled) / free
    white = square * np.linalg.inv(equations.gram.sum(axis=0))
    factors, freedom, noise = _noise(
        problem, equations, c, white, _whole(residual, weights, keep), square, turns, free
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
    rms = math.sqrt(float(kept @ kept) / free)
    return HarmonicFit(
        harmonics=harmonics,
        offset=offset,
        drift=drift,
        covariance=covariance[first:, first:],
        residual=residual,
        residual_rms=rms,
        samples=int(kept.size),
        turns=turns.count,
        outliers=_named(problem, residual, keep, turns),
        noise=noise,
        unit=unit,
        notes=_notes(problem, white, square, turns, kept.size)
        + (_LASTING if noise == "correlated" and float(factors[first:].max()) > _WIDE else ()),
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


def _noise(
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
    factors = found.density / square
    if whole == 1:
        # that of residuals is a little less than that of what they are residuals of
        factors = factors * (left.size / free) ** 2
    return factors, np.minimum(found.freedom, free), "white" if found.white else "correlated"


def _whole(residual: Array, weights: Array | None, keep: NDArray[np.bool_] | None) -> Array:
    """Return the residuals in the order of the samples, as weighed; none where set aside."""
    left = residual if weights is None else residual * np.sqrt(weights)
    return left if keep is None else np.where(keep, left, 0.0)


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
