"""A triangle with round corners."""

import numpy as np

from flexstage.control.trajectories.trajectory import Trajectory, checked_ends, period_samples
from flexstage.control.trajectories.turns import (
    BEYOND,
    linear_between_turns,
    there_and_back,
    turn_share,
)


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
