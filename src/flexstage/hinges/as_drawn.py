"""A notch as drawn: any contour of lines and arcs that gets deeper away from the neck."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np

from flexstage.base.errors import HingeError
from flexstage.hinges.profile import Array, Length, Piece, Profile, Vertex

_SLACK = 1e-9  # a contour may go back by so much through rounding [m]
_LEAN = 2e-3  # a slope may be beyond level or upright by so much [rad]
_PARTS = 16  # arcs that stand for a stretched one
_STEEP = 1e-6  # a line that leans less from upright is a step [1]


@dataclass(frozen=True, slots=True, kw_only=True)
class AsDrawn(Profile):
    """Notch with a contour of its own, of straight lines and arcs.

    The contour begins at the neck, on its surface, and goes through the given corners to the root.
    It never turns back, neither along the hinge nor in depth.

    Raises
    ------
    HingeError
        The lists differ in length, or the contour turns back.

    Examples
    --------
    >>> notch = AsDrawn(
    ...     neck_thickness=0.5e-3,
    ...     distances=(1e-3, 2e-3),
    ...     depths=(0.0, 1e-3),
    ...     bulges=(0.0, 0.41421356),
    ... )
    >>> notch.flat_length, round(notch.neck_radius, 9)
    (0.002, 0.001)
    """

    kind: ClassVar[str] = "as-drawn"

    distances: tuple[Length, ...]
    """Distance of each corner from the neck, along the hinge [m]."""
    depths: tuple[Length, ...]
    """Depth of each corner below the surface of the neck, on a side [m]."""
    bulges: tuple[float, ...] = ()
    """Tangent of a quarter of the angle of the arc that leads to each corner, positive where it
    turns away from the hinge [1]; 0 for a straight line; empty if all are straight.
    """

    def _check(self) -> None:
        count = len(self.distances)
        if not count or len(self.depths) != count or len(self.bulges) not in (0, count):
            raise HingeError(
                f"as-drawn notch: it needs as many depths (and bulges, if any) as distances, at "
                f"least 1, got {count} distances, {len(self.depths)} depths and "
                f"{len(self.bulges)} bulges"
            )
        numbers = (*self.distances, *self.depths, *self.bulges)
        if not all(math.isfinite(v) for v in numbers):
            raise HingeError("as-drawn notch: a value of its contour is not finite")
        for a, b in pairwise(self.contour()):
            first, last = _slopes(a, b)
            if min(first, last) < -_LEAN or max(first, last) > 0.5 * math.pi + _LEAN:
                raise HingeError(
                    "as-drawn notch: its contour must lead away from the neck and get deeper, "
                    f"but between {a.x!r} and {b.x!r} m from the neck it turns back"
                )
        if not self.distances[-1] > 0.0:
            raise HingeError("as-drawn notch: its contour must lead away from the neck")
        if not self.depths[-1] > 0.0:
            raise HingeError("as-drawn notch: its contour must get deeper than the neck")

    @property
    def length(self) -> float:
        return 2.0 * self.distances[-1]

    @property
    def depth(self) -> float:
        return self.depths[-1]

    @property
    def neck_radius(self) -> float:
        for a, b in pairwise(self.contour()):
            if a.bulge:
                return _radius(a, b)
            if b.depth > a.depth + _SLACK:
                return 0.0
        return 0.0

    @property
    def flat_length(self) -> float:
        flat = 0.0
        for a, b in pairwise(self.contour()):
            if a.bulge or b.depth > _SLACK:
                break
            flat = b.x
        return 2.0 * flat

    @property
    def step(self) -> float:
        a, b = self.contour()[-2:]
        return b.depth - a.depth if _upright(a, b) else 0.0

    def pieces(self) -> tuple[Piece, ...]:
        pairs = [(a, b) for a, b in pairwise(self.contour()) if not _upright(a, b)]
        return tuple(_piece(a, b) for a, b in pairs)

    def contour(self) -> tuple[Vertex, ...]:
        bulges = self.bulges or (0.0,) * len(self.distances)
        starts = ((0.0, 0.0), *zip(self.distances, self.depths, strict=True))
        return tuple(Vertex(x, d, b) for (x, d), b in zip(starts, (*bulges, 0.0), strict=True))

    def stretched(
        self, neck_thickness: float, depth: float, length: float | None = None
    ) -> "AsDrawn":
        """Return it with another neck, depth and length, the same where None: in proportion."""
        share = depth / self.depth
        longer = 1.0 if length is None else length / self.length
        corners: list[Vertex] = []
        for a, b in pairwise(self.contour()):
            if not a.bulge:
                corners.append(Vertex(longer * b.x, share * b.depth))
                continue
            # a stretched arc is none, but a chain of short ones is near to it
            x, d, _, _ = _piece(a, b)(np.arange(2 * _PARTS + 1) / (2 * _PARTS))
            at = np.column_stack([longer * x, share * d])
            for k in range(0, 2 * _PARTS, 2):
                bulge = _through(at[k], at[k + 1], at[k + 2])
                corners.append(Vertex(float(at[k + 2, 0]), float(at[k + 2, 1]), bulge))
        return replace(
            self,
            neck_thickness=neck_thickness,
            distances=tuple(c.x for c in corners),
            depths=tuple(c.depth for c in corners),
            bulges=tuple(c.bulge for c in corners),
        )


def _through(start: Array, via: Array, end: Array) -> float:
    """Return the bulge of the arc through three points."""
    (ax, ay), (bx, by) = via - start, end - via
    return float(np.tan(0.5 * np.arctan2(ax * by - ay * bx, ax * bx + ay * by)))


def _upright(a: Vertex, b: Vertex) -> bool:
    """Return whether a line of the contour is a sharp step."""
    return not a.bulge and abs(b.x - a.x) <= _STEEP * abs(b.depth - a.depth)


def _radius(a: Vertex, b: Vertex) -> float:
    chord = math.hypot(b.x - a.x, b.depth - a.depth)
    return chord * (1.0 + a.bulge**2) / (4.0 * abs(a.bulge))


def _slopes(a: Vertex, b: Vertex) -> tuple[float, float]:
    """Return the slope of the contour at both ends of a piece [rad]."""
    chord, half = math.atan2(b.depth - a.depth, b.x - a.x), 2.0 * math.atan(a.bulge)
    return chord - half, chord + half


def _piece(a: Vertex, b: Vertex) -> Piece:
    first, last = _slopes(a, b)
    sweep = last - first
    if abs(sweep) < 1e-9:
        size = math.hypot(b.x - a.x, b.depth - a.depth)
        slope = max(0.5 * (first + last), 0.0)

        def line(u: Array) -> tuple[Array, Array, Array, Array]:
            x, depth = a.x + (b.x - a.x) * u, a.depth + (b.depth - a.depth) * u
            return x, depth, np.full_like(u, slope), np.full_like(u, size)

        return line
    radius = _radius(a, b)

    def bow(u: Array) -> tuple[Array, Array, Array, Array]:
        # the chord to a point, without the loss of digits of a flat arc
        turn = sweep * u
        chord = 2.0 * radius * np.sin(0.5 * np.abs(turn))
        towards = first + 0.5 * turn
        x, depth = a.x + chord * np.cos(towards), a.depth + chord * np.sin(towards)
        angle = np.clip(first + turn, 0.0, 0.5 * np.pi)
        return x, depth, angle, np.full_like(u, radius * abs(sweep))

    return bow
