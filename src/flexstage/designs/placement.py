"""Where a mechanism that is described in its own coordinates lies in the plane of a stage."""

import math
from dataclasses import dataclass

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """Where the coordinates (u, v) of an axis lie in the plane of the stage."""

    origin: Pair = (0.0, 0.0)
    """The point u = v = 0 [m]."""
    turned: bool = False
    """Whether u runs along y instead of x."""

    @property
    def angle(self) -> float:
        """Direction of u, from the x axis to the left [rad]."""
        return math.pi / 2.0 if self.turned else 0.0

    def to_plane(self, point: Pair) -> Pair:
        """Map a point."""
        u, v = point
        x, y = (-v, u) if self.turned else (u, v)
        return (self.origin[0] + x, self.origin[1] + y)
