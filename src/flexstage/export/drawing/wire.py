"""Wire cutting: path of the wire centre, start holes, and cutting order."""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexstage.base.errors import StageError
from flexstage.export.drawing.contours import Contour, Pair, PlateContours, clockwise
from flexstage.stage import Circle, Loop
from flexstage.stage.curve import Curve, crossings, distance, point_distance

_SAME = 1e-12  # distance of identical points [m]
# Largest undercut of a contour, or excess material on a neck [m]; rounding is a millionth of it.
_GOUGE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class WirePath:
    """Path of the wire centre along one contour."""

    contour: Contour
    """The contour."""
    loop: Loop
    """Path in the direction of the contour, with the material on its left."""
    circle: Circle | None = None
    """Path of a circular contour."""


def offset_contours(contours: PlateContours, distance: float) -> tuple[WirePath, ...]:
    """Return the path of the wire centre along the outline and every slot, in order.

    The distance [m] is half of the kerf: half the wire diameter plus the spark gap. Mounting holes
    are drilled, and have no path.

    Each contour is offset into the waste; lines remain lines and arcs remain arcs. Around an
    external corner the wire moves on an arc, which leaves the corner sharp; an internal corner gets
    a fillet with half the kerf as radius.

    Notes
    -----
    Validity: the path is checked. It is nowhere closer to a contour than `distance`, and passes
    both ends of every neck at that distance, within 1 nm.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.export.drawing.contours import plate_contours
    >>> plate = plate_contours(design("parallelogram"))
    >>> outline, slot = offset_contours(plate, 0.15e-3)
    >>> round((plate.slots[0].area - slot.loop.integrals().area) * 1e6, 3)
    22.149
    """
    cut = (contours.outline, *contours.slots)
    paths = tuple(_path(c, distance) for c in cut)
    sides = [Curve(*s) for c in contours.contours for s in c.loop.segments()]
    for path in paths:
        _require_clear(path, sides, distance)
    _require_necks(contours, paths, distance)
    return paths


def _path(contour: Contour, d: float) -> WirePath:
    if contour.circle is not None:
        radius = contour.circle.radius - d
        if radius < _GOUGE:
            raise _too_wide(contour, 0, contour.circle.radius, d)
        circle = Circle(contour.circle.centre, radius)
        return WirePath(contour=contour, loop=clockwise(circle), circle=circle)
    pieces: list[Curve] = []
    corners: list[Pair] = []  # vertex of the contour at the start of each piece
    for i, segment in enumerate(contour.loop.segments()):
        curve = Curve(*segment)
        if curve.bulge < 0.0 and -curve.radius - d < _GOUGE:
            raise _too_wide(contour, i, -curve.radius, d)
        pieces.append(curve.shifted(d))
        corners.append(curve.start)
    joined = _trimmed(contour, _rounded(pieces, corners, d), d)
    if len(joined) == 2 and not any(c.bulge for c in joined):
        # a slot of the width of the kerf, forward and back: a loop needs three points
        joined = [joined[0].part(0.0, 0.5), joined[0].part(0.5, 1.0), joined[1]]
    points = tuple(c.start for c in joined)
    return WirePath(contour=contour, loop=Loop(points, tuple(c.bulge for c in joined)))


def _too_wide(contour: Contour, i: int, radius: float, d: float) -> StageError:
    x, y = Curve(*contour.loop.segments()[i]).point(0.5)
    hinge = contour.hinges[i]
    what = f"the notch of hinge '{hinge}'" if hinge else f"an edge of body '{contour.bodies[i]}'"
    return StageError(
        f"a kerf of {2e3 * d:.6g} mm does not fit into {what}, which has a radius of "
        f"{radius * 1e3:.6g} mm at ({x * 1e3:.6g}, {y * 1e3:.6g}) mm: use a wire with a "
        f"kerf below {2e3 * radius:.6g} mm, or a larger radius"
    )


