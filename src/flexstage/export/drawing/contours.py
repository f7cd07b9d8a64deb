"""Closed contours of a monolithic plate: bodies joined at the necks of their hinges."""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

from flexstage.base.errors import StageError
from flexstage.stage import Body, Circle, Hinge, Loop, Stage
from flexstage.stage.contour import body_contour

Pair = tuple[float, float]

_SAME = 1e-9  # distance of identical points [m]
# Distance of a corner from the line of its neighbours by rounding [m]: without it the area of a
# plate changes by less than 1e-13.
_STRAIGHT = 1e-14


class NeckLine(NamedTuple):
    """Thinnest section of a hinge, as the line between its two surfaces."""

    hinge: str
    """Name of the hinge."""
    right: Pair
    """End on the right of the hinge's direction [m], a vertex of a contour."""
    left: Pair
    """End on the left of the hinge's direction [m], a vertex of a contour."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contour:
    """A closed line of a plate, with the material on its left."""

    loop: Loop
    """The line: counter-clockwise round the plate, clockwise round an opening in it."""
    kind: Literal["outline", "slot", "hole"]
    """``"outline"`` round the plate, ``"slot"`` round an opening in it, ``"hole"`` round a mounting
    hole, which is drilled.
    """
    bodies: tuple[str, ...]
    """Body of each segment."""
    hinges: tuple[str | None, ...]
    """Hinge of the notch of each segment; None on the edge of a body."""
    circle: Circle | None = None
    """Circle of a circular contour."""

    @property
    def area(self) -> float:
        """Area inside the line [m^2], positive."""
        return self.loop.integrals().area


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateContours:
    """All contours of a plate."""

    outline: Contour
    """Outer contour."""
    slots: tuple[Contour, ...]
    """Slots between bodies, and openings."""
    holes: tuple[Contour, ...]
    """Mounting holes."""
    necks: tuple[NeckLine, ...]
    """The necks of the hinges, in the order of the stage."""

    @property
    def inner(self) -> tuple[Contour, ...]:
        """Slots and holes."""
        return (*self.slots, *self.holes)

    @property
    def contours(self) -> tuple[Contour, ...]:
        """All contours, the outline first."""
        return (self.outline, *self.inner)

    @property
    def area(self) -> float:
        """Area of the plate's face [m^2]."""
        return self.outline.area - math.fsum(c.area for c in self.inner)


class _Step(NamedTuple):
    """A segment of a contour, the material on its left."""

    start: Pair
    end: Pair
    bulge: float
    body: str
    hinge: str | None


def plate_contours(stage: Stage) -> PlateContours:
    """Return the closed contours of the plate of a stage.

    The contours of the bodies with their half notches are opened at the necks and joined across
    them, so that lines remain lines and arcs remain arcs. Vertices in a straight edge are removed,
    except the two ends of every neck.

    Notes
    -----
    Validity: exact for notches of lines and arcs; other profiles (ellipse, parabola, hyperbola,
    power) are the arcs of `Profile.contour` within 10 nm, as in the finite-element models. Bodies
    must not overlap or touch except at their hinges, see `flexstage.stage.check`.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> plate = plate_contours(design("parallelogram"))
    >>> len(plate.slots), len(plate.holes), round(plate.area * 1e6, 3)
    (1, 2, 2417.718)
    """
    necks = tuple(_neck(h) for h in stage.hinges)
    steps = _body_steps(stage, necks)
    loops = [_joined(loop) for loop in _chained(steps)]
    outer = [loop for loop in loops if _signed_area(loop) > 0.0]
    if len(outer) != 1:
        names = ", ".join(f"'{loop[0].body}'" for loop in outer[:4])
        raise StageError(
            f"the plate of stage '{stage.name}' is in {len(outer)} pieces (with bodies {names}): "
            "join them by hinges, or make each a stage of its own"
        )
    slots = [_contour(loop, "slot") for loop in loops if loop is not outer[0]]
    holes: list[Contour] = []
    for body in stage.bodies:
        slots += [_round(body, h, "slot") for h in body.holes if isinstance(h, Circle)]
        holes += [_round(body, h, "hole") for h in body.mounting_holes]
    return PlateContours(
        outline=_contour(outer[0], "outline"), slots=tuple(slots), holes=tuple(holes), necks=necks
    )


def _neck(hinge: Hinge) -> NeckLine:
    half = 0.5 * hinge.profile.neck_thickness
    return NeckLine(hinge.name, hinge.to_plane(0.0, -half), hinge.to_plane(0.0, half))


def _round(body: Body, circle: Circle, kind: Literal["slot", "hole"]) -> Contour:
    two = (body.name, body.name)
    return Contour(
        loop=clockwise(circle), kind=kind, bodies=two, hinges=(None, None), circle=circle
    )


def clockwise(circle: Circle) -> Loop:
    """Return a circle as a loop with the material outside on its left."""
    loop = circle.loop()
    return Loop(loop.points, tuple(-b for b in loop.bulges))


def _contour(loop: list[_Step], kind: Literal["outline", "slot"]) -> Contour:
    return Contour(
        loop=Loop(tuple(s.start for s in loop), tuple(s.bulge for s in loop)),
        kind=kind,
        bodies=tuple(s.body for s in loop),
        hinges=tuple(s.hinge for s in loop),
    )


