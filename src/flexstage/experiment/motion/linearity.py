"""How far the motion of an axis is from a straight line over its command."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.estimate import Estimate
from flexstage.experiment.motion.curve_extremes import (
    Line,
    curve_largest,
    curve_range,
    line_weights,
)
from flexstage.experiment.motion.motion_curve import Direction, MotionCurve


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
    >>> from flexstage.experiment.motion.curve_fit import fit_motion_curve
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
