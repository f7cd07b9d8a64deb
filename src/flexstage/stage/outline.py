"""Closed outlines of straight lines and circular arcs, and their exact area integrals."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexstage.base.errors import StageError
from flexstage.quantities.units import DIMENSIONS

Point = Annotated[tuple[float, float], DIMENSIONS["length"]]

#: Shortest and longest length of a stage [m]. Beyond them one is a slip of the pen: figures leave
#: the range of numbers before a check can say what is wrong, and a polygon has no end.
SMALLEST, LARGEST = 1e-12, 100.0
# leaves a quarter of a degree of the full circle open
_LARGEST_BULGE = 1e3
# an arc that leaves its chord by less than half of this part of it is straight; the centre of one
# that is flatter still would be out of reach of numbers
_FLATTEST = 1e-12
# below this bulge an arc is integrated along its chord, to rounding by this many points
_FLAT = 0.02
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


class AreaIntegrals(NamedTuple):
    """Integrals over an area, about the origin."""

    area: float
    """Integral of 1 [m^2]."""
    x: float
    """Integral of x [m^3]."""
    y: float
    """Integral of y [m^3]."""
    xx: float
    """Integral of x^2 [m^4]."""
    yy: float
    """Integral of y^2 [m^4]."""
    xy: float
    """Integral of x y [m^4]."""

    def plus(self, other: "AreaIntegrals", sign: float = 1.0) -> "AreaIntegrals":
        """Add another area, or with a sign of -1 take it away."""
        return AreaIntegrals(*(a + sign * b for a, b in zip(self, other, strict=True)))


@dataclass(frozen=True, slots=True)
class Loop:
    """A closed line of straight segments and arcs.

    Segment i runs from point i to point i + 1; its bulge is the tangent of a quarter of the angle
    of its arc, positive where the arc turns left, 0 for a straight line (the convention of DXF).

    Raises
    ------
    StageError
        Too few points, a coordinate or a bulge out of all proportion, or the wrong number of
        bulges.

    Examples
    --------
    >>> square = Loop(((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)))
    >>> square.integrals().area
    4.0
    """

    points: tuple[tuple[float, float], ...]
    """The corners [m], each (x, y), at least three, or two where arcs join them."""
    bulges: tuple[float, ...] = ()
    """One for each segment [1]; empty if all are straight."""

    def __post_init__(self) -> None:
        n = len(self.points)
        if any(0.0 < abs(bulge) < _FLATTEST for bulge in self.bulges):
            straight = tuple(b if abs(b) >= _FLATTEST else 0.0 for b in self.bulges)
            object.__setattr__(self, "bulges", straight)
        if self.bulges and not any(self.bulges):
            object.__setattr__(self, "bulges", ())
        if n < (2 if self.bulges else 3):
            raise StageError(f"an outline needs at least 3 points, or 2 joined by arcs, got {n}")
        if self.bulges and len(self.bulges) != n:
            raise StageError(
                f"an outline of {n} points needs {n} bulges, one for each segment, "
                f"got {len(self.bulges)}"
            )
        if not all(abs(c) <= LARGEST for p in self.points for c in p):
            raise StageError(
                f"an outline has a coordinate that is not finite, or over {LARGEST:g} m"
            )
        if not all(abs(b) <= _LARGEST_BULGE for b in self.bulges):
            raise StageError(
                f"an outline has a bulge that is not between -{_LARGEST_BULGE:g} and "
                f"{_LARGEST_BULGE:g}: it is the tangent of a quarter of the arc's angle"
            )

    def segments(self) -> list[tuple[tuple[float, float], tuple[float, float], float]]:
        """Return the segments in order.

        Returns
        -------
        list of tuple
            Start [m], end [m] and bulge [1] of each.
        """
        ends = self.points[1:] + self.points[:1]
        bulges = self.bulges or (0.0,) * len(self.points)
        return list(zip(self.points, ends, bulges, strict=True))

    def integrals(self) -> AreaIntegrals:
        """Integrate over the enclosed area, exactly for arcs as well.

        Returns
        -------
        AreaIntegrals
            Positive whichever way round the loop runs.
        """
        total = AreaIntegrals(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for start, end, bulge in self.segments():
            total = total.plus(_triangle(start, end))
            if bulge:
                total = total.plus(_circular_segment(start, end, bulge))
        return total if total.area >= 0.0 else AreaIntegrals(*(-v for v in total))

    def polyline(self, tolerance: float = 2e-6) -> NDArray[np.float64]:
        """Return the loop as a polygon.

        Parameters
        ----------
        tolerance : float
            Largest distance of a chord from its arc [m].

        Returns
        -------
        numpy.ndarray
            Corners [m], shape (n, 2), the first not repeated.
        """
        corners: list[tuple[float, float]] = []
        for start, end, bulge in self.segments():
            corners.append(start)
            if bulge:
                centre, radius, first, sweep = arc(start, end, bulge)
                step = 2.0 * math.acos(max(1.0 - tolerance / radius, 0.0))
                for k in range(1, count := max(2, math.ceil(abs(sweep) / step))):
                    angle = first + sweep * k / count
                    corners.append(
                        (
                            centre[0] + radius * math.cos(angle),
                            centre[1] + radius * math.sin(angle),
                        )
                    )
        return np.array(corners)

    def bounds(self) -> tuple[float, float, float, float]:
        """Return least x and y, greatest x and y [m], of arcs as well.

        Examples
        --------
        >>> [round(1e3 * v, 6) for v in Circle((3e-3, 1e-3), 2e-3).loop().bounds()]
        [1.0, -1.0, 5.0, 3.0]
        """
        places = [*self.points]
        for start, end, bulge in self.segments():
            if not bulge:
                continue
            (cx, cy), r, first, sweep = arc(start, end, bulge)
            for quarter, at in enumerate(((cx + r, cy), (cx, cy + r), (cx - r, cy), (cx, cy - r))):
                # how far on the arc, the way it turns, the point of this side lies
                turn = math.copysign(1.0, sweep) * (0.5 * math.pi * quarter - first)
                if turn % math.tau <= abs(sweep):
                    places.append(at)
        x, y = zip(*places, strict=True)
        return min(x), min(y), max(x), max(y)

    def mapped(self, move: Callable[[tuple[float, float]], tuple[float, float]]) -> "Loop":
        """Move every point by a rotation, translation or reflection.

        Parameters
        ----------
        move : callable
            Maps (x, y) to (x, y) [m]; distances must be kept.

        Returns
        -------
        Loop
            The moved loop; a reflection turns the arcs over as it should.
        """
        origin, e1, e2 = move((0.0, 0.0)), move((1.0, 0.0)), move((0.0, 1.0))
        a = (e1[0] - origin[0], e1[1] - origin[1])
        b = (e2[0] - origin[0], e2[1] - origin[1])
        turn = math.copysign(1.0, a[0] * b[1] - a[1] * b[0])
        return Loop(tuple(map(move, self.points)), tuple(turn * v for v in self.bulges))


@dataclass(frozen=True, slots=True)
class Circle:
    """A circle.

    Raises
    ------
    StageError
        The radius is not positive, or something is out of all proportion.
    """

    centre: Point
    """Centre [m]."""
    radius: Annotated[float, DIMENSIONS["length"]]
    """Radius [m]."""

    def __post_init__(self) -> None:
        if not 0.0 < self.radius <= LARGEST:
            raise StageError(
                f"a circle needs a positive radius, at most {LARGEST:g} m, got {self.radius!r} m"
            )
        if not all(abs(c) <= LARGEST for c in self.centre):
            raise StageError(f"the centre of a circle is not within {LARGEST:g} m of the origin")

    def loop(self) -> Loop:
        """Return it as a loop of two half circles.

        Returns
        -------
        Loop
            Counter-clockwise, exact.
        """
        x, y = self.centre
        return Loop(((x - self.radius, y), (x + self.radius, y)), (1.0, 1.0))


def arc(
    start: tuple[float, float], end: tuple[float, float], bulge: float
) -> tuple[tuple[float, float], float, float, float]:
    """Return centre, radius, first angle and signed sweep of an arc."""
    sweep = 4.0 * math.atan(bulge)
    dx, dy = end[0] - start[0], end[1] - start[1]
    # distance of the centre from the chord's middle, to its left, in chords: cot(sweep/2)/2
    q = (1.0 - bulge**2) / (4.0 * bulge)
    centre = (0.5 * (start[0] + end[0]) - q * dy, 0.5 * (start[1] + end[1]) + q * dx)
    radius = math.hypot(dx, dy) * (1.0 + bulge**2) / (4.0 * abs(bulge))
    first = math.atan2(start[1] - centre[1], start[0] - centre[0])
    return centre, radius, first, sweep


def _triangle(p: tuple[float, float], q: tuple[float, float]) -> AreaIntegrals:
    """Integrate over the triangle of the origin, p and q."""
    cross = p[0] * q[1] - p[1] * q[0]
    return AreaIntegrals(
        cross / 2.0,
        cross * (p[0] + q[0]) / 6.0,
        cross * (p[1] + q[1]) / 6.0,
        cross * (p[0] ** 2 + p[0] * q[0] + q[0] ** 2) / 12.0,
        cross * (p[1] ** 2 + p[1] * q[1] + q[1] ** 2) / 12.0,
        cross * (2 * p[0] * p[1] + p[0] * q[1] + q[0] * p[1] + 2 * q[0] * q[1]) / 24.0,
    )


def _flat_segment(
    start: tuple[float, float], end: tuple[float, float], bulge: float
) -> AreaIntegrals:
    """Integrate as `_circular_segment`, by strips across the chord.

    The centre of a flat arc is far away, and moments about it cancel but for their rounding.
    """
    length = math.dist(start, end)
    if length == 0.0:
        return AreaIntegrals(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    half = 2.0 * math.atan(abs(bulge))
    radius = length / (2.0 * math.sin(half))
    sign = math.copysign(1.0, bulge)
    c, s = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    t = half * _NODES
    height = 2.0 * radius * np.sin(0.5 * (half + t)) * np.sin(0.5 * (half - t))
    along = radius * np.sin(t)
    x, y = 0.5 * (start[0] + end[0]) + c * along, 0.5 * (start[1] + end[1]) + s * along
    # an arc that turns left lies to the right of its chord
    u, v = sign * s, -sign * c
    area = sign * radius * np.cos(t) * half * _WEIGHTS * height
    h, hh = height / 2.0, height**2 / 3.0
    return AreaIntegrals(
        float(np.sum(area)),
        float(np.sum(area * (x + u * h))),
        float(np.sum(area * (y + v * h))),
        float(np.sum(area * (x**2 + 2.0 * u * x * h + u**2 * hh))),
        float(np.sum(area * (y**2 + 2.0 * v * y * h + v**2 * hh))),
        float(np.sum(area * (x * y + (u * y + v * x) * h + u * v * hh))),
    )


def _circular_segment(
    start: tuple[float, float], end: tuple[float, float], bulge: float
) -> AreaIntegrals:
    """Integrate over the area between a chord and its arc, positive where the arc turns left."""
    if abs(bulge) < _FLAT:
        return _flat_segment(start, end, bulge)
    (cx, cy), r, first, sweep = arc(start, end, bulge)
    a = abs(sweep) / 2.0
    sign = math.copysign(1.0, sweep)
    # in axes through the centre, u along the bisector of the arc
    area = r**2 * (a - math.sin(2.0 * a) / 2.0)
    u = 2.0 / 3.0 * r**3 * math.sin(a) ** 3
    uu = r**4 / 4.0 * (a - math.sin(4.0 * a) / 4.0)
    vv = 2.0 / 3.0 * r**4 * (3.0 * a / 8.0 - math.sin(2.0 * a) / 4.0 + math.sin(4.0 * a) / 32.0)
    middle = first + sweep / 2.0
    c, s = math.cos(middle), math.sin(middle)
    x, y = c * u, s * u
    xx, yy, xy = c * c * uu + s * s * vv, s * s * uu + c * c * vv, c * s * (uu - vv)
    return AreaIntegrals(
        sign * area,
        sign * (x + cx * area),
        sign * (y + cy * area),
        sign * (xx + 2.0 * cx * x + cx**2 * area),
        sign * (yy + 2.0 * cy * y + cy**2 * area),
        sign * (xy + cx * y + cy * x + cx * cy * area),
    )
