"""Harmonics of an error over the turn, by least squares, with what they are worth."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.centring.harmonic_fit import MANY_TURNS, HarmonicFit, covering_both, described
from flexstage.centring.normal_equations import HarmonicProblem, NormalEquations, of_column, solved
from flexstage.centring.outliers import FEW, stands_out, without_outliers
from flexstage.centring.turn_spectrum import whole_orders
from flexstage.centring.turns import Turns, find_turns
from flexstage.errors import RecordError

_TURN = 2.0 * math.pi

#: Orders that are fitted where nobody says which, and samples allow.
_USUAL = 12


def fit_harmonics(
    angle: ArrayLike,
    value: ArrayLike,
    *,
    orders: int | Sequence[int] | None = None,
    robust: bool = True,
    unit: str = "rad",
) -> HarmonicFit:
    r"""Fit harmonics of the turn to values at any angles.

    .. math:: y(\theta) = c + d\,\frac{\theta}{2\pi} + \sum_n a_n \cos n\theta + b_n \sin n\theta

    The coefficients are those of least squares; a drift is fitted from about two turns on, as
    within one turn it is hardly told from harmonics. Their covariance allows for noise that lasts
    from sample to sample: from eight turns on it is taken from how turns differ, of two and
    more from the spectrum of the residuals between the orders, and of fewer from all of it, where
    that is not white. An outlier is a sample that stands out alone: an error that comes in runs, or
    again in other turns, is the scale's. Where more than a hundredth of the samples are set aside,
    the intervals cover the fit of all samples too.

    Parameters
    ----------
    angle : array_like
        Angle of each sample [rad], shape (n,): rising, falling or in any order, wrapped or not, of
        one turn or several, from any start.
    value : array_like
        The values, shape (n,).
    orders : int or sequence of int, optional
        Highest order, or all that are fitted; 1 to 12 where not given, or fewer as samples allow.
    robust : bool
        Whether to look for outliers, and set them aside.
    unit : str
        Unit of the values.

    Returns
    -------
    HarmonicFit
        The harmonics, with uncertainty.

    Validity
    --------
    The harmonics are those of the error at the places that were sampled; of uneven samples, what is
    beyond the orders fitted leaks into them. Within one turn sharp errors of the scale cannot be
    told from noise: they make intervals too wide, and one that is a single sample long counts as an
    outlier. Noise of fewer than eight turns: white
    and drifting, as of an autoregressive process, in samples at about equal steps. Errors of the
    angle times the slope of the values are noise too.

    Raises
    ------
    RecordError
        The samples are too few, not finite, cover less than 0.9 of a turn, or cannot tell the
        orders apart; an order is not positive; more than a quarter of the samples stand out, most
        of them alone.

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
    return fit_many(angle, y[:, None], orders=orders, robust=robust, unit=unit)[0]


def fit_many(
    angle: ArrayLike,
    values: ArrayLike,
    *,
    orders: int | Sequence[int] | None = None,
    robust: bool = True,
    unit: str = "rad",
) -> tuple[HarmonicFit, ...]:
    """Fit harmonics of the turn to several columns that share their angles.

    It does what `fit_harmonics` does to each column, and is faster than that many calls.

    Parameters
    ----------
    angle : array_like
        Angle of each sample [rad], shape (n,).
    values : array_like
        The columns, shape (n, m).
    orders : int or sequence of int, optional
        Highest order, or all that are fitted.
    robust : bool
        Whether to look for outliers, and set them aside.
    unit : str
        Unit of the values.

    Returns
    -------
    tuple of HarmonicFit
        One for each column.

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
            f"{int((~np.isfinite(y)).sum())} of the values are not finite: leave these samples out"
        )
    turns = find_turns(theta)
    chosen = _orders(orders, turns.angle)
    # the least number of turns from which a drift can be told from harmonics
    with_drift = turns.count >= 1.9
    _require_enough(turns, chosen, with_drift)
    # about its middle the drift is least like the mean, and the offset is the mean over the record
    middle = 0.5 * (turns.angle.max() + turns.angle.min()) / _TURN
    shift = math.floor(middle)
    problem = HarmonicProblem(
        u=turns.angle / _TURN - shift, y=y, orders=chosen, drift=with_drift,
        middle=middle - shift, bounds=turns.bounds if len(turns.bounds) > MANY_TURNS else None,
    )  # fmt: skip
    equations = problem.sums(None)
    coefficients = solved(equations, chosen)
    residual = problem.residual(coefficients)
    fits = []
    for j in range(y.shape[1]):
        own = residual[:, j]
        if (
            robust
            and stands_out(own)
            and float(np.abs(own).max()) > 1e-12 * float(np.abs(y[:, j]).max())
        ):
            fits.append(_robust_fit(problem.column(j), own, turns, unit))
            continue
        single = of_column(equations, j)
        fits.append(
            described(problem.column(j), single, coefficients[:, j], own, None, turns, unit)
        )
    return tuple(fits)


def _orders(orders: int | Sequence[int] | None, angle: Array) -> tuple[int, ...]:
    if orders is None:
        places = int(np.unique(np.rint(angle / _TURN % 1.0 * 1e6)).size)
        return tuple(range(1, max(1, min(_USUAL, (places - 2) // 2)) + 1))
    if isinstance(orders, (int, np.integer)):
        orders = range(1, int(orders) + 1)
    return whole_orders(orders)


def _require_enough(turns: Turns, orders: tuple[int, ...], drift: bool) -> None:
    size, needed = turns.angle.size, 2 * len(orders) + (2 if drift else 1)
    if size <= needed:
        raise RecordError(
            f"{size} samples are too few for {len(orders)} harmonics, which take "
            f"{needed + 1} or more: give more samples, or fit fewer orders"
        )
    if turns.coverage < 0.9:
        raise RecordError(
            f"the samples cover {turns.coverage:.2f} of a turn: 0.9 or more are "
            "needed, as otherwise offset and harmonics cannot be separated; check the unit of the "
            "angle"
        )


def _robust_fit(problem: HarmonicProblem, start: Array, turns: Turns, unit: str) -> HarmonicFit:
    last: list[tuple[Array, NormalEquations, Array, Array]] = []

    def solve(w: Array) -> Array:
        equations = problem.sums(w)
        coefficients = solved(equations, problem.orders)
        residual = problem.residual(coefficients)[:, 0]
        last[:] = [(w, equations, coefficients, residual)]
        return residual

    keep = without_outliers(solve, start, float(np.abs(problem.y).max()), turns)
    own = keep.astype(np.float64)
    # a few that were left out one by one end in the very fit that is wanted
    if not last or not np.array_equal(last[0][0], own):
        solve(own)
    _, equations, coefficients, residual = last[0]
    fit = described(problem, equations, coefficients[:, 0], residual, keep, turns, unit)
    if len(fit.outliers) <= FEW * keep.size:
        return fit
    equations = problem.sums(None)
    coefficients = solved(equations, problem.orders)
    residual = problem.residual(coefficients)[:, 0]
    return covering_both(
        fit,
        described(problem, equations, coefficients[:, 0], residual, None, turns, unit),
    )
