"""Contours of bodies as cut: the roots of hinges on them, and their half notches."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

from flexstage.base.errors import StageError
from flexstage.hinges.hinge_spring import ROOT_REACH
from flexstage.hinges.profile import Profile, Vertex
from flexstage.stage.curve import Curve, line_coordinates
from flexstage.stage.model import Body, Hinge, Stage
from flexstage.stage.outline import Circle, Loop, arc

#: Largest distance of a root from the edge that it should lie on [m].
TOLERANCE = 1e-6
# strips on both sides of a body that turn less are one straight strip (sine)
_STRAIGHT = 0.02
# a bend is as thick as its strips within this part, and so many times longer at most
_UNEVEN, _LONGEST = 0.1, 40.0
# a contour that turns less has no corner (sine)
_BLUNT = 0.1

_Pair = tuple[float, float]


class Root(NamedTuple):
    """The straight line on which a notch meets a body."""

    body: str
    """Name of the body."""
    ends: tuple[_Pair, _Pair]
    """The two ends of the root [m], right and left of the hinge's direction."""
    edge: tuple[_Pair, _Pair]
    """The two ends of the edge of the body that holds the root [m], right and left as well."""
    width: float
    """Width of the body behind the root [m]."""


def root_line(hinge: Hinge, which: int) -> tuple[_Pair, _Pair]:
    """Return the ends of the root of a hinge.

    Right and left of the hinge's direction [m]; `which` is 0 for the root on body a, 1 for the one
    on body b.
    """
    profile = hinge.profile
    along = (-0.5, 0.5)[which] * profile.length
    half_neck = 0.5 * profile.neck_thickness
    right = -half_neck if profile.one_sided else -0.5 * profile.root_height
    return hinge.to_plane(along, right), hinge.to_plane(along, half_neck + profile.depth)


def hinge_root(stage: Stage, hinge: Hinge, which: int) -> Root:
    """Find the edge of a body that a hinge grows from."""
    body = stage.body(hinge.bodies[which])
    right, left = root_line(hinge, which)
    for first, second in _straight_edges(body):
        if _contains(first, second, right) and _contains(first, second, left):
            # seen from the neck the edge may run either way
            across = (left[0] - right[0], left[1] - right[1])
            swap = (second[0] - first[0]) * across[0] + (second[1] - first[1]) * across[1] < 0.0
            edge = (second, first) if swap else (first, second)
            middle = (0.5 * (right[0] + left[0]), 0.5 * (right[1] + left[1]))
            width = 2.0 * min(math.dist(middle, edge[0]), math.dist(middle, edge[1]))
            return Root(body.name, (right, left), edge, width)
    x, y = hinge.to_plane((-0.5, 0.5)[which] * hinge.profile.length, 0.0)
    raise StageError(
        f"hinge '{hinge.name}' is not attached to body '{body.name}': its end face, "
        f"{hinge.profile.root_height * 1e3:.6g} mm wide at ({x * 1e3:.6g}, {y * 1e3:.6g}) mm, "
        f"must lie on one straight edge of the body's outline (to {TOLERANCE * 1e6:.0f} um); move "
        "the hinge, correct its direction, or widen the edge"
    )


def root_widths(stage: Stage, hinge: Hinge) -> tuple[float, float]:
    """Return the widths of the two bodies behind the roots of a hinge.

    The width is twice the distance from the middle of the root (which is on the hinge's line for a
    notch cut from both sides) to the nearer end of the edge, so it is never less than the root.

    Parameters
    ----------
    stage : Stage
        The stage.
    hinge : Hinge
        One of its hinges.

    Returns
    -------
    tuple of float
        Width of body a and of body b [m].

    Raises
    ------
    StageError
        A root does not lie on its body.
    """
    return hinge_root(stage, hinge, 0).width, hinge_root(stage, hinge, 1).width


def root_reaches(stage: Stage, hinge: Hinge) -> tuple[float, float]:
    """Return how far the roots of a hinge reach into its two bodies, in heights of the root [1].

    It is `flexstage.hinges.hinge_spring.ROOT_REACH`, but in a corner of a bent strip, a body two of
    whose edges are roots from end to end. Where these meet, hinges reach to the middle of it, and
    leaves without a step to where their middle lines cross; in a bend as thick as the strip such
    leaves share its length.
    """
    a, b = (root_reach(stage, hinge, hinge_root(stage, hinge, which)) for which in (0, 1))
    return a, b


