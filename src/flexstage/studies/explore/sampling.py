"""Points in a box of parameters, on a grid or spread over it, and what varies between them.

Sobol' indices, first order and total, with intervals, come from points of Saltelli's plan.
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
    """Return every combination of evenly spaced values, both ends among them.

    The last variable changes fastest, as in nested loops.

    Examples
    --------
    >>> grid_points(np.array([0.0, 5.0]), np.array([1.0, 7.0]), (2, 3)).tolist()
    [[0.0, 5.0], [0.0, 6.0], [0.0, 7.0], [1.0, 5.0], [1.0, 6.0], [1.0, 7.0]]
    """
    _require(math.prod(counts))
    if min(counts) < 2:
        raise ModelError(f"a grid has 2 values of a variable or more, got {min(counts)}")
    values = [np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)]
    return np.stack(np.meshgrid(*values, indexing="ij"), axis=-1).reshape(-1, len(counts))


def grid_counts(samples: int, given: Sequence[int | None]) -> tuple[int, ...]:
    """Return how many values of each variable a grid of at most so many points has.

    Those that are given are kept; the others have the same count, 2 at least.

    Examples
    --------
    >>> grid_counts(400, (None, None)), grid_counts(100, (6, None))
    ((20, 20), (6, 16))
    """
    free = sum(count is None for count in given)
    share = samples / math.prod(count for count in given if count is not None)
    each = max(2, math.floor(share ** (1.0 / free) + 1e-9)) if free else 0
    return tuple(each if count is None else count for count in given)


def latin_hypercube_points(low: Array, high: Array, samples: int, seed: int) -> Array:
    """Return points of which each variable has one in each of `samples` equal slices.

    McKay, Beckman and Conover 1979, by SciPy.
    """
    from scipy.stats.qmc import LatinHypercube

    _require(samples)
    # SciPy before 1.15 knows no other name for it
    generator: dict[str, Any] = {"seed": np.random.default_rng(seed)}
    unit = LatinHypercube(len(low), **generator).random(samples)
    return low + unit * (high - low)


def sobol_points(low: Array, high: Array, samples: int, seed: int) -> Array:
    """Return the first points of a Sobol' sequence, scrambled by a seed (Owen 1998), by SciPy.

    There are as many as the next power of 2 from `samples` on: with another count the points would
    not be balanced. The first half of them is what half the count would have been.
    """
    return low + _sobol(len(low), samples, seed) * (high - low)


def saltelli_points(low: Array, high: Array, samples: int, seed: int) -> Array:
    """Return the points from which `flexstage.studies.explore.sampling` are estimated.

    For each of N base samples, the next power of 2 from `samples` on, these d + 2 points follow one
    another: a_j and b_j, independent of each other, then a_j with one coordinate after the other
    taken from b_j (Saltelli et al. 2010, sec. 3). Both are halves of the points of one Sobol'
    sequence in 2 d dimensions.

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
    """Return the smallest power of 2 that is not below a count.

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


# Points that are looked at where no number is given: of one variable, of a grid of two, and of a
# sequence, which is also the number of base samples. Models of elements take longer.
_USUAL = {"lumped": (25, 400, 256), "superelement": (13, 49, 64)}
_USUAL_OTHERS = (7, 16, 16)


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPlan:
    """Which stages a sweep looks at."""

    sampling: Sampling
    """How points are spread over the box of the variables."""
    samples: int
    """How many are asked for: at most so many on a grid, at least so many of a Sobol' sequence;
    with `indices` the base samples, each of which needs two points and one for each variable."""
    seed: int = 0
    """Seed of what is drawn at random."""
    indices: bool = False
    """Whether Sobol' indices are estimated, from points of their own kind."""

    def __post_init__(self) -> None:
        if self.indices and self.sampling != "sobol":
            raise ModelError(
                f"Sobol' indices need points of a Sobol' sequence, got '{self.sampling}': leave "
                "the plan out"
            )
        if self.indices and self.samples < FEWEST:
            raise ModelError(
                f"Sobol' indices need {FEWEST} base samples or more, got {self.samples}"
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
        """What is done otherwise than it was asked for."""
        count = next_power_of_two(self.samples)
        if self.sampling != "sobol" or count == self.samples:
            return ()
        what = "base samples" if self.indices else "points"
        return (f"{count} {what} instead of {self.samples}: a Sobol' sequence goes in powers of 2",)

    def counts(self, variables: Sequence[Variable]) -> tuple[int, ...]:
        """Return how many values of each variable there are on a grid; nothing for other points."""
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
    """Return a plan of which something is left open.

    One or two variables are looked at on a grid, more by a Sobol' sequence, and as many points as
    can be waited for.
    """
    few = len(variables) <= 2
    if sampling is None:
        counted = all(variable.count is not None for variable in variables)
        sampling = "grid" if (few or counted) and not indices else "sobol"
    if samples is None:
        usual = _USUAL.get(model, _USUAL_OTHERS)
        samples = usual[len(variables) - 1 if few and sampling == "grid" else 2]
    return SweepPlan(sampling=sampling, samples=samples, seed=seed, indices=indices)


#: Largest share of base samples that may hold an impossible stage.
LARGEST_SHARE_LEFT_OUT = 0.05
#: Fewest base samples that intervals are estimated from.
FEWEST = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class SobolIndices:
    """Shares of the variance of figures over a box of variables that are independent and uniform.

    Arrays have a row for each figure and a column for each variable (F, d); NaN in the row of a
    figure that does not vary.
    """

    first: Array
    """Share that varying the variable alone explains, first order."""
    first_low: Array
    """Lower end of its interval."""
    first_high: Array
    """Upper end of its interval."""
    total: Array
    """Share in which the variable has a part, alone or together with others."""
    total_low: Array
    """Lower end of its interval."""
    total_high: Array
    """Upper end of its interval."""
    samples: int
    """Base samples N that the estimate is made of; N (d + 2) stages."""
    left_out: int
    """Base samples that were left out, as one of their stages is impossible."""
    confidence: float
    """Coverage of the intervals."""


def sobol_indices(
    values: Array, seed: int = 0, *, confidence: float = 0.95, resamples: int = 1000
) -> SobolIndices:
    r"""Estimate Sobol' indices from the values at `flexstage.studies.explore.saltelli_points`.

    With :math:`f` less its mean, :math:`V` its variance over all :math:`a` and :math:`b`,

    .. math::

        S_i = \frac{1}{N V} \sum_j f(b_j) \left(f(ab^{(i)}_j) - f(a_j)\right), \qquad
        S_{Ti} = \frac{1}{2 N V} \sum_j \left(f(a_j) - f(ab^{(i)}_j)\right)^2

    (Saltelli, Annoni, Azzini, Campolongo, Ratto and Tarantola 2010, table 2, b and f; the latter is
    Jansen's). Intervals are those between quantiles of the same from base samples drawn with
    replacement (Archer, Saltelli and Sobol' 1997).

    Parameters
    ----------
    values : Array
        Figures (N, d + 2, F) at a, b, and a with the i-th coordinate of b; NaN where impossible.
    seed : int
        Seed of the resampling.
    confidence : float
        Coverage of the intervals.
    resamples : int
        How often the base samples are drawn again.

    Returns
    -------
    SobolIndices
        The indices.

    Validity
    --------
    Variables are independent and uniform over their bounds. Both estimates are free of bias but for
    the division by an estimated variance. The points of a Sobol' sequence lie more evenly than
    independent ones, for which the resampling stands: of smooth functions the intervals are wider
    than they need be. A base sample with an impossible stage is left out, up to 5 % of them, and
    the shares are then those over what is left, where variables are no longer quite independent.

    Raises
    ------
    ModelError
        Too many stages are impossible, or fewer than 16 base samples are left.

    Examples
    --------
    Of the sum of one variable and the double of another, 1/5 and 4/5:

    >>> from flexstage.studies.explore.sampling import saltelli_points
    >>> points = saltelli_points(np.zeros(2), np.ones(2), 1024, seed=1)
    >>> found = sobol_indices((points @ [[1.0], [2.0]]).reshape(1024, 4, 1), seed=1)
    >>> found.first.round(3).tolist(), found.total.round(3).tolist()
    ([[0.2, 0.8]], [[0.2, 0.8]])
    """
    possible = np.isfinite(values).all(axis=(1, 2))
    asked, kept = len(values), int(possible.sum())
    if asked - kept > LARGEST_SHARE_LEFT_OUT * asked:
        raise ModelError(
            f"{asked - kept} of {asked} base samples hold an impossible stage, more than the "
            f"{100.0 * LARGEST_SHARE_LEFT_OUT:g} % that may be left out: Sobol' indices need "
            "bounds between which nearly every stage is possible"
        )
    if kept < FEWEST:
        raise ModelError(
            f"Sobol' indices need {FEWEST} base samples or more, got {kept}: ask for more samples"
        )
    f = values[possible]
    f = f - f[:, :2].mean(axis=(0, 1))
    one = np.ones((1, kept))
    first, total = (part[0] for part in _estimates(f, one))
    counts = np.random.default_rng(seed).multinomial(kept, np.full(kept, 1.0 / kept), resamples)
    drawn = _estimates(f, counts.astype(float))
    ends = [0.5 * (1.0 - confidence), 0.5 * (1.0 + confidence)]
    (first_low, first_high), (total_low, total_high) = (
        np.quantile(part, ends, axis=0) for part in drawn
    )
    size = np.abs(values[possible]).max(axis=(0, 1))
    still = np.ptp(f[:, :2], axis=(0, 1)) <= ROUNDING * size
    for part in (first, first_low, first_high, total, total_low, total_high):
        part[still] = np.nan
    return SobolIndices(
        first=first,
        first_low=first_low,
        first_high=first_high,
        total=total,
        total_low=total_low,
        total_high=total_high,
        samples=kept,
        left_out=asked - kept,
        confidence=confidence,
    )


def _estimates(f: Array, counts: Array) -> tuple[Array, Array]:
    """Return both indices (R, F, d) of samples (N, d + 2, F), each taken so many times (R, N)."""
    n, rest, figures = f.shape
    a, b, ab = f[:, 0], f[:, 1], f[:, 2:]
    shape = (len(counts), rest - 2, figures)

    def mean(x: Array) -> Array:
        return (counts @ x.reshape(n, -1)) / n

    middle = 0.5 * (mean(a) + mean(b))
    # no smaller than rounding: what does not vary is told apart by who calls
    variance = np.maximum(0.5 * (mean(a * a) + mean(b * b)) - middle**2, np.finfo(float).tiny)
    first = mean(b[:, None] * (ab - a[:, None])).reshape(shape) / variance[:, None]
    total = 0.5 * mean((a[:, None] - ab) ** 2).reshape(shape) / variance[:, None]
    return first.swapaxes(1, 2), total.swapaxes(1, 2)
