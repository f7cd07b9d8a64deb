"""Where the wire is threaded, how it is led to its path, and in which order contours are cut."""

import math
from dataclasses import dataclass
from typing import Any

from flexstage.errors import StageError
from flexstage.export.drawing.contours import Contour, Pair, PlateContours
from flexstage.export.drawing.offset import WirePath
from flexstage.stage.curve import Curve, distance, point_distance

#: The rule by which `cuts` orders contours, in words.
CUT_ORDER_RULE = (
    "openings without notches first, then slots from the middle of the plate outwards, "
    "the outline last"
)

# where the wire enters for the outline: this far outside, in radii of the start hole
_OUTSIDE = 4.0
_CHORD = 2e-6  # how near polygons come to contours where only a good place is looked for [m]
_AWAY = 6e-3  # beyond this distance from a neck, more room is better than more distance [m]
_MARGIN = 1e-6  # how much further than it must the wire stays away on its way to the path [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """One contour as it is cut."""

    number: int
    """Its place in the order, from 1."""
    path: WirePath
    """The path of the wire."""
    start: Pair
    """Centre of the start hole [m]."""
    entry: Pair
    """Where the wire comes upon its path, on a straight line from the start hole [m]."""


def cuts(
    contours: PlateContours, paths: tuple[WirePath, ...], offset: float, start_hole: float
) -> tuple[Cut, ...]:
    """Place start holes and lead-in lines, and number the cuts by `CUT_ORDER_RULE`.

    `paths` are those of `offset_contours` along the outline and the slots, `offset` half of the
    width of the cut and `start_hole` the diameter [m].

    The start hole of a slot lies away from necks as far as the slot has room for it, that of the
    outline outside of its longest straight edge. The lead-in goes straight to the nearest place of
    the path that does not lie on a notch, where it would leave a mark.
    """
    if not 2.0 * offset <= start_hole < math.inf:
        raise StageError(
            f"the start hole must be at least as wide as the cut, {2e3 * offset:.6g} mm, got "
            f"{start_hole * 1e3:.6g} mm"
        )
    sides = [Curve(*s) for c in contours.contours for s in c.loop.segments()]
    middle = _middle(contours.outline)
    found = []
    for path in paths:
        radius = 0.5 * start_hole
        if path.contour.kind == "outline":
            start = _outside(path.contour, sides, _OUTSIDE * radius + offset)
        else:
            start = _inside(path.contour, contours, radius)
        found.append((path, start, _entry(path, start, sides, offset)))
    # to a micrometre, so that symmetric slots do not change places by rounding
    found.sort(key=lambda item: _rank(item[0].contour, item[1], middle))
    return tuple(
        Cut(number=k, path=path, start=start, entry=entry)
        for k, (path, start, entry) in enumerate(found, start=1)
    )


def _rank(contour: Contour, start: Pair, middle: Pair) -> tuple[float, ...]:
    group = 2 if contour.kind == "outline" else int(any(contour.hinges))
    um = (math.dist(start, middle), start[1], start[0])
    return (group, *(round(v * 1e6) for v in um))


def _middle(contour: Contour) -> Pair:
    a = contour.loop.integrals()
    return a.x / a.area, a.y / a.area


def _inside(contour: Contour, contours: PlateContours, radius: float) -> Pair:
    """Find a place in a slot with room for a start hole, away from necks if there is one."""
    if contour.circle is not None:
        places = [(contour.circle.radius, contour.circle.centre)]
    else:
        places = _places(contour, radius)
    if max(places)[0] <= radius:
        room, (x, y) = max(places)
        raise StageError(
            f"a start hole of {2e3 * radius:.6g} mm does not fit into the slot by body "
            f"'{contour.bodies[0]}' about ({x * 1e3:.6g}, {y * 1e3:.6g}) mm: there is room for "
            f"{2e3 * room:.4g} mm; use a smaller start hole"
        )
    own = {name for name in contour.hinges if name is not None}
    necks = [p for n in contours.necks if n.hinge in own for p in (n.right, n.left)]

    def merit(place: tuple[float, Pair]) -> tuple[float, ...]:
        room, p = place
        away = min((math.dist(p, q) for q in necks), default=0.0)
        # to micrometres, so that rounding does not choose between places that are as good
        return tuple(round(v * 1e6) for v in (min(away, _AWAY), room, -p[1], -p[0]))

    return max((p for p in places if p[0] > radius), key=merit)[1]


