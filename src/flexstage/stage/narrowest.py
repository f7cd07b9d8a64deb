"""The narrowest cut and the thinnest part of a stage, and the checks against limits.

The checks say whether a stage can be cut: overlaps of bodies and notches, slots that the wire does
not fit through. The numbers say by how much, so that a search can follow them. They go with the
geometry without a jump, but for 1 um where an arc gets one more chord, and for tapers: sides count
as those of one slot or wall within 6 deg of being parallel.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array, Integers
from flexstage.base.errors import StageError
from flexstage.stage.model import Body, Issue, Stage, millimetres
from flexstage.stage.outline import Circle
from flexstage.stage.shapes import CHORD, Shape, body_shapes, drawn_openings, notch_shapes

# Two polygons of arcs are off by CHORD each, so shapes that only touch overlap by at most twice
# that. An overlap counts if a disc of this radius fits into it: twice what touching can give.
_DISC = 2.0 * CHORD
# the same for distances, which are too short by at most two chords
_SLACK = 2.0 * CHORD
# notches at an angle of more than about 10 deg touch over less than this in a corner
_CORNER = 10.0 * _SLACK
# faces count as the two sides of a slot if they are within this of being parallel: cos(45 deg)
_FACING = -0.7
_ARC_STEPS = 32
# edges that are compared with all others at once
_ROWS = 256


def overlaps(shapes: list[Shape]) -> Iterator[Issue]:
    """Find pairs of bodies and notches that overlap.

    The shapes are bodies without their notches, and notches.
    """
    from shapely import STRtree

    # a tree of nothing cannot be asked
    if len(shapes) < 2:
        return
    tree = STRtree([s.polygon for s in shapes])
    for i, j in sorted(map(tuple, tree.query([s.polygon for s in shapes]).T.tolist())):
        a, b = shapes[i], shapes[j]
        if i >= j:
            continue
        common = a.polygon.intersection(b.polygon)
        if common.is_empty or common.buffer(-_DISC).is_empty:
            continue
        where = common.representative_point()
        related = a.name in b.bodies or b.name in a.bodies
        if a.is_notch and b.is_notch:
            code, cure = "hinges-coincide", "move one of them or remove it"
        elif a.is_notch or b.is_notch:
            code = "notch-overlap"
            cure = (
                "exclude the notch from the outline of the body, and let 'direction' point from "
                "the first body to the second"
                if related
                else "move the hinge or shorten its notch"
            )
        else:
            code, cure = (
                "overlap",
                "move them apart, or give the outer one a hole for the inner one",
            )
        yield Issue(
            severity="error",
            code=code,
            what=(a.name, b.name),
            message=f"{a.label} and {b.label} overlap about {millimetres(where.x, where.y)} "
            f"({common.area * 1e6:.3g} mm^2): {cure}",
        )


def slots_between(
    shapes: list[Shape], wire_width: float, skip: set[frozenset[str]]
) -> Iterator[Issue]:
    """Find bodies and notches that are nearer to one another than the wire is wide.

    Two bodies face each other across the full length of the notch that joins them, so bodies are
    compared without their notches; a notch is compared with everything but its own two bodies, from
    which it grows. Only the opening of the notch itself is excluded in this way, and its width is
    that of the profile.

    `wire_width` is the width of the narrowest slot that can be cut [m]; `skip` are pairs of names
    with an issue already.
    """
    from shapely import STRtree, box
    from shapely.ops import nearest_points

    if len(shapes) < 2:
        return
    polygons = [s.polygon for s in shapes]
    reach = np.array([-wire_width, -wire_width, wire_width, wire_width])
    around = [box(*(polygon.bounds + reach)) for polygon in polygons]
    for i, j in sorted(map(tuple, STRtree(polygons).query(around).T.tolist())):
        a, b = shapes[i], shapes[j]
        if i >= j or frozenset((a.name, b.name)) in skip:
            continue
        if a.is_notch != b.is_notch and (a.name in b.bodies or b.name in a.bodies):
            continue
        gap = a.polygon.distance(b.polygon)
        if gap < wire_width - _SLACK and not _meet_in_corner(a, b):
            p, q = nearest_points(a.polygon, b.polygon)
            yield Issue(
                severity="error",
                code="narrow-slot",
                what=(a.name, b.name),
                message=f"{a.label} and {b.label} are only {millimetres(gap)} apart about "
                f"{millimetres(0.5 * (p.x + q.x), 0.5 * (p.y + q.y))}, less than the wire width of "
                f"{millimetres(wire_width)}: widen the slot",
            )


def _meet_in_corner(a: Shape, b: Shape) -> bool:
    """Return whether two notches touch in a corner of a body that they share, and nowhere else."""
    if not (a.is_notch and b.is_notch) or set(a.bodies).isdisjoint(b.bodies):
        return False
    if a.polygon.distance(b.polygon) > _SLACK:
        return False
    low_x, low_y, high_x, high_y = a.polygon.buffer(_SLACK).intersection(b.polygon).bounds
    return float(np.hypot(high_x - low_x, high_y - low_y)) < _CORNER


def slots_within(body: Body, wire_width: float) -> Iterator[Issue]:
    """Find slots and holes of one body that the wire does not fit into.

    What a disc as wide as the wire cannot reach outside of the body is either the rest of a sharp
    corner, which the wire rounds, or a narrow slot, which has two sides that face each other.
    """
    from shapely import STRtree, buffer, get_parts, is_empty, linestrings

    radius = 0.5 * wire_width - _SLACK
    if radius <= 0.0:
        return
    # round holes that are wide enough are no part of what may be narrow
    polygon = drawn_openings(body, narrower_than=wire_width)
    if polygon is None:
        return
    # closing the material with a disc fills what the disc cannot reach
    closed = polygon.buffer(radius, quad_segs=_ARC_STEPS)
    closed = closed.buffer(-radius, quad_segs=_ARC_STEPS)
    missed = get_parts(closed.difference(polygon))
    # polygons in place of arcs leave slivers thinner than this
    missed = missed[~is_empty(buffer(missed, -0.5 * CHORD))]
    if not missed.size:
        return
    start, end, normals = edges(polygon)
    lines: Any = linestrings(np.stack([start, end], axis=1))
    tree = STRtree(lines)
    for part in missed:
        width = _facing_distance(part, tree, normals, wire_width)
        if width is not None:
            where = part.representative_point()
            yield Issue(
                severity="error",
                code="narrow-slot",
                what=(body.name,),
                message=f"a slot or hole in body '{body.name}' about "
                f"{millimetres(where.x, where.y)} is only {millimetres(width)} wide, less than the "
                f"wire width of {millimetres(wire_width)}: widen it",
            )


def edges(polygon: Any) -> tuple[Array, Array, Array]:
    """Return starts and ends of the edges of a body [m], and their outward normals, (n, 2) each."""
    from shapely.geometry.polygon import orient

    starts, ends = [], []
    for part in getattr(polygon, "geoms", [polygon]):
        oriented = orient(part)
        for line in (oriented.exterior, *oriented.interiors):
            xy = np.asarray(line.coords)[:, :2]
            starts.append(xy[:-1])
            ends.append(xy[1:])
    start, end = np.concatenate(starts), np.concatenate(ends)
    along = end - start
    length = np.hypot(along[:, 0], along[:, 1])
    keep = length > 0.0
    normal = np.stack([along[keep, 1], -along[keep, 0]], axis=1) / length[keep, None]
    return start[keep], end[keep], normal


def opposite_edges(normals: Array, largest: float) -> tuple[Integers, Integers]:
    """Return the pairs of edges, each once, whose normals have a scalar product of at most this."""
    pairs = []
    for first in range(0, len(normals), _ROWS):
        i, j = np.nonzero(normals[first : first + _ROWS] @ normals[first:].T <= largest)
        pairs.append(np.stack([i, j])[:, i < j] + first)
    i, j = np.concatenate(pairs, axis=1)
    return i, j


def _facing_distance(part: Any, tree: Any, normals: Array, wire_width: float) -> float | None:
    """Return the distance between the two sides of a slot, or None for a corner."""
    import shapely

    near = tree.query(part, predicate="dwithin", distance=CHORD)
    # only the parts that bound this region: a long edge bounds others as well
    faces = shapely.intersection(tree.geometries[near], part.buffer(2.0 * CHORD))
    reached = ~shapely.is_empty(faces)
    faces, normals = faces[reached], normals[near[reached]]
    face_tree = shapely.STRtree(faces)
    best = wire_width
    for face, normal in zip(faces, normals, strict=True):
        others = face_tree.query(face, predicate="dwithin", distance=best)
        # the two faces of a thin wall are parallel too, but the slot is not between them
        others = others[normals[others] @ normal <= _FACING]
        if others.size:
            best = min(best, float(np.min(shapely.distance(face, faces[others]))))
    return best if best < wire_width else None


# two sides of a slot or a wall: their outward normals are within 6 deg of opposite, and within 37
# deg of the shortest line between them; a round end is then narrower than its slot by 0.1 %
_OPPOSITE, _ACROSS = -0.995, 0.8
# how far bodies are looked for about each other, in widths of the wire
_REACH = 3.0
# pairs of edges that are measured at once
_AT_ONCE = 256


def narrowest_slot(stage: Stage) -> float:
    """Return the width of the narrowest cut of a stage [m].

    It is the least of the distances between bodies and notches, the widths of slots and holes
    within a body, the lengths of the notches, and twice the radii at their necks: what
    `flexstage.stage.check` compares with the width of the wire.

    Parameters
    ----------
    stage : Stage
        The stage.

    Returns
    -------
    float
        The width; where bodies or notches overlap, less than nothing: the depth of the deepest
        overlap (the width of the narrowest rectangle about it), with a minus sign. Infinite where
        nothing is cut.

    Raises
    ------
    StageError
        An outline is none: it crosses itself, or a hole reaches beyond it.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> round(1e3 * narrowest_slot(design("vgtu-piezo")), 3)
    1.0
    """
    bodies = _bodies(stage)
    shapes = [*bodies, *notch_shapes(list(stage.hinges))]
    profiles = {hinge.profile for hinge in stage.hinges}
    widths = [profile.length for profile in profiles]
    widths += [2.0 * profile.neck_radius for profile in profiles if profile.neck_radius > 0.0]
    widths += [2.0 * hole.radius for body in stage.bodies for hole in _circles(body)]
    widths.append(
        _between(shapes, _REACH * stage.manufacture.wire_width, min(widths, default=np.inf))
    )
    narrowest = min(widths)
    for body in stage.bodies if narrowest > 0.0 else ():
        if (openings := drawn_openings(body)) is not None:
            narrowest = min(narrowest, _within(openings, narrowest, outside=True))
    return float(narrowest)


def thinnest_wall(stage: Stage, body: str | None = None) -> float:
    """Return the thickness of the thinnest place of a body, between two sides that face away [m].

    Necks and sharp corners do not count.

    Parameters
    ----------
    stage : Stage
        The stage.
    body : str, optional
        The body; all where not given.

    Returns
    -------
    float
        The thickness; infinite where no body has two sides that are nearly parallel.

    Raises
    ------
    StageError
        An outline is none: it crosses itself, or a hole reaches beyond it.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> round(1e3 * thinnest_wall(design("vgtu-piezo")), 3)
    2.4
    """
    looked_at = [
        (one, shape.polygon)
        for one, shape in zip(stage.bodies, _bodies(stage), strict=True)
        if body in (None, one.name)
    ]
    thinnest = np.inf
    # the smallest bodies first, as nothing thicker is looked for in those that follow
    for one, polygon in sorted(looked_at, key=lambda pair: float(pair[1].area)):
        thinnest = min(thinnest, wall_of(one, polygon, thinnest))
    return float(thinnest)


def wall_of(body: Body, polygon: Any, reach: float = np.inf) -> float:
    """Return the thickness of the thinnest place of one body [m]; the polygon has its holes.

    Mounting holes count as the others do. Walls that are not thinner than `reach` [m] are not
    sought, which saves time; then `reach` or more is returned.
    """
    from shapely import Point
    from shapely.geometry import Polygon

    thinnest = reach
    # what stands between round holes and all else is known without their chords
    round_holes = _circles(body)
    inner = [r for r in polygon.interiors if not _is_round(r, round_holes)]
    rest = Polygon(polygon.exterior, inner)
    for hole in round_holes:
        thinnest = min(thinnest, rest.boundary.distance(Point(hole.centre)) - hole.radius)
    for one, other in combinations(round_holes, 2):
        apart = float(np.hypot(*np.subtract(one.centre, other.centre)))
        thinnest = min(thinnest, apart - one.radius - other.radius)
    return float(min(thinnest, _within(rest, thinnest, outside=False)))


def _bodies(stage: Stage) -> list[Shape]:
    bodies, issues = body_shapes(stage)
    if issues:
        raise StageError(issues[0].message)
    return bodies


def _circles(body: Body) -> list[Circle]:
    return [h for h in (*body.holes, *body.mounting_holes) if isinstance(h, Circle)]


def _is_round(ring: Any, circles: Iterable[Circle]) -> bool:
    x, y = np.asarray(ring.coords)[0, :2]
    return any(
        abs(np.hypot(x - c.centre[0], y - c.centre[1]) - c.radius) < 1e-3 * c.radius
        for c in circles
    )


def _between(shapes: Sequence[Shape], reach: float, narrowest: float) -> float:
    """Return the least distance between shapes if it is below a known one, or the overlap."""
    from shapely import STRtree, distance

    polygons = np.array([s.polygon for s in shapes])
    tree = STRtree(polygons)
    while True:
        i, j = tree.query(polygons, predicate="dwithin", distance=min(reach, narrowest))
        apart = [
            a < b
            and not (
                shapes[a].is_notch != shapes[b].is_notch
                and not {*shapes[a].bodies}.isdisjoint(shapes[b].bodies)
            )
            and not _meet_in_corner(shapes[a], shapes[b])
            for a, b in zip(i.tolist(), j.tolist(), strict=True)
        ]
        first, second = polygons[i[apart]], polygons[j[apart]]
        if first.size:
            break
        if reach >= narrowest or i.size == len(shapes) ** 2:
            return narrowest
        reach *= 4.0
    gap = distance(first, second)
    touching = gap == 0.0
    return -_depth(first[touching], second[touching]) if touching.any() else float(gap.min())


def _depth(first: NDArray[Any], second: NDArray[Any]) -> float:
    """Return the depth of the deepest overlap."""
    from shapely import get_parts, intersection, minimum_rotated_rectangle

    deepest = 0.0
    for part in get_parts(intersection(first, second)):
        around = minimum_rotated_rectangle(part)
        if around.geom_type == "Polygon":
            corners = np.asarray(around.exterior.coords)
            deepest = max(deepest, float(np.hypot(*np.diff(corners[:3], axis=0).T).min()))
    return deepest


def _within(polygon: Any, reach: float, *, outside: bool) -> float:
    """Least distance of two sides of a body, across a slot or across its material."""
    import shapely

    start, end, normals = edges(polygon)
    middle, half = 0.5 * (start + end), 0.5 * np.hypot(*(end - start).T)
    sign = 1.0 if outside else -1.0
    i, j = opposite_edges(normals, _OPPOSITE)
    between = middle[j] - middle[i]
    apart = sign * _dot(normals[i], between)
    # an edge leans by less than a tenth of its length against the other
    least = np.maximum(apart - 0.1 * half[j], np.hypot(*between.T) - half[i] - half[j])
    order = np.flatnonzero((apart >= 0.0) & (least < reach))
    order = order[np.argsort(least[order])]
    lines: Any = shapely.linestrings(np.stack([start, end], axis=1))
    for first in range(0, order.size, _AT_ONCE):
        some = order[first : first + _AT_ONCE]
        some = some[least[some] < reach]
        if not some.size:
            break
        a, b = i[some], j[some]
        ends = shapely.get_coordinates(shapely.shortest_line(lines[a], lines[b]))
        across = ends[1::2] - ends[::2]
        width = np.hypot(*across.T)
        facing = (
            (width < reach)
            & (sign * _dot(normals[a], across) >= _ACROSS * width)
            & (-sign * _dot(normals[b], across) >= _ACROSS * width)
        )
        # in the middle of what lies side by side, as corners lie on other edges
        along = np.stack([-normals[a][:, 1], normals[a][:, 0]], axis=1)
        limits = [_dot(along, e[b] - middle[a]) for e in (start, end)]
        low = np.maximum(np.minimum(*limits), -half[a])
        high = np.minimum(np.maximum(*limits), half[a])
        place = 0.5 * (ends[::2] + ends[1::2])
        inner = middle[a] + 0.5 * (
            (low + high)[:, None] * along + sign * width[:, None] * normals[a]
        )
        place[high > low] = inner[high > low]
        x, y = place[facing].T
        facing[facing] = (shapely.contains_xy(polygon, x, y) != outside) | (width[facing] == 0.0)
        reach = min(reach, float(width[facing].min(initial=np.inf)))
    return reach


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("ij,ij->i", a, b)
