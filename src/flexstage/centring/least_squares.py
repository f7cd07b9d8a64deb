"""Least squares of harmonics: normal equations in one pass, and noise from the residuals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError

#: Samples per block: its tables fit in the cache of the processor.
_CHUNK = 4096


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NormalEquations:
    """Sums of the products of the fitted functions, with each other and with the values.

    The functions are 1, the turn number if there is a drift, then cosine and sine of each order.
    """

    gram: Array
    """Products of the functions, for each group of samples, shape (groups, p, p)."""
    right: Array
    """Products of the functions with each column of values, shape (groups, p, m)."""
    squares: Array
    """Squares of the values, shape (groups, m)."""


def accumulated(
    turns: Array,
    values: Array,
    orders: Sequence[int],
    *,
    drift: bool,
    weights: Array | None = None,
    bounds: Sequence[int] | None = None,
) -> NormalEquations:
    """Sum the normal equations of the harmonic fit over samples.

    `turns` is the angle of each sample [turn], `values` columns over it, shape (n, m). A weight of
    zero excludes a sample. `bounds` are the first sample of each group and the number of samples;
    all are one group without it.

    Products of cosines are cosines of sums and differences of orders. The sums are therefore of
    cosines and sines up to twice the highest order, each from the two before it.
    """
    edges = [0, turns.size] if bounds is None else list(bounds)
    highest = max(orders, default=0)
    m = values.shape[1]
    groups = len(edges) - 1
    # rows: cosine and sine of each order; columns: weight, weight x turn, weighted values
    table = np.zeros((groups, 2, 2 * highest + 1, 2 + m))
    drifts = np.zeros((groups, 1 + m))
    squares = np.zeros((groups, m))
    for g in range(groups):
        for start in range(edges[g], edges[g + 1], _CHUNK):
            part = slice(start, min(start + _CHUNK, edges[g + 1]))
            u, y = turns[part], values[part]
            w = np.ones(u.size) if weights is None else weights[part]
            columns = np.column_stack((w, w * u, y * w[:, None]))
            waves = _waves(u, 2 * highest)
            # the values are needed up to the highest order only
            table[g, :, :, :2] += waves @ columns[:, :2]
            table[g, :, : highest + 1, 2:] += waves[:, : highest + 1] @ columns[:, 2:]
            squares[g] += np.einsum("ij,ij->j", y, columns[:, 2:])
            drifts[g] += u @ columns[:, 1:]
    return NormalEquations(
        gram=_gram(table, drifts, orders, drift),
        right=_right(table, drifts, orders, drift),
        squares=squares,
    )


def evaluated(turns: Array, coefficients: Array, orders: Sequence[int], *, drift: bool) -> Array:
    """Return the sum of the functions, in the order of `NormalEquations`, shape (n, m)."""
    # columns are contiguous, as later steps work on columns
    out = np.empty((coefficients.shape[1], turns.size)).T
    first = 2 if drift else 1
    at = np.asarray(orders, dtype=np.intp)
    for start in range(0, turns.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        waves = _waves(turns[part], max(orders, default=0))
        out[part] = (
            coefficients[0]
            + waves[0, at].T @ coefficients[first::2]
            + waves[1, at].T @ coefficients[first + 1 :: 2]
        )
        if drift:
            out[part] += turns[part, None] * coefficients[1]
    return out


def _waves(turns: Array, highest: int) -> Array:
    """Return cosine and sine of the orders 0 to the highest, shape (2, highest + 1, n)."""
    out = np.empty((2, highest + 1, turns.size))
    out[0, 0], out[1, 0] = 1.0, 0.0
    if highest == 0:
        return out
    # full turns are subtracted while they are exact
    x = 2.0 * np.pi * (turns - np.rint(turns))
    np.cos(x, out=out[0, 1])
    np.sin(x, out=out[1, 1])
    twice = 2.0 * out[0, 1]
    for k in range(2, highest + 1):
        np.multiply(out[:, k - 1], twice, out=out[:, k])
        out[:, k] -= out[:, k - 2]
    return out


def _gram(table: Array, drifts: Array, orders: Sequence[int], drift: bool) -> Array:
    k = np.asarray(orders, dtype=np.intp)
    c, s = table[:, 0, :, 0], table[:, 1, :, 0]
    total, apart = k[:, None] + k[None, :], k[:, None] - k[None, :]
    near = c[:, np.abs(apart)]
    sine = np.sign(apart) * s[:, np.abs(apart)]
    first = 2 if drift else 1
    out = np.zeros((table.shape[0], first + 2 * k.size, first + 2 * k.size))
    out[:, first::2, first::2] = 0.5 * (near + c[:, total])
    out[:, first + 1 :: 2, first + 1 :: 2] = 0.5 * (near - c[:, total])
    # cos(a) sin(b) = (sin(a + b) - sin(a - b)) / 2
    mixed = 0.5 * (s[:, total] - sine)
    out[:, first::2, first + 1 :: 2] = mixed
    out[:, first + 1 :: 2, first::2] = np.swapaxes(mixed, 1, 2)
    edge = [(0, c[:, 0], 0)] + ([(1, table[:, 0, 0, 1], 1)] if drift else [])
    for row, total_wave, column in edge:
        out[:, row, 0] = out[:, 0, row] = total_wave
        for offset, wave in ((first, 0), (first + 1, 1)):
            out[:, row, offset::2] = out[:, offset::2, row] = table[:, wave][:, k, column]
    if drift:
        out[:, 1, 1] = drifts[:, 0]
    return out


def _right(table: Array, drifts: Array, orders: Sequence[int], drift: bool) -> Array:
    k = np.asarray(orders, dtype=np.intp)
    first = 2 if drift else 1
    out = np.zeros((table.shape[0], first + 2 * k.size, table.shape[3] - 2))
    out[:, 0] = table[:, 0, 0, 2:]
    if drift:
        out[:, 1] = drifts[:, 1:]
    out[:, first::2] = table[:, 0, k, 2:]
    out[:, first + 1 :: 2] = table[:, 1, k, 2:]
    return out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HarmonicProblem:
    """Columns of values over turns, and the functions fitted to them."""

    u: Array
    """Angle of each sample [turn], shape (n,)."""
    y: Array
    """The values, shape (n, m)."""
    orders: tuple[int, ...]
    """Orders, rising."""
    drift: bool
    """Whether a change in proportion to the angle is fitted."""
    middle: float
    """Middle of the angles [turn], at which the offset is defined."""
    bounds: Sequence[int] | None
    """First sample of each turn and, at the end, the number of samples; None for one group."""

    def column(self, j: int) -> "HarmonicProblem":
        """Return the problem of one column alone."""
        return replace(self, y=self.y[:, j : j + 1])

    def sums(self, weights: Array | None) -> NormalEquations:
        """Return the normal equations."""
        return accumulated(
            self.u, self.y, self.orders, drift=self.drift, weights=weights, bounds=self.bounds
        )

    def residual(self, coefficients: Array) -> Array:
        """Return the residuals of the values, shape (n, m), for coefficients of shape (p, m)."""
        fitted = evaluated(self.u, coefficients, self.orders, drift=self.drift)
        return np.subtract(self.y, fitted, out=fitted)

    @property
    def first(self) -> int:
        """Number of coefficients before those of the harmonics."""
        return 2 if self.drift else 1


def solved(equations: NormalEquations, orders: tuple[int, ...]) -> Array:
    """Return the coefficients, shape (p, m); `orders` are for the message."""
    # condition number from which functions are not separable in double precision
    worst_condition = 1e9
    gram = equations.gram.sum(axis=0)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    if np.linalg.cond(gram * np.outer(scale, scale)) > worst_condition:
        raise RecordError(
            f"the samples do not separate the harmonics up to order {orders[-1]}: they need more "
            f"than {2 * orders[-1]} different angles per turn, without large gaps; fit fewer orders"
        )
    return np.linalg.solve(gram, equations.right.sum(axis=0))


def of_column(equations: NormalEquations, j: int) -> NormalEquations:
    """Return the normal equations of one column."""
    return NormalEquations(
        gram=equations.gram,
        right=equations.right[:, :, j : j + 1],
        squares=equations.squares[:, j : j + 1],
    )


#: Least number of free frequencies that determine a spectrum.
_LEAST_FREE = 24
#: Gain of log likelihood from which noise counts as correlated.
_GAIN = 3.0


def from_turns(
    equations: NormalEquations, coefficients: Array, white: Array, slow: int
) -> tuple[Array, float]:
    """Return factors on the variance of each function from the scatter of turns, and their freedom.

    `equations` are of each turn and one column, `white` is the covariance of the coefficients for
    white noise; the first `slow` functions are no harmonics. Factors are not pooled.

    It is the variance from the scores of full turns, as of clustered samples (Liang and Zeger 1986,
    Biometrika 73), over that of white noise. It includes correlation within a turn.
    """
    groups = equations.gram.shape[0]
    scores = equations.right[:, :, 0] - equations.gram @ coefficients
    solved = np.linalg.solve(equations.gram.sum(axis=0), scores.T)
    variance = np.sum(solved**2, axis=1)
    # a slow drift is correlated between turns, and adds to the mean but not to harmonics
    lasting = 2.0 * np.sum(solved[:, 1:] * solved[:, :-1], axis=1)
    variance[:slow] += np.maximum(lasting[:slow], 0.0)
    variance *= groups / (groups - 1)
    return variance / np.maximum(np.diag(white), np.finfo(float).tiny), groups - 1.0


def from_spectrum(
    residual: Array,
    frequencies: Sequence[float] | Array,
    fitted: Sequence[float],
    turn: float | None,
) -> tuple[Array, Array, bool] | None:
    r"""Return the noise at the frequency of each function, from the spectrum of the residuals.

    It is the variance of equivalent white noise, in the square of the residuals' unit, shape (p,);
    its degrees of freedom, shape (p,); and whether white noise explains the residuals.

    It is not less than white noise of the same power. Frequencies are in cycles per sample: of the
    functions, of all fitted functions, and of the turn, None for residuals of less than two full
    turns. The result is None if there are too few residuals, or if they are not periodic and white
    noise explains them.

    The spectrum of an autoregressive moving-average process of orders 1 and 1, as of white noise
    with drift, is fitted to the periodogram by Whittle's likelihood (Whittle 1953, Arkiv för
    Matematik 2). Fitted frequencies are missing in the residuals and are omitted; for several turns
    with synchronous residuals, all multiples of one per turn are omitted too. The variance of a
    harmonic is proportional to the spectrum at its frequency (Grenander 1954, Annals of
    Mathematical Statistics 25).

    Validity
    --------
    Samples in sequence at about equal steps.
    """
    # distance [bins] below which a frequency belongs to a multiple of one per turn
    nearest = 0.75
    n = residual.size
    power = np.abs(np.fft.rfft(residual)[1:]) ** 2 / n
    bins = np.arange(1, power.size + 1, dtype=np.float64)
    free = np.ones(power.size, dtype=bool)
    for f in fitted:
        free &= np.abs(bins - f * n) >= 0.99
    if n % 2 == 0:
        free[-1] = False  # its power has only one degree of freedom
    if turn is not None:
        between = np.abs(bins - np.rint(bins / (turn * n)) * turn * n) >= nearest
        if _is_synchronous(power[free & ~between], power[free & between]):
            free &= between
        else:
            turn = None
    square = float(np.mean(residual**2))
    if free.sum() < _LEAST_FREE or square == 0.0:
        return None
    mean = square if turn is None else float(power[free].mean())
    f = np.asarray(frequencies, dtype=np.float64)
    # rounding errors have no spectrum
    colour = None
    if mean > 1e-20 * square:
        colour = _coloured(bins[free] / n, power[free] / mean, n, f)
    if colour is not None:
        # a value below that of white noise may be chance, and would not be safe
        density, freedom = colour
        return mean * np.maximum(density, 1.0), freedom, False
    if turn is None:
        return None
    freedom_of_white = 2.0 * float(free.sum())
    return np.full(f.size, mean), np.full(f.size, freedom_of_white), True


def _is_synchronous(multiples: Array, between: Array) -> bool:
    """Return whether the power at multiples of one per turn is significantly higher."""
    # least excess of that power, in standard deviations
    significant = 3.0
    if multiples.size == 0 or between.size < _LEAST_FREE:
        return False
    chance = math.sqrt(1.0 / multiples.size + 1.0 / between.size)
    return bool(multiples.mean() > (1.0 + significant * chance) * between.mean())


def _coloured(at: Array, power: Array, n: int, f: Array) -> tuple[Array, Array] | None:
    """Return the spectrum at frequencies and its degrees of freedom; None if it is white."""
    # the slowest modelled noise is a random walk over the record, which bounds slower noise
    least_freedom = 3.0
    at, mean_power, count = _grouped(at, power)
    if not _looks_correlated(at, mean_power, count):
        return None
    # noise slower than the record has, at the frequencies of the record, the spectrum of a walk
    fit = _fitted_spectrum(at, mean_power, count, 1.0 - 2.0 * math.pi / n)
    if fit is None:
        return None
    level, rho, theta = fit
    gradient = _gradient(at, rho, theta)
    information = (gradient * count[:, None]).T @ gradient
    at_f = _gradient(f, rho, theta)
    spread = np.einsum("ij,jk,ik->i", at_f, np.linalg.pinv(information), at_f)
    # the logarithm of chi squared with nu degrees has the variance 2 / nu + 2 / nu^2, nearly
    freedom = (1.0 + np.sqrt(1.0 + 2.0 * spread)) / np.maximum(spread, 1e-12)
    return level * _shape(f, rho, theta), np.maximum(freedom, least_freedom)


def _grouped(at: Array, power: Array) -> tuple[Array, Array, Array]:
    """Average neighbouring frequencies, more of them the higher they are."""
    # largest number of groups of frequencies in the fit of a spectrum
    groups = 240
    edges = np.unique(
        np.rint(np.geomspace(1.0, at.size + 1.0, min(groups, at.size + 1))).astype(np.intp) - 1
    )
    edges = edges[edges < at.size]
    count = np.diff(np.append(edges, at.size)).astype(np.float64)
    return np.add.reduceat(at, edges) / count, np.add.reduceat(power, edges) / count, count


def _shape(f: Array, rho: float, theta: float) -> Array:
    c = np.cos(2.0 * np.pi * f)
    return (1.0 + theta**2 - 2.0 * theta * c) / (1.0 + rho**2 - 2.0 * rho * c)


def _gradient(f: Array, rho: float, theta: float) -> Array:
    """Derivatives of the logarithm of the spectrum by level, rho and theta."""
    c = np.cos(2.0 * np.pi * f)
    moving = 2.0 * (theta - c) / (1.0 + theta**2 - 2.0 * theta * c)
    regressive = -2.0 * (rho - c) / (1.0 + rho**2 - 2.0 * rho * c)
    return np.column_stack((np.ones(f.size), regressive, moving))


def _looks_correlated(at: Array, power: Array, count: Array) -> bool:
    """Return whether a small deviation from white noise, of any colour, improves the fit."""
    wave = np.cos(2.0 * np.pi * at)
    rho = np.array([-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.8, 0.9, 0.96, 0.99, 0.998])[:, None]
    slope = 2.0 * (wave - rho) / (1.0 + rho**2 - 2.0 * rho * wave)
    slope = slope - (slope @ count / count.sum())[:, None]
    mean = float(count @ power) / float(count.sum())
    score = slope @ (count * (power / mean - 1.0))
    return bool((0.5 * score**2 / (slope**2 @ count)).max() > 0.5 * _GAIN)


def _fitted_spectrum(
    at: Array, power: Array, count: Array, most: float
) -> tuple[float, float, float] | None:
    """Return level, rho and theta; None if white noise is as likely."""
    from scipy.optimize import minimize

    total = float(count.sum())

    def cost(rho: float, theta: float) -> float:
        shape = _shape(at, rho, theta)
        level = float(count @ (power / shape)) / total
        return total * math.log(max(level, 1e-300)) + float(count @ np.log(shape))

    white = total * math.log(float(count @ power) / total)
    grid = np.array([-0.6, -0.3, 0.0, 0.3, 0.6, 0.8, 0.9, 0.96, 0.99])
    _, rho, theta = min((cost(r, t), r, t) for r in grid for t in grid if r != t)

    def in_range(x: Array) -> tuple[float, float]:
        return most * math.tanh(x[0]), most * math.tanh(x[1])

    start = np.arctanh(np.clip(np.array([rho, theta]) / most, -0.99, 0.99))
    best = minimize(
        lambda x: cost(*in_range(x)), start, method="Nelder-Mead", options={"maxfev": 400}
    )
    if white - float(best.fun) < _GAIN:
        return None
    rho, theta = in_range(best.x)
    level = float(count @ (power / _shape(at, rho, theta))) / total
    return level, rho, theta
