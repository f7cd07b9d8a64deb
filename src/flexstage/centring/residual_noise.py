"""How much more or less than white noise the residuals disturb each harmonic."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.normal_equations import NormalEquations

#: Fewer free frequencies than this say nothing of a spectrum.
_LEAST_FREE = 24
#: Gain of log likelihood from which noise counts as correlated.
_GAIN = 3.0


def from_turns(
    equations: NormalEquations, coefficients: Array, white: Array, slow: int
) -> tuple[Array, float]:
    """Return factors on the variance of each function, from how turns differ; degrees of freedom.

    `equations` are of each turn and one column, `white` is the covariance of the coefficients for
    white noise; the first `slow` functions are no harmonics. Factors are not pooled.

    The variance that the scores of whole turns give, as of clustered samples (Liang and Zeger 1986,
    Biometrika 73), over that of white noise: whatever repeats itself within a turn, or not, is in
    it.
    """
    groups = equations.gram.shape[0]
    scores = equations.right[:, :, 0] - equations.gram @ coefficients
    solved = np.linalg.solve(equations.gram.sum(axis=0), scores.T)
    variance = np.sum(solved**2, axis=1)
    # a slow drift lasts from turn to turn, and adds to the mean what it does not to harmonics
    lasting = 2.0 * np.sum(solved[:, 1:] * solved[:, :-1], axis=1)
    variance[:slow] += np.maximum(lasting[:slow], 0.0)
    variance *= groups / (groups - 1)
    return variance / np.maximum(np.diag(white), np.finfo(float).tiny), groups - 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoiseSpectrum:
    """Noise at the frequencies of functions."""

    density: Array
    """Variance of white noise that would disturb each as much, in the square of the residuals'
    unit, shape (p,).
    """
    freedom: Array
    """Its degrees of freedom, shape (p,)."""
    white: bool
    """Whether white noise explains the residuals as well as any."""


def from_spectrum(
    residual: Array,
    frequencies: Sequence[float] | Array,
    fitted: Sequence[float],
    turn: float | None,
) -> NoiseSpectrum | None:
    r"""Return the noise at the frequency of each function, from the spectrum of the residuals.

    It is not less than white noise of the same power. Frequencies are in cycles per sample: of the
    functions, of all that was fitted and is missing, and of the turn, None where the residuals are
    of less than two whole turns. There is none where residuals are too few or, where nothing
    repeats, where white noise explains them as well.

    The spectrum of an autoregressive and moving average process of orders 1 and 1, which white
    noise and drift together have, is fitted to the periodogram by Whittle's likelihood (Whittle
    1953, Arkiv för Matematik 2). Frequencies that were fitted, and so are missing in the residuals,
    are left out; and of several turns, where more repeats than noise does, all multiples of one
    per turn. The variance of a harmonic is in proportion to the spectrum at its frequency
    (Grenander 1954, Annals of Mathematical Statistics 25).

    Validity
    --------
    Samples that follow one another at about equal steps.
    """
    # frequencies of the record that are nearer to a multiple of one per turn belong to it.
    nearest = 0.75
    n = residual.size
    power = np.abs(np.fft.rfft(residual)[1:]) ** 2 / n
    bins = np.arange(1, power.size + 1, dtype=np.float64)
    free = np.ones(power.size, dtype=bool)
    for f in fitted:
        free &= np.abs(bins - f * n) >= 0.99
    if n % 2 == 0:
        free[-1] = False  # its power has but one degree of freedom
    if turn is not None:
        beside = np.abs(bins - np.rint(bins / (turn * n)) * turn * n) >= nearest
        if _repeats(power[free & ~beside], power[free & beside]):
            free &= beside
        else:
            turn = None
    square = float(np.mean(residual**2))
    if free.sum() < _LEAST_FREE or square == 0.0:
        return None
    mean = square if turn is None else float(power[free].mean())
    f = np.asarray(frequencies, dtype=np.float64)
    # what is as small as rounding has no colour
    found = None if mean <= 1e-20 * square else _coloured(bins[free] / n, power[free] / mean, n, f)
    if found is not None:
        # less than white noise would give is not believed: it may be chance, and would not be safe
        density, freedom = found
        return NoiseSpectrum(density=mean * np.maximum(density, 1.0), freedom=freedom, white=False)
    if turn is None:
        return None
    known = 2.0 * float(free.sum())
    return NoiseSpectrum(density=np.full(f.size, mean), freedom=np.full(f.size, known), white=True)


def _repeats(own: Array, beside: Array) -> bool:
    """Say whether there is more at the multiples of one per turn than chance puts there."""
    # standard deviations that the power at them must be more by than that between them.
    repeated = 3.0
    if own.size == 0 or beside.size < _LEAST_FREE:
        return False
    chance = math.sqrt(1.0 / own.size + 1.0 / beside.size)
    return bool(own.mean() > (1.0 + repeated * chance) * beside.mean())


def _coloured(at: Array, power: Array, n: int, f: Array) -> tuple[Array, Array] | None:
    """Return the spectrum at frequencies and its degrees of freedom; None where it is white."""
    # the slowest noise that is allowed for is a walk over the record, which bounds what is beyond
    least_freedom = 3.0
    at, own, count = _grouped(at, power)
    if not _looks_correlated(at, own, count):
        return None
    # what lasts for longer than the record has, at the frequencies in it, the spectrum of a walk
    found = _fitted_spectrum(at, own, count, 1.0 - 2.0 * math.pi / n)
    if found is None:
        return None
    level, rho, theta = found
    gradient = _gradient(at, rho, theta)
    information = (gradient * count[:, None]).T @ gradient
    own_gradient = _gradient(f, rho, theta)
    spread = np.einsum("ij,jk,ik->i", own_gradient, np.linalg.pinv(information), own_gradient)
    # of chi squared with nu degrees the logarithm has the variance 2 / nu + 2 / nu^2, nearly
    freedom = (1.0 + np.sqrt(1.0 + 2.0 * spread)) / np.maximum(spread, 1e-12)
    return level * _shape(f, rho, theta), np.maximum(freedom, least_freedom)


def _grouped(at: Array, power: Array) -> tuple[Array, Array, Array]:
    """Average neighbouring frequencies, more of them the higher they are."""
    # groups of frequencies that a spectrum is fitted to.
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
    """Say whether a small step away from white noise, of any colour, promises a better fit."""
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
    """Return level, rho and theta; None where white noise is as likely."""
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
