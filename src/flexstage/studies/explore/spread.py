"""Statistics of samples: scatter of figures, contributions to the variance, yield."""

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

#: Percentiles of every figure [%].
PERCENTILES: tuple[float, ...] = (0.5, 2.5, 50.0, 97.5, 99.5)
#: Probability of the intervals of percentiles and yields.
CONFIDENCE = 0.95

_BINS = (12, 60)  # least and largest number of bins of a histogram


@dataclass(frozen=True, slots=True, kw_only=True)
class Percentile:
    """A percentile of samples with its 95 % confidence interval."""

    percent: float
    """Share of stages below [%]."""
    value: float
    """The percentile, in the unit of the figure; NaN if less than one sample is beyond it."""
    low: float
    """Lower end of the interval; minus infinity with too few samples."""
    high: float
    """Upper end of the interval; infinity with too few samples."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spread:
    """Scatter of a figure of many stages."""

    figure: Figure
    """The figure."""
    nominal: float
    """Figure of the nominal stage by the same model."""
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
    """Number of samples with the figure."""
    outliers: int
    """Number of samples more than 8 robust standard deviations from the median."""

    def data(self) -> dict[str, Any]:
        """Return the statistics as plain data."""
        return {
            **picked(self, "name=figure.name", "quantity=figure.quantity", "axis=figure.axis"),
            **picked(self, "unit=figure.display.unit", "nominal", "mean", "standard_deviation"),
            **picked(self, "count", "outliers", "percentiles"),
            "histogram": picked(self, "edges", "counts"),
        }

    @property
    def constant(self) -> bool:
        """True if the samples differ by rounding errors alone."""
        return self.standard_deviation <= max(
            self.figure.display.zero, ROUNDING * abs(self.nominal)
        )

    @property
    def middle(self) -> tuple[float, float]:
        """Ends of the central 95 % range; NaN with fewer than 40 samples."""
        percentiles = {p.percent: p.value for p in self.percentiles}
        return percentiles[2.5], percentiles[97.5]


def spread_of(figure: Figure, nominal: float, values: Array) -> Spread:
    """Return the statistics of values of a figure, without NaN.

    The interval of a percentile is that of order statistics: the k-th and the m-th of n values
    enclose the p-quantile of any distribution, with k and m from the binomial distribution of n and
    p (H. A. David, H. N. Nagaraja, Order Statistics, 3rd ed. (2003), section 7.1).

    Raises
    ------
    ModelError
        No sample has the figure.
    """
    ordered = np.sort(values[np.isfinite(values)])
    if not ordered.size:
        raise ModelError(f"no sample has the figure {figure.name}: reduce the scatter")
    median = ordered[(ordered.size - 1) // 2]
    # standard deviation over the median absolute deviation of a normal distribution
    robust = 1.4826 * float(np.median(np.abs(ordered - median)))
    ends = (ordered[0], ordered[-1])
    if ordered.size > 200:  # an outlier must not squeeze all other values into one bin
        ends = tuple(np.quantile(ordered, (0.5e-3, 1.0 - 0.5e-3)))
    width = max(ends[1] - ends[0], 1e-9 * abs(median)) or 1.0
    # Rice's rule
    bins = int(np.clip(2.0 * ordered.size ** (1.0 / 3.0), *_BINS))
    edges = np.linspace(ends[0] - 0.04 * width, ends[1] + 0.04 * width, bins + 1)
    return Spread(
        figure=figure,
        nominal=nominal,
        mean=float(ordered.mean()),
        standard_deviation=float(ordered.std(ddof=1)) if ordered.size > 1 else 0.0,
        percentiles=tuple(_percentile(ordered, p) for p in PERCENTILES),
        edges=edges,
        counts=np.diff(np.searchsorted(ordered, edges)),
        count=ordered.size,
        outliers=int((np.abs(ordered - median) > 8.0 * robust).sum()) if robust > 0.0 else 0,
    )


def samples_for(percent: float) -> int:
    """Return the number of samples of which one is beyond a percentile.

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
    # k or fewer values are below the quantile with probability tail, and more than m likewise
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
    """Yield: the share of stages that meet one requirement or all of them."""

    requirement: Requirement | None
    """The requirement; None for all of them."""
    met: int
    """Number of good samples."""
    count: int
    """Number of samples."""
    low: float
    """Lower end of the confidence interval [1]."""
    high: float
    """Upper end of the confidence interval [1]."""

    def data(self) -> dict[str, Any]:
        """Return the yield as plain data."""
        required = "all" if self.requirement is None else self.requirement.text
        return {"required": required} | picked(self, "met", "count", "share", "low", "high")

    @property
    def share(self) -> float:
        """Share of good samples [1]."""
        return self.met / self.count


