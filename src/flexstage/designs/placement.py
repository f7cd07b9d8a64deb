"""Where a mechanism that is described in its own coordinates lies in the plane of a stage."""

import math
from dataclasses import dataclass

__all__ = ["Placement"]

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """Where the coordinates (u, v) of an axis lie in the plane of the stage.

    Parameters
    ----------
    origin : tuple of float
        The point u = v = 0 [m].
    turned : bool
        Whether u runs along y instead of x.
    """

    origin: Pair = (0.0, 0.0)
    turned: bool = False

    @property
    def angle(self) -> float:
        """Direction of u, from the x axis to the left [rad]."""
        return math.pi / 2.0 if self.turned else 0.0

    def to_plane(self, point: Pair) -> Pair:
        """Map a point.

        Parameters
        ----------
        point : tuple of float
            The point (u, v) [m].

        Returns
        -------
        tuple of float
            The point (x, y) [m].
        """
        u, v = point
        x, y = (-v, u) if self.turned else (u, v)
        return (self.origin[0] + x, self.origin[1] + y)
