"""Harmonics of an error over the turn, by least squares with outlier rejection."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.centring.harmonic_fit import MANY_TURNS, HarmonicFit, covering_both, fit_result
from flexstage.centring.least_squares import HarmonicProblem, NormalEquations, solved
from flexstage.centring.turns import Turns, find_turns, places, whole_orders
from flexstage.records.quality import RMS_OVER_MEDIAN

_TURN = 2.0 * math.pi

#: Default number of orders, if there are enough samples.
_DEFAULT_ORDERS = 12


def fit_harmonics(
    angle: ArrayLike,
    value: ArrayLike,
    *,
    orders: int | Sequence[int] | None = None,
    robust: bool = True,
    unit: str = "rad",
    least_outlier: float = 0.0,
    resolution: float = 0.0,
) -> HarmonicFit:
    r"""Fit harmonics of the turn to values at any angles.

    .. math:: y(\theta) = c + d\,\frac{\theta}{2\pi} + \sum_n a_n \cos n\theta + b_n \sin n\theta

    The coefficients are those of least squares. A drift is fitted from 1.04 turns on, as one turn
    hardly separates it from harmonics. Below eight turns it follows from the differences between
    readings of one angle alone, and angles that are read more often than others have no more
    weight: errors of the scale at other orders leave no trace in harmonics. The covariance allows
    for correlated noise: from eight turns on it follows from the scatter of turns, from two on from
    the spectrum of the residuals between the orders, and below from the orders around the first in
    one turn, of which those that stand out belong to the scale. An outlier is a single sample that
    deviates: an error of several samples, or one that repeats in other turns, belongs to the scale.
    If more than 1 % of the samples are rejected, the intervals cover the fit of all samples too.

    Parameters
    ----------
    angle : array_like
        Angle of each sample [rad], shape (n,): rising, falling or in any order, wrapped or not,
        over one turn or several, from any start.
    value : array_like
        The values, shape (n,).
    orders : int or sequence of int, optional
        Highest order, or all that are fitted; 1 to 12 if not given, or fewer as samples allow.
    robust : bool
        Whether to find and reject outliers.
    unit : str
        Unit of the values.
    least_outlier : float
        Deviation up to which no sample is an outlier, such as a few steps of a code.
    resolution : float
        Step of the values, which bounds their noise from below: 1/sqrt(12) of it.

    Returns
    -------
    HarmonicFit
        The harmonics, with uncertainty.

    Validity
    --------
    The harmonics are those of the error at the sampled angles; with non-uniform sampling, orders
    that are not fitted leak into them. One turn does not separate errors of the scale at most
    orders from noise, which widens the intervals, nor a drift that is below the noise from order 2
    on, which they leave out; a sharp error of a single sample counts as an outlier. Simulated
    intervals of order 1 of one turn hold white noise in 93 to 96 %, but a random walk with 7 times
    its part of order 1 in 45 to 73 %, and with 22 times or more in 74 to 95 %: a scale with errors
    of a few low orders looks the same. From 1.05 turns on they hold a linear drift in 93 to 97 %,
    for which they are 1.44 times as wide as without any at 1.05 turns, 1.13 times at 1.2. Noise
    over fewer than eight turns: white, alone or with a random walk, a drift or noise below a corner
    frequency, in samples at about equal steps. Errors of the angle times the slope of the values
    are noise too.

    Raises
    ------
    RecordError
        The samples are too few, not finite, cover less than 0.9 of a turn, or do not separate the
        orders; an order is not positive; more than a quarter of the samples deviate, most of them
        singly.

    Examples
    --------
    >>> theta = np.linspace(0.3, 0.3 + 2.0 * np.pi, 401)[:-1]
    >>> noise = np.random.default_rng(3).normal(0.0, 0.2, theta.size)
    >>> fit = fit_harmonics(theta, 3.0 * np.cos(2.0 * theta - 0.7) + noise, orders=4)
    >>> amplitude, phase = fit.harmonic(2).amplitude, fit.harmonic(2).phase
    >>> print(f"{amplitude.value:.2f} +- {amplitude.expanded:.2f}, {phase.value:.2f}")
    3.00 +- 0.03, 0.70
    """
    y = np.asarray(value, dtype=np.float64)
    if y.ndim != 1:
        raise RecordError(f"the values must be one column, got shape {y.shape}")
    return fit_many(
        angle, y[:, None], orders=orders, robust=robust, unit=unit, least_outlier=least_outlier,
        resolution=resolution,
    )[0]  # fmt: skip


def fit_many(
    angle: ArrayLike,
    values: ArrayLike,
    *,
    orders: int | Sequence[int] | None = None,
    robust: bool = True,
    unit: str = "rad",
    least_outlier: float = 0.0,
    resolution: float = 0.0,
) -> tuple[HarmonicFit, ...]:
    """Fit harmonics of the turn to several columns that share their angles.

    It is faster than a call of `fit_harmonics` for each column.

    Parameters
    ----------
    angle : array_like
        Angle of each sample [rad], shape (n,).
    values : array_like
        The columns, shape (n, m).
    orders : int or sequence of int, optional
        Highest order, or all that are fitted.
    robust : bool
        Whether to find and reject outliers.
    unit : str
        Unit of the values.
    least_outlier : float
        Deviation up to which no sample is an outlier.
    resolution : float
        Step of the values.

    Returns
    -------
    tuple of HarmonicFit
        A fit for each column.

    Raises
    ------
    RecordError
        As of `fit_harmonics`.

    Examples
    --------
    >>> theta = np.arange(40) * 2.0 * np.pi / 40
    >>> fits = fit_many(theta, np.column_stack((np.sin(theta), 2.0 * np.cos(3.0 * theta))))
    >>> print(f"{fits[0].harmonic(1).sine.value:.3f} {fits[1].harmonic(3).cosine.value:.3f}")
    1.000 2.000
    """
    y = np.asarray(values, dtype=np.float64)
    theta = np.asarray(angle, dtype=np.float64)
    if y.ndim != 2 or theta.shape != y.shape[:1] or y.shape[1] == 0:
        raise RecordError(
            f"each angle needs a row of values, got angles of shape {theta.shape} and values of "
            f"shape {y.shape}"
        )
    if not np.isfinite(y).all():
        raise RecordError(
            f"{int((~np.isfinite(y)).sum())} of the values are not finite: remove these samples"
        )
    turns = find_turns(theta)
    fitted_orders = _orders(orders, turns.angle)
    again = turns.direction != 0 and turns.count > 1.01 and turns.full < MANY_TURNS
    # the least numbers of turns that separate a drift from harmonics, in sequence and in any order
    with_drift = turns.count >= (1.04 if turns.direction else 1.9)
    _require_enough(turns, fitted_orders, with_drift)
    # about the middle, drift and offset are least correlated, and the offset is the mean
    middle = 0.5 * (turns.angle.max() + turns.angle.min()) / _TURN
    shift = math.floor(middle)
    problem = HarmonicProblem(
        u=turns.angle / _TURN - shift, y=y, orders=fitted_orders, drift=with_drift,
        middle=middle - shift, bounds=turns.bounds if len(turns.bounds) > MANY_TURNS else None,
        resolution=resolution, readings=turns.readings() if again else None,
    )  # fmt: skip
    equations = problem.sums(None)
    coefficients = solved(equations, fitted_orders)
    residuals = problem.residual(coefficients)
    few = 2 * coefficients.shape[0] > y.shape[0]
    fits = []
    for j in range(y.shape[1]):
        residual = residuals[:, j]
        if (
            robust
            and (few or has_outlier(residual))
            and float(np.abs(residual).max()) > 1e-12 * float(np.abs(y[:, j]).max()) + least_outlier
        ):
            fits.append(_robust_fit(problem.column(j), residual, turns, unit, least_outlier))
            continue
        single = replace(equations, right=equations.right[:, :, j : j + 1])
        fits.append(
            fit_result(problem.column(j), single, coefficients[:, j], residual, None, turns, unit)
        )
    return tuple(fits)


def _orders(orders: int | Sequence[int] | None, angle: Array) -> tuple[int, ...]:
    if orders is None:
        return tuple(range(1, max(1, min(_DEFAULT_ORDERS, (places(angle / _TURN) - 2) // 2)) + 1))
    if isinstance(orders, (int, np.integer)):
        orders = range(1, int(orders) + 1)
    return whole_orders(orders)


def _require_enough(turns: Turns, orders: tuple[int, ...], drift: bool) -> None:
    size, needed = turns.angle.size, 2 * len(orders) + (2 if drift else 1)
    if size <= needed:
        raise RecordError(
            f"{size} samples are too few for {len(orders)} harmonics, which need "
            f"{needed + 1} or more: give more samples, or fit fewer orders"
        )
    if turns.coverage < 0.9:
        raise RecordError(
            f"the samples cover {turns.coverage:.2f} of a turn: at least 0.9 is needed to separate "
            "offset and harmonics; check the unit of the angle"
        )


def _robust_fit(
    problem: HarmonicProblem, start: Array, turns: Turns, unit: str, least: float
) -> HarmonicFit:
    last: list[tuple[Array, NormalEquations, Array, Array]] = []

    def solve(w: Array) -> Array:
        equations = problem.sums(w)
        coefficients = solved(equations, problem.orders)
        residual = problem.residual(coefficients)[:, 0]
        last[:] = [(w, equations, coefficients, residual)]
        return residual

    coefficients = problem.first + 2 * len(problem.orders)
    if 2 * coefficients > start.size:
        keep = _single_outliers(solve, start, coefficients, least)
    else:
        keep = without_outliers(solve, start, float(np.abs(problem.y).max()), turns, least)
    weights = keep.astype(np.float64)
    # the last iteration of a few rejected outliers is already the required fit
    if not last or not np.array_equal(last[0][0], weights):
        solve(weights)
    _, equations, coefficients, residual = last[0]
    fit = fit_result(problem, equations, coefficients[:, 0], residual, keep, turns, unit)
    if len(fit.outliers) <= FEW * keep.size:
        return fit
    equations = problem.sums(None)
    coefficients = solved(equations, problem.orders)
    residual = problem.residual(coefficients)[:, 0]
    return covering_both(
        fit,
        fit_result(problem, equations, coefficients[:, 0], residual, None, turns, unit),
    )


# constants of Huber's and Tukey's weights for 95 % efficiency with normal noise
_HUBER, _TUKEY = 1.345, 4.685
_ROUNDS = 60
#: Share of samples up to which outliers are rejected directly, and the iterations for that.
FEW, _FEW_ROUNDS = 0.01, 6
#: Share of a residual from which a neighbour, or another turn, has the same error.
_SHARED = 0.5


def has_outlier(residual: Array) -> bool:
    """Return whether a residual is too large for normal noise of the size of the others."""
    size = np.abs(residual)
    return bool(size.max() > _threshold(size.size) * _spread(size))


def without_outliers(
    solve: Callable[[Array], Array],
    start: Array,
    value_size: float,
    turns: Turns,
    least: float = 0.0,
) -> NDArray[np.bool_]:
    """Return the mask of samples that are no outliers.

    `solve` maps weights of the samples to residuals of the fit, `start` are those of all samples.
    Residuals within the rounding of `value_size`, the largest of the values, count as zero; those
    up to `least` are no outliers. A
    record is refused if more than a quarter of its samples deviate, most of them singly.

    An outlier deviates alone: an error that the sample before or after shares, or most other turns
    at the same angle, belongs to the scale, and is kept.

    A few outliers of the first fit are excluded, and the fit is repeated until they are the same.
    If they are many, weighted least squares is repeated with Huber's weights (Huber 1964, Annals of
    Mathematical Statistics 35), then with Tukey's (Beaton and Tukey 1974, Technometrics 16). With
    normal noise at most one record in twenty loses a sample, whatever its length.
    """
    # largest share of samples that may deviate, if most of them do so singly
    most = 0.25
    floor = 1e-13 * value_size
    few = _few(solve, start, (floor, least), turns)
    if few is not None:
        return few
    residual = start
    for weigh, rounds in ((_huber, _ROUNDS // 4), (_tukey, _ROUNDS)):
        last = math.inf
        for _ in range(rounds):
            size = np.abs(residual)
            spread = max(_spread(size), floor)
            residual = solve(weigh(size / spread))
            if abs(spread - last) <= 1e-4 * spread:
                break
            last = spread
    near = _near(residual, (floor, least))
    keep = near | _of_the_scale(residual, ~near, turns)
    alone = int(keep.size - keep.sum())
    if near.mean() < 1.0 - most and alone > 0.5 * (near.size - near.sum()):
        raise RecordError(
            f"{near.size - int(near.sum())} of {near.size} samples deviate from the others, "
            f"{alone} of them singly: too many for outliers; check the columns and their units, or "
            "fit without rejecting outliers"
        )
    return keep


def _single_outliers(
    solve: Callable[[Array], Array], start: Array, coefficients: int, least: float
) -> NDArray[np.bool_]:
    """Return the mask without outliers, found one by one; for fits of more than n / 2 coefficients.

    The residuals of such a fit are few independent ones, whose median says little. A sample is an
    outlier if a fit without it predicts it with an error that Student's distribution excludes
    (Rosner 1983, Technometrics 25).
    """
    from scipy.special import stdtrit

    keep = np.ones(start.size, dtype=bool)
    residual = start
    for _ in range((start.size - coefficients) // 4):
        largest = int(np.argmax(np.where(keep, np.abs(residual), 0.0)))
        trial = keep.copy()
        trial[largest] = False
        left = solve(trial.astype(np.float64))
        free = int(trial.sum()) - coefficients
        square = float(np.sum(left[trial] ** 2)) / free
        # a residual is the predicted error times the share of the sample that is not fitted
        distance = float(residual[largest] * left[largest])
        limit = float(stdtrit(free, 1.0 - 0.0125 / keep.size)) ** 2 * square
        if distance <= limit or abs(left[largest]) <= least:
            break
        keep, residual = trial, left
    return keep


def _few(
    solve: Callable[[Array], Array],
    start: Array,
    floor: tuple[float, float],
    turns: Turns,
) -> NDArray[np.bool_] | None:
    """Return the mask without a few outliers, if excluding them adds no others, else None."""
    residual, last = start, np.ones(start.size, dtype=bool)
    for _ in range(_FEW_ROUNDS):
        near = _near(residual, floor)
        keep = near | _of_the_scale(residual, ~near, turns)
        if np.array_equal(keep, last):
            return keep
        if keep.mean() < 1.0 - FEW:
            return None
        residual, last = solve(keep.astype(np.float64)), keep
    return None


def _near(residual: Array, floor: tuple[float, float]) -> NDArray[np.bool_]:
    """Return for each sample whether it agrees with the fit.

    `floor` are the least rms, and the deviation up to which any sample agrees.
    """
    size = np.abs(residual)
    return size <= max(_threshold(size.size) * max(_spread(size), floor[0]), floor[1])


def _of_the_scale(residual: Array, suspect: NDArray[np.bool_], turns: Turns) -> NDArray[np.bool_]:
    """Return for each suspect sample whether others share its error, which is the scale's then."""
    at = np.flatnonzero(suspect)
    out = np.zeros(residual.size, dtype=bool)
    if at.size:
        out[at] = _in_a_run(residual, at, turns) | _repeated(residual, at, turns)
    return out