def _turn(a: Curve, b: Curve) -> float:
    """Return the angle by which b turns left at the end of a [rad]."""
    (ux, uy), (vx, vy) = a.direction(1.0), b.direction(0.0)
    return math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)


def _rounded(pieces: list[Curve], corners: list[Pair], d: float) -> list[Curve]:
    """Return the pieces with an arc around each external corner."""
    out: list[Curve] = []
    for k, piece in enumerate(pieces):
        before = pieces[k - 1]
        gap = math.dist(before.end, piece.start)
        if gap > _SAME and (turn := _turn(before, piece)) > 0.0:
            # from the angle, not the chord: both ends are at the same distance from the corner
            out.append(Curve(before.end, piece.start, math.tan(0.25 * turn)))
        out.append(piece)
    return out


def _trimmed(contour: Contour, pieces: list[Curve], d: float) -> list[Curve]:
    """Trim neighbours to their crossings, and remove pieces without length."""
    chain = list(pieces)
    k = 0
    clean = 0  # junctions in a row that are in order
    while clean <= len(chain):
        k %= len(chain)
        a, b = chain[k - 1], chain[k]
        if math.dist(a.end, b.start) <= _SAME:
            clean, k = clean + 1, k + 1
            continue
        clean = 0
        meeting = _meeting(a, b)
        if meeting is not None:
            a, b = a.part(0.0, meeting[0]), b.part(meeting[1], 1.0)
            chain[k - 1], chain[k] = a, b._replace(start=a.end)
            chain = [c for c in chain if c.length > _SAME]
            continue
        if math.dist(a.end, b.start) < _GOUGE and abs(_turn(a, b)) < 1e-3:
            chain[k] = b._replace(start=a.end)  # tangent, parted by rounding
            continue
        drop = _hidden(chain, k)
        if drop is None or len(chain) <= 3:
            x, y = a.end
            raise _narrow(contour, (x, y), d)
        del chain[drop]
    return chain


def _meeting(a: Curve, b: Curve) -> tuple[float, float] | None:
    """Return the crossing of a and b that keeps most of both."""
    common_points = crossings(a, b)
    if not common_points:
        return None
    return min(common_points, key=lambda st: (1.0 - st[0]) * a.length + st[1] * b.length)


def _hidden(chain: list[Curve], k: int) -> int | None:
    """Return which of two neighbours without crossing is out of reach of the wire."""
    n = len(chain)
    a, b, before, after = chain[k - 1], chain[k], chain[k - 2], chain[(k + 1) % n]
    options = []
    if _meeting(before, b) is not None:
        options.append((a.length, (k - 1) % n))
    if _meeting(a, after) is not None:
        options.append((b.length, k))
    return min(options)[1] if options else None


def _narrow(contour: Contour, p: Pair, d: float) -> StageError:
    body = min(
        zip(contour.bodies, contour.loop.segments(), strict=True),
        key=lambda item: point_distance(p, Curve(*item[1])),
    )[0]
    return StageError(
        f"a kerf of {2e3 * d:.6g} mm does not fit between the edges at ({p[0] * 1e3:.6g}, "
        f"{p[1] * 1e3:.6g}) mm, near body '{body}': use a thinner wire, or widen the slot there"
    )


def _boxes(curves: list[Curve]) -> np.ndarray:
    """Return the bounds of curves, shape (n, 4); for arcs, of a square around them."""
    ends = np.array([[*c.start, *c.end] for c in curves])
    low = np.minimum(ends[:, :2], ends[:, 2:])
    high = np.maximum(ends[:, :2], ends[:, 2:])
    # the height of an arc over its chord is bulge times half the chord, beyond its ends less
    bulges = np.abs([c.bulge for c in curves])
    chord = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
    rise = (0.5 * chord * np.maximum(bulges, bulges**2))[:, None]
    return np.hstack([low - rise, high + rise])


