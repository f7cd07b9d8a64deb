"""How the figures of many stages are spread, what spreads them, and how many are good."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.files.plain import picked, plain
from flexstage.studies.explore.figures import ROUNDING, Figure, Requirement

#: Percentiles that are given of every figure [%].
PERCENTILES: tuple[float, ...] = (0.5, 2.5, 50.0, 97.5, 99.5)
#: Probability of the intervals of percentiles and yields.
CONFIDENCE = 0.95

_BINS = (12, 60)  # of a histogram, at least and at most


@dataclass(frozen=True, slots=True, kw_only=True)
class Percentile:
    """A percentile of a lot, with the interval that holds it in 95 of 100 lots."""

    percent: float
    """Share of the stages below it [%]."""
    value: float
    """The percentile, in the unit of the figure; NaN where less than one sample lies beyond it."""
    low: float
    """Lower end of its interval; minus infinity where there are too few samples for one."""
    high: float
    """Upper end of its interval; infinite where there are too few samples for one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spread:
    """How one figure of many stages is spread."""

    figure: Figure
    """The figure."""
    nominal: float
    """Of the stage as drawn, by the same model."""
    mean: float
    """Mean of the samples."""
    standard_deviation: float
    """Standard deviation of the samples."""
    percentiles: tuple[Percentile, ...]
    """The percentiles of `PERCENTILES`."""
    edges: Array
    """Edges of the bins of a histogram, shape (bins + 1,)."""
    counts: Array
    """Samples in each bin, shape (bins,)."""
    count: int
    """Number of samples that have the figure."""
    apart: int
    """Number of samples that lie more than 8 robust standard deviations from the median."""

    def data(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            **picked(self, "name=figure.name", "quantity=figure.quantity", "axis=figure.axis"),
            **picked(self, "unit=figure.shown.unit", "nominal", "mean", "standard_deviation"),
            **picked(self, "count", "apart", "percentiles"),
            "histogram": picked(self, "edges", "counts"),
        }

    @property
    def still(self) -> bool:
        """Whether the samples differ by rounding alone."""
        return self.standard_deviation <= max(self.figure.shown.zero, ROUNDING * abs(self.nominal))

    @property
    def middle(self) -> tuple[float, float]:
        """Ends of what 95 % of the stages lie between; NaN of fewer than 40 samples."""
        found = {p.percent: p.value for p in self.percentiles}
        return found[2.5], found[97.5]