def root_reach(stage: Stage, hinge: Hinge, root: Root) -> float:
    """Return how far one of the roots of a hinge reaches into its body, as `root_reaches` does."""
    if not _fills(root):
        return ROOT_REACH
    height = math.dist(*root.ends)
    for other in stage.hinges:
        if other.name == hinge.name or root.body not in other.bodies:
            continue
        around = hinge_root(stage, other, other.bodies.index(root.body))
        if not _fills(around):
            continue
        touching = min(math.dist(p, q) for p in root.edge for q in around.edge) <= TOLERANCE
        if hinge.profile.depth > 0.0 or other.profile.depth > 0.0:
            if touching:
                return 0.5 * math.dist(*around.edge) / height
            continue
        if touching:
            return _to_crossing(root, around) / height
        bend = _bend_length(stage.body(root.body), root, around)
        if bend is not None:
            return 0.5 * bend / height
    return ROOT_REACH


def _normal(root: Root) -> _Pair:
    """Return the direction of a hinge at its root, from body a to body b."""
    (ax, ay), (bx, by) = root.ends
    length = math.dist(*root.ends)
    return (by - ay) / length, (ax - bx) / length


def _to_crossing(root: Root, other: Root) -> float:
    """Return the distance of a root from where the middle lines of both cross [m]."""
    (ux, uy), (vx, vy) = _normal(root), _normal(other)
    (ax, ay), (bx, by) = root.ends
    (cx, cy), (dx, dy) = other.ends
    px, py = 0.5 * (cx + dx - ax - bx), 0.5 * (cy + dy - ay - by)
    return abs((px * vy - py * vx) / (ux * vy - uy * vx))


def _bend_length(body: Body, root: Root, other: Root) -> float | None:
    """Return the length of a body that continues around a bend as a strip [m]; None if it does not.

    The two long sides of a strip are as long together as twice its area over its thickness.
    """
    (ux, uy), (vx, vy) = _normal(root), _normal(other)
    (ax, ay), (bx, by) = root.ends
    (cx, cy), (dx, dy) = other.ends
    px, py = 0.5 * (cx + dx - ax - bx), 0.5 * (cy + dy - ay - by)
    straight = abs(ux * vy - uy * vx) < _STRAIGHT and abs(px * uy - py * ux) <= TOLERANCE
    if straight or body.holes or body.mounting_holes:
        return None
    thickness = 0.5 * (math.dist(*root.ends) + math.dist(*other.ends))
    length = abs(body.outline.integrals().area) / thickness
    sides = sum(Curve(*s).length for s in body.outline.segments()) - 2.0 * thickness
    uniform = abs(sides - 2.0 * length) <= _UNEVEN * sides
    return length if uniform and length <= _LONGEST * thickness else None


def _fills(root: Root) -> bool:
    """Return whether a root takes its whole edge."""
    return math.dist(*root.edge) <= math.dist(*root.ends) + 2.0 * TOLERANCE


# several hinges grow from a body
@lru_cache(maxsize=1024)
def _straight_edges(body: Body) -> list[tuple[_Pair, _Pair]]:
    """Return the straight edges of the outline and the holes, collinear neighbours joined."""
    loops = [body.outline, *(hole for hole in body.holes if isinstance(hole, Loop))]
    edges: list[tuple[_Pair, _Pair]] = []
    for loop in loops:
        run: list[tuple[_Pair, _Pair]] = []
        for start, end, bulge in loop.segments():
            if bulge or start == end:
                continue
            if run and run[-1][1] == start and _in_line(run[-1], end):
                run[-1] = (run[-1][0], end)
            else:
                run.append((start, end))
        # the first corner of a loop may lie within a straight side
        if len(run) > 1 and run[-1][1] == run[0][0] and _in_line(run[-1], run[0][1]):
            run[0] = (run.pop()[0], run[0][1])
        edges += run
    return edges


def _in_line(edge: tuple[_Pair, _Pair], onward: _Pair) -> bool:
    """Return whether an edge keeps its direction when it is continued to a point."""
    (x0, y0), (x1, y1) = edge
    ax, ay, bx, by = x1 - x0, y1 - y0, onward[0] - x1, onward[1] - y1
    # a corner that is off the chord by less than a nanometre is a rounding, not a corner
    chord = math.hypot(ax + bx, ay + by)
    return ax * bx + ay * by > 0.0 and abs(ax * by - ay * bx) <= 1e-9 * chord


