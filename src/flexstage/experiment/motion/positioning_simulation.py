"""Intervals of the figures of positioning, by simulating the measurement they come from."""

import math

import numpy as np

from flexstage.arrays import Array
from flexstage.estimate import Component, Estimate

#: Figures that are spreads: their errors are in proportion to them.
_SPREADS = ("repeatability_upward", "repeatability_downward")
#: Means within so many times their noise of the extreme one may be as extreme.
_NEAR = 2.0
#: Figures that may have either sign.
_SIGNED = ("mean_reversal",)


def figures(mean: Array, spread: Array) -> dict[str, Array]:
    """Return the figures of ISO 230-2:2014 from means and spreads at targets.

    Both have shape (..., 2, m), upward and downward [m]; the figures have the names of
    `Positioning`.
    """
    reversal = mean[..., 0, :] - mean[..., 1, :]
    sides = 4.0 * spread
    both = 2.0 * (spread[..., 0, :] + spread[..., 1, :]) + np.abs(reversal)
    outer, inner = mean + 2.0 * spread, mean - 2.0 * spread
    one_way = {
        "repeatability": sides.max(axis=-1),
        "systematic": np.ptp(mean, axis=-1),
        "accuracy": outer.max(axis=-1) - inner.min(axis=-1),
    }
    found = {
        f"{name}_{side}": values[..., i]
        for name, values in one_way.items()
        for i, side in enumerate(("upward", "downward"))
    }
    return found | {
        "reversal": np.abs(reversal).max(axis=-1),
        "mean_reversal": reversal.mean(axis=-1),
        "repeatability": np.maximum(both, sides.max(axis=-2)).max(axis=-1),
        "systematic": np.ptp(mean, axis=(-2, -1)),
        "mean_deviation": np.ptp(mean.mean(axis=-2), axis=-1),
        "accuracy": outer.max(axis=(-2, -1)) - inner.min(axis=(-2, -1)),
    }


def estimates(deviation: Array, *, trials: int, seed: int) -> dict[str, Estimate]:
    """Return the figures with intervals.

    The deviations are those upward and downward [m], shape (2, m, n).
    """
    runs = deviation.shape[-1]
    mean, spread = deviation.mean(axis=-1), deviation.std(axis=-1, ddof=1)
    observed = figures(mean, spread)
    # with less scatter behind the data noise adds more to an extreme: that gives the lower end, and
    # the data as they are the upper one
    share = _run_share(deviation)
    drawn, pooled = _without_noise(deviation)
    low = _simulated(drawn, pooled, share, runs, trials, seed)
    of_means = _simulated(mean, pooled, share, runs, trials, seed)
    # what all targets of a run have in common is in spreads, and known from few runs only
    of_spreads = _simulated(mean, spread, _run_share(deviation, 0.1), runs, trials, seed)
    return {
        name: _estimate(
            name,
            float(observed[name]),
            low[name],
            (of_spreads if name.startswith(("repeat", "accuracy")) else of_means)[name],
            runs,
        )
        for name in observed
    }


def _simulated(
    mean: Array, spread: Array, share: float, runs: int, trials: int, seed: int
) -> dict[str, tuple[Array, Array]]:
    """Return the figures that simulated measurements show, and those behind them."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    # how large the noise is, is itself known from few runs only
    parts = (share / (runs - 1), (1.0 - share) / (spread.size * (runs - 1)))
    freedom = 1.0 / (share * parts[0] + (1.0 - share) * parts[1])
    sizes = np.sqrt(freedom / rng.chisquare(freedom, trials))[:, None, None]
    noise = math.sqrt(1.0 - share) * rng.standard_normal((trials, *spread.shape, runs))
    noise += math.sqrt(share) * rng.standard_normal((trials, 1, 1, runs))
    noise *= (sizes * spread)[..., None]
    seen = figures(mean + noise.mean(axis=-1), noise.std(axis=-1, ddof=1))
    behind = figures(np.broadcast_to(mean, (trials, *mean.shape)), sizes * spread)
    return {name: (seen[name], behind[name]) for name in seen}


def _estimate(
    name: str, value: float, low: tuple[Array, Array], high: tuple[Array, Array], runs: int
) -> Estimate:
    """Turn what simulated measurements show, beside what is behind them, into an interval."""
    ends = []
    for (seen, behind), p in ((low, 0.975), (high, 0.025)):
        if name in _SPREADS and np.all(behind > 0.0):
            ends.append(value / float(np.quantile(seen / behind, p)))
        else:
            error = seen - behind
            # an extreme lies too far out, if at all: the upper end needs none of that taken off
            kept = float(error.mean()) if p < 0.5 and name not in _SIGNED else 0.0
            ends.append(value - float(np.quantile(error, p)) + kept)
    if name not in _SIGNED:
        ends = [max(end, 0.0) for end in ends]
    part = Component(
        name="repeatability",
        uncertainty=float(np.std(high[0] - high[1])),
        degrees_of_freedom=runs - 1,
    )
    return Estimate(
        value=value, unit="m", components=(part,), bounds=(min(*ends, value), max(*ends, value)),
        note=f"{runs} runs upward and downward",
    )  # fmt: skip


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
    middle = _drawn(middle, 0.5 * noise, freedom)
    reversal = _drawn(reversal, 2.0 * noise, freedom)
    drawn = np.stack((middle + 0.5 * reversal, middle - 0.5 * reversal))
    # several means that noise does not tell from the extreme one may all be at the extreme
    near = _NEAR * math.sqrt(noise)
    top, bottom = drawn.max(axis=1, keepdims=True), drawn.min(axis=1, keepdims=True)
    drawn = np.where(drawn > top - near, top, np.where(drawn < bottom + near, bottom, drawn))
    return drawn, _spreads(variance, runs - 1)


def _drawn(values: Array, noise: float, freedom: float) -> Array:
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
    logs = _drawn(logs.ravel(), float(polygamma(1, 0.5 * freedom)), 1e6).reshape(variance.shape)
    drawn = np.exp(logs)
    # the mean of logarithms lies low: let the sum of variances be that of the data
    return np.sqrt(drawn * variance.mean() / drawn.mean())
