"""A staircase: steps of least jerk with rests between them, up and down again."""

from collections.abc import Sequence

import numpy as np

from flexstage.control.trajectories.trajectory import Trajectory, period_samples, smooth_step
from flexstage.errors import ModelError


def staircase(
    axis: str,
    levels: Sequence[float],
    *,
    move_time: float,
    hold_time: float,
    sample_rate_hz: float,
) -> Trajectory:
    """Return a staircase over levels, and back over the same ones.

    A step of height D has a speed of at most ``1.875 D / move_time`` and an acceleration of at most
    ``5.774 D / move_time^2``; it does not overshoot.

    Parameters
    ----------
    axis : str
        The axis.
    levels : sequence of float
        Positions [m], two or more; after the last the same ones follow backwards.
    move_time : float
        Time of a step [s].
    hold_time : float
        Time of a rest [s].
    sample_rate_hz : float
        Samples in a second [Hz].

    Returns
    -------
    Trajectory
        One period, begun with a rest; its linear part is where it rests.

    Raises
    ------
    ModelError
        There are fewer than two levels, or a time is shorter than a sample.

    Examples
    --------
    >>> made = staircase("x", [10e-6, 10.1e-6, 10.2e-6], move_time=0.02, hold_time=0.08,
    ...                  sample_rate_hz=1e3)
    >>> round(made.period, 6), round(made.linear_share, 2)
    (0.4, 0.81)
    """
    if len(levels) < 2:
        raise ModelError(f"a staircase needs two levels or more, got {len(levels)}")
    move, hold = round(move_time * sample_rate_hz), round(hold_time * sample_rate_hz)
    if move < 1 or hold < 1:
        raise ModelError(
            f"a step and a rest must last a sample, {1.0 / sample_rate_hz:g} s, at least, got "
            f"{move_time!r} and {hold_time!r} s"
        )
    way = np.asarray([*levels, *list(levels)[-2::-1]], dtype=np.float64)
    period_samples(sample_rate_hz / ((move + hold) * (way.size - 1)), sample_rate_hz)
    # the last level is the first: it needs no rest of its own
    k = np.arange((move + hold) * (way.size - 1))
    step, within = k // (move + hold), k % (move + hold)
    share = smooth_step((within - hold + 1.0) / move)
    return Trajectory(
        positions={axis: way[step] + (way[step + 1] - way[step]) * share},
        sample_rate_hz=float(sample_rate_hz),
        linear=(within < hold) | (within == hold + move - 1),
        kind="staircase",
    )