def _contains(first: _Pair, second: _Pair, point: _Pair) -> bool:
    dx, dy = second[0] - first[0], second[1] - first[1]
    length = math.hypot(dx, dy)
    px, py = point[0] - first[0], point[1] - first[1]
    along, across = (px * dx + py * dy) / length, (dx * py - dy * px) / length
    return abs(across) <= TOLERANCE and -TOLERANCE <= along <= length + TOLERANCE


def half_notch(hinge: Hinge, which: int) -> Loop:
    """Return the outline of the half of a notch that belongs to one of its bodies.

    It is bounded by the neck, the two sides of the notch, and the root on the body.

    `which` is 0 for the half of body a, 1 for that of body b. It is exact where the profile is made
    of lines and arcs, and within 10 nm elsewhere.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=1e-3)
    >>> hinge = Hinge(name="h", bodies=("a", "b"), at=(0.0, 0.0), direction=0.0, profile=notch)
    >>> round(half_notch(hinge, 1).integrals().area * 1e6, 4)
    0.9292
    """
    return _from_neck(hinge, which, hinge.profile.contour())


def _from_neck(hinge: Hinge, which: int, contour: Sequence[Vertex]) -> Loop:
    """Return the outline between the neck and the end of a contour of one side.

    It runs along the left side from the neck to the end, across, and back on the right side.
    """
    (left, bent), (right, right_bent) = _both_sides(hinge, which, contour)
    bulges = (*bent, 0.0, *right_bent, 0.0)
    return Loop((*left, *right), bulges if any(bulges) else ())


def _both_sides(
    hinge: Hinge, which: int, contour: Sequence[Vertex]
) -> tuple[tuple[list[_Pair], list[float]], tuple[list[_Pair], list[float]]]:
    """Return points and bulges of the left side outward, then of the right one back."""
    half_neck = 0.5 * hinge.profile.neck_thickness
    side = (-1.0, 1.0)[which]
    left = [(side * v.x, half_neck + v.depth) for v in contour]
    bent = [side * v.bulge for v in contour[:-1]]
    if hinge.profile.one_sided:
        right = [(side * contour[-1].x, -half_neck), (side * contour[0].x, -half_neck)]
        right_bent = [0.0]
    else:
        right = [(x, -y) for x, y in reversed(left)]
        # mirrored and run backwards, an arc turns to the same side
        right_bent = bent[::-1]
    on_left, on_right = ([hinge.to_plane(*p) for p in points] for points in (left, right))
    return (on_left, bent), (on_right, right_bent)


_SAME = 1e-9  # two points are one [m]


def _split(contour: Sequence[Vertex], x: float) -> tuple[list[Vertex], list[Vertex]]:
    """Cut a contour at a distance from the neck; both parts hold the point of the cut."""
    for i, (a, b) in enumerate(itertools.pairwise(contour)):
        if not a.x <= x <= b.x or a.x == b.x:
            continue
        if x - a.x < _SAME or b.x - x < _SAME:
            k = i if x - a.x < _SAME else i + 1
            return list(contour[: k + 1]), list(contour[k:])
        if a.bulge == 0.0:
            depth = a.depth + (b.depth - a.depth) * (x - a.x) / (b.x - a.x)
            cut, before, after = (x, depth), 0.0, 0.0
        else:
            centre, radius, first, sweep = arc((a.x, a.depth), (b.x, b.depth), a.bulge)
            angle = math.acos((x - centre[0]) / radius)
            turns = [
                s
                for sign in (1.0, -1.0)
                for k in (-1, 0, 1)
                if 0.0 < (s := (sign * angle + 2.0 * math.pi * k - first) / sweep) < 1.0
            ]
            share = turns[0]
            y = centre[1] + radius * math.sin(first + share * sweep)
            cut = (x, y)
            before, after = math.tan(share * sweep / 4.0), math.tan((1.0 - share) * sweep / 4.0)
        inner = [*contour[:i], Vertex(a.x, a.depth, before), Vertex(*cut)]
        return inner, [Vertex(*cut, after), *contour[i + 1 :]]
    return [], list(contour)


def _sides(hinge: Hinge, share: float) -> tuple[list[Vertex], list[Vertex]]:
    """Contour of one side from the neck to the cut, and from the cut to the root."""
    contour = hinge.profile.contour()
    if share == 0.0:
        return [], list(contour)
    return _split(contour, share * contour[-1].x)


def _path(hinge: Hinge, which: int, outer: list[Vertex]) -> tuple[list[_Pair], list[float]]:
    """Return the outer part of a half notch, from the right end of the root to the left one.

    Right and left are those of the hinge's direction. Bulges belong to the segment that follows.
    """
    (left, bent), (right, right_bent) = _both_sides(hinge, which, outer)
    return [*right, *left], [*right_bent, 0.0, *bent]


