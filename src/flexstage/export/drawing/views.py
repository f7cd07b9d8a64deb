"""Views of a drawing: details of notches, and the plate with drives, probes and labels.

A label is next to its object, where there is no other text and few lines.
"""

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

from flexstage.export.drawing.canvas import (
    MEDIUM,
    PAPER,
    THICK,
    THIN,
    Box,
    Canvas,
    Pair,
    dimension,
    millimetres,
)
from flexstage.export.drawing.contours import PlateContours
from flexstage.export.svg import text_width
from flexstage.hinges import Profile
from flexstage.hinges.profile import CurvedProfile
from flexstage.quantities.quantity import round_below
from flexstage.quantities.units import DIMENSIONS
from flexstage.stage import Circle, Hinge, Loop, Stage
from flexstage.stage.curve import Curve

#: Size of a detail on the sheet: width and height [mm].
CELL = (69.0, 56.0)

_LARGEST = (34.0, 23.0)  # of a notch on the sheet [mm]
# H is for holes, R for radii; I, O and Q look like numbers
_LETTERS = "ABCDEFGJKLMNPSTUVWXYZ"
_SHORT = {
    "radius": "R",
    "fillet_radius": "fillet R",
    "half_opening_angle": "half angle",
    "notch_depth": "depth",
    "notch_length": "length",
    "leaf_length": "length",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class NotchKind:
    """Hinges with the same notch."""

    letter: str
    """Letter in the drawing."""
    profile: Profile
    """Profile of the notch."""
    hinges: tuple[Hinge, ...]
    """The hinges."""

    @property
    def dimensions(self) -> str:
        """All dimensions except the neck thickness, in mm and degrees."""
        profile = self.profile
        hints = get_type_hints(type(profile), include_extras=True)
        words = []
        for field in dataclasses.fields(profile):
            value, hint = getattr(profile, field.name), hints[field.name]
            # a contour of many vertices is in the drawing itself
            if field.name in ("neck_thickness", "one_sided") or isinstance(value, tuple):
                continue
            marks = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
            if DIMENSIONS["length"] in marks:
                text = millimetres(value)
            elif DIMENSIONS["angle"] in marks:
                text = f"{math.degrees(value):.5g}°"
            else:
                text = f"{value:.6g}"
            name = _SHORT.get(field.name, field.name.replace("_", " "))
            words.append(f"{name} {text}")
        return ", ".join([*words, "one side"] if profile.one_sided else words)


def notch_kinds(stage: Stage) -> tuple[NotchKind, ...]:
    """Return the kinds of notches of a stage, in the order in which they first occur.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> [(k.letter, len(k.hinges)) for k in notch_kinds(design("vgtu-piezo"))]
    [('A', 8), ('B', 8), ('C', 8), ('D', 8)]
    """
    groups: dict[Profile, list[Hinge]] = {}
    for hinge in stage.hinges:
        groups.setdefault(hinge.profile, []).append(hinge)
    return tuple(
        NotchKind(letter=_letter(k), profile=profile, hinges=tuple(hinges))
        for k, (profile, hinges) in enumerate(groups.items())
    )


def _letter(k: int) -> str:
    """Return a number in letters: A to Z without some, AA, AB, ..."""
    word = ""
    k += 1
    while k:
        k, digit = divmod(k - 1, len(_LETTERS))
        word = _LETTERS[digit] + word
    return word


def ratio(scale: float) -> str:
    """Return a scale as text: ``5:1`` or ``1:2``."""
    return f"{scale:g}:1" if scale >= 1.0 else f"1:{1.0 / scale:g}"


def draw_detail(canvas: Canvas, corner: Pair, kind: NotchKind) -> None:
    """Draw one kind of notch with neck, length, height at the root, and any radius.

    `corner` is the upper left corner of its cell [mm].
    """
    profile = kind.profile
    length, height = profile.length * 1e3, profile.root_height * 1e3
    scale = round_below(min(_LARGEST[0] / length, _LARGEST[1] / height))
    x0, y0 = corner
    heading = f"{kind.letter}   {len(kind.hinges)} ×   {profile.kind}   {ratio(scale)}"
    canvas.text((x0 + 1.0, y0 + 4.0), heading, 3.0, bold=True)
    # middle of the root, also for a notch on one side only
    middle = 0.5 * profile.depth * 1e3 if profile.one_sided else 0.0
    cx, cy = x0 + 0.42 * CELL[0], y0 + 32.0

    def place(p: Pair) -> Pair:
        return cx + scale * p[0], cy - scale * (p[1] - middle)

    upper, lower, shape = _outlines(profile, PAPER.body / scale)
    canvas.loops([(shape, True)], place, 0.0, fill="#e8e8e8")
    for line in (upper, lower):
        canvas.loops([(line, False)], place, THICK)
    half_neck = 0.5 * profile.neck_thickness * 1e3
    top = half_neck + profile.depth * 1e3
    left, right = place((-0.5 * length, top)), place((0.5 * length, top))
    low = place((0.5 * length, top - height))
    dimension(canvas, left, right, left[1] - 10.0, millimetres(length * 1e-3, 4))
    right_of_body = right[0] + PAPER.body + 6.0
    dimension(canvas, right, low, right_of_body, millimetres(height * 1e-3, 4), upright=True)
    text = millimetres(profile.neck_thickness)
    _neck(canvas, place((0.0, half_neck)), place((0.0, -half_neck)), low[1] + 4.0, text)
    _radius(canvas, profile, place, left[1] - PAPER.body + 0.5)


def _outlines(profile: Profile, body: float) -> tuple[Loop, Loop, Loop]:
    """Return upper and lower line of a notch, and its area with a margin of the bodies [mm]."""
    half_neck = 0.5 * profile.neck_thickness * 1e3
    half = [(v.x * 1e3, v.depth * 1e3, v.bulge) for v in profile.contour()]
    end, depth = half[-1][0], half[-1][1]
    # left half inwards, right half outwards; a mirrored and reversed arc has the same bulge
    points = [(-x, half_neck + y) for x, y, _ in reversed(half)]
    points += [(x, half_neck + y) for x, y, _ in half[1:]]
    bulges = [b for *_, b in reversed(half[:-1])] + [b for *_, b in half[:-1]]
    rise = half_neck + depth + body
    points = [(-end, rise), *points, (end, rise)]
    bulges = [0.0, *bulges, 0.0, 0.0]
    upper = Loop(tuple(points), tuple(bulges))
    if profile.one_sided:
        under = [(-end - body, -half_neck), (end + body, -half_neck)]
        lower = Loop((under[0], (0.0, -half_neck), under[1]))
        border = [(end + body, rise), under[1], under[0], (-end - body, rise)]
        return upper, lower, Loop((*points, *border), (*bulges, 0.0, 0.0, 0.0, 0.0))
    lower = upper.mapped(lambda p: (p[0], -p[1]))
    border = [(end + body, rise), (end + body, -rise)]
    back = lower.segments()[:-1][::-1]
    points += [*border, *(e for _, e, _ in back), lower.points[0]]
    bulges += [0.0, 0.0, *(-b for *_, b in back), 0.0]
    points += [(-end - body, -rise), (-end - body, rise)]
    bulges += [0.0, 0.0]
    return upper, lower, Loop(tuple(points), tuple(bulges[: len(points)]))


def _neck(canvas: Canvas, above: Pair, below: Pair, y: float, text: str) -> None:
    """Draw the thickness of the neck: arrows from both sides, the value below the notch."""
    canvas.line((above[0], above[1] - 4.0), above)
    canvas.arrow(above, (0.0, 1.0))
    canvas.line(below, (below[0], y))
    canvas.arrow(below, (0.0, -1.0))
    canvas.text((below[0], y + 3.0), text, 2.8, anchor="middle", bold=True)


def _radius(canvas: Canvas, profile: Profile, place: Callable[[Pair], Pair], y: float) -> None:
    """Draw the radius of the arc of a notch, if there is one."""
    contour = profile.contour()
    arcs = [k for k, v in enumerate(contour) if v.bulge]
    if not arcs or isinstance(profile, CurvedProfile):
        return
    v, w = contour[arcs[0]], contour[arcs[0] + 1]
    bow = Curve((v.x, v.depth), (w.x, w.depth), v.bulge)
    x, depth = bow.point(0.6)
    tip = place((x * 1e3, 0.5 * profile.neck_thickness * 1e3 + depth * 1e3))
    start = (tip[0] - 0.25 * (tip[1] - y), y)
    canvas.line(start, tip)
    canvas.arrow(tip, (tip[0] - start[0], tip[1] - start[1]))
    canvas.text((start[0] + 1.0, y - 0.8), f"R{millimetres(bow.radius)}", 2.8, anchor="end")


class Label(NamedTuple):
    """A label of an object."""

    at: Pair
    """Position of the object [mm]."""
    text: str
    """Text."""
    colour: str = "#000"
    """Colour."""
    radius: float = 0.0
    """Radius of the object, which the label must not cover [mm]."""


#: Candidate distances of a label from its object [mm].
_DISTANCES = (1.5, 2.5, 4.0, 6.0, 8.5, 11.5, 15.0, 20.0, 27.0, 36.0)
_DIRECTIONS = 24
_DRIVE, _PROBE = "#a00000", "#0040a0"
_CENTRE = "4 0.8 0.8 0.8"


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Placement of the plate on the sheet."""

    scale: float
    """Length on paper over length of the part [1]."""
    origin: Pair
    """Position of the point (0, 0) of the stage on the sheet [mm]."""
    bounds: tuple[float, float, float, float]
    """Smallest x and y, largest x and y of the plate [m]."""

    def place(self, p: Pair) -> Pair:
        """Return a point of the stage [m] on the sheet [mm], y down."""
        k = 1e3 * self.scale
        return self.origin[0] + k * p[0], self.origin[1] - k * p[1]

    @classmethod
    def fitted(cls, plate: PlateContours, room: Box) -> "View":
        """Return the view of a plate and its dimensions at the largest usual scale in a box."""
        x0, y0, x1, y1 = plate.outline.loop.bounds()
        width = room.right - room.left - PAPER.left - 2.0 * PAPER.around
        height = room.bottom - room.top - PAPER.below - 2.0 * PAPER.around
        scale = round_below(min(width / (x1 - x0), height / (y1 - y0)) * 1e-3)
        k = 1e3 * scale
        left = 0.5 * (room.left + PAPER.left + room.right - k * (x1 - x0))
        top = 0.5 * (room.top + room.bottom - PAPER.below - k * (y1 - y0))
        origin = (left - k * x0, top + k * y1)
        return cls(scale=scale, origin=origin, bounds=(x0, y0, x1, y1))


def hinge_marks(stage: Stage, kinds: tuple[NotchKind, ...]) -> dict[str, str]:
    """Return the mark of each hinge: letter of its notch and row in the table."""
    letters = {h.name: kind.letter for kind in kinds for h in kind.hinges}
    return {h.name: f"{letters[h.name]}{k}" for k, h in enumerate(stage.hinges, start=1)}


def round_openings(plate: PlateContours) -> list[tuple[str, Circle, str]]:
    """Return mark, circle and type of the round openings of a plate."""
    circles = [(c.circle, "mounting hole") for c in plate.holes]
    circles += [(c.circle, "opening") for c in plate.slots if c.circle is not None]
    return [(f"H{k}", c, what) for k, (c, what) in enumerate(circles, start=1) if c is not None]


def draw_view(
    canvas: Canvas, view: View, stage: Stage, plate: PlateContours, marks: dict[str, str]
) -> None:
    """Draw the plate with its dimensions and labels."""
    loops = [c.loop for c in plate.contours]
    canvas.loops([(loop, True) for loop in loops], view.place, THICK, fill="#f1f1f1")
    x0, y0, x1, y1 = view.bounds
    left, bottom = view.place((x0, y0))
    right, top = view.place((x1, y1))
    # outside the labels around the plate
    away = PAPER.around + 7.0
    width, height = millimetres(x1 - x0, 3), millimetres(y1 - y0, 3)
    dimension(canvas, (left, bottom), (right, bottom), bottom + away, width)
    dimension(canvas, (left, top), (left, bottom), left - away, height, upright=True)
    strokes: list[tuple[Pair, Pair]] = []
    labels = _origin(canvas, view, strokes)
    labels += _arrows(canvas, view, stage, strokes)
    for mark, circle, _ in round_openings(plate):
        _centre_lines(canvas, view, circle, strokes)
        reach = 1e3 * view.scale * circle.radius
        labels.append(Label(view.place(circle.centre), mark, radius=reach if reach < 6.0 else 1.0))
    for neck in plate.necks:
        ends = view.place(neck.right), view.place(neck.left)
        canvas.line(*ends, MEDIUM)
        centre = (0.5 * (ends[0][0] + ends[1][0]), 0.5 * (ends[0][1] + ends[1][1]))
        labels.append(Label(centre, marks[neck.hinge], radius=0.5 * math.dist(*ends)))
    area = Box(
        left - PAPER.around,
        top - PAPER.around,
        right + PAPER.around,
        bottom + PAPER.around,
    )
    place_labels(
        canvas,
        labels,
        Surroundings(_lines(view, loops, labels, strokes), area, canvas.boxes),
        PAPER.label,
    )


def _lines(
    view: View, loops: list[Loop], labels: list[Label], strokes: list[tuple[Pair, Pair]]
) -> list[Any]:
    """Return the lines and objects that labels should not cover."""
    from shapely import LineString, Point

    lines = []
    for loop in loops:
        # to a fiftieth of a millimetre of paper
        points = [view.place((x, y)) for x, y in loop.polyline(2e-5 / view.scale).tolist()]
        ends = [*points[1:], points[0]]
        lines += [LineString([a, b]) for a, b in zip(points, ends, strict=True)]
    # twice: text over an arrow is worse than over an edge
    lines += 2 * [LineString(stroke) for stroke in strokes]
    lines += [Point(label.at).buffer(label.radius + 0.3) for label in labels]
    return lines


def _origin(canvas: Canvas, view: View, strokes: list[tuple[Pair, Pair]]) -> list[Label]:
    """Draw the origin with its axes; or mark the lower left corner if the origin is outside."""
    x0, y0, x1, y1 = view.bounds
    if not (x0 <= 0.0 <= x1 and y0 <= 0.0 <= y1):
        x, y = view.place((x0, y0))
        canvas.line((x - 1.5, y), (x + 1.5, y), THIN)
        canvas.line((x, y - 1.5), (x, y + 1.5), THIN)
        return [Label((x, y), f"x {millimetres(x0, 3)}, y {millimetres(y0, 3)}", radius=1.0)]
    x, y = view.place((0.0, 0.0))
    canvas.circle((x, y), 0.8, THIN)
    for ux, uy in ((1.0, 0.0), (0.0, -1.0)):
        canvas.line((x, y), (x + 5.0 * ux, y + 5.0 * uy), THIN)
        canvas.arrow((x + 6.0 * ux, y + 6.0 * uy), (ux, uy), size=1.5)
        strokes.append(((x, y), (x + 6.0 * ux, y + 6.0 * uy)))
    return [
        Label((x + 6.0, y), "x", radius=0.3),
        Label((x, y - 6.0), "y", radius=0.3),
        Label((x, y), "0", radius=0.8),
    ]


def _arrows(
    canvas: Canvas, view: View, stage: Stage, strokes: list[tuple[Pair, Pair]]
) -> list[Label]:
    """Draw the points and directions of drives and probes."""
    labels = []
    for drive in stage.drives:
        tip = view.place(drive.at[0])
        c, s = math.cos(drive.direction), -math.sin(drive.direction)
        tail = (tip[0] - PAPER.arrow * c, tip[1] - PAPER.arrow * s)
        canvas.line(tail, (tip[0] - c, tip[1] - s), THICK, colour=_DRIVE)
        canvas.arrow(tip, (c, s), size=3.0, colour=_DRIVE)
        middle = (tip[0] - 0.6 * PAPER.arrow * c, tip[1] - 0.6 * PAPER.arrow * s)
        strokes.append((tail, tip))
        labels.append(Label(middle, f"drive {drive.name}", _DRIVE, 1.0))
    for probe in stage.probes:
        start = view.place(probe.at)
        canvas.circle(start, 0.8, THIN, fill=_PROBE)
        if probe.direction is None:
            reach = _turning_arrow(canvas, start, strokes)
            labels.append(Label(start, f"probe {probe.name}", _PROBE, reach))
            continue
        c, s = probe.along[0], -probe.along[1]
        tip = (start[0] + PAPER.arrow * c, start[1] + PAPER.arrow * s)
        canvas.line(start, (tip[0] - c, tip[1] - s), MEDIUM, colour=_PROBE)
        canvas.arrow(tip, (c, s), size=2.5, colour=_PROBE)
        strokes.append((start, tip))
        labels.append(Label(tip, f"probe {probe.name}", _PROBE, 0.6))
    return labels


def _turning_arrow(canvas: Canvas, centre: Pair, strokes: list[tuple[Pair, Pair]]) -> float:
    """Draw an anticlockwise arrow of three quarters of a circle; return its radius."""
    radius = 0.45 * PAPER.arrow
    turns = [math.radians(a) for a in range(-135, 136, 15)]
    around = [(centre[0] + radius * math.cos(a), centre[1] - radius * math.sin(a)) for a in turns]
    for line in pairwise(around):
        canvas.line(*line, MEDIUM, colour=_PROBE)
        strokes.append(line)
    c, s = math.cos(turns[-1]), math.sin(turns[-1])
    canvas.arrow(
        (around[-1][0] - 1.2 * s, around[-1][1] - 1.2 * c), (-s, -c), size=2.5, colour=_PROBE
    )
    return radius


def _centre_lines(
    canvas: Canvas, view: View, circle: Circle, strokes: list[tuple[Pair, Pair]]
) -> None:
    x, y = view.place(circle.centre)
    reach = 1e3 * view.scale * circle.radius + 1.5
    for stroke in (((x - reach, y), (x + reach, y)), ((x, y - reach), (x, y + reach))):
        canvas.line(*stroke, dash=_CENTRE)
        strokes.append(stroke)


def scale_bar(canvas: Canvas, at: Pair, scale: float) -> None:
    """Draw a scale bar of a round length from its left end [mm]."""
    length = round_below(50.0 / scale)
    x, y = at
    for k in range(5):
        a, b = x + 0.2 * k * length * scale, x + 0.2 * (k + 1) * length * scale
        canvas.line((a, y), (b, y), 1.2 if k % 2 else THICK)
    for share in (0.0, 1.0):
        end = x + share * length * scale
        canvas.line((end, y - 1.5), (end, y + 1.5), MEDIUM)
        canvas.text((end, y - 2.3), f"{share * length:g}", PAPER.label, anchor="middle")
    canvas.text((x + length * scale + 3.0, y + 0.9), "mm", PAPER.label)


class Surroundings:
    """Obstacles of labels: other text, and, if possible, lines."""

    def __init__(self, lines: Sequence[Any], area: Box, boxes: Iterable[Box]) -> None:
        from shapely import STRtree

        self.tree = STRtree(list(lines))
        self.area = area
        # text outside the area is no obstacle
        self.boxes = [t for t in boxes if t.meets(area, PAPER.label_gap)]
        self.leaders: list[Any] = []

    def cost(self, box: Box, leader: Any) -> float | None:
        """Return the cost of a place as a distance [mm]; None if the place is not allowed.

        The leader is the line from the label to its object, or None.
        """
        from shapely import box as rectangle

        a = self.area
        if not (a.left <= box.left and box.right <= a.right):
            return None
        if not (a.top <= box.top and box.bottom <= a.bottom):
            return None
        if any(box.meets(t, PAPER.label_gap) for t in self.boxes):
            return None
        area_of_box = rectangle(*box)
        if any(area_of_box.intersects(other) for other in self.leaders):
            return None
        cost = PAPER.label_line * len(
            self.tree.query(area_of_box, predicate="dwithin", distance=PAPER.label_gap)
        )
        if leader is not None:
            if any(leader.intersects(rectangle(*t)) for t in self.boxes):
                return None
            cost += 3.0 * sum(leader.crosses(other) for other in self.leaders)
        return cost


def place_labels(
    canvas: Canvas, labels: Iterable[Label], around: Surroundings, size: float
) -> None:
    """Draw labels near their objects without overlap, and add them to the surroundings."""
    from shapely import LineString

    for label in labels:
        best: tuple[float, Pair, Box, Any] | None = None
        for distance in _DISTANCES:
            if best is not None and distance > best[0]:
                break  # larger distances cost more
            for k in range(_DIRECTIONS):
                place = _place(canvas, label, size, label.radius + distance, k)
                start, box = place
                tip = _nearest(box, label.at)
                leader = LineString([label.at, tip]) if distance > 2.0 else None
                cost = around.cost(box, leader)
                if cost is not None and (best is None or distance + cost < best[0]):
                    best = (distance + cost, start, box, leader)
        if best is None:
            # no free place: draw it over lines
            start, box = _place(canvas, label, size, label.radius + 1.5, 3)
            best = (0.0, start, box, None)
        _, start, box, leader = best
        canvas.text(start, label.text, size, colour=label.colour)
        around.boxes.append(box)
        if leader is not None:
            canvas.line(label.at, _nearest(box, label.at), 0.6 * THIN, colour=label.colour)
            around.leaders.append(leader)


def _place(canvas: Canvas, label: Label, size: float, distance: float, k: int) -> tuple[Pair, Box]:
    """Return the start of the text and its box for one direction and distance."""
    # begin at the upper right
    angle = 2.0 * math.pi * (k + 3) / _DIRECTIONS
    c, s = math.cos(angle), -math.sin(angle)
    x, y = label.at[0] + distance * c, label.at[1] + distance * s
    # the near side of the box touches the point
    width, height = text_width(label.text, size), size
    left = x + 0.5 * (c - 1.0) * width
    baseline = y + 0.5 * (s + 1.0) * height - 0.1 * size
    start = (left, baseline)
    return start, canvas.text_box(start, label.text, size)


def _nearest(box: Box, p: Pair) -> Pair:
    return min(max(p[0], box.left), box.right), min(max(p[1], box.top), box.bottom)
