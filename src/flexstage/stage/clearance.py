"""Overlaps between bodies and notches, and slots that the wire does not fit through."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from flexstage.arrays import Array, Integers
from flexstage.stage.issue import Issue, millimetres
from flexstage.stage.model import Body
from flexstage.stage.shapes import CHORD, Shape, drawn_openings

# Two polygons of arcs are off by CHORD each, so shapes that only touch overlap by at most twice
# that. An overlap counts if a disc of this radius fits into it: twice what touching can give.
_DISC = 2.0 * CHORD
# the same for distances, which are too short by at most two chords
_SLACK = 2.0 * CHORD
# faces count as the two sides of a slot if they are within this of being parallel: cos(45 deg)
_FACING = -0.7
_ARC_STEPS = 32
# edges that are compared with all others at once
_ROWS = 256


def overlaps(shapes: list[Shape]) -> Iterator[Issue]:
    """Find pairs of bodies and notches that fill the same place.

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
        own = a.name in b.bodies or b.name in a.bodies
        if a.is_notch and b.is_notch:
            code, cure = "hinges-coincide", "move one of them or leave it out"
        elif a.is_notch or b.is_notch:
            code = "notch-overlap"
            cure = (
                "leave the notch out of the outline of the body, and have 'direction' point from "
                "the first body to the second"
                if own
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
    which it grows. What is left out in this way is the opening of the notch itself, and that is as
    wide as the profile says.

    `wire_width` is the width of the narrowest slot that can be cut [m]; `skip` are pairs of names
    that have been spoken of.
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
        if gap < wire_width - _SLACK:
            p, q = nearest_points(a.polygon, b.polygon)
            yield Issue(
                severity="error",
                code="narrow-slot",
                what=(a.name, b.name),
                message=f"{a.label} and {b.label} are only {millimetres(gap)} apart about "
                f"{millimetres(0.5 * (p.x + q.x), 0.5 * (p.y + q.y))}, less than the wire width of "
                f"{millimetres(wire_width)}: widen the slot",
            )


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
    found = shapely.STRtree(faces)
    best = wire_width
    for face, normal in zip(faces, normals, strict=True):
        others = found.query(face, predicate="dwithin", distance=best)
        # the two faces of a thin wall are parallel too, but the slot is not between them
        others = others[normals[others] @ normal <= _FACING]
        if others.size:
            best = min(best, float(np.min(shapely.distance(face, faces[others]))))
    return best if best < wire_width else None
