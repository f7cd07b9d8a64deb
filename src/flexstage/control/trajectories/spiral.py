r"""A spiral from the middle outwards and back on the same path.

The path is Archimedes' spiral, :math:`r = p\,\theta/2\pi` with the pitch p. At constant angular
velocity the angle is proportional to the time; at constant linear velocity v

.. math:: \dot\theta = \frac{v}{\sqrt{r^2 + (v/\omega)^2 + (p/2\pi)^2}}

where the largest angular velocity :math:`\omega` keeps the motion smooth near the middle.
"""

import math
from typing import Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.control.trajectories.trajectory import Trajectory, period_samples
from flexstage.control.trajectories.triangle import linear_between_turns, there_and_back
from flexstage.errors import ModelError

#: Points of the path from which its time law is inverted.
_POINTS = 20001


def spiral(
    axes: tuple[str, str],
    centre: tuple[float, float],
    radius: float,
    pitch: float,
    *,
    sample_rate_hz: float,
    turn_rate_hz: float,
    velocity: Literal["angular", "linear"] = "angular",
    speed: float | None = None,
    turn: float = 0.02,
) -> Trajectory:
    """Return a spiral, outwards and back.

    Parameters
    ----------
    axes : tuple of str
        The two axes.
    centre : tuple of float
        Its middle [m].
    radius : float
        Its outer radius [m].
    pitch : float
        Distance from one turn to the next [m].
    sample_rate_hz : float
        Samples in a second [Hz].
    turn_rate_hz : float
        Turns in a second [Hz]; the largest number of them at constant linear velocity.
    velocity : {"angular", "linear"}
        Which velocity is constant.
    speed : float, optional
        The constant linear velocity [m/s]; given for it, and only for it.
    turn : float
        Share of the way outwards in which the motion comes to rest and turns back [1].

    Returns
    -------
    Trajectory
        The way outwards and back; its linear part is where the velocity is constant.

    Raises
    ------
    ModelError
        A size is not positive, the pitch exceeds the radius, or the speed is missing or too much.

    Examples
    --------
    >>> made = spiral(("x", "y"), (30e-6, 30e-6), 25e-6, 1e-6, sample_rate_hz=2e3,
    ...               turn_rate_hz=10.0)
    >>> round(made.period, 2), round(made.linear_share, 2)
    (5.04, 0.98)
    """
    for name, value in (("radius", radius), ("pitch", pitch), ("rate of turns", turn_rate_hz)):
        if not 0.0 < value < math.inf:
            raise ModelError(f"the {name} of a spiral must be positive, got {value!r}")
    if pitch > radius:
        raise ModelError(
            f"the pitch of a spiral, {pitch:g} m, must not exceed its radius, {radius:g} m"
        )
    if (velocity == "linear") != (speed is not None):
        raise ModelError(
            "a spiral at constant linear velocity needs its speed, and no other takes one; got "
            f"velocity {velocity!r} and speed {speed!r}"
        )
    angle, elapsed = _time_law(radius, pitch, turn_rate_hz, speed)
    # there_and_back is faster than the mean by what its turns take longer
    stretch = 1.0 - 0.375 * turn
    total = 2.0 * elapsed[-1] / stretch
    count, _ = period_samples(1.0 / total, sample_rate_hz)
    phase = np.arange(count) / count
    at = elapsed[-1] * there_and_back(phase, turn)
    theta = _angle_at(at, angle, elapsed)
    r = pitch * theta / (2.0 * math.pi)
    linear = linear_between_turns(phase, turn)
    if speed is not None:
        linear &= r > 3.0 * speed / (2.0 * math.pi * turn_rate_hz)
    return Trajectory(
        positions={axes[0]: centre[0] + r * np.cos(theta), axes[1]: centre[1] + r * np.sin(theta)},
        sample_rate_hz=float(sample_rate_hz),
        linear=linear,
        kind="spiral",
    )


def _angle_at(time: Array, angle: Array, elapsed: Array) -> Array:
    from scipy.interpolate import CubicSpline

    # a spline, so that the speed has no kinks
    return np.asarray(CubicSpline(elapsed, angle)(time), dtype=np.float64)


def _time_law(
    radius: float, pitch: float, turn_rate_hz: float, speed: float | None
) -> tuple[Array, Array]:
    """Return angles of the way outwards, and the time at which each is reached."""
    omega = 2.0 * math.pi * turn_rate_hz
    angle = np.linspace(0.0, 2.0 * math.pi * radius / pitch, _POINTS)
    if speed is None:
        return angle, angle / omega
    if not 0.0 < speed < omega * radius:
        raise ModelError(
            f"the speed of a spiral must be positive and below that of its outermost turn at the "
            f"largest rate of turns, {omega * radius:.3g} m/s, got {speed!r} m/s"
        )
    r = pitch * angle / (2.0 * math.pi)
    slowness = np.sqrt(r**2 + (speed / omega) ** 2 + (pitch / (2.0 * math.pi)) ** 2) / speed
    steps = 0.5 * (slowness[1:] + slowness[:-1]) * np.diff(angle)
    return angle, np.concatenate(([0.0], np.cumsum(steps)))
