"""A raster: a fast triangle, and a slow axis that goes on steadily or from line to line."""

from typing import Literal

import numpy as np

from flexstage.control.trajectories.trajectory import (
    Trajectory,
    checked_ends,
    period_samples,
    smooth_step,
)
from flexstage.control.trajectories.triangle import (
    BEYOND,
    linear_between_turns,
    there_and_back,
    turn_share,
)
from flexstage.errors import ModelError


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
