"""The path of the cutting wire's centre: the contours of a plate, moved into the waste."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from flexstage.errors import StageError
from flexstage.export.drawing.contours import Contour, Pair, PlateContours
from flexstage.stage import Circle, Loop
from flexstage.stage.curve import Curve, crossings, distance, point_distance

_SAME = 1e-12  # two points are one [m]
# How far the wire may cut into the design, or leave material on a neck, before the path is refused
# [m]: rounding is a millionth of it.
_GOUGE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class WirePath:
    """The path of the wire's centre along one contour."""

    contour: Contour
    """The contour that it cuts."""
    loop: Loop
    """The path, in the direction of the contour: the material on its left."""
    circle: Circle | None = None
    """The path of a circular contour."""


def offset_contours(contours: PlateContours, distance: float) -> tuple[WirePath, ...]:
    """Return the path of the wire's centre along the outline and every slot, in their order.

    The distance [m] is half of the width of the cut: half the diameter of the wire and the spark
    gap. Mounting holes are drilled, and have no path.

    Each contour is moved into the waste. Lines and arcs stay what they are. About a corner of the
    material the wire runs on an arc, which leaves the corner sharp; into a re-entrant corner it
    goes as far as it fits, which leaves a fillet of the radius of the cut.

    Notes
    -----
    Validity: the path is checked before it is returned. Nowhere is it nearer to a contour than
    `distance`, and it passes both ends of every neck at that distance, to 1 nm.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.export.drawing.contours import plate_contours
    >>> plate = plate_contours(design("parallelogram"))
    >>> outline, slot = offset_contours(plate, 0.15e-3)
    >>> round((plate.slots[0].area - slot.loop.integrals().area) * 1e6, 3)
    22.149
    """
    if not 0.0 < distance < math.inf:
        raise StageError(
            f"half of the width of the cut must be positive and finite, got {distance!r} m"
        )
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
        loop = circle.loop()
        turned = Loop(loop.points, tuple(-b for b in loop.bulges))
        return WirePath(contour=contour, loop=turned, circle=circle)
    pieces: list[Curve] = []
    corners: list[Pair] = []  # the corner of the contour at the start of each piece
    for i, segment in enumerate(contour.loop.segments()):
        curve = Curve(*segment)
        if curve.bulge < 0.0 and -curve.radius - d < _GOUGE:
            raise _too_wide(contour, i, -curve.radius, d)
        pieces.append(curve.shifted(d))
        corners.append(curve.start)
    joined = _trimmed(contour, _rounded(pieces, corners, d), d)
    if len(joined) == 2 and not any(c.bulge for c in joined):
        # a slot as wide as the cut, there and back: a loop has three points at least
        joined = [joined[0].part(0.0, 0.5), joined[0].part(0.5, 1.0), joined[1]]
    points = tuple(c.start for c in joined)
    return WirePath(contour=contour, loop=Loop(points, tuple(c.bulge for c in joined)))


def _too_wide(contour: Contour, i: int, radius: float, d: float) -> StageError:
    x, y = Curve(*contour.loop.segments()[i]).point(0.5)
    hinge = contour.hinges[i]
    what = f"the notch of hinge '{hinge}'" if hinge else f"an edge of body '{contour.bodies[i]}'"
    return StageError(
        f"a cut {2e3 * d:.6g} mm wide does not fit into {what}, which is rounded by a radius of "
        f"{radius * 1e3:.6g} mm about ({x * 1e3:.6g}, {y * 1e3:.6g}) mm: use a wire whose cut is "
        f"narrower than {2e3 * radius:.6g} mm, or a larger radius"
    )


def _turn(a: Curve, b: Curve) -> float:
    """Angle by which b turns left at the end of a [rad]."""
    (ux, uy), (vx, vy) = a.direction(1.0), b.direction(0.0)
    return math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)


def _rounded(pieces: list[Curve], corners: list[Pair], d: float) -> list[Curve]:
    """Put an arc wherever the wire goes round a corner of the material."""
    out: list[Curve] = []
    for k, piece in enumerate(pieces):
        before = pieces[k - 1]
        gap = math.dist(before.end, piece.start)
        if gap > _SAME and (turn := _turn(before, piece)) > 0.0:
            # by the turn, not by the chord: both ends are at the same distance from the corner
            out.append(Curve(before.end, piece.start, math.tan(0.25 * turn)))
        out.append(piece)
    return out


def _trimmed(contour: Contour, pieces: list[Curve], d: float) -> list[Curve]:
    """Cut neighbours back to where they cross, and drop those that nothing is left of."""
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
        met = _meeting(a, b)
        if met is not None:
            a, b = a.part(0.0, met[0]), b.part(met[1], 1.0)
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
    """The crossing of a and b that leaves most of both."""
    found = crossings(a, b)
    if not found:
        return None
    return min(found, key=lambda st: (1.0 - st[0]) * a.length + st[1] * b.length)


def _hidden(chain: list[Curve], k: int) -> int | None:
    """Find which of two neighbours that do not meet is out of the wire's reach."""
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
        f"a cut {2e3 * d:.6g} mm wide does not fit between the edges about ({p[0] * 1e3:.6g}, "
        f"{p[1] * 1e3:.6g}) mm, by body '{body}': use a thinner wire, or widen the slot there"
    )


def _boxes(curves: list[Curve]) -> np.ndarray:
    """Bounds of curves, shape (n, 4); of an arc, those of a square that holds it."""
    ends = np.array([[*c.start, *c.end] for c in curves])
    low = np.minimum(ends[:, :2], ends[:, 2:])
    high = np.maximum(ends[:, :2], ends[:, 2:])
    # an arc rises over its chord by the bulge times half of it, and past its ends by less
    bulges = np.abs([c.bulge for c in curves])
    chord = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
    rise = (0.5 * chord * np.maximum(bulges, bulges**2))[:, None]
    return np.hstack([low - rise, high + rise])


def _require_clear(path: WirePath, sides: list[Curve], d: float) -> None:
    """Refuse a path that comes nearer to a contour than half of the cut."""
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
    """Refuse paths that do not pass the two ends of every neck."""
    curves = [Curve(*s) for p in paths for s in p.loop.segments()]
    boxes = _boxes(curves)
    for neck, point in itertools.product(contours.necks, ("right", "left")):
        p = getattr(neck, point)
        reach = d + _GOUGE
        near = np.all((boxes[:, :2] <= np.add(p, reach)) & (boxes[:, 2:] >= np.subtract(p, reach)),
                      axis=1).nonzero()[0]  # fmt: skip
        if not any(point_distance(p, curves[j]) <= reach for j in near):
            raise StageError(
                f"a cut {2e3 * d:.6g} mm wide does not reach the neck of hinge '{neck.hinge}' to a "
                "nanometre: use a thinner wire, a longer notch, or arcs where a notch is drawn in "
                "chords"
            )
