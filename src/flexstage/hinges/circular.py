"""Right-circular notch: the profile of most wire-cut stages."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexstage.hinges.profile import Array, Length, Piece, Profile, Vertex


@dataclass(frozen=True, slots=True, kw_only=True)
class RightCircular(Profile):
    """Notch of half circles of one radius.

    Examples
    --------
    >>> RightCircular(neck_thickness=0.5e-3, radius=1.0e-3).root_height
    0.0025
    """

    kind: ClassVar[str] = "circular"

    radius: Length
    """Radius R of the circle [m]."""

    @property
    def length(self) -> float:
        return 2.0 * self.radius

    @property
    def depth(self) -> float:
        return self.radius

    @property
    def neck_radius(self) -> float:
        return self.radius

    def pieces(self) -> tuple[Piece, ...]:
        def quarter(u: Array) -> tuple[Array, Array, Array, Array]:
            angle = 0.5 * np.pi * u
            speed = np.full_like(u, 0.5 * np.pi * self.radius)
            # 1 - cos(a) without cancellation near the neck
            depth = 2.0 * self.radius * np.sin(0.5 * angle) ** 2
            return self.radius * np.sin(angle), depth, angle, speed

        return (quarter,)

    def contour(self) -> tuple[Vertex, ...]:
        return (
            Vertex(0.0, 0.0, float(np.tan(np.pi / 8.0))),
            Vertex(self.radius, self.radius),
        )
