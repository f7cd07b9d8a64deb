"""V notch whose tip is rounded."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from flexstage.errors import HingeError
from flexstage.hinges.profile import Array, Length, Piece, Profile, Vertex
from flexstage.units import DIMENSIONS


@dataclass(frozen=True, slots=True, kw_only=True)
class VFillet(Profile):
    """Notch of two straight flanks that touch a circle at the neck.

    Raises
    ------
    HingeError
        The flanks would be parallel or flat, or the notch ends before the circle does.

    Examples
    --------
    >>> notch = VFillet(
    ...     neck_thickness=0.5e-3, half_opening_angle=0.5, fillet_radius=0.5e-3, notch_depth=2e-3
    ... )
    >>> round(notch.length, 7)
    0.0027784
    """

    kind: ClassVar[str] = "v"

    half_opening_angle: Annotated[float, DIMENSIONS["angle"]]
    """Half of the angle between the flanks of a side [rad]."""
    fillet_radius: Length
    """Radius of the circle at the tip [m]."""
    notch_depth: Length
    """Depth of the notch at the root, on a side [m]."""

    def _check(self) -> None:
        if not self.half_opening_angle < 0.5 * np.pi:
            raise HingeError(
                f"v notch: half_opening_angle must be below pi/2 rad (90 deg), "
                f"got {self.half_opening_angle!r} rad"
            )
        if self.notch_depth < self._arc_depth():
            raise HingeError(
                f"v notch: notch_depth must reach the end of the fillet at "
                f"{self._arc_depth():.6g} m, got {self.notch_depth!r} m; use a smaller fillet"
            )

    def _turn(self) -> float:
        """Angle of the arc, which is the slope of the flanks [rad]."""
        return 0.5 * np.pi - self.half_opening_angle

    def _arc_depth(self) -> float:
        return 2.0 * self.fillet_radius * float(np.sin(0.5 * self._turn())) ** 2

    def _arc_length(self) -> float:
        """Extent of the arc along the hinge [m]."""
        return self.fillet_radius * float(np.sin(self._turn()))

    @property
    def length(self) -> float:
        flank = (self.notch_depth - self._arc_depth()) * float(np.tan(self.half_opening_angle))
        return 2.0 * (self._arc_length() + flank)

    @property
    def depth(self) -> float:
        return self.notch_depth

    @property
    def neck_radius(self) -> float:
        return self.fillet_radius

    def pieces(self) -> tuple[Piece, ...]:
        r, turn = self.fillet_radius, self._turn()
        x1, d1 = self._arc_length(), self._arc_depth()
        flank_length = (self.notch_depth - d1) / float(np.sin(turn))

        def arc(u: Array) -> tuple[Array, Array, Array, Array]:
            angle = turn * u
            depth = 2.0 * r * np.sin(0.5 * angle) ** 2
            return r * np.sin(angle), depth, angle, np.full_like(u, r * turn)

        def flank(u: Array) -> tuple[Array, Array, Array, Array]:
            s = flank_length * u
            x, depth = x1 + s * np.cos(turn), d1 + s * np.sin(turn)
            return x, depth, np.full_like(u, turn), np.full_like(u, flank_length)

        return (arc, flank) if flank_length > 0.0 else (arc,)

    def contour(self) -> tuple[Vertex, ...]:
        first = (
            Vertex(0.0, 0.0, float(np.tan(0.25 * self._turn()))),
            Vertex(self._arc_length(), self._arc_depth()),
        )
        if self.notch_depth <= self._arc_depth():
            return first
        return (*first, Vertex(0.5 * self.length, self.notch_depth))
