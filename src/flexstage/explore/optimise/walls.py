"""Walls: how far a design can go before a stage of its dimensions is impossible."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array

Bools = NDArray[np.bool_]

#: How far inside a wall a search stays, in parts of the bounds.
MARGIN = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wall:
    """Points with normal . x <= offset are possible; those beyond are not."""

    normal: Array
    """Unit vector across the wall, out of what is possible, shape (d,)."""
    offset: float
    """Its distance from the origin along the normal, less `MARGIN`."""
    beyond: Array
    """A point just beyond it, shape (d,), which says why it is impossible."""


def find_wall(possible: Callable[[Array], Bools], inside: Array, step: Array) -> Wall | None:
    """Return the wall between a possible point and an impossible one.

    The distance to the wall along each variable gives its normal: exactly where the wall is plane,
    as it is where dimensions in a row must fit between two faces.

    Parameters
    ----------
    possible : callable
        Which of the points (S, d) are possible.
    inside : array
        A possible point, from 0 to 1, shape (d,).
    step : array
        What leads from it to an impossible one, shape (d,).

    Returns
    -------
    Wall or None
        None where no variable alone leads across it.

    Notes
    -----
    Validity: components of the normal below a thirtieth of the largest are not seen.

    Examples
    --------
    >>> inside, step = np.array([0.5, 0.2]), np.array([0.4, 0.4])
    >>> wall = find_wall(lambda x: x @ [3.0, 4.0] <= 3.5, inside, step)
    >>> np.round(wall.normal, 3), round(wall.offset, 3)
    (array([0.6, 0.8]), 0.7)
    """
    # how near to a wall its normal is measured, and how far is looked for it along each variable:
    # less than the margin from other walls, which are not to be taken for this one
    near_wall, reach, halvings = 2e-6, 6e-5, 18
    length = float(np.linalg.norm(step))
    if length < near_wall:
        return None
    low, high = 0.0, 1.0
    while (high - low) * length > 0.02 * near_wall:
        middle = 0.5 * (low + high)
        ok = bool(possible((inside + middle * step)[None])[0])
        low, high = (middle, high) if ok else (low, middle)
    at, outside = inside + low * step, inside + high * step
    before = inside + max(low - near_wall / length, 0.0) * step
    d = len(inside)
    ways = np.vstack([np.eye(d), -np.eye(d)]) * reach
    stopped = np.flatnonzero(~possible(before + ways))
    if not len(stopped):
        return None
    near, far = np.zeros(len(stopped)), np.ones(len(stopped))
    for _ in range(halvings):
        middle = 0.5 * (near + far)
        ok = possible(before + middle[:, None] * ways[stopped])
        near, far = np.where(ok, middle, near), np.where(ok, far, middle)
    slope = np.zeros(2 * d)
    slope[stopped] = 2.0 / (near + far)
    normal = slope[:d] - slope[d:]
    size = float(np.linalg.norm(normal))
    if size == 0.0 or float(normal @ step) <= 0.0:
        return None
    normal = normal / size
    return Wall(normal=normal, offset=float(normal @ at) - MARGIN, beyond=outside)


def inside(possible: Callable[[Array], Bools], point: Array) -> Array:
    """Return a point beside a possible one that keeps `MARGIN` from walls along every variable.

    On a wall, or where two meet, what lies beyond tells none of them from another. It is the point
    itself where no way leads from all of them.
    """
    ways = np.vstack([np.eye(len(point)), -np.eye(len(point))]) * MARGIN
    for _ in range(4):  # steps of the margin each
        stopped = ways[~possible(np.clip(point + ways, 0.0, 1.0))]
        there = np.clip(point - 1.1 * stopped.sum(axis=0), 0.0, 1.0)
        if not np.any(there != point) or not possible(there[None])[0]:
            break
        point = there
    return point


def joined(walls: tuple[Wall, ...], wall: Wall) -> tuple[Wall, ...]:
    """Return walls with another one, which replaces what was measured of it further away."""
    # two whose normals are within 2.6 degrees are one
    others = (w for w in walls if float(wall.normal @ w.normal) <= 0.999)
    return (*others, wall)