def yield_of(met: NDArray[np.bool_], requirement: Requirement | None = None) -> Yield:
    """Return the yield of samples that are good or not.

    The interval is the exact one of the binomial distribution (C. J. Clopper, E. S. Pearson,
    Biometrika 26 (1934) 404), with a coverage of at least 95 %.

    Examples
    --------
    >>> good = yield_of(np.arange(1000) >= 13)
    >>> print(f"{good.share:.1%}, {good.low:.2%} to {good.high:.2%}")
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
    """Contribution of a kind of deviation to the variance of a figure."""

    kind: str
    """The field of `Scatter`."""
    share: float
    """Share of the variance [1]."""
    slope: float
    """Change of the figure for one standard deviation of the most important deviation of the kind,
    in the unit of the figure.
    """
    largest: tuple[tuple[str, float], ...]
    """Hinges or drives with their shares of the variance, the largest first [1]; empty for a
    deviation of the whole stage.
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class Shares:
    """Contributions to the variance of a figure."""

    figure: Figure
    """The figure."""
    contributions: tuple[Contribution, ...]
    """Kinds of deviations, the largest share first."""
    unexplained: float
    """Share of nonlinear and joint effects [1]."""

    def data(self) -> dict[str, Any]:
        """Return the contributions as plain data."""
        return {
            **picked(self, "figure=figure.name", "explained"),
            "contributions": [
                {**picked(c, "kind", "share", "slope"), "largest": plain(dict(c.largest))}
                for c in self.contributions
            ],
        }

    @property
    def explained(self) -> float:
        """Share of the variance that a linear model explains, R^2 [1]."""
        return 1.0 - self.unexplained


def shares_of(
    figures: Sequence[Figure], parts: Sequence[tuple[str, str]], numbers: Array, values: Array
) -> tuple[Shares, ...]:
    r"""Return the first-order shares of the variance of each figure.

    A linear model :math:`y = a + \sum_j b_j z_j` is fitted by least squares to the samples, whose
    deviations :math:`z_j` are independent with variance 1, so that :math:`b_j^2/\mathrm{var}\,y` is
    the first-order index of Sobol' of a linear model (A. Saltelli et al., Global Sensitivity
    Analysis (2008), eq. 1.22). The bias of :math:`b_j^2` is subtracted.

    Parameters
    ----------
    figures : sequence of Figure
        The figures.
    parts : sequence of tuple
        Kind, and hinge or drive, of each column of the numbers.
    numbers : numpy.ndarray
        Standard normal deviations, shape (samples, parts).
    values : numpy.ndarray
        The figures, NaN for missing ones, shape (samples, figures).

    Raises
    ------
    ModelError
        There are fewer than two samples per deviation.
    """
    good = np.isfinite(values).all(axis=1)
    z, y = numbers[good], values[good]
    n, m = z.shape
    if n < 2 * m + 2:
        raise ModelError(f"{n} samples are too few for {m} deviations: use {2 * m + 2} or more")
    mean, centre = y.mean(axis=0), z.mean(axis=0)
    z = z - centre
    gram = z.T @ z
    slopes = np.linalg.solve(gram, z.T @ (y - mean))
    residual = y - mean - z @ slopes
    freedom = n - m - 1
    noise = (residual**2).sum(axis=0) / freedom
    part = slopes**2 - np.outer(np.diag(np.linalg.inv(gram)), noise)
    # variance of the fitted model, so that the shares add up to one
    variance = np.maximum(part.sum(axis=0), 0.0) + noise
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(variance > 0.0, part / variance, 0.0)
    return tuple(
        Shares(
            figure=figure,
            contributions=_by_kind(parts, slopes[:, f], share[:, f]),
            unexplained=float(noise[f] / variance[f]) if variance[f] > 0.0 else 0.0,
        )
        for f, figure in enumerate(figures)
    )


def _by_kind(
    parts: Sequence[tuple[str, str]], slopes: Array, share: Array
) -> tuple[Contribution, ...]:
    sums: dict[str, dict[str, float]] = {}
    steepest: dict[str, float] = {}
    for (kind, name), slope, each in zip(parts, slopes.tolist(), share.tolist(), strict=True):
        shares = sums.setdefault(kind, {})
        shares[name] = shares.get(name, 0.0) + each
        if abs(slope) > abs(steepest.get(kind, 0.0)):
            steepest[kind] = slope
    contributions = [
        Contribution(
            kind=kind,
            share=max(sum(shares.values()), 0.0),
            slope=steepest.get(kind, 0.0),
            largest=_largest(shares),
        )
        for kind, shares in sums.items()
    ]
    return tuple(sorted(contributions, key=lambda c: -c.share))


def _largest(shares: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    pairs = [(name, share) for name, share in shares.items() if name and share > 0.0]
    return tuple(sorted(pairs, key=lambda pair: -pair[1]))
