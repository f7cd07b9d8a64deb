"""Notches with straight sides: leaf, corner-filleted leaf, V with a round tip."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from flexstage.base.errors import HingeError
from flexstage.hinges.profile import Array, Length, Piece, Profile, Vertex
from flexstage.quantities.units import DIMENSIONS


def _flat(half: float) -> Piece:
    """Return the straight piece of a contour at the neck."""

    def piece(u: Array) -> tuple[Array, Array, Array, Array]:
        zero = np.zeros_like(u)
        return half * u, zero, zero, np.full_like(u, half)

    return piece


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaf(Profile):
    """Strip of constant thickness that ends at sharp steps, or continues into bodies without them.

    Examples
    --------
    >>> leaf = Leaf(neck_thickness=0.5e-3, leaf_length=6e-3, notch_depth=1e-3)
    >>> leaf.root_height
    0.0025
    """

    kind: ClassVar[str] = "leaf"
    can_be_zero: ClassVar[frozenset[str]] = frozenset({"notch_depth"})

    leaf_length: Length
    """Length of the strip [m]."""
    notch_depth: Length
    """Height of the step at its ends, on a side [m]; 0 where bodies are as wide as the strip."""

    @property
    def length(self) -> float:
        return self.leaf_length

    @property
    def depth(self) -> float:
        return self.notch_depth

    @property
    def neck_radius(self) -> float:
        return 0.0

    @property
    def flat_length(self) -> float:
        return self.leaf_length

    @property
    def step(self) -> float:
        return self.notch_depth

    def pieces(self) -> tuple[Piece, ...]:
        return (_flat(0.5 * self.leaf_length),)

    def contour(self) -> tuple[Vertex, ...]:
        half = 0.5 * self.leaf_length
        step = (Vertex(half, self.notch_depth),) if self.notch_depth else ()
        return (Vertex(0.0, 0.0), Vertex(half, 0.0), *step)


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

        def fillet(u: Array) -> tuple[Array, Array, Array, Array]:
            angle = 0.5 * np.pi * u
            depth = 2.0 * r * np.sin(0.5 * angle) ** 2
            return half + r * np.sin(angle), depth, angle, np.full_like(u, 0.5 * np.pi * r)

        return (_flat(half), fillet) if half > 0.0 else (fillet,)

    def contour(self) -> tuple[Vertex, ...]:
        half, r = 0.5 * self.flat_length, self.fillet_radius
        arc = (Vertex(half, 0.0, float(np.tan(np.pi / 8.0))), Vertex(half + r, r))
        return (Vertex(0.0, 0.0), *arc) if half > 0.0 else arc


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
