"""Corner-filleted notch: a leaf whose ends are rounded by quarter circles."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexstage.errors import HingeError
from flexstage.hinges.profile import Array, Length, Piece, Profile, Vertex


@dataclass(frozen=True, slots=True, kw_only=True)
class CornerFilleted(Profile):
    """Notch of constant thickness with a quarter circle at each end.

    Raises
    ------
    HingeError
        The fillets do not fit into the length.

    Examples
    --------
    >>> notch = CornerFilleted(neck_thickness=0.5e-3, notch_length=6e-3, fillet_radius=1e-3)
    >>> notch.flat_length
    0.004
    """

    kind: ClassVar[str] = "corner-filleted"

    notch_length: Length
    """Length of the whole notch, fillets included [m]."""
    fillet_radius: Length
    """Radius of the fillets, the depth of the notch on a side [m]."""

    def _check(self) -> None:
        if self.notch_length < 2.0 * self.fillet_radius:
            raise HingeError(
                f"corner-filleted notch: notch_length must be at least two fillet radii "
                f"({2.0 * self.fillet_radius!r} m), got {self.notch_length!r} m"
            )

    @property
    def length(self) -> float:
        return self.notch_length

    @property
    def depth(self) -> float:
        return self.fillet_radius

    @property
    def neck_radius(self) -> float:
        return self.fillet_radius

    @property
    def flat_length(self) -> float:
        return self.notch_length - 2.0 * self.fillet_radius

    def pieces(self) -> tuple[Piece, ...]:
        half, r = 0.5 * self.flat_length, self.fillet_radius

        def flat(u: Array) -> tuple[Array, Array, Array, Array]:
            zero = np.zeros_like(u)
            return half * u, zero, zero, np.full_like(u, half)

        def fillet(u: Array) -> tuple[Array, Array, Array, Array]:
            angle = 0.5 * np.pi * u
            depth = 2.0 * r * np.sin(0.5 * angle) ** 2
            return half + r * np.sin(angle), depth, angle, np.full_like(u, 0.5 * np.pi * r)

        return (flat, fillet) if half > 0.0 else (fillet,)

    def contour(self) -> tuple[Vertex, ...]:
        half, r = 0.5 * self.flat_length, self.fillet_radius
        arc = (Vertex(half, 0.0, float(np.tan(np.pi / 8.0))), Vertex(half + r, r))
        return (Vertex(0.0, 0.0), *arc) if half > 0.0 else arc