def _body_steps(stage: Stage, necks: tuple[NeckLine, ...]) -> list[_Step]:
    """Return the segments of all bodies, without circles and lines across necks."""
    steps: list[_Step] = []
    crossed = dict.fromkeys((h.name for h in stage.hinges), 0)
    for body in stage.bodies:
        outline, holes = body_contour(stage, body)
        own_necks = [
            (h, n) for h, n in zip(stage.hinges, necks, strict=True) if body.name in h.bodies
        ]
        loops = [(outline, True), *((h, False) for h in holes if isinstance(h, Loop))]
        for loop, outside in loops:
            for start, end, bulge in _oriented(loop, outside):
                neck = next((n for _, n in own_necks if _is_neck(n, start, end)), None)
                if neck is not None:
                    crossed[neck.hinge] += 1
                    continue
                hinge = next((h.name for h, _ in own_necks if _on_notch(h, start, end)), None)
                steps.append(_Step(start, end, bulge, body.name, hinge))
    for name, count in crossed.items():
        if count != 2:
            raise StageError(
                f"the two halves of hinge '{name}' do not meet at its neck: run 'flexstage check' "
                "for details"
            )
    return steps


def _oriented(loop: Loop, outside: bool) -> list[tuple[Pair, Pair, float]]:
    """Return the segments of a loop with the material on their left, without zero length."""
    segments = [s for s in loop.segments() if s[0] != s[1]]
    area = math.fsum(_segment_area(*s) for s in segments)
    if (area > 0.0) == outside:
        return segments
    return [(end, start, -bulge) for start, end, bulge in reversed(segments)]


def _segment_area(start: Pair, end: Pair, bulge: float) -> float:
    """Return the area between a segment and the origin, with that between arc and chord."""
    area = 0.5 * (start[0] * end[1] - start[1] * end[0])
    if bulge:
        sweep = 4.0 * math.atan(bulge)
        radius = math.dist(start, end) * (1.0 + bulge**2) / (4.0 * bulge)
        area += 0.5 * radius**2 * math.copysign(1.0, bulge) * abs(sweep - math.sin(sweep))
    return area


def _signed_area(steps: list[_Step]) -> float:
    return math.fsum(_segment_area(s.start, s.end, s.bulge) for s in steps)


def _is_neck(neck: NeckLine, start: Pair, end: Pair) -> bool:
    ends = ((neck.right, neck.left), (neck.left, neck.right))
    return any(math.dist(a, start) < _SAME and math.dist(b, end) < _SAME for a, b in ends)


def _on_notch(hinge: Hinge, start: Pair, end: Pair) -> bool:
    """Return whether a segment is on the surface of a notch.

    The steps of a leaf are on the edges of its bodies, and count as part of these.
    """
    profile = hinge.profile
    half = 0.5 * profile.length
    (x0, y0), (x1, y1) = hinge.from_plane(start), hinge.from_plane(end)
    top = 0.5 * profile.neck_thickness + profile.depth + _SAME
    bottom = -0.5 * profile.neck_thickness - (0.0 if profile.one_sided else profile.depth) - _SAME
    inside = all(abs(x) <= half + _SAME and bottom <= y <= top for x, y in ((x0, y0), (x1, y1)))
    at_root = abs(x0) > half - _SAME and abs(x1) > half - _SAME
    return inside and not (at_root and abs(x0 - x1) < half)


def _chained(steps: list[_Step]) -> list[list[_Step]]:
    """Return closed loops of segments, each with the next one at its end."""
    starts: dict[tuple[int, int], list[int]] = {}
    for i, s in enumerate(steps):
        starts.setdefault(_cell(s.start), []).append(i)
    following = [_next(steps, starts, s) for s in steps]
    loops: list[list[_Step]] = []
    used = [False] * len(steps)
    for first in range(len(steps)):
        loop: list[_Step] = []
        i = first
        while not used[i]:
            used[i] = True
            # the two halves of a neck may differ in the last digit: use one point
            loop.append(steps[i]._replace(end=steps[following[i]].start))
            i = following[i]
        if loop:
            loops.append(loop)
    return loops


def _cell(p: Pair) -> tuple[int, int]:
    return round(p[0] / _SAME), round(p[1] / _SAME)


def _next(steps: list[_Step], starts: dict[tuple[int, int], list[int]], step: _Step) -> int:
    x, y = _cell(step.end)
    near = [
        i
        for dx in (0, -1, 1)
        for dy in (0, -1, 1)
        for i in starts.get((x + dx, y + dy), ())
        if math.dist(steps[i].start, step.end) < _SAME
    ]
    if len(near) != 1:
        raise StageError(
            f"the contour of body '{step.body}' continues in {len(near)} edges at "
            f"({step.end[0] * 1e3:.6g}, {step.end[1] * 1e3:.6g}) mm instead of one: bodies or "
            "notches touch there; run 'flexstage check' for details"
        )
    return near[0]


def _joined(loop: list[_Step]) -> list[_Step]:
    """Remove vertices from straight edges, but not at the ends of necks, between bodies."""
    out: list[_Step] = []
    for step in [*loop, None]:
        # the first vertex may be within an edge too
        nxt = step or (out[0] if out else None)
        assert nxt is not None
        if out and len(loop) > 3 and _is_straight_on(out[-1], nxt):
            out[-1] = out[-1]._replace(end=nxt.end)
            if step is None and len(out) > 1:
                out[0] = out.pop()
        elif step is not None:
            out.append(step)
    return out


def _is_straight_on(a: _Step, b: _Step) -> bool:
    """Return whether the next segment continues a straight one."""
    if a.bulge or b.bulge or (a.body, a.hinge) != (b.body, b.hinge):
        return False
    ux, uy = a.end[0] - a.start[0], a.end[1] - a.start[1]
    vx, vy = b.end[0] - b.start[0], b.end[1] - b.start[1]
    chord = math.hypot(ux + vx, uy + vy)
    return ux * vx + uy * vy > 0.0 and abs(ux * vy - uy * vx) <= _STRAIGHT * chord