def _require_clear(path: WirePath, sides: list[Curve], d: float) -> None:
    """Refuse a path that is closer to a contour than half of the kerf."""
    curves = [Curve(*s) for s in path.loop.segments()]
    boxes, others = _boxes(curves), _boxes(sides)
    for curve, box in zip(curves, boxes, strict=True):
        near = np.all(
            (others[:, :2] <= box[2:] + d) & (others[:, 2:] >= box[:2] - d), axis=1
        ).nonzero()[0]
        for j in near:
            if distance(curve, sides[j]) < d - _GOUGE:
                raise _narrow(path.contour, curve.point(0.5), d)


def _require_necks(contours: PlateContours, paths: tuple[WirePath, ...], d: float) -> None:
    """Refuse paths that miss an end of a neck."""
    curves = [Curve(*s) for p in paths for s in p.loop.segments()]
    boxes = _boxes(curves)
    for neck, point in itertools.product(contours.necks, ("right", "left")):
        p = getattr(neck, point)
        reach = d + _GOUGE
        near = np.all((boxes[:, :2] <= np.add(p, reach)) & (boxes[:, 2:] >= np.subtract(p, reach)),
                      axis=1).nonzero()[0]  # fmt: skip
        if not any(point_distance(p, curves[j]) <= reach for j in near):
            raise StageError(
                f"a kerf of {2e3 * d:.6g} mm does not reach the neck of hinge '{neck.hinge}' "
                "within a nanometre: use a thinner wire, a longer notch, or arcs for a notch drawn "
                "in chords"
            )


#: Rule for the order of `cuts`.
CUT_ORDER_RULE = (
    "openings without notches first, then slots from the middle of the plate outwards, "
    "the outline last"
)

# distance of the start hole of the outline, in its radii
_OUTSIDE = 4.0
_CHORD = 2e-6  # tolerance of polygons for the search of places [m]
_AWAY = 6e-3  # distance from a neck beyond which space is more important [m]
_MARGIN = 1e-6  # additional clearance of the lead-in [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """Cut of one contour."""

    number: int
    """Number in the cutting order, from 1."""
    path: WirePath
    """Path of the wire."""
    start: Pair
    """Centre of the start hole [m]."""
    entry: Pair
    """First point of the path, on a straight line from the start hole [m]."""


def cuts(
    contours: PlateContours, paths: tuple[WirePath, ...], offset: float, start_hole: float
) -> tuple[Cut, ...]:
    """Return the cuts with start holes and lead-in lines, in the order of `CUT_ORDER_RULE`.

    `paths` are those of `offset_contours` along the outline and the slots, `offset` is half of the
    kerf and `start_hole` a diameter, at least the kerf [m].

    The start hole of a slot is far from necks, as far as space permits; that of the outline is
    outside its longest straight edge. The lead-in is straight to the nearest point of the path that
    is not on a notch, where it would leave a mark.
    """
    sides = [Curve(*s) for c in contours.contours for s in c.loop.segments()]
    area_moments = contours.outline.loop.integrals()
    middle = area_moments.x / area_moments.area, area_moments.y / area_moments.area
    started = []
    for path in paths:
        radius = 0.5 * start_hole
        if path.contour.kind == "outline":
            start = _outside(path.contour, sides, _OUTSIDE * radius + offset)
        else:
            start = _inside(path.contour, contours, radius)
        started.append((path, start, _entry(path, start, sides, offset)))
    # rounded to a micrometre, so that the order of symmetric slots is unique
    started.sort(key=lambda item: _rank(item[0].contour, item[1], middle))
    return tuple(
        Cut(number=k, path=path, start=start, entry=entry)
        for k, (path, start, entry) in enumerate(started, start=1)
    )


def _rank(contour: Contour, start: Pair, middle: Pair) -> tuple[float, ...]:
    group = 2 if contour.kind == "outline" else int(any(contour.hinges))
    um = (math.dist(start, middle), start[1], start[0])
    return (group, *(round(v * 1e6) for v in um))


