"""Sampling plans over the ranges of parameters, and Sobol' indices.

Sobol' indices of first order and total, with confidence intervals, need Saltelli's sampling plan.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.studies.explore.figures import ROUNDING
from flexstage.studies.explore.requests import LARGEST, Sampling
from flexstage.studies.explore.variables import Variable


def grid_points(low: Array, high: Array, counts: Sequence[int]) -> Array:
    """Return all combinations of evenly spaced values, including the bounds.

    The last variable changes fastest.

    Examples
    --------
    >>> grid_points(np.array([0.0, 5.0]), np.array([1.0, 7.0]), (2, 3)).tolist()
    [[0.0, 5.0], [0.0, 6.0], [0.0, 7.0], [1.0, 5.0], [1.0, 6.0], [1.0, 7.0]]
    """
    _require(math.prod(counts))
    if min(counts) < 2:
        raise ModelError(f"a grid needs 2 or more values of a variable, got {min(counts)}")
    values = [np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)]
    return np.stack(np.meshgrid(*values, indexing="ij"), axis=-1).reshape(-1, len(counts))


def grid_counts(samples: int, counts: Sequence[int | None]) -> tuple[int, ...]:
    """Return the number of values of each variable for a grid with a limited number of points.

    Given counts are kept; the others are equal, and at least 2.

    Examples
    --------
    >>> grid_counts(400, (None, None)), grid_counts(100, (6, None))
    ((20, 20), (6, 16))
    """
    free = sum(count is None for count in counts)
    share = samples / math.prod(count for count in counts if count is not None)
    each = max(2, math.floor(share ** (1.0 / free) + 1e-9)) if free else 0
    return tuple(each if count is None else count for count in counts)


def latin_hypercube_points(low: Array, high: Array, samples: int, seed: int) -> Array:
    """Return a Latin hypercube: one point in each of `samples` equal slices of each variable.

    McKay, Beckman and Conover 1979, by SciPy.
    """
    from scipy.stats.qmc import LatinHypercube

    _require(samples)
    # SciPy before 1.15 has only this argument
    generator: dict[str, Any] = {"seed": np.random.default_rng(seed)}
    unit = LatinHypercube(len(low), **generator).random(samples)
    return low + unit * (high - low)


def sobol_points(low: Array, high: Array, samples: int, seed: int) -> Array:
    """Return the first points of a Sobol' sequence, scrambled by a seed (Owen 1998), by SciPy.

    The number is `samples` rounded up to a power of 2, so that the points are balanced. The first
    half of them is the sequence of half the number.
    """
    return low + _sobol(len(low), samples, seed) * (high - low)


def saltelli_points(low: Array, high: Array, samples: int, seed: int) -> Array:
    """Return the points for the estimation of Sobol' indices (`sobol_indices`).

    The number N of base samples is `samples` rounded up to a power of 2. Each has d + 2 points: the
    independent points a_j and b_j, then a_j with each coordinate in turn from b_j (Saltelli et al.
    2010, sec. 3). Both are halves of the points of one Sobol' sequence in 2 d dimensions.

    Returns
    -------
    Array
        The points (N (d + 2), d).
    """
    d = len(low)
    both = _sobol(2 * d, samples, seed)
    _require(len(both) * (d + 2))
    a, b = both[:, :d], both[:, d:]
    points = np.repeat(a[:, None, :], d + 2, axis=1)
    points[:, 1, :] = b
    each = np.arange(d)
    points[:, 2 + each, each] = b
    return low + points.reshape(-1, d) * (high - low)


def next_power_of_two(count: int) -> int:
    """Return the smallest power of 2 that is at least a count.

    Examples
    --------
    >>> next_power_of_two(100), next_power_of_two(128)
    (128, 128)
    """
    return 1 << max(count - 1, 0).bit_length()


def _sobol(dimensions: int, samples: int, seed: int) -> Array:
    from scipy.stats.qmc import Sobol

    _require(samples)
    count = next_power_of_two(samples)
    generator: dict[str, Any] = {"seed": np.random.default_rng(seed)}
    return Sobol(dimensions, scramble=True, **generator).random_base2(count.bit_length() - 1)


def _require(samples: int) -> None:
    if not 1 <= samples <= LARGEST:
        raise ModelError(f"the number of samples must be 1 to {LARGEST}, got {samples}")


# Default number of points: for one variable, for a grid of two, and for a sequence, also the number
# of base samples. Finite-element models take longer.
_DEFAULTS = {"lumped": (25, 400, 256), "superelement": (13, 49, 64)}
_DEFAULTS_OF_OTHERS = (7, 16, 16)


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPlan:
    """Sampling plan of a sweep."""

    sampling: Sampling
    """Kind of sampling."""
    samples: int
    """Requested number of points: the upper limit for a grid, the lower one for a Sobol' sequence;
    with `indices` the number of base samples, each with two points more than variables."""
    seed: int = 0
    """Random seed."""
    indices: bool = False
    """True to estimate Sobol' indices, with Saltelli's plan."""

    def __post_init__(self) -> None:
        if self.indices and self.sampling != "sobol":
            raise ModelError(
                f"Sobol' indices need points of a Sobol' sequence, got '{self.sampling}': omit the "
                "plan"
            )
        if self.indices and self.samples < FEWEST_SAMPLES:
            raise ModelError(
                f"Sobol' indices need {FEWEST_SAMPLES} or more base samples, got {self.samples}"
            )

    def points(self, variables: Sequence[Variable]) -> Array:
        """Return the points (S, d) [SI]."""
        low = np.array([variable.low for variable in variables])
        high = np.array([variable.high for variable in variables])
        if self.indices:
            return saltelli_points(low, high, self.samples, self.seed)
        match self.sampling:
            case "grid":
                return grid_points(low, high, self.counts(variables))
            case "latin-hypercube":
                return latin_hypercube_points(low, high, self.samples, self.seed)
            case "sobol":
                return sobol_points(low, high, self.samples, self.seed)

    @property
    def notes(self) -> tuple[str, ...]:
        """Differences from the request."""
        count = next_power_of_two(self.samples)
        if self.sampling != "sobol" or count == self.samples:
            return ()
        what = "base samples" if self.indices else "points"
        return (
            f"{count} {what} instead of {self.samples}: the length of a Sobol' sequence is a power "
            "of 2",
        )

    def counts(self, variables: Sequence[Variable]) -> tuple[int, ...]:
        """Return the number of values of each variable on a grid; empty for other plans."""
        if self.sampling != "grid":
            return ()
        return grid_counts(self.samples, [variable.count for variable in variables])


def usual_plan(
    variables: Sequence[Variable],
    model: str,
    *,
    sampling: Sampling | None = None,
    samples: int | None = None,
    seed: int = 0,
    indices: bool = False,
) -> SweepPlan:
    """Return a plan with defaults: a grid for one or two variables, a Sobol' sequence for more.

    The default number of points suits the computing time of the model.
    """
    few = len(variables) <= 2
    if sampling is None:
        counted = all(variable.count is not None for variable in variables)
        sampling = "grid" if (few or counted) and not indices else "sobol"
    if samples is None:
        defaults = _DEFAULTS.get(model, _DEFAULTS_OF_OTHERS)
        samples = defaults[len(variables) - 1 if few and sampling == "grid" else 2]
    return SweepPlan(sampling=sampling, samples=samples, seed=seed, indices=indices)


#: Largest share of base samples with an impossible stage.
LARGEST_EXCLUDED_SHARE = 0.05
#: Least number of base samples for confidence intervals.
FEWEST_SAMPLES = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class SobolIndices:
    """Sobol' indices: shares of the variance of figures, for independent uniform variables.

    Arrays have a row for each figure and a column for each variable (F, d); NaN for a constant
    figure.
    """

    first: Array
    """First-order indices: shares of the variables alone."""
    first_low: Array
    """Lower end of its interval."""
    first_high: Array
    """Upper end of its interval."""
    total: Array
    """Total indices: shares of the variables, alone and with others."""
    total_low: Array
    """Lower end of its interval."""
    total_high: Array
    """Upper end of its interval."""
    samples: int
    """Number N of base samples in the estimate; N (d + 2) stages."""
    excluded: int
    """Number of base samples with an impossible stage, which are excluded."""
    confidence: float
    """Confidence level of the intervals."""


def sobol_indices(
    values: Array, seed: int = 0, *, confidence: float = 0.95, resamples: int = 1000
) -> SobolIndices:
    r"""Estimate Sobol' indices from values at `saltelli_points`.

    With :math:`f` less its mean, :math:`V` its variance over all :math:`a` and :math:`b`,

    .. math::

        S_i = \frac{1}{N V} \sum_j f(b_j) \left(f(ab^{(i)}_j) - f(a_j)\right), \qquad
        S_{Ti} = \frac{1}{2 N V} \sum_j \left(f(a_j) - f(ab^{(i)}_j)\right)^2

    (Saltelli, Annoni, Azzini, Campolongo, Ratto and Tarantola 2010, table 2, b and f; the latter is
    Jansen's). Confidence intervals are bootstrap quantiles over base samples (Archer, Saltelli and
    Sobol' 1997).

    Parameters
    ----------
    values : Array
        Figures (N, d + 2, F) at a, b, and a with the i-th coordinate of b; NaN if impossible.
    seed : int
        Seed of the resampling.
    confidence : float
        Confidence level of the intervals.
    resamples : int
        Number of bootstrap samples.

    Returns
    -------
    SobolIndices
        The indices.

    Validity
    --------
    Variables are independent and uniform over their bounds. Both estimates are unbiased, except for
    the division by an estimated variance. Points of a Sobol' sequence are more even than the
    independent ones of the bootstrap, so that intervals of smooth functions are too wide. Base
    samples with an impossible stage are excluded, up to 5 %; the variables of the others are then
    not exactly independent.

    Raises
    ------
    ModelError
        Too many stages are impossible, or fewer than 16 base samples remain.

    Examples
    --------
    The sum of one variable and twice another, 1/5 and 4/5:

    >>> from flexstage.studies.explore.sampling import saltelli_points
    >>> points = saltelli_points(np.zeros(2), np.ones(2), 1024, seed=1)
    >>> indices = sobol_indices((points @ [[1.0], [2.0]]).reshape(1024, 4, 1), seed=1)
    >>> indices.first.round(3).tolist(), indices.total.round(3).tolist()
    ([[0.2, 0.8]], [[0.2, 0.8]])
    """
    possible = np.isfinite(values).all(axis=(1, 2))
    count, valid = len(values), int(possible.sum())
    if count - valid > LARGEST_EXCLUDED_SHARE * count:
        raise ModelError(
            f"{count - valid} of {count} base samples have an impossible stage, more than "
            f"{100.0 * LARGEST_EXCLUDED_SHARE:g} %: Sobol' indices need bounds within which nearly "
            "every stage is possible"
        )
    if valid < FEWEST_SAMPLES:
        raise ModelError(
            f"Sobol' indices need {FEWEST_SAMPLES} or more base samples, got {valid}: increase the "
            "number of samples"
        )
    f = values[possible]
    f = f - f[:, :2].mean(axis=(0, 1))
    first, total = (estimate[0] for estimate in _estimates(f, np.ones((1, valid))))
    counts = np.random.default_rng(seed).multinomial(valid, np.full(valid, 1.0 / valid), resamples)
    bootstrap = _estimates(f, counts.astype(float))
    ends = [0.5 * (1.0 - confidence), 0.5 * (1.0 + confidence)]
    (first_low, first_high), (total_low, total_high) = (
        np.quantile(estimate, ends, axis=0) for estimate in bootstrap
    )
    size = np.abs(values[possible]).max(axis=(0, 1))
    constant = np.ptp(f[:, :2], axis=(0, 1)) <= ROUNDING * size
    for estimate in (first, first_low, first_high, total, total_low, total_high):
        estimate[constant] = np.nan
    return SobolIndices(
        first=first,
        first_low=first_low,
        first_high=first_high,
        total=total,
        total_low=total_low,
        total_high=total_high,
        samples=valid,
        excluded=count - valid,
        confidence=confidence,
    )


def _estimates(f: Array, counts: Array) -> tuple[Array, Array]:
    """Return both indices (R, F, d) of samples (N, d + 2, F), with multiplicities (R, N)."""
    n, points, figures = f.shape
    a, b, ab = f[:, 0], f[:, 1], f[:, 2:]
    shape = (len(counts), points - 2, figures)

    def mean(x: Array) -> Array:
        return (counts @ x.reshape(n, -1)) / n

    middle = 0.5 * (mean(a) + mean(b))
    # not zero: the caller identifies constant figures
    variance = np.maximum(0.5 * (mean(a * a) + mean(b * b)) - middle**2, np.finfo(float).tiny)
    first = mean(b[:, None] * (ab - a[:, None])).reshape(shape) / variance[:, None]
    total = 0.5 * mean((a[:, None] - ab) ** 2).reshape(shape) / variance[:, None]
    return first.swapaxes(1, 2), total.swapaxes(1, 2)