def spread_of(figure: Figure, nominal: float, values: Array) -> Spread:
    """Return how the values of a figure are spread; NaN is left out.

    The interval of a percentile is that of order statistics: of n values the k-th and the m-th
    enclose the p-quantile whatever the distribution, with k and m from the binomial distribution
    of n and p (H. A. David, H. N. Nagaraja, Order Statistics, 3rd ed. (2003), section 7.1).

    Raises
    ------
    ModelError
        No sample has the figure.
    """
    kept = np.sort(values[np.isfinite(values)])
    if not kept.size:
        raise ModelError(f"no sample has the figure {figure.name}: give a finer process")
    median = kept[(kept.size - 1) // 2]
    # standard deviation over the median absolute deviation of a normal distribution
    robust = 1.4826 * float(np.median(np.abs(kept - median)))
    ends = (kept[0], kept[-1])
    if kept.size > 200:  # a lonely value must not squeeze all others into one bin
        ends = tuple(np.quantile(kept, (0.5e-3, 1.0 - 0.5e-3)))
    width = max(ends[1] - ends[0], 1e-9 * abs(median)) or 1.0
    # as many bins as keep what is seen of chance alike
    bins = int(np.clip(2.0 * kept.size ** (1.0 / 3.0), *_BINS))
    edges = np.linspace(ends[0] - 0.04 * width, ends[1] + 0.04 * width, bins + 1)
    return Spread(
        figure=figure,
        nominal=nominal,
        mean=float(kept.mean()),
        standard_deviation=float(kept.std(ddof=1)) if kept.size > 1 else 0.0,
        percentiles=tuple(_percentile(kept, p) for p in PERCENTILES),
        edges=edges,
        counts=np.diff(np.searchsorted(kept, edges)),
        count=kept.size,
        apart=int((np.abs(kept - median) > 8.0 * robust).sum()) if robust > 0.0 else 0,
    )


def samples_for(percent: float) -> int:
    """Return how many samples have one beyond a percentile.

    Examples
    --------
    >>> samples_for(97.5), samples_for(0.5)
    (40, 200)
    """
    return math.ceil(round(100.0 / min(percent, 100.0 - percent), 6))


def _percentile(ordered: Array, percent: float) -> Percentile:
    from scipy.special import bdtr

    n, p = ordered.size, percent / 100.0
    tail = 0.5 * (1.0 - CONFIDENCE)
    # at most k of the values are below the quantile with probability tail, and more than m likewise
    below = np.arange(n)
    cumulated = bdtr(below, n, p)
    k = int(np.searchsorted(cumulated, tail, side="right")) - 1
    m = int(np.searchsorted(cumulated, 1.0 - tail))
    return Percentile(
        percent=percent,
        value=float(np.quantile(ordered, p)) if n >= samples_for(percent) else math.nan,
        low=float(ordered[k]) if k >= 0 else -math.inf,
        high=float(ordered[m]) if m < n else math.inf,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Yield:
    """The share of stages that meet a requirement, or all of them."""

    requirement: Requirement | None
    """The requirement; None for all together."""
    met: int
    """Number of samples that meet it."""
    count: int
    """Number of samples."""
    low: float
    """Lower end of the interval of the share [1]."""
    high: float
    """Upper end of the interval of the share [1]."""

    def data(self) -> dict[str, Any]:
        """Return it as plain data."""
        required = "all" if self.requirement is None else self.requirement.text
        return {"required": required} | picked(self, "met", "count", "share", "low", "high")

    @property
    def share(self) -> float:
        """Share of the samples that meet it [1]."""
        return self.met / self.count


def yield_of(met: NDArray[np.bool_], requirement: Requirement | None = None) -> Yield:
    """Return the yield of samples of which each met a requirement or did not.

    Its interval is the exact one of the binomial distribution (C. J. Clopper, E. S. Pearson,
    Biometrika 26 (1934) 404), which holds the true yield in at least 95 of 100 lots.

    Examples
    --------
    >>> found = yield_of(np.arange(1000) >= 13)
    >>> print(f"{found.share:.1%}, {found.low:.2%} to {found.high:.2%}")
    98.7%, 97.79% to 99.31%
    """
    from scipy.special import betaincinv

    n, k, tail = met.size, int(met.sum()), 0.5 * (1.0 - CONFIDENCE)
    return Yield(
        requirement=requirement,
        met=k,
        count=n,
        low=float(betaincinv(k, n - k + 1, tail)) if k else 0.0,
        high=float(betaincinv(k + 1, n - k, 1.0 - tail)) if k < n else 1.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Contribution:
    """What a kind of deviation gives to the variance of a figure."""

    kind: str
    """The field of `Scatter`."""
    share: float
    """Share of the variance [1]."""
    slope: float
    """Change of the figure for one standard deviation of what has the largest part in it, with its
    sign, in the unit of the figure.
    """
    largest: tuple[tuple[str, float], ...]
    """The hinges or drives with the largest shares of the variance, by name [1]; empty for what is
    of the whole stage.
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class Shares:
    """Where the variance of a figure comes from."""

    figure: Figure
    """The figure."""
    contributions: tuple[Contribution, ...]
    """Kinds of deviations, the largest share first."""
    rest: float
    """Share that no straight line in the deviations explains: bent, or joint effects [1]."""

    def data(self) -> dict[str, Any]:
        """Return them as plain data."""
        return {
            **picked(self, "figure=figure.name", "explained"),
            "contributions": [
                {**picked(c, "kind", "share", "slope"), "largest": plain(dict(c.largest))}
                for c in self.contributions
            ],
        }

    @property
    def explained(self) -> float:
        """Share of the variance that straight lines explain, R^2 [1]."""
        return 1.0 - self.rest


def shares_of(
    figures: Sequence[Figure], parts: Sequence[tuple[str, str]], numbers: Array, values: Array
) -> tuple[Shares, ...]:
    r"""Return the first-order shares of the variance of each figure.

    A straight line :math:`y = a + \sum_j b_j z_j` is fitted by least squares to the samples, whose
    deviations :math:`z_j` are independent with variance 1, so that :math:`b_j^2/\mathrm{var}\,y` is
    the first-order index of Sobol' of a linear model (A. Saltelli et al., Global Sensitivity
    Analysis (2008), eq. 1.22). What chance adds to :math:`b_j^2` is taken off.

    Parameters
    ----------
    figures : sequence of Figure
        The figures.
    parts : sequence of tuple
        Kind, and hinge or drive, of each column of the numbers.
    numbers : numpy.ndarray
        Deviations in standard deviations, shape (samples, parts).
    values : numpy.ndarray
        The figures, NaN where a sample has none, shape (samples, figures).

    Raises
    ------
    ModelError
        There are not twice as many samples as deviations.
    """
    good = np.isfinite(values).all(axis=1)
    z, y = numbers[good], values[good]
    n, m = z.shape
    if n < 2 * m + 2:
        raise ModelError(
            f"{n} samples are too few to tell {m} deviations apart: take {2 * m + 2} or more"
        )
    mean, centre = y.mean(axis=0), z.mean(axis=0)
    z = z - centre
    gram = z.T @ z
    slopes = np.linalg.solve(gram, z.T @ (y - mean))
    left = y - mean - z @ slopes
    freedom = n - m - 1
    noise = (left**2).sum(axis=0) / freedom
    part = slopes**2 - np.outer(np.diag(np.linalg.inv(gram)), noise)
    # of the fitted model: that of the samples is off by chance, and shares would not add up to one
    variance = np.maximum(part.sum(axis=0), 0.0) + noise
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(variance > 0.0, part / variance, 0.0)
    return tuple(
        Shares(
            figure=figure,
            contributions=_by_kind(parts, slopes[:, f], share[:, f]),
            rest=float(noise[f] / variance[f]) if variance[f] > 0.0 else 0.0,
        )
        for f, figure in enumerate(figures)
    )


def _by_kind(
    parts: Sequence[tuple[str, str]], slopes: Array, share: Array
) -> tuple[Contribution, ...]:
    sums: dict[str, dict[str, float]] = {}
    steepest: dict[str, float] = {}
    for (kind, name), slope, each in zip(parts, slopes.tolist(), share.tolist(), strict=True):
        of = sums.setdefault(kind, {})
        of[name] = of.get(name, 0.0) + each
        if abs(slope) > abs(steepest.get(kind, 0.0)):
            steepest[kind] = slope
    found = [
        Contribution(
            kind=kind,
            share=max(sum(of.values()), 0.0),
            slope=steepest.get(kind, 0.0),
            largest=_largest(of),
        )
        for kind, of in sums.items()
    ]
    return tuple(sorted(found, key=lambda c: -c.share))


def _largest(of: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    named = [(name, share) for name, share in of.items() if name and share > 0.0]
    return tuple(sorted(named, key=lambda pair: -pair[1]))
