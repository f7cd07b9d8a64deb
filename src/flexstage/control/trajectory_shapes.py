"""Trajectories of usual shapes: sines, triangles with round corners, rasters."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.control.trajectory import (
    Trajectory,
    checked_ends,
    period_samples,
    smooth_step,
)

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


def sine(
    axis: str, low: float, high: float, rate_hz: float, *, sample_rate_hz: float
) -> Trajectory:
    """Return a sine, begun at its lower end.

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

    Returns
    -------
    Trajectory
        One period; the speed is at most ``pi rate (high - low)``.

    Raises
    ------
    ModelError
        The ends do not rise, or a rate is impossible.

    Examples
    --------
    >>> made = sine("y", 1e-6, 60.5e-6, 50.0, sample_rate_hz=10e3)
    >>> round(made.largest_speed("y") * 1e3, 2)
    9.34
    """
    low, high = checked_ends(low, high, axis)
    count, notes = period_samples(rate_hz, sample_rate_hz)
    phase = 2.0 * np.pi * np.arange(count) / count
    return Trajectory(
        positions={axis: 0.5 * (low + high) - 0.5 * (high - low) * np.cos(phase)},
        sample_rate_hz=float(sample_rate_hz),
        linear=np.ones(count, dtype=np.bool_),
        kind="sine",
        notes=notes,
    )


def raster(
    axes: tuple[str, str],
    fast: tuple[float, float],
    slow: tuple[float, float],
    line_rate_hz: float,
    lines: int,
    *,
    sample_rate_hz: float,
    slow_motion: Literal["ramp", "steps"] = "ramp",
    turn_time: float | None = None,
) -> Trajectory:
    """Return a raster, over the field and back.

    Every line is a period of the fast axis, there and back. After the last line the slow axis goes
    back over the field while the fast one goes on, so that the whole repeats without a jump.

    Parameters
    ----------
    axes : tuple of str
        The fast and the slow axis.
    fast, slow : tuple of float
        Lowest and highest position of each [m].
    line_rate_hz : float
        Lines in a second [Hz].
    lines : int
        Number of lines of the field, 2 or more.
    sample_rate_hz : float
        Samples in a second [Hz].
    slow_motion : {"ramp", "steps"}
        Steady motion of the slow axis with round turns at the ends of the field, or steps of least
        jerk from line to line while the fast axis turns at its lower end.
    turn_time : float, optional
        Duration of a turn of the fast axis [s]; a tenth of half a line where not given.

    Returns
    -------
    Trajectory
        The field forwards and backwards; its linear part is where both axes move steadily.

    Raises
    ------
    ModelError
        The ends do not rise, a rate or a time is impossible, or there are fewer than two lines.

    Examples
    --------
    >>> made = raster(("x", "y"), (1e-6, 51e-6), (5e-6, 25e-6), 10.0, 16, sample_rate_hz=2e3,
    ...               slow_motion="steps")
    >>> round(made.period, 6), round(made.linear_share, 2)
    (3.2, 0.91)
    """
    x0, x1 = checked_ends(*fast, axes[0])
    y0, y1 = checked_ends(*slow, axes[1])
    if lines < 2:
        raise ModelError(f"a raster needs two lines or more, got {lines}")
    if slow_motion not in ("ramp", "steps"):
        raise ModelError(f"the slow axis moves by 'ramp' or 'steps', got {slow_motion!r}")
    count, notes = period_samples(line_rate_hz, sample_rate_hz)
    half = 0.5 * count / sample_rate_hz
    turn = turn_share(turn_time, half)
    line = np.arange(2 * lines * count) / count
    linear = linear_between_turns(line, turn)
    if slow_motion == "ramp":
        # the slow axis turns while the fast one does a whole line
        own = 1.0 / lines
        share = there_and_back(line / (2 * lines), own)
        linear &= linear_between_turns(line / (2 * lines), own)
    else:
        share = _steps(line, lines, turn)
    speed = (x1 - x0) / (half * (1.0 - turn + 2.0 * BEYOND * turn))
    return Trajectory(
        positions={
            axes[0]: x0 + (x1 - x0) * there_and_back(line, turn),
            axes[1]: y0 + (y1 - y0) * share,
        },
        sample_rate_hz=float(sample_rate_hz),
        linear=linear,
        kind="raster",
        overshoot=BEYOND * speed * turn * half,
        notes=notes,
    )


def _steps(line: np.ndarray, lines: int, turn: float) -> np.ndarray:
    """Levels 0 ... n-1, n-1 ... 0, each left during the turn about the end of its line."""
    level = np.concatenate((np.arange(lines), np.arange(lines)[::-1])) / (lines - 1.0)
    nearest = np.round(line).astype(np.intp)
    before, after = level[nearest - 1], level[nearest % level.size]
    # a turn lasts `turn` of half a line
    share = smooth_step((line - nearest) / (0.5 * turn) + 0.5)
    return before + (after - before) * share
