"""A triangle with round corners."""

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.control.trajectories.trajectory import Trajectory, checked_ends, period_samples
from flexstage.errors import ModelError

#: How far a turn leads beyond the linear part, over speed and duration.
BEYOND = 5.0 / 16.0


def there_and_back(phase: Array, turn: float) -> Array:
    r"""Return a motion from 0 to 1 and back at constant speed, with turns of least jerk.

    In a turn of duration :math:`T_t` the speed goes from v to -v as a cubic,

    .. math:: \dot x = v\,(1 - 6 s^2 + 4 s^3), \qquad s = t/T_t,

    which has the least mean square of jerk of all turns that begin and end at that speed without
    acceleration, wherever they have their peak. It leads :math:`5/16\, v T_t` beyond the linear
    part; acceleration is at most :math:`3 v/T_t`, jerk :math:`12 v/T_t^2`.

    The phase is a share of the period, 0 in the middle of the lower turn; `turn` is the duration of
    a turn over half the period, above 0 and at most 1.

    Examples
    --------
    >>> there_and_back(np.array([0.0, 0.25, 0.5]), 0.2).round(6).tolist()
    [0.0, 0.5, 1.0]
    """
    # counted in half periods; the motion is odd about a quarter and even about a half
    t = 2.0 * np.abs(np.asarray(phase, dtype=np.float64) - np.round(phase))
    rising = np.minimum(t, 1.0 - t)
    speed = 1.0 / (1.0 - turn + 2.0 * BEYOND * turn)
    s = np.clip(rising / turn + 0.5, 0.5, 1.0)
    # turned upside down: the lower turn goes from -v to v
    way = -(s - 2.0 * s**3 + s**4) + BEYOND
    lower = speed * (turn * way + np.maximum(rising - 0.5 * turn, 0.0))
    return np.where(t <= 0.5, lower, 1.0 - lower)


def linear_between_turns(phase: Array, turn: float) -> NDArray[np.bool_]:
    """Say where such a motion has constant speed."""
    t = 2.0 * np.abs(np.asarray(phase, dtype=np.float64) - np.round(phase))
    edge = 0.5 * turn - 1e-9
    return (t >= edge) & (t <= 1.0 - edge)


def turn_share(turn_time: float | None, half_period: float) -> float:
    """Return the duration of a turn over half the period [1]; both are given in s."""
    if turn_time is None:
        return 0.1
    if not 0.0 < turn_time <= half_period * (1.0 + 1e-9):
        raise ModelError(
            f"a turn must take more than 0 s and at most half the period, {half_period:g} s, got "
            f"{turn_time!r} s"
        )
    return min(turn_time / half_period, 1.0)


def triangle(
    axis: str,
    low: float,
    high: float,
    rate_hz: float,
    *,
    sample_rate_hz: float,
    turn_time: float | None = None,
) -> Trajectory:
    """Return a triangle whose corners are turns of least jerk, begun at its lower end.

    With the range D, the half period h and the duration T of a turn the speed is
    ``v = D / (h - 3/8 T)``, the acceleration at most ``3 v / T``. The turns lie within the range.

    Parameters
    ----------
    axis : str
        The axis.
    low, high : float
        Lowest and highest position [m].
    rate_hz : float
        Periods in a second [Hz].
    sample_rate_hz : float
        Samples in a second [Hz].
    turn_time : float, optional
        Duration of a turn [s]; a tenth of the half period where not given.

    Returns
    -------
    Trajectory
        One period; its linear part has constant speed.

    Raises
    ------
    ModelError
        The ends do not rise, a rate is impossible, or the turn is longer than half the period.

    Examples
    --------
    >>> made = triangle("x", 2e-6, 61.5e-6, 1.0, sample_rate_hz=1e3, turn_time=0.04)
    >>> round(made.largest_speed("x") * 1e6, 2), round(made.overshoot * 1e6, 3)
    (122.68, 1.534)
    >>> round(made.linear_share, 2)
    0.92
    """
    low, high = checked_ends(low, high, axis)
    count, notes = period_samples(rate_hz, sample_rate_hz)
    half = 0.5 * count / sample_rate_hz
    turn = turn_share(turn_time, half)
    phase = np.arange(count) / count
    speed = (high - low) / (half * (1.0 - turn + 2.0 * BEYOND * turn))
    return Trajectory(
        positions={axis: low + (high - low) * there_and_back(phase, turn)},
        sample_rate_hz=float(sample_rate_hz),
        linear=linear_between_turns(phase, turn),
        kind="triangle",
        overshoot=BEYOND * speed * turn * half,
        notes=notes,
    )
