"""The area that a stage of two axes reaches, its corners, sides, diagonals and squareness."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import RecordError
from flexstage.estimate import Estimate
from flexstage.measure.motion.cycles import spread_estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Workspace:
    """What a stage of two axes reaches.

    Corners are in the order low x and low y, high x and low y, high x and high y, low x and high y.
    """

    corners: Array
    """Mean corners [m], shape (4, 2)."""
    area: Estimate
    """Area between the corners [m^2]."""
    stroke_x: tuple[Estimate, Estimate]
    """Distance from corner to corner along x, at low and at high y [m]."""
    stroke_y: tuple[Estimate, Estimate]
    """The same along y, at low and at high x [m]."""
    diagonals: tuple[Estimate, Estimate]
    """From low x, low y to high x, high y, and from high x, low y to low x, high y [m]."""
    squareness: Estimate
    """Angle from the mean direction of the x sides to that of the y sides, less a right angle
    [rad].
    """
    repeatability: Estimate
    """Standard deviation of a coordinate of a corner from round to round, of all corners [m]."""
    rounds: int
    """How many times each corner was reached."""


def workspace(corners: ArrayLike) -> Workspace:
    r"""Find the figures of a workspace from its corners, reached several times.

    The area is :math:`\frac12 \sum_i (x_i y_{i+1} - x_{i+1} y_i)` (the surveyor's formula, Meister
    1769). Every figure is taken of the mean corners, and its uncertainty from what the rounds give
    it by its derivative: the rounds are independent observations, whatever their corners have in
    common.

    Parameters
    ----------
    corners : array_like
        The four corners in the order that `Workspace` has, for each round, shape (r, 4, 2) [m].

    Returns
    -------
    Workspace
        The figures.

    Validity
    --------
    A drift from round to round counts as scatter, and enters the repeatability; of lengths, angles
    and the area it cancels as far as it shifts a round as a whole.

    Raises
    ------
    RecordError
        There are fewer than two rounds, a corner is not finite, or they are not in that order.

    Examples
    --------
    >>> one = np.array([[0.0, 0.0], [63.0, 0.4], [63.1, 61.0], [0.2, 60.5]]) * 1e-6
    >>> found = workspace([one, one + 1e-9 * np.arange(8.0).reshape(4, 2)])
    >>> print(f"{1e12 * found.area.value:.1f} um^2, {1e3 * found.squareness.value:.2f} mrad")
    3811.7 um^2, -9.66 mrad
    """
    points = np.asarray(corners, dtype=np.float64)
    if points.ndim != 3 or points.shape[1:] != (4, 2) or points.shape[0] < 2:
        raise RecordError(
            "a workspace needs two rounds of four corners at least, as an array of shape (rounds, "
            f"4, 2), got {points.shape}"
        )
    if not np.isfinite(points).all():
        raise RecordError("the corners of a workspace must be finite")
    mean = points.mean(axis=0)
    _require_order(mean)
    rounds = points.shape[0]

    def estimate(figure: Callable[[Array], Array], unit: str) -> Estimate:
        return _figure(figure, points, unit)

    def distance(i: int, j: int) -> Estimate:
        return estimate(lambda p: np.linalg.norm(p[..., j, :] - p[..., i, :], axis=-1), "m")

    return Workspace(
        corners=mean,
        area=estimate(_area, "m^2"),
        stroke_x=(distance(0, 1), distance(3, 2)),
        stroke_y=(distance(0, 3), distance(1, 2)),
        diagonals=(distance(0, 2), distance(1, 3)),
        squareness=estimate(_squareness, "rad"),
        repeatability=spread_estimate(
            points - mean,
            unit="m",
            degrees_of_freedom=8 * (rounds - 1),
            note="a coordinate of a corner",
        ),
        rounds=rounds,
    )


def _area(points: Array) -> Array:
    x, y = points[..., 0], points[..., 1]
    return 0.5 * np.sum(x * np.roll(y, -1, axis=-1) - np.roll(x, -1, axis=-1) * y, axis=-1)


def _squareness(c: Array) -> Array:
    along = c[..., 1, :] - c[..., 0, :] + c[..., 2, :] - c[..., 3, :]
    up = c[..., 3, :] - c[..., 0, :] + c[..., 2, :] - c[..., 1, :]
    cross = along[..., 0] * up[..., 1] - along[..., 1] * up[..., 0]
    return np.arctan2(cross, np.sum(along * up, axis=-1)) - 0.5 * np.pi


def _figure(figure: Callable[[Array], Array], points: Array, unit: str) -> Estimate:
    """Return a figure of the mean corners, with what the rounds differ in it to first order."""
    mean = points.mean(axis=0)
    value = float(figure(mean))
    step = 1e-4 * float(np.ptp(mean, axis=0).max())
    derivative = np.empty_like(mean)
    for i in np.ndindex(*mean.shape):
        moved = np.stack((mean, mean))
        moved[(0, *i)] += step
        moved[(1, *i)] -= step
        above, below = figure(moved)
        derivative[i] = (above - below) / (2.0 * step)
    each = np.tensordot(points - mean, derivative, axes=2)
    rounds = points.shape[0]
    uncertainty = math.sqrt(float(each @ each) / (rounds * (rounds - 1)))
    return Estimate.of(
        value, uncertainty, unit, source="repeatability", degrees_of_freedom=rounds - 1
    )


def _require_order(corners: Array) -> None:
    steps = np.roll(corners, -1, axis=0) - corners
    following = np.roll(steps, -1, axis=0)
    turns = steps[:, 0] * following[:, 1] - steps[:, 1] * following[:, 0]
    if not (np.all(turns > 0.0) and steps[0, 0] > 0.0 and steps[1, 1] > 0.0):
        raise RecordError(
            "the corners must go around from low x and low y to high x, then to high y, "
            f"counterclockwise, got {np.array2string(corners, precision=4, separator=', ')}"
        )
