"""The notches of a stage, each kind drawn once, enlarged and with its dimensions."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, get_args, get_origin, get_type_hints

from flexstage.export.drawing.canvas import PAPER, THICK, Canvas, dimension, millimetres
from flexstage.hinges import Profile
from flexstage.hinges.profile import CurvedProfile
from flexstage.quantities.quantity import round_below
from flexstage.quantities.units import DIMENSIONS
from flexstage.stage import Hinge, Loop, Stage
from flexstage.stage.curve import Curve

Pair = tuple[float, float]

#: Room of a detail on the sheet: width and height [mm].
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
    """Hinges whose notches are alike."""

    letter: str
    """What the drawing calls them."""
    profile: Profile
    """The shape of their notch."""
    hinges: tuple[Hinge, ...]
    """The hinges."""

    @property
    def dimensions(self) -> str:
        """Every dimension but the neck's thickness, in words, in mm and degrees."""
        profile = self.profile
        hints = get_type_hints(type(profile), include_extras=True)
        words = []
        for field in dataclasses.fields(profile):
            value, hint = getattr(profile, field.name), hints[field.name]
            # a contour of many corners is in the drawing itself
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
    """Count in letters: A to Z without some, AA, AB, ..."""
    word = ""
    k += 1
    while k:
        k, rest = divmod(k - 1, len(_LETTERS))
        word = _LETTERS[rest] + word
    return word


def ratio(scale: float) -> str:
    """Return a scale in words: ``5:1`` or ``1:2``."""
    return f"{scale:g}:1" if scale >= 1.0 else f"1:{1.0 / scale:g}"


def draw_detail(canvas: Canvas, corner: Pair, kind: NotchKind) -> None:
    """Draw one kind of notch with neck, length, height at the root, and radius if it has one.

    `corner` is the upper left corner of its cell [mm].
    """
    profile = kind.profile
    length, height = profile.length * 1e3, profile.root_height * 1e3
    scale = round_below(min(_LARGEST[0] / length, _LARGEST[1] / height))
    x0, y0 = corner
    heading = f"{kind.letter}   {len(kind.hinges)} ×   {profile.kind}   {ratio(scale)}"
    canvas.text((x0 + 1.0, y0 + 4.0), heading, 3.0, bold=True)
    # the middle of the notch at its root, as it may be cut from one side only
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
    beside = right[0] + PAPER.body + 6.0
    dimension(canvas, right, low, beside, millimetres(height * 1e-3, 4), upright=True)
    text = millimetres(profile.neck_thickness)
    _neck(canvas, place((0.0, half_neck)), place((0.0, -half_neck)), low[1] + 4.0, text)
    _radius(canvas, profile, place, left[1] - PAPER.body + 0.5)


def _outlines(profile: Profile, body: float) -> tuple[Loop, Loop, Loop]:
    """Return the upper and the lower line of a notch, open, and its area, with some body [mm]."""
    half_neck = 0.5 * profile.neck_thickness * 1e3
    half = [(v.x * 1e3, v.depth * 1e3, v.bulge) for v in profile.contour()]
    end, depth = half[-1][0], half[-1][1]
    # left half inwards, right half outwards; mirrored and run backwards an arc turns the same way
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
    """Draw the thickness of the neck: arrows from both sides, the number under the notch."""
    canvas.line((above[0], above[1] - 4.0), above)
    canvas.arrow(above, (0.0, 1.0))
    canvas.line(below, (below[0], y))
    canvas.arrow(below, (0.0, -1.0))
    canvas.text((below[0], y + 3.0), text, 2.8, anchor="middle", bold=True)


def _radius(canvas: Canvas, profile: Profile, place: Callable[[Pair], Pair], y: float) -> None:
    """Point at the arc of a notch, if its shape has one, and write its radius above."""
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
