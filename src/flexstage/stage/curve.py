"""Straight lines and circular arcs in the plane: where they meet, how far they are apart."""

import math
from typing import NamedTuple

from flexstage.stage.outline import arc

Pair = tuple[float, float]

# how far beyond its end a curve still counts as met there [m]
_REACH = 1e-12


def line_coordinates(point: Pair, start: Pair, end: Pair) -> tuple[float, float, Pair]:
    """Return how far a point is along a line and to its left [m], and the line's unit tangent."""
    length = math.dist(start, end)
    ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    dx, dy = point[0] - start[0], point[1] - start[1]
    return dx * ux + dy * uy, dy * ux - dx * uy, (ux, uy)


class Curve(NamedTuple):
    """A straight line or an arc."""

    start: Pair
    """Start point [m]."""
    end: Pair
    """End point [m]."""
    bulge: float = 0.0
    """Tangent of a quarter of its angle, positive where it turns left [1]; 0 of a line."""

    @property
    def length(self) -> float:
        """Length along the curve [m]."""
        chord = math.dist(self.start, self.end)
        if not self.bulge:
            return chord
        # radius times angle, without the loss of digits of a flat arc
        b = abs(self.bulge)
        return chord * (1.0 + b * b) * (math.atan(b) / b)

    @property
    def radius(self) -> float:
        """Radius [m], positive where it turns left; infinite of a line."""
        if not self.bulge:
            return math.inf
        chord = math.dist(self.start, self.end)
        return chord * (1.0 + self.bulge**2) / (4.0 * self.bulge)

    def direction(self, share: float) -> Pair:
        """Return the unit tangent at a share of the length, 0 at the start and 1 at the end."""
        chord = math.dist(self.start, self.end)
        ux, uy = (self.end[0] - self.start[0]) / chord, (self.end[1] - self.start[1]) / chord
        if not self.bulge:
            return ux, uy
        # half of the sweep to either side of the chord; its sine and cosine are rational
        b = self.bulge
        if share in (0.0, 1.0):
            c, s = (1.0 - b * b) / (1.0 + b * b), 2.0 * b / (1.0 + b * b)
            s = -s if share == 0.0 else s
        else:
            turn = 4.0 * math.atan(b) * (share - 0.5)
            c, s = math.cos(turn), math.sin(turn)
        return ux * c - uy * s, ux * s + uy * c

    def point(self, share: float) -> Pair:
        """Return the point at a share of the length."""
        if share in (0.0, 1.0):
            return self.end if share else self.start
        if not self.bulge:
            (x0, y0), (x1, y1) = self.start, self.end
            return x0 + share * (x1 - x0), y0 + share * (y1 - y0)
        # the chord to it: twice the radius times the sine of half its angle
        part = share * math.atan(self.bulge)
        length = 2.0 * self.radius * math.sin(2.0 * part)
        ux, uy = self.direction(0.0)
        c, s = math.cos(2.0 * part), math.sin(2.0 * part)
        return (
            self.start[0] + length * (ux * c - uy * s),
            self.start[1] + length * (ux * s + uy * c),
        )

    def part(self, first: float, last: float) -> "Curve":
        """Return the part between two shares of the length."""
        bulge = math.tan((last - first) * math.atan(self.bulge)) if self.bulge else 0.0
        return Curve(self.point(first), self.point(last), bulge)

    def shifted(self, distance: float) -> "Curve":
        """Return the parallel curve, of the same angle, at a distance [m] to the right.

        Negative is to the left; less than the radius of an arc whose centre is on that side.
        """
        ends = []
        for share, (x, y) in ((0.0, self.start), (1.0, self.end)):
            tx, ty = self.direction(share)
            ends.append((x + distance * ty, y - distance * tx))
        return Curve(ends[0], ends[1], self.bulge)

    def share(self, p: Pair) -> float | None:
        """Return where the curve passes a point of its line or circle; None where it does not."""
        slack = _REACH / self.length
        if self.bulge:
            centre, _, first, sweep = arc(*self)
            angle = math.atan2(p[1] - centre[1], p[0] - centre[0]) - first
            # the turn of the circle nearest to the middle of the arc
            angle += 2.0 * math.pi * round((0.5 * sweep - angle) / (2.0 * math.pi))
            share = angle / sweep
        else:
            dx, dy = self.end[0] - self.start[0], self.end[1] - self.start[1]
            share = ((p[0] - self.start[0]) * dx + (p[1] - self.start[1]) * dy) / (
                dx * dx + dy * dy
            )
        if not -slack <= share <= 1.0 + slack:
            return None
        return min(max(share, 0.0), 1.0)


