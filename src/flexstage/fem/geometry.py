"""The plane of a stage as named faces that share their edges, and the names.

In names `which` is 0 for the half on a hinge's first body, or the patch on the pushed body, and 1
for the other.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain

from netgen.occ import Glue, TopoDS_Shape

from flexstage.base.errors import StageError
from flexstage.elasticity import face
from flexstage.elasticity.shapes import METRE
from flexstage.stage import Body, Circle, Drive, Hinge, Loop, Stage
from flexstage.stage.checks import ON_BODY
from flexstage.stage.contour import STRAINED, body_contour, inner_notch, share_to_root
from flexstage.stage.curve import line_coordinates

_SYNTAX = frozenset("^$\\.*+?()[]{}|")  # characters that mean something in an expression

#: Boundary by which the fixed bodies are held.
MOUNTING = "mounting"


def body_region(body: str) -> str:
    """Return the name of the region of a body without its half notches."""
    return f"body {body}"


def notch_region(hinge: str, which: int) -> str:
    """Return the name of the region of one half of a notch."""
    return f"notch {hinge} {'ab'[which]}"


def outer_region(hinge: str, which: int) -> str:
    """Return the name of the region between half of a notch and a body of another material."""
    return f"outer {notch_region(hinge, which)}"


def neck_edge(hinge: str) -> str:
    """Return the name of the boundary between the two halves of a notch."""
    return f"neck {hinge}"


def surface_edge(hinge: str) -> str:
    """Return the name of the free surface of a notch."""
    return f"surface {hinge}"


def patch_edge(drive: str, which: int) -> str:
    """Return the name of the patch on which a drive acts."""
    return f"patch {drive} {('push', 'react')[which]}"


def exactly(name: str) -> str:
    r"""Return the regular expression that matches one name and no other.

    Examples
    --------
    >>> print(exactly("body x+"))
    body x\+
    """
    # names come from stage files, and the mesher takes every name for an expression
    return "".join(f"\\{c}" if c in _SYNTAX else c for c in name)


def either(names: Iterable[str]) -> str:
    """Return the regular expression that matches any of some names."""
    return "|".join(f"({exactly(n)})" for n in names)


Point = tuple[float, float]
_NEAR = 1e-9  # two points are one [m]


def notch_cuts(stage: Stage, hinge: Hinge, which: int) -> tuple[float, ...]:
    """Return where the regions of a half notch end, from the neck on, in half lengths [1].

    There is a second one as far as the root where the body is of another material or rigid. Where
    the contour allows none so far (`flexstage.stage.contour.share_to_root`), the remainder is of
    the body, and `flexstage.stage.check` warns of a region that ends before `STRAINED`.
    """
    if all(b.name != hinge.bodies[which] for b in stage.other_bodies):
        return (STRAINED,)
    share = share_to_root(hinge.profile)
    return (STRAINED, share) if share > STRAINED else (share,)


_REGIONS = (notch_region, outer_region)


@dataclass(frozen=True, slots=True, kw_only=True)
class DrivePatch:
    """Patch of a drive on a body."""

    drive: str
    """Name of the drive."""
    which: int
    """0 on the pushed body, 1 on the reacting one."""
    body: str
    """Name of the body."""
    at: Point
    """The point [m]."""
    ends: tuple[Point, Point] | None
    """Ends of the straight stretch of its edge on which the force is spread [m]; None where the
    point lies on no straight edge, and the force is spread in a disc.
    """


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StageFaces:
    """Faces of a stage, or of some of its bodies with their half notches."""

    shape: TopoDS_Shape
    """The faces, glued; regions and edges are named as in `flexstage.fem.geometry`."""
    patches: tuple[DrivePatch, ...]
    """Patches of the drives on them."""
    supports: str
    """Supports of the fixed bodies, as text; empty where none is fixed."""
    corners: tuple[Point, ...]
    """Corners of all their outlines, in the order of the stage [m]."""


def patches(drive: Drive, bodies: Iterable[Body]) -> tuple[DrivePatch, ...]:
    """Return the patches of a drive on some bodies.

    These are those of its two patches whose body is among them.
    """
    by_name = {b.name: b for b in bodies}
    drive_patches = []
    for which, name in enumerate((drive.pushes, drive.reacts)):
        if name in by_name:
            at = drive.at[which]
            ends = _stretch(by_name[name], at, drive.patch_half_width)
            drive_patches.append(
                DrivePatch(drive=drive.name, which=which, body=name, at=at, ends=ends)
            )
    return tuple(drive_patches)


def _stretch(body: Body, at: Point, half_width: float) -> tuple[Point, Point] | None:
    """Find the part of a straight edge about the foot of a point on it or near it."""
    candidates: list[tuple[float, tuple[Point, Point]]] = []
    for loop in (body.outline, *(h for h in body.holes if isinstance(h, Loop))):
        for a, b, bulge in loop.segments():
            length = math.dist(a, b)
            if bulge or length < _NEAR:
                continue
            along, aside, (ux, uy) = line_coordinates(at, a, b)
            # as far to either side, so that the resultant goes through the point
            w = min(half_width, along, length - along)
            if abs(aside) < ON_BODY and w > _NEAR:
                x, y = (at[0] + aside * uy, at[1] - aside * ux) if abs(aside) > _NEAR else at
                ends = (x - w * ux, y - w * uy), (x + w * ux, y + w * uy)
                candidates.append((abs(aside), ends))
    return min(candidates)[1] if candidates else None


def _with_points(loop: Loop, extra: Iterable[Point]) -> Loop:
    """Add points that lie on straight segments of a loop as corners."""
    points: list[Point] = []
    bulges: list[float] = []
    added = list(extra)
    for a, b, bulge in loop.segments():
        points.append(a)
        bulges.append(bulge)
        length = math.dist(a, b)
        if bulge or length < _NEAR:
            continue
        on_segment = [(*line_coordinates(p, a, b)[:2], p) for p in added]
        inside = sorted(
            (s, p)
            for s, aside, p in on_segment
            if _NEAR < s < length - _NEAR and abs(aside) < _NEAR
        )
        for _, p in inside:
            if math.dist(p, points[-1]) > _NEAR:
                points.append(p)
                bulges.append(0.0)
    return Loop(tuple(points), tuple(bulges))


def _body_face(stage: Stage, body: Body, extra: list[Point]) -> tuple[TopoDS_Shape, list[Point]]:
    """Return the face of a body, and the corners of its outline and holes."""
    contour, holes = body_contour(stage, body, lambda h, which: notch_cuts(stage, h, which)[-1])
    outline = _with_points(contour, extra)
    shape, corners = face(outline.points, outline.bulges), list(outline.points)
    for hole in (*holes, *body.mounting_holes):
        loop = hole.loop() if isinstance(hole, Circle) else _with_points(hole, extra)
        shape = shape - face(loop.points, loop.bulges)
        corners += loop.points
    if len(shape.faces) != 1:
        raise StageError(
            f"body '{body.name}' is in {len(shape.faces)} pieces once its holes are cut: run "
            "'flexstage check'"
        )
    shape = shape.faces[0]
    shape.name = body_region(body.name)
    return shape, corners


def stage_faces(stage: Stage, bodies: Iterable[str] | None = None) -> StageFaces:
    """Return the faces of a stage: one for each body and one for each half notch.

    Of some bodies alone, each with its half notches, where their names are given. Of the entire
    stage, a body without support is an error too.
    """
    if bodies is None:
        _require_held(stage)
    selected = [b for b in stage.bodies if bodies is None or b.name in set(bodies)]
    names = {b.name for b in selected}
    touched = tuple(p for d in stage.drives for p in patches(d, selected))
    extra = [end for p in touched if p.ends is not None for end in p.ends]
    shapes, corners = [], []
    for body in selected:
        shape, of_body = _body_face(stage, body, extra)
        shapes.append(shape)
        corners += of_body
    halves: list[tuple[Hinge, int]] = [
        (h, i) for h in stage.hinges for i in (0, 1) if h.bodies[i] in names
    ]
    for hinge, which in halves:
        start = 0.0
        for end, region in zip(notch_cuts(stage, hinge, which), _REGIONS, strict=False):
            loop = inner_notch(hinge, which, end, start)
            half = face(loop.points, loop.bulges)
            half.name = region(hinge.name, which)
            shapes.append(half)
            corners += loop.points
            start = end
    glued = Glue(shapes) if len(shapes) > 1 else shapes[0]
    if len(glued.faces) != len(shapes):
        raise StageError(
            f"bodies or notches of stage '{stage.name}' overlap: {len(shapes)} faces became "
            f"{len(glued.faces)} when they were joined; run 'flexstage check' for details"
        )
    supports = _name_edges(stage, glued, selected, touched, halves)
    return StageFaces(shape=glued, patches=touched, supports=supports, corners=tuple(corners))


def _middle(edge: TopoDS_Shape) -> Point:
    first, last = edge.parameter_interval
    p = edge.Value(0.5 * (first + last))
    return p.x / METRE, p.y / METRE


def _name_edges(
    stage: Stage,
    glued: TopoDS_Shape,
    bodies: list[Body],
    touched: tuple[DrivePatch, ...],
    halves: list[tuple[Hinge, int]],
) -> str:
    """Name the edges of necks, notches, patches and supports; return the supports as text."""
    by_face = {f.name: f for f in glued.faces}
    for hinge, which in halves:
        half = hinge.profile.length / 2.0
        cuts = [share * half for share in notch_cuts(stage, hinge, which)]
        cut = cuts[0]
        for edge in by_face[notch_region(hinge.name, which)].edges:
            start, end = _along(hinge, edge)
            if abs(start) < _NEAR and abs(end) < _NEAR:
                edge.name = neck_edge(hinge.name)
            elif abs(abs(start) - cut) > _NEAR or abs(abs(end) - cut) > _NEAR:
                edge.name = surface_edge(hinge.name)
        outer = [outer_region(hinge.name, which)] * (len(cuts) - 1)
        for region in (*outer, body_region(hinge.bodies[which])):
            for edge in by_face[region].edges:
                if not edge.name and _on_outer_notch(hinge, edge, cuts):
                    edge.name = surface_edge(hinge.name)
    supports = []
    for body in bodies:
        body_face = by_face[body_region(body.name)]
        for patch in (p for p in touched if p.body == body.name and p.ends is not None):
            a, b = patch.ends  # type: ignore[misc]
            for edge in body_face.edges:
                if not _between(_middle(edge), a, b):
                    continue
                if edge.name:
                    raise StageError(
                        f"drive '{patch.drive}' and another act on the same stretch of edge of "
                        f"body '{body.name}': move them apart, or make their patches narrower"
                    )
                edge.name = patch_edge(patch.drive, patch.which)
        if body.fixed:
            supports.append(_name_supports(stage, body, body_face))
    return "; ".join(dict.fromkeys(supports))


def _require_held(stage: Stage) -> None:
    """Refuse a stage with a body without support: its stiffness could not be factorised."""
    reached = {b.name for b in stage.bodies if b.fixed}
    if not reached:
        raise StageError(
            f"no body of stage '{stage.name}' is fixed, so it has no support: set 'fixed: true' "
            "on the body that is bolted down"
        )
    while True:
        more = {n for h in stage.hinges if reached & set(h.bodies) for n in h.bodies} - reached
        if not more:
            break
        reached |= more
    loose = [b.name for b in stage.bodies if b.name not in reached]
    if loose:
        raise StageError(
            f"body '{loose[0]}' is connected to no fixed body by hinges: add a hinge, or fix it"
        )


def _ends(edge: TopoDS_Shape) -> tuple[Point, Point]:
    a, b = edge.start, edge.end
    return (a.x / METRE, a.y / METRE), (b.x / METRE, b.y / METRE)


def _along(hinge: Hinge, edge: TopoDS_Shape) -> tuple[float, float]:
    a, b = _ends(edge)
    return hinge.from_plane(a)[0], hinge.from_plane(b)[0]


def _on_outer_notch(hinge: Hinge, edge: TopoDS_Shape, cuts: Sequence[float]) -> bool:
    """Return whether an edge is of the outer part of a notch, between its first cut and root."""
    half, height = hinge.profile.length / 2.0, hinge.profile.root_height
    cut, last = cuts[0], cuts[-1]
    for p in chain(_ends(edge), map(_middle, [edge])):  # most edges fail at an end
        along, across = hinge.from_plane(p)
        if not cut - _NEAR < abs(along) < half + _NEAR or abs(across) > height:
            return False
    first, second = _along(hinge, edge)
    middle = abs(hinge.from_plane(_middle(edge))[0])
    if abs(abs(first) - last) < _NEAR and abs(abs(second) - last) < _NEAR:
        return False  # where its last region meets the body
    # the cut lies across, and so does an edge of the body next to the root
    return not abs(first - second) < _NEAR or cut + _NEAR < middle < half - _NEAR


def _between(p: Point, a: Point, b: Point) -> bool:
    along, aside, _ = line_coordinates(p, a, b)
    return abs(aside) < _NEAR and 0.0 < along < math.dist(a, b)


def _name_supports(stage: Stage, body: Body, body_face: TopoDS_Shape) -> str:
    """Name the supported edges of a fixed body: its mounting holes, or else its outer edges."""
    if body.mounting_holes:
        for edge in body_face.edges:
            x, y = _middle(edge)
            for hole in body.mounting_holes:
                if abs(math.hypot(x - hole.centre[0], y - hole.centre[1]) - hole.radius) < _NEAR:
                    edge.name = MOUNTING
        return "fixed bodies held at their mounting holes"
    # Without holes it is supported all around, except for the edges with a notch and those next to
    # them, which must be free to deform at the root. The line at which the body and the inner part
    # of a notch meet is no edge of the stage.
    roots: list[Point] = []
    hinges = [h for h in stage.hinges if body.name in h.bodies]
    for hinge in hinges:
        for which, name in enumerate(hinge.bodies):
            if name == body.name:
                side = (-1.0, 1.0)[which]
                roots.append(hinge.to_plane(side * hinge.profile.length / 2.0, 0.0))
    clear = max((h.profile.root_height for h in hinges), default=0.0)
    count = 0
    for edge in body_face.edges:
        if edge.name or any(_in_notch(h, _middle(edge)) for h in hinges):
            continue
        if all(_distance_to(edge, p) > clear for p in roots):
            edge.name = MOUNTING
            count += 1
    if not count:
        raise StageError(
            f"the fixed body '{body.name}' has no mounting hole, and no edge away from its "
            "notches that could support it: give it mounting_holes"
        )
    return "fixed bodies without mounting holes held at their edges away from the notches"


def _in_notch(hinge: Hinge, p: Point) -> bool:
    along, across = hinge.from_plane(p)
    half, height = hinge.profile.length / 2.0, hinge.profile.root_height
    return abs(along) < half - _NEAR and abs(across) < height


def _distance_to(edge: TopoDS_Shape, p: Point) -> float:
    a, b = (edge.start.x / METRE, edge.start.y / METRE), (edge.end.x / METRE, edge.end.y / METRE)
    length = math.dist(a, b)
    if length < _NEAR:
        return math.dist(_middle(edge), p)
    along, _, (ux, uy) = line_coordinates(p, a, b)
    along = min(max(along, 0.0), length)
    return math.dist(p, (a[0] + along * ux, a[1] + along * uy))
