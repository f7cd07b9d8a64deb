"""Figures of axes from their curves: stroke, hysteresis, drift, linearity."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.estimate import Estimate
from flexstage.measure.motion.curve_extremes import (
    Line,
    curve_largest,
    curve_loop_width,
    curve_range,
    line_weights,
)
from flexstage.measure.motion.curve_fit import fit_motion_curve
from flexstage.measure.motion.cycles import MotionCycles, spread_estimate
from flexstage.measure.motion.motion_curve import Direction, MotionCurve


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
    order: int | None = None,
    settling: float = 0.3,
    unit: str = "m",
    command_unit: str = "m",
    seed: int = 0,
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
    order : int, optional
        Order of the curve; chosen where not given.
    settling : float
        Share of each rest of a staircase to leave out at its beginning [1].
    unit, command_unit : str
        Units of position and command.
    seed : int
        Seed of the simulation that finds what noise adds to the width of the loop.

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
        command, position, time, cycles=cycles, order=order, drift=drift, settling=settling,
        unit=unit, position_unit=command_unit,
    )  # fmt: skip
    ends = curve.rows([curve.basis.low, curve.basis.high], "mean")
    across = ends[1] - ends[0]
    of_cycles = curve.each_cycle(across)
    lost = 2 if drift else 1
    at_ends = tuple(
        spread_estimate(
            curve.each_cycle(end) - end @ curve.coefficients.ravel(),
            unit=unit,
            degrees_of_freedom=curve.cycles - lost,
            note="drift taken off" if drift else "",
        )
        for end in ends
    )
    return Stroke(
        stroke=curve.of_coefficients(across, reach=2.0**0.5),
        of_cycles=of_cycles,
        repeatability=spread_estimate(of_cycles, unit=unit, note="from cycle to cycle, with noise"),
        end_repeatability=(at_ends[0], at_ends[1]),
        gain=curve.slope(),
        loop_width=curve_loop_width(curve, seed=seed),
        drift_rate=curve.drift_rate,
        curve=curve,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Linearity:
    """Distance of a curve from a straight line."""

    line: Line
    """The line: of least squares, through the ends, or from the lower end with the slope of least
    squares.
    """
    largest: Estimate
    """Largest distance from it [m]."""
    range: Estimate
    """Largest less smallest distance, with sign [m]."""
    percent: Estimate
    """Largest distance over the stroke [%]."""
    slope: float
    """Slope of the line, in the unit of the reading over that of the command."""
    position: Array
    """Positions at which the distance is given, shape (g,)."""
    deviation: Array
    """Distance of the curve from the line there [m], shape (g,), or (2, g) for both runs."""


def linearity(
    curve: MotionCurve,
    *,
    line: Literal["least_squares", "terminal", "zero"] = "least_squares",
    direction: Direction | Literal["both"] = "mean",
    seed: int = 0,
) -> Linearity:
    """Compare a curve of position over command with a straight line.

    Parameters
    ----------
    curve : MotionCurve
        Position over command.
    line : {"least_squares", "terminal", "zero"}
        The line: of least squares over the stroke, all commands alike; through the ends of the
        curve; or through its lower end, with the slope that is best then.
    direction : {"forward", "backward", "mean", "both"}
        Which run; of both, the two runs about the line of their mean, which counts hysteresis in.
    seed : int
        Seed of the simulation that finds what noise adds to an extreme.

    Returns
    -------
    Linearity
        Largest distance and range, in metres and in per cent of the stroke.

    Raises
    ------
    ModelError
        There is no such line or direction.

    Examples
    --------
    >>> from flexstage.measure.motion.curve_fit import fit_motion_curve
    >>> t = np.arange(1500) / 300.0
    >>> u = 1.0 - np.cos(2.0 * np.pi * t)
    >>> curve = fit_motion_curve(u, 3e-5 * u + 2e-7 * u**2, t, position_unit="V")
    >>> found = linearity(curve, line="terminal")
    >>> print(f"{1e9 * found.largest.value:.0f} nm, {found.percent.value:.2f} %")
    200 nm, 0.33 %
    """
    largest = curve_largest(curve, direction, line=line, seed=seed)
    x = curve.grid()
    over = "mean" if direction == "both" else direction
    mean = curve.value(x, over)
    base = line_weights(x, line) @ mean
    names: tuple[Direction, ...] = ("forward", "backward") if direction == "both" else (direction,)
    deviation = np.array([curve.value(x, name) - base for name in names])
    extent = float(abs(mean[-1] - mean[0]))
    return Linearity(
        line=line,
        largest=largest,
        range=curve_range(curve, direction, line=line, seed=seed),
        # the stroke is known far better, of itself, than a small difference from a line
        percent=largest.times(100.0 / extent, "%"),
        slope=float((base[-1] - base[0]) / (x[-1] - x[0])),
        position=x,
        deviation=deviation if direction == "both" else deviation[0],
    )
