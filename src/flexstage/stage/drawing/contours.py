"""The closed contours of a part, chained from the lines and arcs of a drawing."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexstage.base.errors import StageError
from flexstage.stage.curve import Curve
from flexstage.stage.drawing.strokes import DrawnStroke, Pair, circle_of, rounded, tidy
from flexstage.stage.outline import Circle, Loop, arc
from flexstage.stage.shapes import CHORD

#: Largest gap that is closed by default [m].
GAP = 2e-6
#: Largest distance of a drawn contour from its profile, in a drawing with all digits [m].
FIT_TOLERANCE = 0.5e-6

_ASKEW = 0.1  # lines that are nearer to parallel have no sure crossing (sine)
_SAME = 2e-9  # two points are one, or two lines one on the other [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnContour:
    """A closed line, with the material on its left."""

    strokes: tuple[DrawnStroke, ...]
    """Pieces in order."""
    layer: str = ""
    """The layer on which most of it was drawn."""

    @property
    def loop(self) -> Loop:
        """The same as a loop."""
        return Loop(
            tuple(s.curve.start for s in self.strokes), tuple(s.curve.bulge for s in self.strokes)
        )

    @property
    def circle(self) -> Circle | None:
        """The circle, where it is one."""
        if not all(s.curve.bulge for s in self.strokes):
            return None
        circles = [arc(*s.curve) for s in self.strokes]
        (x, y), radius, _, _ = max(circles, key=lambda c: abs(c[3]))
        turn = abs(sum(c[3] for c in circles))
        near = all(math.dist(c[0], (x, y)) < 5e-6 and abs(c[1] - radius) < 5e-6 for c in circles)
        if not near or abs(turn - 2.0 * math.pi) > 1e-3:
            return None
        off = 0.0
        if all(s.trace for s in self.strokes):
            (x, y), radius, off = circle_of(np.array([p for s in self.strokes for p in s.trace]))
        return Circle((rounded(x, off), rounded(y, off)), rounded(radius, off))


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnPart:
    """A part as it was drawn: its outline and the openings in it."""

    outline: DrawnContour
    """Outline, counter-clockwise."""
    openings: tuple[DrawnContour, ...]
    """Openings in it, clockwise."""
    unit: float = 1e-3
    """Unit of coordinates in messages [m]."""
    unit_name: str = "mm"
    """Name of the unit."""
    rounding: float = 0.0
    """Largest rounding error of a coordinate in the file [m]."""

    @property
    def contours(self) -> tuple[DrawnContour, ...]:
        """All of them, the outline first."""
        return (self.outline, *self.openings)

    @property
    def tolerance(self) -> float:
        """Largest distance of the drawn contour from its profile [m]."""
        return max(FIT_TOLERANCE, 2.0 * self.rounding)

    def place(self, point: Pair) -> str:
        """Return the coordinates of a place as text, in the unit of the drawing."""
        return place(point, self.unit, self.unit_name)


def place(point: Sequence[float], unit: float, name: str) -> str:
    """Return the coordinates of a place as text.

    Examples
    --------
    >>> place((0.0123, -0.004), 1e-3, "mm")
    '(12.3, -4) mm'
    """
    x, y = (f"{c / unit:.7g}" for c in point)
    return f"({x}, {y}) {name}"


def part_of(
    curves: Sequence[tuple[Curve, str]],
    *,
    gap: float,
    unit: float,
    unit_name: str,
    rounding: float = 0.0,
) -> DrawnPart:
    """Chain the lines and arcs of a drawing to closed contours, and find which encloses which.

    Each curve comes with its layer. Ends that are up to `gap` apart are joined [m]; `unit` and
    `unit_name` are those of coordinates in messages, `rounding` is the error of a coordinate [m].
    """

    def at(point: Sequence[float]) -> str:
        return place(point, unit, unit_name)

    if not curves:
        raise StageError("the drawing contains no lines, arcs or curves of a contour")
    nodes, points = _nodes(curves, gap)
    distinct = _without_doubles(curves, nodes)
    loops = _chained(curves, nodes, points, distinct, gap, at)
    return _nested(loops, unit, unit_name, rounding, at)


def _nodes(curves: Sequence[tuple[Curve, str]], gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Number the places where curves end: shape (n, 2); and give the places."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    ends = np.array([p for c, _ in curves for p in (c.start, c.end)])
    pairs = KDTree(ends).query_pairs(_SAME, output_type="ndarray")

    def grouped(pairs: np.ndarray, count: int) -> np.ndarray:
        joined = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (count, count))
        return connected_components(joined, directed=False)[1]

    label = grouped(pairs, len(ends))
    # ends that meet nothing look for one of their kind within the gap
    single = np.flatnonzero(np.bincount(label)[label] == 1)
    if len(single) > 1:
        near = KDTree(ends[single]).query_pairs(gap, output_type="ndarray")
        label = grouped(np.vstack([pairs, single[near]]), len(ends))
    order = np.argsort(label, kind="stable")
    _, first = np.unique(label[order], return_index=True)
    points = ends[order][first]
    for members in np.split(order, first[1:]):
        if len(members) == 2 and math.dist(*ends[members]) > _SAME:
            points[label[members[0]]] = _meeting(curves, ends, members.tolist(), gap)
    return label.reshape(-1, 2), points


def _meeting(
    curves: Sequence[tuple[Curve, str]], ends: np.ndarray, members: list[int], gap: float
) -> Pair:
    """Return the intended common point of two ends with a gap between them.

    It is the intersection of two lines, the end of an arc, or else the point half way.
    """
    one, other = (curves[m // 2][0] for m in members)
    p, q = ends[members].tolist()
    middle = (0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]))
    if one.bulge and not other.bulge:
        return p[0], p[1]
    if other.bulge and not one.bulge:
        return q[0], q[1]
    if not one.bulge:
        (ux, uy), (vx, vy) = one.direction(0.0), other.direction(0.0)
        cross = ux * vy - uy * vx
        if abs(cross) > _ASKEW:
            along = ((q[0] - p[0]) * vy - (q[1] - p[1]) * vx) / cross
            corner = (p[0] + along * ux, p[1] + along * uy)
            if math.dist(corner, middle) < 2.0 * gap:
                return corner
    return middle


def _without_doubles(curves: Sequence[tuple[Curve, str]], nodes: np.ndarray) -> list[int]:
    """Remove duplicate curves and curves without length."""
    drawn_points: dict[tuple[int, int], list[Pair]] = {}
    distinct = []
    for k, (curve, _) in enumerate(curves):
        a, b = sorted(nodes[k].tolist())
        if a == b:
            continue
        middle = curve.point(0.5)
        others = drawn_points.setdefault((a, b), [])
        # the ends may be off by the gap, the middle then by as much
        if all(math.dist(middle, m) > GAP for m in others):
            others.append(middle)
            distinct.append(k)
    return distinct


def _chained(
    curves: Sequence[tuple[Curve, str]],
    nodes: np.ndarray,
    points: np.ndarray,
    curves_of_contours: list[int],
    gap: float,
    at: Any,
) -> list[tuple[list[Curve], str]]:
    """Follow curves from end to end until they close."""
    meeting: dict[int, list[int]] = {}
    for k in curves_of_contours:
        for node in nodes[k].tolist():
            meeting.setdefault(node, []).append(k)
    loose = [n for n, ends in meeting.items() if len(ends) == 1]
    if loose:
        first = min(loose, key=lambda n: (-points[n][1], points[n][0]))
        text = f"the contour is open at {at(points[first])}"
        if len(loose) > 1:
            others = [n for n in loose if n != first]
            nearest = min(others, key=lambda n: math.dist(points[n], points[first]))
            apart = math.dist(points[nearest], points[first])
            text += (
                f": the nearest other open end is {apart * 1e6:.4g} um away, at "
                f"{at(points[nearest])}, more than the largest gap that is closed, "
                f"{gap * 1e6:.4g} um"
            )
        if len(loose) > 2:
            text += f" ({len(loose)} open ends in total)"
        raise StageError(
            f"{text}; close it in the drawing, name its layers, or give --contours gap=LENGTH"
        )
    crowded = [n for n, ends in meeting.items() if len(ends) > 2]
    if crowded:
        n = min(crowded, key=lambda n: (-points[n][1], points[n][0]))
        raise StageError(
            f"{len(meeting[n])} lines meet at {at(points[n])}, where a contour has 2: exclude the "
            "layer of other lines"
        )
    loops, used = [], set()
    for first in curves_of_contours:
        if first in used:
            continue
        loop, layers, k, node = [], [], first, int(nodes[first][0])
        while k not in used:
            used.add(k)
            curve, layer = curves[k]
            layers.append(layer)
            a, b = nodes[k].tolist()
            forward = a == node
            node = b if forward else a
            start, end = (points[n].tolist() for n in ((a, b) if forward else (b, a)))
            bulge = curve.bulge if forward else -curve.bulge
            loop.append(Curve((start[0], start[1]), (end[0], end[1]), bulge))
            k = next((other for other in meeting[node] if other not in used), k)
        loops.append((loop, max(set(layers), key=layers.count)))
    return loops


def _nested(
    loops: list[tuple[list[Curve], str]], unit: float, unit_name: str, rounding: float, at: Any
) -> DrawnPart:
    from shapely import Polygon, STRtree

    rings = []
    for loop, _ in loops:
        shape = Loop(tuple(c.start for c in loop), tuple(c.bulge for c in loop))
        corners = shape.polyline(CHORD)
        if len(corners) < 3:
            raise StageError(f"the contour at {at(corners[0])} encloses no area: remove it")
        rings.append(Polygon(corners))
    _refuse_crossings(rings, at)
    tree = STRtree(rings)
    depth = [0] * len(rings)
    for i, ring in enumerate(rings):
        inside = ring.representative_point()
        depth[i] = sum(
            j != i and rings[j].area > ring.area and rings[j].contains(inside)
            for j in tree.query(inside, "intersects").tolist()
        )
    outer = [i for i, d in enumerate(depth) if d == 0]
    if len(outer) > 1:
        outer.sort(key=lambda i: -rings[i].area)
        where = " and ".join(at(rings[i].representative_point().coords[0]) for i in outer[:2])
        raise StageError(
            f"the drawing shows {len(outer)} separate parts, about {where}: keep one, or name the "
            "layers of the intended one"
        )
    deep = [i for i, d in enumerate(depth) if d > 1]
    if deep:
        where = at(rings[deep[0]].representative_point().coords[0])
        raise StageError(
            f"a closed contour about {where} lies within an opening of the part, so it is a loose "
            "piece: remove it, or name the layers of the contours; a frame round the drawing "
            "must be removed as well"
        )
    contours = []
    for i, (loop, layer) in enumerate(loops):
        outward = rings[i].exterior.is_ccw == (depth[i] == 0)
        turned = loop if outward else [Curve(c.end, c.start, -c.bulge) for c in reversed(loop)]
        contours.append(DrawnContour(strokes=tuple(tidy(turned, rounding)), layer=layer))
    outline = contours[outer[0]]
    return DrawnPart(
        outline=outline,
        openings=tuple(c for c in contours if c is not outline),
        unit=unit,
        unit_name=unit_name,
        rounding=rounding,
    )


def _refuse_crossings(rings: list[Any], at: Any) -> None:
    from shapely import STRtree
    from shapely.validation import explain_validity

    for ring in rings:
        if not ring.is_valid:
            # "Self-intersection[x y]"
            where = explain_validity(ring).partition("[")[2].rstrip("]").split()
            raise StageError(
                f"a contour crosses or touches itself at {at([float(c) for c in where])}: correct "
                "the drawing there"
            )
    lines = [ring.exterior for ring in rings]
    for i, j in STRtree(lines).query(lines, "intersects").T.tolist():
        if i < j:
            common = lines[i].intersection(lines[j]).representative_point().coords[0]
            raise StageError(
                f"two contours cross or touch at {at(common)}: correct the drawing there, or "
                "exclude the layer of other lines"
            )
