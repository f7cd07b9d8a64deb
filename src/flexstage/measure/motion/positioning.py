"""Accuracy and repeatability of linear and rotary axes at targets, as in ISO 230-2."""

import math
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.files.plain import picked, plain
from flexstage.quantities.estimate import Estimate
from flexstage.quantities.quantity import prefixed

#: Figures that are spreads: their errors are in proportion to them.
_SPREADS = ("repeatability_upward", "repeatability_downward")
#: Means within so many times their noise of the extreme one may be as extreme.
_NEAR = 2.0
#: Figures that may have either sign.
_SIGNED = ("mean_reversal",)
#: Figures of simulated measurements, and those behind them.
_Pair = tuple[Array, Array]
_TURN = 2.0 * math.pi
#: Rounding of a target, relative to the travel.
_SAME = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Positioning:
    r"""Figures of positioning along an axis, named and defined as in ISO 230-2:2014, clause 3.

    With the positional deviations :math:`x_{ij}` of target i in run j, approached upward or
    downward, their mean :math:`\bar x_i` over the n runs and their standard deviation
    :math:`s_i` with n - 1. Of a rotary axis, all lengths [m] are angles [rad].
    """

    target: Array
    """Target positions, rising [m], shape (m,)."""
    mean_upward: Array
    """Mean unidirectional positional deviations from below [m], shape (m,)."""
    mean_downward: Array
    """Mean unidirectional positional deviations from above [m], shape (m,)."""
    spread_upward: Array
    """Estimators s of the unidirectional repeatability at each target from below [m], shape (m,).
    """
    spread_downward: Array
    """Estimators s of the unidirectional repeatability at each target from above [m], shape (m,).
    """
    runs: int
    """Number n of runs upward and downward."""
    reversal: Estimate
    """Reversal value B of the axis: the largest magnitude of the mean upward less the mean downward
    deviation [m].
    """
    mean_reversal: Estimate
    """Mean over the targets of upward less downward [m]."""
    repeatability_upward: Estimate
    """Unidirectional repeatability from below: the largest of R_i = 4 s_i [m]."""
    repeatability_downward: Estimate
    """Unidirectional repeatability from above: the largest of R_i = 4 s_i [m]."""
    repeatability: Estimate
    """Bidirectional repeatability R: the largest of ``max(2 s_i up + 2 s_i down + |B_i|, R_i up,
    R_i down)`` [m].
    """
    systematic_upward: Estimate
    """Unidirectional systematic positional deviation E from below: largest less smallest mean [m].
    """
    systematic_downward: Estimate
    """Unidirectional systematic positional deviation E from above: largest less smallest mean [m].
    """
    systematic: Estimate
    """Bidirectional systematic positional deviation E: the same over both directions [m]."""
    mean_deviation: Estimate
    """Mean bidirectional positional deviation M: largest less smallest of the means of both [m]."""
    accuracy_upward: Estimate
    """Unidirectional accuracy A from below: largest of mean + 2 s less smallest of mean - 2 s [m].
    """
    accuracy_downward: Estimate
    """Unidirectional accuracy A from above: largest of mean + 2 s less smallest of mean - 2 s [m].
    """
    accuracy: Estimate
    """Bidirectional accuracy A: the same over both directions [m]."""
    unit: Literal["m", "rad"] = "m"
    """Unit of targets and figures: rad of a rotary axis."""
    closure: Estimate | None = None
    """Of a rotary axis with targets over whole turns: mean deviation at the last target less that
    at the first [rad].
    """

    def data(self) -> dict[str, Any]:
        """Return all of it as plain data, in SI units."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        keys = "value", "unit", "uncertainty", "interval"
        at_targets = {
            "target": self.target,
            "mean_upward": self.mean_upward,
            "mean_downward": self.mean_downward,
            "mean_bidirectional": self.mean_bidirectional,
            "reversal": self.reversal_at_targets,
            "spread_upward": self.spread_upward,
            "spread_downward": self.spread_downward,
            "repeatability_upward": 4.0 * self.spread_upward,
            "repeatability_downward": 4.0 * self.spread_downward,
            "repeatability": self.repeatability_at_targets,
        }
        return {
            "runs": self.runs,
            "figures": {n: picked(e, *keys) for n, e in values.items() if isinstance(e, Estimate)},
            "targets": plain(at_targets),
        }

    @property
    def shown_units(self) -> tuple[tuple[float, str], tuple[float, str]]:
        """Factor and name of the printed units of targets, and of figures."""
        if self.unit == "rad":
            return (180.0 / math.pi, "deg"), (180.0 * 3600.0 / math.pi, "arcsec")
        largest = float(np.abs(self.target).max()), abs(self.accuracy.value)
        (across, first), (factor, second) = (prefixed(size) for size in largest)
        return (across, f"{first}m"), (factor, f"{second}m")

    @property
    def positions(self) -> int:
        """Number of targets; the first and the last over whole turns are one position."""
        return self.target.size - (self.closure is not None)

    @property
    def targets_required(self) -> int:
        """Least number of targets that ISO 230-2 asks for over this travel.

        Five in a metre, and five at least; of a rotary axis three up to 90 deg, five up to 180 deg,
        eight up to a turn, and eight in each turn of more.
        """
        travel = (1.0 - _SAME) * float(np.ptp(self.target))
        if self.unit == "m":
            return max(5, math.ceil(5.0 * travel))
        turns = travel / _TURN
        return 3 if turns <= 0.25 else 5 if turns <= 0.5 else max(8, math.ceil(8.0 * turns))

    @property
    def reversal_at_targets(self) -> Array:
        """Reversal values B_i: mean upward less mean downward deviation [m], shape (m,)."""
        return self.mean_upward - self.mean_downward

    @property
    def repeatability_at_targets(self) -> Array:
        """Bidirectional repeatability R_i of each target [m], shape (m,)."""
        up, down = self.spread_upward, self.spread_downward
        both = 2.0 * (up + down) + np.abs(self.reversal_at_targets)
        return np.maximum(both, 4.0 * np.maximum(up, down))

    @property
    def mean_bidirectional(self) -> Array:
        """Mean bidirectional positional deviations [m], shape (m,)."""
        return 0.5 * (self.mean_upward + self.mean_downward)


def positioning(
    target: ArrayLike,
    upward: ArrayLike,
    downward: ArrayLike,
    *,
    unit: Literal["m", "rad"] = "m",
    trials: int = 2000,
) -> Positioning:
    """Evaluate repeated approaches to targets from both sides, in the manner of ISO 230-2:2014.

    The values are those of the standard, from the data as they are. Their intervals are found by
    simulating the whole measurement, means, spreads and the run-to-run part that all targets share,
    from the values less the share of noise in them: a largest value of noisy means lies too far
    out, and the interval about it is not symmetric.

    Where the targets of a rotary axis go over whole turns, the first and the last are one position
    that was measured twice. It counts once in the mean reversal; its closure error is an error of
    the axis or of the instrument, stays in all figures, and is given apart.

    Parameters
    ----------
    target : array_like
        Target positions [`unit`], shape (m,).
    upward, downward : array_like
        Positions reached from below and from above [`unit`], shape (m, n): one column for each run.
    unit : str
        m of a linear axis, rad of a rotary one; angles are unwrapped.
    trials : int
        How many measurements are simulated.

    Returns
    -------
    Positioning
        All figures.

    Validity
    --------
    Runs that differ by chance only: a drift from run to run counts as lack of repeatability, as the
    standard has it. The standard asks for n = 5 runs and, of axes up to 2 m, at least five targets
    in a metre, of rotary axes `Positioning.targets_required`; two of each are enough here, with an
    uncertainty that says so. The measurement
    uncertainty of the instrument is not in it.

    Raises
    ------
    RecordError
        There are fewer than two targets or two runs, the shapes do not belong together, or a value
        is not finite.

    Examples
    --------
    >>> target = np.array([0.0, 20e-6, 40e-6])
    >>> up = target[:, None] + 1e-9 * np.array([[2, 4, 3], [7, 8, 12], [-3, 1, -1]])
    >>> down = target[:, None] + 1e-9 * np.array([[9, 8, 13], [15, 17, 16], [4, 9, 8]])
    >>> found = positioning(target, up, down)
    >>> print(f"B {1e9 * found.reversal.value:.1f} nm, A {1e9 * found.accuracy.value:.1f} nm")
    B 8.0 nm, A 23.0 nm
    """
    x, deviation = _deviations(target, upward, downward)
    mean, spread = deviation.mean(axis=-1), deviation.std(axis=-1, ddof=1)
    turns = float(np.ptp(x)) / _TURN
    closed = unit == "rad" and turns > 0.5 and abs(turns - round(turns)) < _SAME * turns
    return Positioning(
        target=x, mean_upward=mean[0], mean_downward=mean[1], spread_upward=spread[0],
        spread_downward=spread[1], runs=deviation.shape[-1], unit=unit,
        closure=_closure(deviation) if closed else None,
        **estimates(deviation, trials, unit, closed=closed),
    )  # fmt: skip


def _closure(deviation: Array) -> Estimate:
    """Return the mean deviation at the last target less that at the first [rad]."""
    of_runs = (deviation[:, -1] - deviation[:, 0]).mean(axis=0)
    return Estimate.of(
        float(of_runs.mean()),
        float(of_runs.std(ddof=1)) / math.sqrt(of_runs.size),
        "rad",
        source="repeatability",
        degrees_of_freedom=of_runs.size - 1,
    )


def _deviations(target: ArrayLike, upward: ArrayLike, downward: ArrayLike) -> tuple[Array, Array]:
    """Return sorted targets and deviations from them, shape (2, m, n)."""
    x = np.asarray(target, dtype=np.float64)
    both = [np.asarray(v, dtype=np.float64) for v in (upward, downward)]
    if x.ndim != 1 or any(v.ndim != 2 or v.shape[0] != x.size for v in both):
        raise RecordError(
            "positions must be given for each target (row) and run (column), got shapes "
            f"{both[0].shape} and {both[1].shape} for {x.size} targets"
        )
    runs = {v.shape[1] for v in both}
    if len(runs) != 1:
        raise RecordError(
            "there must be as many runs upward as downward, got "
            f"{both[0].shape[1]} and {both[1].shape[1]}"
        )
    if x.size < 2 or min(runs) < 2:
        raise RecordError(
            f"positioning needs two targets and two runs at least, got {x.size} targets and "
            f"{min(runs)} runs: record more of them"
        )
    if not all(np.isfinite(v).all() for v in (x, *both)):
        raise RecordError("targets and positions must be finite: omit the failed targets")
    order = np.argsort(x)
    if np.any(np.diff(x[order]) == 0.0):
        raise RecordError("two targets are equal: join their runs as one target")
    return x[order], np.array([v[order] - x[order, None] for v in both])


def figures(mean: Array, spread: Array, *, closed: bool = False) -> dict[str, Array]:
    """Return the figures of ISO 230-2:2014 from means and spreads at targets.

    Both have shape (..., 2, m), upward and downward [m or rad]; the figures have the names of
    `Positioning`. Of a closed circle the first and the last target are one position.
    """
    reversal = mean[..., 0, :] - mean[..., 1, :]
    once = reversal
    if closed:
        ends = reversal[..., [0, -1]].mean(axis=-1, keepdims=True)
        once = np.concatenate((ends, reversal[..., 1:-1]), axis=-1)
    sides = 4.0 * spread
    both = 2.0 * (spread[..., 0, :] + spread[..., 1, :]) + np.abs(reversal)
    outer, inner = mean + 2.0 * spread, mean - 2.0 * spread
    one_way = {
        "repeatability": sides.max(axis=-1),
        "systematic": np.ptp(mean, axis=-1),
        "accuracy": outer.max(axis=-1) - inner.min(axis=-1),
    }
    results = {
        f"{name}_{side}": values[..., i]
        for name, values in one_way.items()
        for i, side in enumerate(("upward", "downward"))
    }
    return results | {
        "reversal": np.abs(reversal).max(axis=-1),
        "mean_reversal": once.mean(axis=-1),
        "repeatability": np.maximum(both, sides.max(axis=-2)).max(axis=-1),
        "systematic": np.ptp(mean, axis=(-2, -1)),
        "mean_deviation": np.ptp(mean.mean(axis=-2), axis=-1),
        "accuracy": outer.max(axis=(-2, -1)) - inner.min(axis=(-2, -1)),
    }


def estimates(
    deviation: Array, trials: int, unit: str = "m", *, closed: bool = False
) -> dict[str, Estimate]:
    """Return the figures with intervals.

    The deviations are those upward and downward [`unit`], shape (2, m, n).
    """
    runs = deviation.shape[-1]
    mean, spread = deviation.mean(axis=-1), deviation.std(axis=-1, ddof=1)
    observed = figures(mean, spread, closed=closed)
    # with less scatter behind the data noise adds more to an extreme: that gives the lower end, and
    # the data as they are the upper one
    share = _run_share(deviation)
    means, pooled = _without_noise(deviation)
    size = runs, trials
    low = _simulated(means, pooled, share, *size, closed=closed)
    of_means = _simulated(mean, pooled, share, *size, closed=closed)
    # what all targets of a run have in common is in spreads, and known from few runs only
    of_spreads = _simulated(mean, spread, _run_share(deviation, 0.1), *size, closed=closed)
    return {
        name: _estimate(
            name,
            float(observed[name]),
            low[name],
            (of_spreads if name.startswith(("repeat", "accuracy")) else of_means)[name],
            runs,
            unit,
        )
        for name in observed
    }


def _simulated(
    mean: Array, spread: Array, share: float, runs: int, trials: int, *, closed: bool
) -> dict[str, _Pair]:
    """Return the figures that simulated measurements show, and those behind them."""
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(0,)))
    # how large the noise is, is itself known from few runs only
    parts = (share / (runs - 1), (1.0 - share) / (spread.size * (runs - 1)))
    freedom = 1.0 / (share * parts[0] + (1.0 - share) * parts[1])
    sizes = np.sqrt(freedom / rng.chisquare(freedom, trials))[:, None, None]
    noise = math.sqrt(1.0 - share) * rng.standard_normal((trials, *spread.shape, runs))
    noise += math.sqrt(share) * rng.standard_normal((trials, 1, 1, runs))
    noise *= (sizes * spread)[..., None]
    observed = figures(mean + noise.mean(axis=-1), noise.std(axis=-1, ddof=1), closed=closed)
    behind = figures(np.broadcast_to(mean, (trials, *mean.shape)), sizes * spread, closed=closed)
    return {name: (observed[name], behind[name]) for name in observed}


def _estimate(name: str, value: float, low: _Pair, high: _Pair, runs: int, unit: str) -> Estimate:
    """Return an interval from the results and the true values of simulated measurements."""
    ends = []
    for (quantile, behind), p in ((low, 0.975), (high, 0.025)):
        if name in _SPREADS and np.all(behind > 0.0):
            ends.append(value / float(np.quantile(quantile / behind, p)))
        else:
            error = quantile - behind
            # an extreme lies too far out, if at all: the upper end needs none of that taken off
            bias = float(error.mean()) if p < 0.5 and name not in _SIGNED else 0.0
            ends.append(value - float(np.quantile(error, p)) + bias)
    if name not in _SIGNED:
        ends = [max(end, 0.0) for end in ends]
    return Estimate.of(
        value,
        float(np.std(high[0] - high[1])),
        unit,
        source="repeatability",
        degrees_of_freedom=runs - 1,
        bounds=(min(*ends, value), max(*ends, value)),
        note=f"{runs} runs upward and downward",
    )


def _run_share(deviation: Array, chance: float | None = None) -> float:
    """Return the share of variance that all targets of a run have in common.

    With a chance, the share that is exceeded with about that chance.
    """
    _, targets, runs = deviation.shape
    left = deviation - deviation.mean(axis=-1, keepdims=True)
    pooled = float(left.var(axis=-1, ddof=1).mean())
    if pooled <= 0.0:
        return 0.0
    of_runs = left.mean(axis=(0, 1))
    power = float(of_runs @ of_runs)
    if chance is None:
        common = power / (runs - 1)
    else:
        from scipy.special import chdtri

        common = power / float(chdtri(runs - 1, 1.0 - chance))
    rest = 1.0 / (2 * targets)
    return min(max((common / pooled - rest) / (1.0 - rest), 0.0), 1.0)


def _without_noise(deviation: Array) -> tuple[Array, Array]:
    """Return means and spreads from which the scatter that noise explains is taken.

    Means of few runs scatter by noise about what is behind them, and so do standard deviations:
    both are drawn together by as much, after James and Stein (1961), the spreads by their
    logarithms, and wholly where an F test at 5 % finds noise alone.
    """
    runs = deviation.shape[-1]
    mean, variance = deviation.mean(axis=-1), deviation.var(axis=-1, ddof=1)
    freedom = (runs - 1) * variance.size
    noise = float(variance.mean()) * (1.0 - _run_share(deviation)) / runs
    reversal, middle = mean[0] - mean[1], mean.mean(axis=0)
    middle = _shrunk(middle, 0.5 * noise, freedom)
    reversal = _shrunk(reversal, 2.0 * noise, freedom)
    means = np.stack((middle + 0.5 * reversal, middle - 0.5 * reversal))
    # several means that noise does not tell from the extreme one may all be at the extreme
    near = _NEAR * math.sqrt(noise)
    top, bottom = means.max(axis=1, keepdims=True), means.min(axis=1, keepdims=True)
    means = np.where(means > top - near, top, np.where(means < bottom + near, bottom, means))
    return means, _spreads(variance, runs - 1)


def _shrunk(values: Array, noise: float, freedom: float) -> Array:
    """Return values drawn towards their mean by the share of their scatter that is noise."""
    from scipy.stats import f

    scatter = float(values.var(ddof=1))
    if scatter <= noise * f.ppf(0.95, values.size - 1, freedom):
        return np.full_like(values, values.mean())
    return values.mean() + math.sqrt(1.0 - noise / scatter) * (values - values.mean())


def _spreads(variance: Array, freedom: int) -> Array:
    from scipy.special import polygamma

    if not np.any(variance > 0.0):
        return np.zeros_like(variance)
    logs = np.log(np.maximum(variance, 1e-12 * variance.mean()))
    # the variance of the logarithm of a chi-squared variate over its degrees of freedom
    logs = _shrunk(logs.ravel(), float(polygamma(1, 0.5 * freedom)), 1e6).reshape(variance.shape)
    spreads = np.exp(logs)
    # the mean of logarithms lies low: let the sum of variances be that of the data
    return np.sqrt(spreads * variance.mean() / spreads.mean())
