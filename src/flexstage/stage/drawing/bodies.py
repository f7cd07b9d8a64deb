"""Bodies: what is left of a part when its notches are taken out."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from flexstage.errors import StageError
from flexstage.stage.curve import Curve
from flexstage.stage.drawing.contours import DrawnContour, DrawnPart
from flexstage.stage.drawing.profiles import Neck
from flexstage.stage.drawing.strokes import SAME, Pair, rounded
from flexstage.stage.outline import Circle, Loop
from flexstage.stage.shapes import CHORD


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnBody:
    """A body of a drawing."""

    outline: Loop
    """Its outline, without the notches."""
    holes: tuple[Loop | Circle, ...]
    """Openings in it."""
    holes_layers: tuple[str, ...]
    """The layer of each opening."""
    roots: tuple[tuple[int, int], ...]
    """The necks that grow from it, each with 0 where it is their body a, 1 where their body b."""


class _Cut(NamedTuple):
    """An end of a root on a contour."""

    stroke: int
    share: float
    point: Pair
    root: tuple[int, int]  # number of the neck, and 0 or 1 for its body
    left: bool
    outward: bool  # whether the contour leaves the notch here


def bodies_of(part: DrawnPart, necks: Sequence[Neck]) -> list[DrawnBody]:
    """Take the notches out of a part and close what is left by straight lines across the roots."""
    cuts = _cuts(part, necks)
    chains: dict[tuple[int, int, bool], tuple[list[Curve], _Cut]] = {}
    loose: list[DrawnContour] = []
    for k, contour in enumerate(part.contours):
        own = sorted(cuts.get(k, []), key=lambda c: (c.stroke, c.share))
        if not own:
            loose.append(contour)
            continue
        for n, cut in enumerate(own):
            following = own[(n + 1) % len(own)]
            if cut.outward == following.outward:
                raise StageError(
                    f"two notches overlap about {part.place(following.point)}: the drawing cannot "
                    "be taken apart there; give --contours neck_limit=LENGTH, the thickest neck "
                    "that counts"
                )
            if cut.outward:
                chains[(*cut.root, cut.left)] = (_between(contour, cut, following), following)
    loops: list[tuple[list[Curve], list[tuple[int, int]]]] = []
    while chains:
        start = next(iter(chains))
        key, curves, roots = start, [], []
        while key in chains:
            found, end = chains.pop(key)
            curves += found
            # straight across the root, to where the contour leaves on its other side
            key = (*end.root, not end.left)
            roots.append(end.root)
            across = chains.get(key) if key != start else (curves,)
            if across is None:
                raise StageError(
                    f"the contours about {part.place(end.point)} do not close to a body"
                )
            curves.append(Curve(curves[-1].end, across[0][0].start))
        loops.append((curves, roots))
    return _gathered(part, loops, loose)


def _cuts(part: DrawnPart, necks: Sequence[Neck]) -> dict[int, list[_Cut]]:
    """Find the four ends of the roots of each neck on the contours."""
    found: dict[int, list[_Cut]] = {}
    for n, neck in enumerate(necks):
        profile = neck.profile
        half, top = 0.5 * profile.length, 0.5 * profile.neck_thickness
        for left in (False, True):
            deep = 0.0 if profile.one_sided and not left else profile.depth
            place = neck.sides.left if left else neck.sides.right
            for which, ahead in ((0, False), (1, True)):
                x, y = neck.frame.plane(
                    half if ahead else -half, (top + deep) * (1.0 if left else -1.0)
                )
                point = (rounded(x), rounded(y))
                stroke, share = _find(part, neck, left, ahead, point)
                # the right side runs from body a to b, the left one back
                outward = ahead != left
                cut = _Cut(stroke, share, point, (n, which), left, outward)
                found.setdefault(place.contour, []).append(cut)
    return found


def _find(part: DrawnPart, neck: Neck, left: bool, ahead: bool, point: Pair) -> tuple[int, float]:
    """Find a point on a side, outward from the neck."""
    place = neck.sides.left if left else neck.sides.right
    strokes = part.contours[place.contour].strokes
    count = len(strokes)
    forward = ahead != left
    for k in range(count):
        n = (place.stroke + (k if forward else -k)) % count
        curve = strokes[n].curve
        share = _nearest(curve, point)
        if math.dist(curve.point(share), point) < 2.0 * part.tolerance + neck.off:
            return n, share
    raise StageError(
        f"the neck about {part.place(neck.frame.at)} has no straight root at {part.place(point)}"
    )


def _nearest(curve: Curve, point: Pair) -> float:
    """Return the share of a curve that is nearest to a point."""
    share = curve.share(point)
    if share is None:
        near_start = math.dist(point, curve.start) < math.dist(point, curve.end)
        return 0.0 if near_start else 1.0
    return share


def _between(contour: DrawnContour, first: _Cut, last: _Cut) -> list[Curve]:
    """Return the pieces of a contour between two cuts, which end at the points of the cuts."""
    curves = [s.curve for s in contour.strokes]
    count = len(curves)
    if first.stroke == last.stroke and first.share <= last.share:
        out = [curves[first.stroke].part(first.share, last.share)]
    else:
        steps = (last.stroke - first.stroke - 1) % count
        out = [curves[first.stroke].part(first.share, 1.0)]
        out += [curves[(first.stroke + 1 + k) % count] for k in range(steps)]
        out.append(curves[last.stroke].part(0.0, last.share))
    out = [c for c in out if c.length > SAME]
    if not out:
        return [Curve(first.point, last.point)]
    out[0] = Curve(first.point, out[0].end, out[0].bulge)
    out[-1] = Curve(out[-1].start, last.point, out[-1].bulge)
    return out


def _gathered(
    part: DrawnPart,
    loops: list[tuple[list[Curve], list[tuple[int, int]]]],
    loose: list[DrawnContour],
) -> list[DrawnBody]:
    """Tell outlines from openings, and give each opening to the body that it is in."""
    from shapely import Polygon

    slack = max(SAME, 4.0 * part.rounding)
    outer: list[tuple[Loop, Any, list[tuple[int, int]]]] = []
    inner: list[tuple[Loop | Circle, Any, list[tuple[int, int]], str]] = []
    for curves, roots in loops:
        loop = _loop(curves, slack)
        ring = Polygon(loop.polyline(CHORD))
        if ring.exterior.is_ccw:
            outer.append((loop, ring, roots))
        else:
            inner.append((loop, ring, roots, ""))
    for contour in loose:
        loop = contour.loop
        ring = Polygon(loop.polyline(CHORD))
        if contour is part.outline:
            outer.append((_loop([s.curve for s in contour.strokes], slack), ring, []))
        else:
            shape = contour.circle or _loop([s.curve for s in contour.strokes], slack)
            inner.append((shape, ring, [], contour.layer))
    outer.sort(key=lambda o: o[1].area)
    owned: list[list[tuple[Loop | Circle, str]]] = [[] for _ in outer]
    roots_of = [list(roots) for *_, roots in outer]
    for shape, ring, roots, layer in inner:
        # a point beside the opening, on the material; the smallest outline round it is its body
        inside = ring.representative_point()
        holder = next(
            (
                k
                for k, (_, out, _) in enumerate(outer)
                if out.area > ring.area and out.contains(inside)
            ),
            None,
        )
        if holder is None:
            raise StageError(
                f"the opening about {part.place(inside.coords[0])} lies in no body: the drawing "
                "cannot be taken apart there; give --contours neck_limit=LENGTH, the thickest neck "
                "that counts"
            )
        owned[holder].append((shape, layer))
        roots_of[holder] += roots
    return [
        DrawnBody(
            outline=loop,
            holes=tuple(shape for shape, _ in owned[k]),
            holes_layers=tuple(layer for _, layer in owned[k]),
            roots=tuple(roots_of[k]),
        )
        for k, (loop, _, _) in enumerate(outer)
    ]


def _loop(curves: list[Curve], slack: float) -> Loop:
    """Return a loop, without corners that are none."""
    kept = [c for c in curves if c.length > SAME]
    points = [(rounded(c.start[0]), rounded(c.start[1])) for c in kept]
    bulges = [c.bulge for c in kept]
    k = 0
    while k < len(points) and len(points) > 3:
        before, here, after = points[k - 1], points[k], points[(k + 1) % len(points)]
        ax, ay = here[0] - before[0], here[1] - before[1]
        bx, by = after[0] - here[0], after[1] - here[1]
        off = abs(ax * by - ay * bx) / math.hypot(ax + bx, ay + by)
        if not bulges[k - 1] and not bulges[k] and off < slack and ax * bx + ay * by > 0.0:
            del points[k], bulges[k]
            k = max(0, k - 1)
        else:
            k += 1
    return Loop(tuple(points), tuple(bulges) if any(bulges) else ())
