"""The necks among the thin places of a part, and the bodies between them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from flexstage.base.errors import StageError
from flexstage.stage.curve import Curve
from flexstage.stage.drawing.contours import DrawnContour, DrawnPart
from flexstage.stage.drawing.profiles import Neck, neck_of, parted
from flexstage.stage.drawing.strips import strips_of
from flexstage.stage.drawing.strokes import SAME, Pair, rounded
from flexstage.stage.drawing.thickness import Pass, Relief, relief
from flexstage.stage.outline import Circle, Loop
from flexstage.stage.shapes import CHORD

#: Least ratio of the thickness of the thinner body to that of a neck, unless a limit is given.
LEAST_RATIO = 1.5
#: The same above the gap in thickness, where a neck counts only if its profile is a notch.
CLEAR_RATIO = 2.0


def find_necks(
    part: DrawnPart, limit: float | None = None
) -> tuple[list[Neck], tuple[float, float] | None]:
    """Return the necks of a part, and the gap in thickness above them.

    These are the thicknesses of the thickest neck and of the thinnest other place [m]; None where
    all thin places are necks.

    All places thinner than `limit` are necks [m]; where none is given, those below the widest gap
    in the thicknesses of all thin places, and above it those whose sides are a notch by its own
    lines and arcs.
    """
    thin_places = relief(part)
    passes = _select_necks(part, thin_places, limit)
    necks: list[Neck] = []
    for each in passes:
        strips = strips_of(part, each, limit)
        if len(strips) > 1:
            necks += _others(strips, necks)
            continue
        neck = neck_of(part, each) or (strips[0] if strips else None)
        if neck is None:
            x, y = each.sides[0].at
            raise StageError(
                f"the neck about {part.place((x, y))}, {each.thickness * 1e3:.4g} mm thick, "
                "matches no hinge profile: both halves must be equal, and both sides equal or "
                "one of them straight, or parallel over more than twice the thickness; correct "
                "the drawing there, or exclude the neck by --contours neck_limit=LENGTH below its "
                "thickness"
            )
        necks += _others([neck], necks)
    if not necks and limit is not None and thin_places.passes:
        thinnest = min(p.thickness for p in thin_places.passes)
        raise StageError(
            f"the drawing contains no neck below neck_limit, {limit * 1e3:.4g} mm: its thinnest "
            f"place is {thinnest * 1e3:.4g} mm thick; give a limit above that"
        )
    if not necks:
        raise StageError(
            "the drawing contains no neck: no place of the part is much thinner than the "
            "material on both sides; give --contours neck_limit=LENGTH, the thickest neck that "
            "counts"
        )
    thickest = max(n.profile.neck_thickness for n in necks)
    others = [p.thickness for p in thin_places.passes if p not in passes and p.thickness > thickest]
    return parted(necks), (thickest, min(others)) if others else None


def _others(candidates: Sequence[Neck], necks: Sequence[Neck]) -> list[Neck]:
    """Return candidates without those that are known from another thin place."""
    known = {_lines(n) for n in necks} - {None}
    return [n for n in candidates if _lines(n) not in known]


def _lines(neck: Neck) -> frozenset[tuple[int, int]] | None:
    """Return contour and piece of both sides, two lines, which face each other once at most.

    It is None where a side is no line.
    """
    strokes = (neck.sides.stroke(left) for left in (False, True))
    if any(s.curve.bulge or s.trace for s in strokes):
        return None
    return frozenset((p.contour, p.stroke) for p in (neck.sides.right, neck.sides.left))


def _select_necks(part: DrawnPart, thin_places: Relief, limit: float | None) -> list[Pass]:
    """Select the passes that are necks."""
    by_size = sorted(thin_places.passes, key=lambda p: p.thickness)
    if limit is not None:
        return _separating([p for p in by_size if p.thickness <= 1.05 * limit], thin_places)
    clear = [p for p in by_size if p.ratio >= LEAST_RATIO]
    if not clear:
        return []
    # the widest gap, on a scale of ratios; beyond the last one lies the thinnest body
    sizes = [p.thickness for p in clear]
    beyond = max(sizes[-1], min(thin_places.heights[h] for p in clear for h in p.hills))
    steps = [b / a for a, b in zip(sizes, [*sizes[1:], beyond], strict=True)]
    cut = sizes[max(range(len(steps)), key=lambda k: steps[k])]
    below = [p for p in clear if p.thickness <= cut]
    above = [p for p in clear if p.thickness > cut and p.ratio >= CLEAR_RATIO]
    return _separating([*below, *(p for p in above if _is_notch(part, p))], thin_places)


def _is_notch(part: DrawnPart, thin_place: Pass) -> bool:
    neck = neck_of(part, thin_place)
    if neck is None or neck.profile.kind in ("as-drawn", "leaf"):
        return False
    # a wall next to a pocket with round corners has two fillets and a straight side as well
    return not (neck.profile.one_sided and neck.profile.flat_length > 0.0)


def _separating(passes: list[Pass], thin_places: Relief) -> list[Pass]:
    """Exclude the passes within one body."""
    hill = {k: k for k in thin_places.heights}

    def root(k: int) -> int:
        while hill[k] != k:
            k = hill[k]
        return k

    for other in thin_places.passes:
        if other not in passes:
            a, b = (root(h) for h in other.hills)
            hill[a] = b
    return [p for p in passes if root(p.hills[0]) != root(p.hills[1])]


def certainty(neck: Neck, gap: tuple[float, float] | None) -> str:
    """Return the certainty of a neck: ``sure``, ``likely`` or ``doubtful``."""
    wide = gap is None or gap[1] >= 2.0 * gap[0] or neck.profile.neck_thickness < 0.5 * gap[1]
    as_drawn = neck.profile.kind == "as-drawn"
    if neck.thin_place.ratio >= CLEAR_RATIO and wide and not as_drawn:
        return "sure"
    return (
        "likely" if neck.thin_place.ratio >= LEAST_RATIO and (wide or not as_drawn) else "doubtful"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnBody:
    """A body of a drawing."""

    outline: Loop
    """Outline, without the notches."""
    holes: tuple[Loop | Circle, ...]
    """Openings in it."""
    holes_layers: tuple[str, ...]
    """The layer of each opening."""
    roots: tuple[tuple[int, int], ...]
    """The necks attached to it, each with 0 where it is their body a, 1 where their body b."""


class _Cut(NamedTuple):
    """An end of a root on a contour."""

    stroke: int
    share: float
    point: Pair
    root: tuple[int, int]  # number of the neck, and 0 or 1 for its body
    left: bool
    outward: bool  # whether the contour leaves the notch here


def bodies_of(part: DrawnPart, necks: Sequence[Neck]) -> list[DrawnBody]:
    """Remove the notches from a part and close its bodies by straight lines across the roots."""
    cuts = _cuts(part, necks)
    chains: dict[tuple[int, int, bool], tuple[list[Curve], _Cut]] = {}
    loose: list[DrawnContour] = []
    for k, contour in enumerate(part.contours):
        body_cuts = sorted(cuts.get(k, []), key=lambda c: (c.stroke, c.share))
        if not body_cuts:
            loose.append(contour)
            continue
        for n, cut in enumerate(body_cuts):
            following = body_cuts[(n + 1) % len(body_cuts)]
            if cut.outward == following.outward:
                raise StageError(
                    f"two notches overlap about {part.place(following.point)}, so the drawing "
                    "cannot be divided into bodies: give --contours neck_limit=LENGTH, the "
                    "thickest neck that counts"
                )
            if cut.outward:
                chains[(*cut.root, cut.left)] = (_between(contour, cut, following), following)
    loops: list[tuple[list[Curve], list[tuple[int, int]]]] = []
    while chains:
        start = next(iter(chains))
        key, curves, roots = start, [], []
        while key in chains:
            chain, end = chains.pop(key)
            curves += chain
            # straight across the root, to where the contour leaves on its other side
            key = (*end.root, not end.left)
            roots.append(end.root)
            across = chains.get(key) if key != start else (curves,)
            if across is None:
                raise StageError(
                    f"the contours about {part.place(end.point)} do not enclose a body"
                )
            curves.append(Curve(curves[-1].end, across[0][0].start))
        loops.append((curves, roots))
    return _gathered(part, loops, loose)


def _cuts(part: DrawnPart, necks: Sequence[Neck]) -> dict[int, list[_Cut]]:
    """Find the four ends of the roots of each neck on the contours."""
    cuts: dict[int, list[_Cut]] = {}
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
                cuts.setdefault(place.contour, []).append(cut)
    return cuts


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
        f"the neck about {part.place(neck.frame.at)} is not attached to a straight edge at "
        f"{part.place(point)}"
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
    """Separate outlines from openings, and assign each opening to its body."""
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
        # a point next to the opening, on the material; the smallest outline around it is its body
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
                f"the opening about {part.place(inside.coords[0])} is in no body, so the drawing "
                "cannot be divided into bodies: give --contours neck_limit=LENGTH, the thickest "
                "neck that counts"
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
    """Return a loop without redundant corners."""
    pieces = [c for c in curves if c.length > SAME]
    points = [(rounded(c.start[0]), rounded(c.start[1])) for c in pieces]
    bulges = [c.bulge for c in pieces]
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