def _in_a_run(left: Array, at: NDArray[np.intp], turns: Turns) -> NDArray[np.bool_]:
    """Return whether the sample before or after has the error too, or is as near as usual."""
    # a quarter of a normal distribution is within this many rms of its mean
    quartile = 0.3186393639643752
    order = np.arange(left.size)
    if turns.direction == 0:
        order = np.argsort(turns.angle % (2.0 * math.pi), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(left.size)
    sign, size = np.sign(left[at]), np.abs(left[at])
    neighbours = [sign * left[order[(rank[at] + k) % left.size]] for k in (-1, 1)]
    nearest = np.maximum(*neighbours)
    # white noise of rms s has steps of rms s sqrt(2); each outlier makes two, so not their median
    step = float(np.quantile(np.abs(np.diff(left[order])), 0.25)) / (quartile * math.sqrt(2.0))
    return (nearest > _SHARED * size) | (size - nearest <= _threshold(left.size) * step)


def _repeated(left: Array, at: NDArray[np.intp], turns: Turns) -> NDArray[np.bool_]:
    """Return whether most of the other turns with samples at that angle have the error."""
    if turns.direction == 0 or len(turns.bounds) < 3:
        return np.zeros(at.size, dtype=bool)
    place = turns.angle / (2.0 * math.pi) % 1.0
    sign, size = np.sign(left[at]), np.abs(left[at])
    reach = 1.5 * float(np.median(np.abs(np.diff(turns.angle)))) / (2.0 * math.pi)
    there = np.full((len(turns.bounds) - 1, at.size), np.nan)
    for t, (first, end) in enumerate(pairwise(turns.bounds)):
        order = first + np.argsort(place[first:end], kind="stable")
        after = np.searchsorted(place[order], place[at])
        for j in (order[after % order.size], order[after - 1]):
            apart = np.abs(place[j] - place[at])
            near = np.minimum(apart, 1.0 - apart) <= reach
            there[t] = np.where(near, np.fmax(there[t], sign * left[j]), there[t])
        there[t, (at >= first) & (at < end)] = np.nan
    others = np.count_nonzero(np.isfinite(there), axis=0)
    shared = np.count_nonzero(there > _SHARED * size, axis=0)
    return (others > 0) & (2 * shared > others)


def _spread(size: Array) -> float:
    # largest number of samples of a median
    sampled = 50_000
    step = max(1, size.size // sampled)
    return RMS_OVER_MEDIAN * float(np.median(size[::step]))


def _threshold(count: int) -> float:
    """Return the multiple of the rms that the largest normal value exceeds once in 40 times."""
    from scipy.special import ndtri

    return max(4.0, -float(ndtri(0.0125 / count)))


def _huber(x: Array) -> Array:
    return np.minimum(1.0, _HUBER / np.maximum(x, _HUBER))


def _tukey(x: Array) -> Array:
    return np.where(x < _TUKEY, (1.0 - (x / _TUKEY) ** 2) ** 2, 0.0)