def inner_notch(hinge: Hinge, which: int, share: float, start: float = 0.0) -> Loop:
    """Return the part of a half notch next to the neck.

    Where a notch ends tangent to the edge of its body, a region up to that end would have a cusp,
    which cannot be meshed; this one ends before.

    `which` is 0 for the half of body a, 1 for that of body b. It reaches a `share`, above 0 and
    at most 1, of the half length of the notch, and ends in a straight line across; so it begins, at
    the neck or at a share `start`.
    """
    inner, _ = _sides(hinge, share)
    if start:
        _, inner = _split(inner, start * hinge.profile.contour()[-1].x)
    return _from_neck(hinge, which, inner)


#: Part of a notch, from the neck on, that can be in plane strain [1]. The remainder belongs to its
#: body, unless that is of another material; it deforms little, and where a notch ends tangent to
#: the edge of the body, a region that ended there would have a cusp.
STRAINED = 0.8

# contours that are steeper meet the straight line of the root at less than 12 degrees
_STEEP = 5.0


@lru_cache(maxsize=1024)
def share_to_root(profile: Profile) -> float:
    """Return the part of a half notch, from the neck on, that a region of a mesh can have [1].

    It ends at the root, or before where the contour becomes almost parallel to the line of the
    root.

    Examples
    --------
    >>> from flexstage.hinges import Leaf, RightCircular
    >>> share_to_root(Leaf(neck_thickness=0.5e-3, leaf_length=8e-3, notch_depth=1e-3))
    1.0
    >>> round(share_to_root(RightCircular(neck_thickness=0.5e-3, radius=1e-3)), 4)
    0.9806
    """
    contour = profile.contour()
    end = contour[-1].x
    for a, b in itertools.pairwise(reversed(contour)):
        begin = _steep_from(b, a)
        if begin is None:
            break
        end = begin
        if begin > b.x:
            break
    return end / contour[-1].x


def short_halves(stage: Stage) -> dict[str, float]:
    """Return hinges whose half notches end early in finite elements, and the share they have [1].

    What remains up to the root is of their body, which is of another material than the plate or
    rigid.
    """
    others = {body.name for body in stage.other_bodies}
    shares = {h.name: share_to_root(h.profile) for h in stage.hinges if others & {*h.bodies}}
    return {name: share for name, share in shares.items() if share < STRAINED}


def has_sharp_root(stage: Stage, hinge: Hinge) -> bool:
    """Return whether a hinge ends in a corner without a radius, where it is thin.

    In linear elasticity the stress there has no bound. A step counts if it begins within half of
    the thickness of the neck; without a step, the contour of the bodies decides. A kink within a
    contour, as one as drawn can have, is not recognised.
    """
    profile = hinge.profile
    if profile.depth > 0.0:
        return 0.0 < profile.step >= profile.depth - 0.5 * profile.neck_thickness
    return _turns_out(stage, hinge, 0) or _turns_out(stage, hinge, 1)


def _turns_out(stage: Stage, hinge: Hinge, which: int) -> bool:
    """Return whether the contour turns outward where a hinge without a step ends."""
    root = hinge_root(stage, hinge, which)
    if not _fills(root):
        return True
    # another strip around a corner begins where this one ends
    others = (h for h in stage.hinges if h.name != hinge.name and root.body in h.bodies)
    around = [p for h in others for p in hinge_root(stage, h, h.bodies.index(root.body)).ends]
    if any(math.dist(p, q) <= TOLERANCE for p in root.ends for q in around):
        return True
    for end, other in (root.ends, root.ends[::-1]):
        ux, uy = Curve(other, end).direction(0.0)
        leaving = _leaving(stage.body(root.body), end)
        if any(x * ux + y * uy > _BLUNT for x, y in leaving):
            return True
    return False


def _leaving(body: Body, corner: _Pair) -> Iterator[_Pair]:
    """Yield the two directions in which the contour of a body leaves one of its corners."""
    for loop in (body.outline, *(hole for hole in body.holes if isinstance(hole, Loop))):
        for start, end, bulge in loop.segments():
            for curve in (Curve(start, end, bulge), Curve(end, start, -bulge)):
                if math.dist(curve.start, corner) <= TOLERANCE:
                    yield curve.direction(0.0)


