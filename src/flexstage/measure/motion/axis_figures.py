"""Figures of axes from their curves: stroke, hysteresis, drift, linearity, coupling, squareness."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.estimate import Component, Estimate
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

    @property
    def relative_loop_width(self) -> float:
        """Width of the loop over the stroke [1]."""
        return self.loop_width.value / abs(self.stroke.value)


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coupling:
    """What an axis moves across its direction."""

    slope: Estimate
    """Motion across for a unit of motion along, by least squares [1]."""
    angle: Estimate
    """The angle of the path to the direction of the sensors along [rad]."""
    largest: Estimate
    """Largest less smallest displacement across, over the stroke [m]."""
    share: Estimate
    """That over the stroke [1]."""


def cross_coupling(
    curve: MotionCurve, *, alignment: Estimate | None = None, seed: int = 0
) -> Coupling:
    """Find the cross-coupling of an axis from its displacement across over that along.

    A sensor that is turned by an angle shows that angle as coupling: what is known of it is taken
    off the slope, and its uncertainty joins that of the slope.

    Parameters
    ----------
    curve : MotionCurve
        Displacement across over displacement along, both measured [m].
    alignment : Estimate, optional
        Angle by which the frame of the sensors has to turn, from along to across, to meet that of
        the stage: it is added to the slope [rad]. Nothing is taken off or added where not given.
    seed : int
        Seed of the simulation that finds what noise adds to a range.

    Returns
    -------
    Coupling
        Slope, angle and range.

    Validity
    --------
    Angles that are small: the slope and the alignment add as they are below some 10 mrad. Without
    an alignment nobody can tell coupling from a sensor that is turned.

    Raises
    ------
    ModelError
        Position and reading of the curve do not have the same unit, or the alignment is no angle.

    Examples
    --------
    >>> import numpy as np
    >>> from flexstage.measure.motion.curve_fit import fit_motion_curve
    >>> t = np.arange(900) / 300.0
    >>> along = 4e-5 * (1.0 - np.cos(2.0 * np.pi * t))
    >>> curve = fit_motion_curve(along, 2.3e-3 * along, t)
    >>> turned = Estimate(value=-4e-4, unit="rad")
    >>> print(f"{cross_coupling(curve, alignment=turned).slope.value:.4f}")
    0.0019
    """
    if curve.unit != curve.position_unit:
        raise ModelError(
            "cross-coupling compares two displacements in one unit, got a reading in "
            f"'{curve.unit}' over a position in '{curve.position_unit}'"
        )
    found = curve.slope()
    if alignment is not None:
        found = _joined(found, alignment)
    extent = curve.basis.high - curve.basis.low
    largest = curve_range(curve, seed=seed)
    return Coupling(
        slope=found, angle=_angle(found), largest=largest, share=largest.times(1.0 / extent, "1")
    )


def squareness(
    y_over_x: MotionCurve, x_over_y: MotionCurve, *, alignment: Estimate | None = None
) -> Estimate:
    """Return the angle between the paths of two axes less a right angle.

    Its sign is that of the angle from the path of x to that of y, counterclockwise, less pi/2:
    negative where the positive directions come closer together. A turn of both sensors in their
    plane does not enter it.

    Parameters
    ----------
    y_over_x : MotionCurve
        Displacement along y over that along x while x moves [m].
    x_over_y : MotionCurve
        Displacement along x over that along y while y moves [m].
    alignment : Estimate, optional
        Angle between the directions of the two sensors less a right angle, which is added [rad].

    Returns
    -------
    Estimate
        The squareness [rad].

    Validity
    --------
    The two paths were measured in runs that are independent of each other.

    Raises
    ------
    ModelError
        A curve does not have the same unit for both of its displacements, or the alignment is no
        angle.

    Examples
    --------
    >>> import numpy as np
    >>> from flexstage.measure.motion.curve_fit import fit_motion_curve
    >>> t = np.arange(900) / 300.0
    >>> s = 4e-5 * (1.0 - np.cos(2.0 * np.pi * t))
    >>> one, two = fit_motion_curve(s, 2e-3 * s, t), fit_motion_curve(s, -1.4e-3 * s, t)
    >>> print(f"{1e3 * squareness(one, two).value:.2f} mrad")
    -0.60 mrad
    """
    angles = []
    for name, curve in (("x", y_over_x), ("y", x_over_y)):
        if curve.unit != curve.position_unit:
            raise ModelError(
                f"the path of {name} needs two displacements in one unit, got a reading in "
                f"'{curve.unit}' over a position in '{curve.position_unit}'"
            )
        angles.append(_angle(curve.slope()))
    parts = tuple(
        replace(part, name=f"{part.name} of {name}")
        for name, angle in zip("xy", angles, strict=True)
        for part in angle.components
    )
    found = Estimate(value=-angles[0].value - angles[1].value, unit="rad", components=parts)
    return found if alignment is None else _joined(found, alignment)


def _angle(slope: Estimate) -> Estimate:
    """Return the angle of a slope, with the uncertainty that its derivative gives."""
    turned = slope.times(1.0 / (1.0 + slope.value**2), "rad")
    return replace(turned, value=math.atan(slope.value))


def _joined(found: Estimate, alignment: Estimate) -> Estimate:
    if alignment.unit != "rad":
        raise ModelError(f"an alignment is an angle in rad, got '{alignment.unit}'")
    part = Component(
        name="alignment",
        uncertainty=alignment.uncertainty,
        degrees_of_freedom=alignment.degrees_of_freedom,
        kind="B",
    )
    return replace(found.plus(part), value=found.value + alignment.value)
