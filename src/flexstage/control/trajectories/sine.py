"""A sine."""

import numpy as np

from flexstage.control.trajectories.trajectory import Trajectory, checked_ends, period_samples


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