def _inside(contour: Contour, contours: PlateContours, radius: float) -> Pair:
    """Return a place for a start hole in a slot, away from necks if possible."""
    if contour.circle is not None:
        places = [(contour.circle.radius, contour.circle.centre)]
    else:
        places = _places(contour, radius)
    if max(places)[0] <= radius:
        room, (x, y) = max(places)
        raise StageError(
            f"a start hole of {2e3 * radius:.6g} mm does not fit into the slot near body "
            f"'{contour.bodies[0]}' at ({x * 1e3:.6g}, {y * 1e3:.6g}) mm: there is space for "
            f"{2e3 * room:.4g} mm; use a smaller start hole"
        )
    bounding_hinges = {name for name in contour.hinges if name is not None}
    necks = [p for n in contours.necks if n.hinge in bounding_hinges for p in (n.right, n.left)]

    def merit(place: tuple[float, Pair]) -> tuple[float, ...]:
        room, p = place
        away = min((math.dist(p, q) for q in necks), default=0.0)
        # rounded to micrometres, so that the choice between equal places is unique
        return tuple(round(v * 1e6) for v in (min(away, _AWAY), room, -p[1], -p[0]))

    return max((p for p in places if p[0] > radius), key=merit)[1]


def _places(contour: Contour, radius: float) -> list[tuple[float, Pair]]:
    """Return candidate places for a start hole in a slot, each with its clearance."""
    import shapely

    slot: Any = shapely.Polygon(contour.loop.polyline(_CHORD))
    candidates = [shapely.maximum_inscribed_circle(slot, tolerance=5e-6).coords[0]]
    # with some clearance
    roomy = slot.buffer(-1.2 * radius)
    for part in getattr(roomy, "geoms", [roomy]):
        if not part.is_empty:
            candidates += shapely.segmentize(part.exterior, 0.5e-3).coords[:-1]
            candidates.append(shapely.maximum_inscribed_circle(part, tolerance=5e-6).coords[0])
    # the polygon is outside the slot where arcs bulge into it
    rooms = shapely.distance(slot.exterior, shapely.points(candidates)) - _CHORD
    return [(float(r), (float(x), float(y))) for r, (x, y) in zip(rooms, candidates, strict=True)]


def _outside(contour: Contour, sides: list[Curve], apart: float) -> Pair:
    """Return a place outside the outline, at the longest straight edge without a notch."""
    edges = [
        Curve(*s)
        for s, hinge in zip(contour.loop.segments(), contour.hinges, strict=True)
        if hinge is None and not s[2]
    ] or [Curve(*s) for s in contour.loop.segments()]
    for edge in sorted(edges, key=lambda e: -round(e.length * 1e9)):
        # not in the middle, where a dimension or a probe may be
        point = edge.shifted(apart).point(0.25)
        if min(point_distance(point, s) for s in sides) > 0.99 * apart:
            return point
    raise StageError(
        f"no edge of the outline has {apart * 1e3:.3g} mm of space in front of it for a start "
        "hole: use a smaller one"
    )


def _entry(path: WirePath, start: Pair, sides: list[Curve], offset: float) -> Pair:
    """Return the nearest point of a path on a straight line from its start hole."""
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
                # preferably perpendicular to the path
                candidates.append((share != foot, math.dist(point, start), point))
    candidates.sort()
    for avoid_notches in (True, False):
        for *_, point in candidates:
            lead = Curve(start, point)
            near = offset + _MARGIN
            if avoid_notches and any(point_distance(point, n) < near for n in notches):
                continue
            if all(distance(lead, s) > offset - 1e-9 for s in sides):
                return point
    raise StageError(
        f"there is no straight lead-in from the start hole at ({start[0] * 1e3:.6g}, "
        f"{start[1] * 1e3:.6g}) mm to the path of the wire: use a smaller kerf"
    )


def _foot(curve: Curve, p: Pair) -> float | None:
    """Return the share of a curve at the foot of the perpendicular from a point."""
    if not curve.bulge:
        ux, uy = curve.direction(0.0)
        along = (p[0] - curve.start[0]) * ux + (p[1] - curve.start[1]) * uy
        share = along / curve.length
        return share if 0.0 < share < 1.0 else None
    return curve.share(p)