def _places(contour: Contour, radius: float) -> list[tuple[float, Pair]]:
    """Return places in a slot where a start hole may fit, each with the room about it."""
    import shapely

    slot: Any = shapely.Polygon(contour.loop.polyline(_CHORD))
    found = [shapely.maximum_inscribed_circle(slot, tolerance=5e-6).coords[0]]
    # somewhat inside of where it just fits
    roomy = slot.buffer(-1.2 * radius)
    for part in getattr(roomy, "geoms", [roomy]):
        if not part.is_empty:
            found += shapely.segmentize(part.exterior, 0.5e-3).coords[:-1]
            found.append(shapely.maximum_inscribed_circle(part, tolerance=5e-6).coords[0])
    # a polygon stands outside of the slot where its arcs bulge into it
    rooms = shapely.distance(slot.exterior, shapely.points(found)) - _CHORD
    return [(float(r), (float(x), float(y))) for r, (x, y) in zip(rooms, found, strict=True)]


def _outside(contour: Contour, sides: list[Curve], apart: float) -> Pair:
    """Find a place outside of the outline, beside the longest straight edge without a notch."""
    edges = [
        Curve(*s)
        for s, hinge in zip(contour.loop.segments(), contour.hinges, strict=True)
        if hinge is None and not s[2]
    ] or [Curve(*s) for s in contour.loop.segments()]
    for edge in sorted(edges, key=lambda e: -round(e.length * 1e9)):
        # off the middle, where a dimension or a probe may be in the way
        point = edge.shifted(apart).point(0.25)
        if min(point_distance(point, s) for s in sides) > 0.99 * apart:
            return point
    raise StageError(
        f"no edge of the outline has {apart * 1e3:.3g} mm of room in front of it for a start hole: "
        "use a smaller one"
    )


def _entry(path: WirePath, start: Pair, sides: list[Curve], offset: float) -> Pair:
    """Find the nearest place of a path that the wire can reach straight from its start."""
    notches = [
        Curve(*s)
        for s, hinge in zip(path.contour.loop.segments(), path.contour.hinges, strict=True)
        if hinge is not None
    ]
    candidates = []
    for segment in path.loop.segments():
        curve = Curve(*segment)
        foot = _foot(curve, start)
        for share in (foot, 0.5, 0.25, 0.75, 0.1, 0.9):
            if share is not None:
                point = curve.point(share)
                # square on to the path, if the wire can
                candidates.append((share != foot, math.dist(point, start), point))
    candidates.sort()
    for beside_notches in (True, False):
        for *_, point in candidates:
            lead = Curve(start, point)
            near = offset + _MARGIN
            if beside_notches and any(point_distance(point, n) < near for n in notches):
                continue
            if all(distance(lead, s) > offset - 1e-9 for s in sides):
                return point
    raise StageError(
        f"no straight way leads from the start hole at ({start[0] * 1e3:.6g}, "
        f"{start[1] * 1e3:.6g}) mm to the path of the wire: use a smaller cut"
    )


def _foot(curve: Curve, p: Pair) -> float | None:
    """Where a curve is square to the way from a point."""
    if not curve.bulge:
        ux, uy = curve.direction(0.0)
        along = (p[0] - curve.start[0]) * ux + (p[1] - curve.start[1]) * uy
        share = along / curve.length
        return share if 0.0 < share < 1.0 else None
    return curve.share(p)