def crossings(a: Curve, b: Curve) -> list[tuple[float, float]]:
    """Return where two curves meet, as shares of a and of b; none where they run along each other.

    Examples
    --------
    >>> crossings(Curve((0.0, 0.0), (4.0, 0.0)), Curve((1.0, -1.0), (1.0, 3.0)))
    [(0.25, 0.25)]
    """
    if a.bulge and b.bulge:
        points = _arc_arc(a, b)
    elif a.bulge or b.bulge:
        points = _line_arc(b, a) if a.bulge else _line_arc(a, b)
    else:
        points = _line_line(a, b)
    shares = []
    for p in points:
        s, t = a.share(p), b.share(p)
        if s is not None and t is not None:
            shares.append((s, t))
    return shares


def _line_line(a: Curve, b: Curve) -> list[Pair]:
    (ux, uy), (vx, vy) = a.direction(0.0), b.direction(0.0)
    cross = ux * vy - uy * vx
    if abs(cross) < 1e-12:
        return []
    dx, dy = b.start[0] - a.start[0], b.start[1] - a.start[1]
    along = (dx * vy - dy * vx) / cross
    return [(a.start[0] + along * ux, a.start[1] + along * uy)]


def _line_arc(line: Curve, bow: Curve) -> list[Pair]:
    centre, radius, _, _ = arc(*bow)
    ux, uy = line.direction(0.0)
    dx, dy = centre[0] - line.start[0], centre[1] - line.start[1]
    along, aside = dx * ux + dy * uy, dx * uy - dy * ux
    square = radius**2 - aside**2
    # where a line touches an arc, rounding may part them by a little
    if square < -2.0 * radius * _REACH:
        return []
    half = math.sqrt(max(square, 0.0))
    return [(line.start[0] + s * ux, line.start[1] + s * uy) for s in {along - half, along + half}]


def _arc_arc(a: Curve, b: Curve) -> list[Pair]:
    (ca, ra, _, _), (cb, rb, _, _) = arc(*a), arc(*b)
    apart = math.dist(ca, cb)
    if apart < _REACH:
        return []
    ux, uy = (cb[0] - ca[0]) / apart, (cb[1] - ca[1]) / apart
    along = 0.5 * (apart + (ra - rb) * (ra + rb) / apart)
    square = ra**2 - along**2
    if square < -2.0 * ra * _REACH:
        return []
    half = math.sqrt(max(square, 0.0))
    x, y = ca[0] + along * ux, ca[1] + along * uy
    return [(x - h * uy, y + h * ux) for h in {half, -half}]


def point_distance(p: Pair, curve: Curve) -> float:
    """Return the distance of a point from a curve."""
    ends = min(math.dist(p, curve.start), math.dist(p, curve.end))
    if curve.bulge:
        centre, radius, _, _ = arc(*curve)
        inside = curve.share(p) is not None
        return min(ends, abs(math.dist(p, centre) - radius)) if inside else ends
    if curve.share(p) is None:
        return ends
    ux, uy = curve.direction(0.0)
    return abs((p[0] - curve.start[0]) * uy - (p[1] - curve.start[1]) * ux)


def distance(a: Curve, b: Curve) -> float:
    """Return the shortest distance between two curves, exactly.

    Examples
    --------
    >>> bow = Curve((-1.0, 0.0), (1.0, 0.0), -1.0)
    >>> round(distance(Curve((-3.0, 2.5), (3.0, 2.5)), bow), 12)
    1.5
    """
    if crossings(a, b):
        return 0.0
    best = min(point_distance(p, b) for p in (a.start, a.end))
    best = min(best, *(point_distance(p, a) for p in (b.start, b.end)))
    # otherwise the shortest way stands square on both, so it goes through the centre of an arc
    for bow, other in ((a, b), (b, a)):
        if bow.bulge:
            centre, radius, _, _ = arc(*bow)
            for p in _feet(centre, other):
                apart = math.dist(p, centre)
                if other.share(p) is None or apart == 0.0:
                    continue
                for sign in (1.0, -1.0):
                    q = tuple(
                        c + sign * radius * (x - c) / apart for c, x in zip(centre, p, strict=True)
                    )
                    if bow.share(q) is not None:  # type: ignore[arg-type]
                        best = min(best, math.dist(p, q))
    return best


def _feet(p: Pair, curve: Curve) -> list[Pair]:
    """Points of the line or circle of a curve where it is square to the way to a point."""
    if not curve.bulge:
        ux, uy = curve.direction(0.0)
        s = (p[0] - curve.start[0]) * ux + (p[1] - curve.start[1]) * uy
        return [(curve.start[0] + s * ux, curve.start[1] + s * uy)]
    centre, radius, _, _ = arc(*curve)
    apart = math.dist(p, centre)
    if apart == 0.0:
        return [curve.start]
    ux, uy = (p[0] - centre[0]) / apart, (p[1] - centre[1]) / apart
    return [(centre[0] + s * radius * ux, centre[1] + s * radius * uy) for s in (1.0, -1.0)]