def _steep_from(a: Vertex, b: Vertex) -> float | None:
    """Return from where on a segment is steep as far as its end; None where it is not."""
    if a.bulge == 0.0:
        return a.x if b.depth - a.depth > _STEEP * (b.x - a.x) else None
    centre, radius, first, sweep = arc((a.x, a.depth), (b.x, b.depth), a.bulge)

    def steep(share: float) -> bool:
        angle = first + share * sweep
        return abs(math.cos(angle)) > _STEEP * abs(math.sin(angle))

    if not steep(1.0 - 1e-9):
        return None
    turn = math.atan(1.0 / _STEEP)
    shares = [
        (k * math.pi + sign * turn - first) / sweep for k in range(-3, 4) for sign in (-1.0, 1.0)
    ]
    begin = max((s for s in shares if 0.0 < s < 1.0), default=0.0)
    return centre[0] + radius * math.cos(first + begin * sweep) if begin else a.x


def body_contour(
    stage: Stage, body: Body, share: float | Callable[[Hinge, int], float] = 0.0
) -> tuple[Loop, tuple[Loop | Circle, ...]]:
    """Return a body as cut: its outline and holes with its half notches added.

    `share` is the part of each half notch, from the neck on, that is omitted [1], of all or for a
    hinge and its side.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> stage = design("parallelogram")
    >>> outline, _ = body_contour(stage, stage.body("left-leg"))
    >>> round(outline.integrals().area * 1e6, 3)
    122.434
    """
    loops: list[Loop | Circle] = [body.outline, *body.holes]
    for hinge in stage.hinges:
        for which in (0, 1):
            if hinge.bodies[which] != body.name:
                continue
            omitted = share if isinstance(share, int | float) else share(hinge, which)
            _, outer = _sides(hinge, omitted)
            points, bulges = _path(hinge, which, outer)
            ends = root_line(hinge, which)
            for i, loop in enumerate(loops):
                grown = None if isinstance(loop, Circle) else _grow(loop, ends, points, bulges)
                if grown is not None:
                    loops[i] = grown
                    break
            else:
                raise StageError(
                    f"hinge '{hinge.name}' is not attached to one straight edge of body "
                    f"'{body.name}': run 'flexstage check'"
                )
    outline = loops[0]
    assert isinstance(outline, Loop)
    return outline, tuple(loops[1:])


def _grow(
    loop: Loop, root: tuple[_Pair, _Pair], points: list[_Pair], bulges: list[float]
) -> Loop | None:
    """Replace the part of a loop between the ends of a root by a path."""
    segments = loop.segments()
    first = _segment_at(segments, root[0], root[1])
    last = _segment_at(segments, root[1], root[0])
    if first is None or last is None:
        return None
    a, b, _ = segments[first]
    run = (root[1][0] - root[0][0]) * (b[0] - a[0]) + (root[1][1] - root[0][1]) * (b[1] - a[1])
    if run < 0.0:  # the loop runs along the root the other way
        first, last = last, first
        points = points[::-1]
        bulges = [-v for v in reversed(bulges)]
    out: list[_Pair] = []
    bent: list[float] = []

    def step(point: _Pair, bulge: float) -> None:
        if out and math.dist(out[-1], point) < _SAME:
            out[-1], bent[-1] = point, bulge
        else:
            out.append(point)
            bent.append(bulge)

    step(segments[first][0], 0.0)
    for point, bulge in zip(points, [*bulges, 0.0], strict=True):
        step(point, bulge)
    n = len(segments)
    k = (last + 1) % n
    while k != first:
        step(segments[k][0], segments[k][2])
        k = (k + 1) % n
    if math.dist(out[-1], out[0]) < _SAME:
        out.pop()
        bent.pop()
    return Loop(tuple(out), tuple(bent) if any(bent) else ())


def _segment_at(segments: list[tuple[_Pair, _Pair, float]], end: _Pair, other: _Pair) -> int | None:
    """Find the straight segment on which one end of a root lies and along which the root runs."""
    for i, (a, b, bulge) in enumerate(segments):
        length = math.dist(a, b)
        if bulge or length < _SAME:
            continue
        along, aside, (ux, uy) = line_coordinates(end, a, b)
        if abs(aside) > TOLERANCE or not -TOLERANCE <= along <= length + TOLERANCE:
            continue
        towards = (other[0] - end[0]) * ux + (other[1] - end[1]) * uy
        across = (other[1] - end[1]) * ux - (other[0] - end[0]) * uy
        room = length - along if towards > 0.0 else along
        if abs(across) <= TOLERANCE and room > TOLERANCE:
            return i
    return None
