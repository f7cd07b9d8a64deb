"""How rigid bodies move the two sides of a hinge, to first order."""

import math
from collections.abc import Mapping

import numpy as np

from flexstage.arrays import Array
from flexstage.stage import Hinge


class BodyCoordinates:
    """Where the coordinates of each body stand among those of the stage.

    A free body has three coordinates: the displacement x, y of its centre of mass [m] and its
    rotation [rad]. A fixed body has none.

    `centres` of mass are given for every body [m], `free` in order.
    """

    __slots__ = ("centres", "first", "free", "order")

    def __init__(self, centres: Mapping[str, tuple[float, float]], free: tuple[str, ...]) -> None:
        self.centres = dict(centres)
        self.free = free
        self.first = {name: 3 * i for i, name in enumerate(free)}
        self.order = 3 * len(free)

    def names(self) -> tuple[str, ...]:
        """Return a name with a unit for every coordinate, such as ``body.rotation [rad]``."""
        parts = (".x [m]", ".y [m]", ".rotation [rad]")
        return tuple(name + part for name in self.free for part in parts)


def point_matrix(layout: BodyCoordinates, body: str, at: tuple[float, float]) -> Array:
    """Return the motion of a point of a body for each coordinate.

    Displacement x, y and rotation, shape (3, n); zero for a fixed body.
    """
    matrix = np.zeros((3, layout.order))
    first = layout.first.get(body)
    if first is not None:
        cx, cy = layout.centres[body]
        matrix[0, first] = matrix[1, first + 1] = matrix[2, first + 2] = 1.0
        matrix[0, first + 2] = -(at[1] - cy)
        matrix[1, first + 2] = at[0] - cx
    return matrix


def hinge_matrix(layout: BodyCoordinates, hinge: Hinge) -> Array:
    """Return the deformation of a hinge for each coordinate.

    Motion of body b against body a at the neck, in the hinge's axes: along, across, rotation; shape
    (3, n).
    """
    a, b = hinge.bodies
    relative = point_matrix(layout, b, hinge.at) - point_matrix(layout, a, hinge.at)
    c, s = math.cos(hinge.direction), math.sin(hinge.direction)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ relative
