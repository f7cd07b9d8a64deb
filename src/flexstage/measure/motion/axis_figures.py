"""The stroke of an axis from its curve, with hysteresis and drift told apart."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.estimate import Estimate
from flexstage.measure.motion.curve_extremes import curve_loop_width
from flexstage.measure.motion.curve_fit import fit_motion_curve
from flexstage.measure.motion.cycles import MotionCycles, spread_estimate
from flexstage.measure.motion.motion_curve import MotionCurve


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stroke:
    """How far an axis goes, and how well it does so again."""

    stroke: Estimate
    """From the lower to the upper end of the command, averaged over both runs and all cycles [m].
    """
    of_cycles: Array
    """Of each cycle [m], shape (c,)."""
    repeatability: Estimate
    """Standard deviation of the stroke from cycle to cycle [m]."""
    end_repeatability: tuple[Estimate, Estimate]
    """Standard deviations of the position at the lower and at the upper end from cycle to cycle,
    drift taken off [m].
    """
    gain: Estimate
    """Slope of the least-squares line of position over command [m/V, or 1 of a displacement]."""
    loop_width: Estimate
    """Largest distance of the forward from the backward run at equal command [m]."""
    drift_rate: Estimate | None
    """Rate at which the position wanders [m/s]; None where it was not fitted."""
    curve: MotionCurve
    """Position over command, from which all of this was taken."""


def stroke(
    command: ArrayLike,
    position: ArrayLike,
    time: ArrayLike,
    *,
    cycles: MotionCycles | None = None,
    drift: bool = True,
    command_unit: str = "m",
) -> Stroke:
    """Find the stroke of an axis, with hysteresis and drift told apart.

    The position is fitted as a curve over the command (`fit_motion_curve`), forward and backward,
    and the stroke is the difference of its ends. So it is no largest value, which noise would
    enlarge.

    Parameters
    ----------
    command : array_like
        Command in cycles over the stroke: triangle, sine or staircase [V or m], shape (n,).
    position : array_like
        Measured position along the axis [m], shape (n,).
    time : array_like
        Time, rising [s], shape (n,).
    cycles : MotionCycles, optional
        Cycles of the command; found where not given.
    drift : bool
        Whether to take a linear drift off; it needs three cycles.
    command_unit : str
        Unit of the command.

    Returns
    -------
    Stroke
        The figures.

    Validity
    --------
    The spread from cycle to cycle holds the noise of the sensor as well, averaged as the curve
    does. The position at an end includes offsets that differ from cycle to cycle; the stroke does
    not.

    Raises
    ------
    RecordError
        The columns do not belong together, or there are too few cycles.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2000) / 400.0
    >>> c, s = np.cos(2.0 * np.pi * t), np.sin(2.0 * np.pi * t)
    >>> noise = 3e-9 * np.random.default_rng(2).standard_normal(t.size)
    >>> position = -31e-6 * c - 0.8e-6 * s * abs(s) + 1e-8 * t + noise
    >>> found = stroke(60.0 - 60.0 * c, position, t, command_unit="V")
    >>> print(f"{1e6 * found.stroke.value:.2f} um, loop {1e6 * found.loop_width.value:.2f} um")
    62.00 um, loop 1.60 um
    """
    curve = fit_motion_curve(
        command, position, time, cycles=cycles, drift=drift, position_unit=command_unit
    )
    ends = curve.rows([curve.basis.low, curve.basis.high], "mean")
    across = ends[1] - ends[0]
    of_cycles = curve.each_cycle(across)
    lost = 2 if drift else 1
    at_ends = tuple(
        spread_estimate(
            curve.each_cycle(end) - end @ curve.coefficients.ravel(),
            unit="m",
            degrees_of_freedom=curve.cycles - lost,
            note="drift taken off" if drift else "",
        )
        for end in ends
    )
    return Stroke(
        stroke=curve.of_coefficients(across, reach=2.0**0.5),
        of_cycles=of_cycles,
        repeatability=spread_estimate(of_cycles, unit="m", note="from cycle to cycle, with noise"),
        end_repeatability=(at_ends[0], at_ends[1]),
        gain=curve.slope(),
        loop_width=curve_loop_width(curve),
        drift_rate=curve.drift_rate,
        curve=curve,
    )
