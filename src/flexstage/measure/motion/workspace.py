"""The area that a stage of two axes reaches, its corners, sides, diagonals and squareness."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.arrays import Array
from flexstage.errors import RecordError
from flexstage.estimate import Estimate
from flexstage.measure.motion.cycles import spread_estimate

#: A command within this share of its range from an end is at that end.
_AT_END = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Workspace:
    """What a stage of two axes reaches.

    Corners are in the order low x and low y, high x and low y, high x and high y, low x and high y.
    """

    outline: Array
    """Mean outline, counterclockwise [m], shape (k, 2)."""
    corners: Array
    """Mean corners [m], shape (4, 2)."""
    area: Estimate
    """Area within the outline [m^2]."""
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


def workspace(outline: ArrayLike, *, corners: tuple[int, int, int, int] | None = None) -> Workspace:
    r"""Find the figures of a workspace from its outline, reached several times.

    The area is :math:`\frac12 \sum_i (x_i y_{i+1} - x_{i+1} y_i)` (the surveyor's formula, Meister
    1769). Every figure is taken of the mean outline, and its uncertainty from what the rounds give
    it by its derivative: the rounds are independent observations, whatever their points have in
    common.

    Parameters
    ----------
    outline : array_like
        Points of the outline in order, for each round, shape (r, k, 2) [m]; or a grid of positions
        by command of y (row) and of x (column), both rising, shape (r, n_y, n_x, 2), of which the
        outer ones are the outline.
    corners : tuple of int, optional
        Which of the points are the corners; needed of an outline of more than four, in the order
        that `Workspace` has.

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
        There are fewer than two rounds or four points, rows or columns of a grid fewer than two, a
        point is not finite, or the corners are not in that order.

    Examples
    --------
    >>> one = np.array([[0.0, 0.0], [63.0, 0.4], [63.1, 61.0], [0.2, 60.5]]) * 1e-6
    >>> found = workspace([one, one + 1e-9 * np.arange(8.0).reshape(4, 2)])
    >>> print(f"{1e12 * found.area.value:.1f} um^2, {1e3 * found.squareness.value:.2f} mrad")
    3811.7 um^2, -9.66 mrad
    """
    points = np.asarray(outline, dtype=np.float64)
    if points.ndim == 4:
        points, corners = _around(points)
    if points.ndim != 3 or points.shape[2] != 2 or points.shape[1] < 4 or points.shape[0] < 2:
        raise RecordError(
            "a workspace needs two rounds of four points at least, as an array of shape (rounds, "
            f"points, 2), got {points.shape}"
        )
    if not np.isfinite(points).all():
        raise RecordError("the points of an outline must be finite")
    if corners is None and points.shape[1] != 4:
        raise RecordError(
            f"say which of the {points.shape[1]} points of the outline are its four corners"
        )
    at = [0, 1, 2, 3] if corners is None else list(corners)
    mean = points.mean(axis=0)
    _require_order(mean[at])
    left = points[:, at] - mean[at]
    rounds = points.shape[0]

    def estimate(figure: Callable[[Array], Array], unit: str) -> Estimate:
        return _figure(figure, points, unit)

    def distance(i: int, j: int) -> Estimate:
        a, b = at[i], at[j]
        return estimate(lambda p: np.linalg.norm(p[..., b, :] - p[..., a, :], axis=-1), "m")

    return Workspace(
        outline=mean,
        corners=mean[at],
        area=estimate(_area, "m^2"),
        stroke_x=(distance(0, 1), distance(3, 2)),
        stroke_y=(distance(0, 3), distance(1, 2)),
        diagonals=(distance(0, 2), distance(1, 3)),
        squareness=estimate(lambda p: _squareness(p[..., at, :]), "rad"),
        repeatability=spread_estimate(
            left, unit="m", degrees_of_freedom=8 * (rounds - 1), note="a coordinate of a corner"
        ),
        rounds=rounds,
    )


def _around(grid: Array) -> tuple[Array, tuple[int, int, int, int]]:
    """Return the outer points of a grid, counterclockwise, and which of them are its corners."""
    if grid.shape[-1] != 2 or min(grid.shape[1:3]) < 2:
        raise RecordError(
            "a grid of positions needs two rows and two columns at least, as an array of shape "
            f"(rounds, rows, columns, 2), got {grid.shape}"
        )
    sides = (grid[:, 0, :-1], grid[:, :-1, -1], grid[:, -1, :0:-1], grid[:, :0:-1, 0])
    up, right = grid.shape[1] - 1, grid.shape[2] - 1
    return np.concatenate(sides, axis=1), (0, right, right + up, 2 * right + up)


def workspace_from_path(
    x: ArrayLike, y: ArrayLike, command_x: ArrayLike, command_y: ArrayLike, *, pieces: int = 16
) -> Workspace:
    """Find the figures of a workspace from a path around it, several times.

    The commands tell where the stage is: on a side where one of them is at an end of its range, in
    a corner where both are. Each side is averaged in pieces of equal command, each corner over the
    samples that rest in it, so noise neither widens the area nor shifts a corner.

    Parameters
    ----------
    x, y : array_like
        Positions [m], shape (n,).
    command_x, command_y : array_like
        Commands, shape (n,); the path goes around in either sense, one axis moving at a time.
    pieces : int
        Pieces of a side.

    Returns
    -------
    Workspace
        The figures.

    Validity
    --------
    A round ends where the path comes back to the corner that it began from; what is left over is
    not used. Both senses in one record mix the two branches of the hysteresis.

    Raises
    ------
    RecordError
        The columns do not belong together or are not finite, a command does not move, there are
        fewer than two whole rounds, or a side has too few samples.

    Examples
    --------
    >>> u, v = np.array([0, 1, 1, 0, 0, 1, 1, 0, 0]), np.array([0, 0, 1, 1, 0, 0, 1, 1, 0])
    >>> t = np.linspace(0.0, 8.0, 1601)
    >>> u, v = np.interp(t, range(9), u), np.interp(t, range(9), v)
    >>> found = workspace_from_path(63e-6 * u + 1e-7 * v, 61e-6 * v, u, v)
    >>> print(f"{1e12 * found.area.value:.0f} um^2, {found.rounds} rounds")
    3843 um^2, 2 rounds
    """
    columns = [np.asarray(c, dtype=np.float64) for c in (x, y, command_x, command_y)]
    if len({c.shape for c in columns}) != 1 or columns[0].ndim != 1:
        raise RecordError(
            "positions and commands must be columns of one length, got shapes "
            + ", ".join(str(c.shape) for c in columns)
        )
    if not all(np.isfinite(c).all() for c in columns):
        raise RecordError("positions and commands must be finite")
    shares = []
    for name, c in zip("xy", columns[2:], strict=True):
        if not np.ptp(c) > 0.0:
            raise RecordError(f"the command of {name} does not move: it is {c[0]:g} throughout")
        shares.append((c - c.min()) / np.ptp(c))
    corner = _corner_numbers(shares[0], shares[1])
    visits = _visits(corner)
    sense = _sense([number for _, _, number in visits])
    measured = np.stack(columns[:2], axis=1)
    outlines = _rounds(measured, np.stack(shares, axis=1), visits, sense, pieces)
    if len(outlines) < 2:
        raise RecordError(
            f"a path needs two whole rounds at least, got {len(outlines)}: each goes through all "
            "four corners and back to the first, one axis moving at a time"
        )
    at = tuple(i * (pieces + 1) for i in range(4))
    return workspace(outlines, corners=(at[0], at[1], at[2], at[3]))


def _corner_numbers(u: Array, v: Array) -> NDArray[np.intp]:
    """Return the number of the corner that each sample rests in, -1 for none."""
    found = np.full(u.size, -1, dtype=np.intp)
    for number, (a, b) in enumerate(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))):
        found[(np.abs(u - a) <= _AT_END) & (np.abs(v - b) <= _AT_END)] = number
    return found


def _visits(corner: NDArray[np.intp]) -> list[tuple[int, int, int]]:
    """Return first sample, sample after the last, and number of the corner of each visit."""
    edges = np.flatnonzero(np.diff(corner)) + 1
    bounds = np.concatenate(([0], edges, [corner.size]))
    return [
        (int(a), int(b), int(corner[a])) for a, b in itertools.pairwise(bounds) if corner[a] >= 0
    ]


def _sense(numbers: list[int]) -> int:
    steps = [(b - a) % 4 for a, b in itertools.pairwise(numbers)]
    return -1 if steps.count(3) > steps.count(1) else 1


def _rounds(
    measured: Array, share: Array, visits: list[tuple[int, int, int]], sense: int, pieces: int
) -> list[Array]:
    """Return the outline of each whole round, counterclockwise from the lowest corner."""
    found = []
    i = 0
    while i + 4 < len(visits):
        five = visits[i : i + 5]
        wanted = [(five[0][2] + sense * j) % 4 for j in range(5)]
        if [v[2] for v in five] != wanted:
            i += 1
            continue
        parts: dict[int, Array] = {}
        for here, there in itertools.pairwise(five):
            corner = measured[here[0] : here[1]].mean(axis=0, keepdims=True)
            side = _side(measured, share, here, there, pieces)
            # counterclockwise, the side after corner c leads to c + 1
            parts[2 * here[2]] = corner
            parts[2 * (here[2] if sense > 0 else there[2]) + 1] = side if sense > 0 else side[::-1]
        found.append(np.vstack([parts[j] for j in range(8)]))
        i += 4
    return found


def _side(
    measured: Array,
    share: Array,
    here: tuple[int, int, int],
    there: tuple[int, int, int],
    pieces: int,
) -> Array:
    """Return the mean position in pieces of a side, in the order of the path."""
    between = slice(here[1], there[0])
    way = np.abs(share[between] - share[here[1] - 1]).max(axis=1)
    number = np.clip((way * pieces).astype(np.intp), 0, pieces - 1)
    counts = np.bincount(number, minlength=pieces)
    if counts.min() == 0:
        raise RecordError(
            f"a side of the path has {way.size} samples, too few or too uneven for {pieces} pieces"
        )
    sums = [np.bincount(number, weights=measured[between, k], minlength=pieces) for k in (0, 1)]
    return np.stack(sums, axis=1) / counts[:, None]


def _area(points: Array) -> Array:
    x, y = points[..., 0], points[..., 1]
    return 0.5 * np.sum(x * np.roll(y, -1, axis=-1) - np.roll(x, -1, axis=-1) * y, axis=-1)


def _squareness(c: Array) -> Array:
    along = c[..., 1, :] - c[..., 0, :] + c[..., 2, :] - c[..., 3, :]
    up = c[..., 3, :] - c[..., 0, :] + c[..., 2, :] - c[..., 1, :]
    cross = along[..., 0] * up[..., 1] - along[..., 1] * up[..., 0]
    return np.arctan2(cross, np.sum(along * up, axis=-1)) - 0.5 * np.pi


def _figure(figure: Callable[[Array], Array], points: Array, unit: str) -> Estimate:
    """Return a figure of the mean outline, with what the rounds differ in it to first order."""
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
