"""Drives and probes of a drawing: arrows on their layers, or texts such as ``x: 12,4 -> 30,4``."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from flexstage.base.errors import StageError
from flexstage.files.decoder import read
from flexstage.stage.drawing.sheet import DRIVES_LAYER, PROBES_LAYER, Sheet
from flexstage.stage.drawing.strokes import Pair
from flexstage.stage.drive import Drive, Force
from flexstage.stage.file import STAGE_FILE
from flexstage.stage.model import Body, Probe, Stage

#: Force of a drive without an actuator [N].
STAND_IN = 1.0
#: A point that is drawn this near to the edge of a body is on it [m].
NEAR = 0.2e-3

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_POINT = rf"\s*({_NUMBER})\s*,\s*({_NUMBER})\s*"
_ARROW = re.compile(rf"^\s*([^:]+?)\s*:{_POINT}->{_POINT}(?:;(.*))?$", re.DOTALL)
_TURN = re.compile(rf"^\s*([^:]+?)\s*:{_POINT}(?:,\s*)?at\s*({_NUMBER})\s*deg\s*$")
_ROUND_DEG = 1e-7  # directions that are this close to whole degrees are whole [deg]


class Arrow(NamedTuple):
    """An arrow with a name."""

    name: str
    """Name."""
    start: Pair
    """Start point [m]."""
    end: Pair
    """Tip [m]."""
    text: str = ""
    """Further text: the actuator of a drive."""

    @property
    def direction(self) -> float:
        """Direction, from the x axis to the left [rad]."""
        return whole_degrees(math.atan2(self.end[1] - self.start[1], self.end[0] - self.start[0]))


def whole_degrees(angle: float) -> float:
    """Return an angle [rad], rounded to whole degrees if it is close to them."""
    degrees = math.degrees(angle)
    near = round(degrees)
    turned = math.radians(near) if abs(degrees - near) < _ROUND_DEG else angle
    return math.pi if turned == -math.pi else turned + 0.0


def arrow_of(text: str, option: str, unit: float) -> Arrow:
    """Read an arrow, whose places are in the unit of the drawing.

    Examples
    --------
    >>> arrow_of("x: 12,4 -> 30,4", "--drive", 1e-3).end
    (0.03, 0.004)
    """
    match = _ARROW.match(text)
    if match:
        x0, y0, x1, y1 = (float(v) * unit for v in match.groups()[1:5])
        arrow = Arrow(match[1], (x0, y0), (x1, y1), (match[6] or "").strip())
        if math.dist(arrow.start, arrow.end) > 0.0:
            return arrow
    elif option == "--probe" and (turned := _TURN.match(text)):
        x, y = float(turned[2]) * unit, float(turned[3]) * unit
        angle = math.radians(float(turned[4]))
        return Arrow(turned[1], (x, y), (x + math.cos(angle), y + math.sin(angle)))
    example = (
        '"x: 12,4 -> 30,4; piezo, free_stroke=38 um, stiffness=50 N/um", from the body it '
        "reacts on to the body it pushes"
        if option == "--drive"
        else '"x: 30,4 -> 40,4" or "x: 30,4 at 0 deg", from the measured point, in its direction'
    )
    raise StageError(f"{option} is {example}, in the unit of the drawing, got '{text}'")


def arrows_on(sheet: Sheet, layer: str) -> list[Arrow]:
    """Return the arrows on a layer: lines, each with the nearest text for its name.

    Short lines are heads: the end of a line at which one ends is its tip; where none does, the
    line was drawn towards it.
    """
    lines = [c for c, on in sheet.arrows if on == layer and not c.bulge]
    longest = max((c.length for c in lines), default=0.0)
    shafts = [c for c in lines if c.length > 0.35 * longest]
    heads = [c for c in lines if c.length <= 0.35 * longest]
    words = [w for w in sheet.words if w.layer == layer and w.text]
    arrows: list[Arrow] = []
    for shaft in shafts:

        def near(p: Pair, size: float = shaft.length) -> int:
            return sum(min(math.dist(p, h.start), math.dist(p, h.end)) < 0.01 * size for h in heads)

        start, end = shaft.start, shaft.end
        if near(start) > near(end):
            start, end = end, start
        turned = whole_degrees(math.atan2(end[1] - start[1], end[0] - start[0]))
        name = "x" if abs(math.cos(turned)) > math.sqrt(0.5) else "y"
        if words:
            word = min(words, key=lambda w: min(math.dist(w.at, start), math.dist(w.at, end)))
            words.remove(word)
            name = word.text
        name, _, rest = name.partition(";")
        name = name.strip()
        while any(a.name == name for a in arrows):
            name += "'"
        arrows.append(Arrow(name, start, end, rest.strip()))
    return arrows


def drives_of(
    bodies: Sequence[Body], sheet: Sheet, texts: Sequence[str], at: "Places"
) -> list[tuple[Drive, bool]]:
    """Return the drives, each with whether its actuator is only assumed."""
    arrows = [*arrows_on(sheet, DRIVES_LAYER)]
    arrows += [arrow_of(text, "--drive", sheet.unit) for text in texts]
    drives: list[tuple[Drive, bool]] = []
    for arrow in arrows:
        reacts, start = at.edge(bodies, arrow.start, f"drive '{arrow.name}' reacts on")
        pushes, end = at.edge(bodies, arrow.end, f"drive '{arrow.name}' pushes")
        place = {
            "name": arrow.name,
            "pushes": pushes,
            "reacts": reacts,
            "at": (end, start),
            "direction": arrow.direction,
        }
        if not arrow.text:
            drives.append((Force(largest_force=STAND_IN, **place), True))
            continue
        drives.append((_with_actuator(arrow, place), False))
    return drives


def _with_actuator(arrow: Arrow, place: Mapping[str, object]) -> Drive:
    """Build a drive as a stage file would, from ``piezo, free_stroke=38 um``."""
    kind, *figures = [w.strip() for w in arrow.text.split(",")]
    # a comma within a pair, as in voltage_range=[0 V, 120 V], belongs to it
    parts: list[str] = []
    for word in figures:
        if "=" in word or not parts:
            parts.append(word)
        else:
            parts[-1] += f", {word}"
    for part in parts:
        if "=" not in part:
            raise StageError(
                f"drive '{arrow.name}': expected figures such as stiffness=50 N/um, got '{part}'"
            )
    fields = "".join(
        f"    {key.strip()}: {value.strip()}\n"
        for key, _, value in (p.partition("=") for p in parts)
    )
    text = (
        f"flexstage: 1\nname: drive\nthickness: 1 m\nmaterial: Al 7075-T6\nbodies: {{}}\n"
        f"drives:\n  d:\n    kind: {kind}\n    pushes: a\n    reacts: b\n"
        f"    at: [[0 m, 0 m], [0 m, 0 m]]\n    direction: 0 rad\n{fields}"
    )
    decoder, root = read(text, f"drive '{arrow.name}'", STAGE_FILE)
    drives = decoder.decode(tuple[Drive, ...], root.items["drives"], "drives")
    from dataclasses import replace

    return replace(drives[0], **place)


def probes_of(
    bodies: Sequence[Body], sheet: Sheet, texts: Sequence[str], at: "Places"
) -> list[Probe]:
    """Return the probes."""
    arrows = [*arrows_on(sheet, PROBES_LAYER)]
    arrows += [arrow_of(text, "--probe", sheet.unit) for text in texts]
    return [
        Probe(
            name=a.name,
            body=at.body(bodies, a.start, f"probe '{a.name}' reads"),
            at=a.start,
            direction=a.direction,
        )
        for a in arrows
    ]


class Places:
    """Finds bodies by points in the plane."""

    def __init__(self, unit: float, unit_name: str) -> None:
        self._unit, self._name = unit, unit_name

    def _words(self, point: Pair) -> str:
        from flexstage.stage.drawing.contours import place

        return place(point, self._unit, self._name)

    def body(self, bodies: Sequence[Body], point: Pair, what: str) -> str:
        """Return the body that holds a point, over an opening of it as well."""
        from shapely import Point

        holding = [(r.area, b.name) for b, r in _rings(bodies) if r.covers(Point(point))]
        if not holding:
            raise StageError(
                f"{what} a body at {self._words(point)}, but there is none: the nearest is "
                f"'{self._nearest(bodies, point)[1]}'"
            )
        return min(holding)[1]

    def edge(self, bodies: Sequence[Body], point: Pair, what: str) -> tuple[str, Pair]:
        """Return the body on whose edge a point lies, and the point there."""
        away, name, foot = self._nearest(bodies, point)
        if away > NEAR:
            raise StageError(
                f"{what} a body at {self._words(point)}, which is {away * 1e3:.4g} mm away from "
                f"the nearest edge, that of '{name}': move the point onto an edge"
            )
        return name, point if away < 1e-6 else foot

    def _nearest(self, bodies: Sequence[Body], point: Pair) -> tuple[float, str, Pair]:
        from shapely import Point
        from shapely.ops import nearest_points

        distances = []
        for body, ring in _rings(bodies, holes=True):
            on = nearest_points(ring.boundary, Point(point))[0]
            distances.append((on.distance(Point(point)), body.name, (on.x, on.y)))
        return min(distances)


def _rings(bodies: Sequence[Body], holes: bool = False) -> list:
    from flexstage.stage.shapes import ring

    polygons = []
    for body in bodies:
        shape = ring(body.outline)
        if holes:
            for hole in body.holes:
                shape = shape.difference(ring(hole))
        polygons.append((body, shape))
    return polygons


def add_axes(stage: Stage) -> Stage:
    """Return a stage with an axis for each drive and probe of one name."""
    from dataclasses import replace

    from flexstage.stage.model import Axis

    probes = {p.name for p in stage.probes}
    axes = tuple(
        Axis(name=d.name, drive=d.name, probe=d.name) for d in stage.drives if d.name in probes
    )
    return replace(stage, axes=axes)
