"""Blocks of a drawing: sizes, pins and symbols."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import Any

from flexstage.export.diagram.graph import Block
from flexstage.export.svg import element, number, path, text_width

Colour = str
Point = tuple[float, float]

#: Edge and fill of blocks by role, safe for colour blindness (M. Okabe, K. Ito, 2002).
COLOURS: dict[str, tuple[Colour, Colour]] = {
    "spring": ("#0072b2", "#e6f2fa"),
    "damper": ("#007d5c", "#e3f4ee"),
    "mass": ("#6f4a8e", "#f1ebf6"),
    "drive": ("#a85000", "#fdf1e3"),
    "": ("#333333", "#ffffff"),
}


#: Sizes of letters [px].
BASE = 12.0
SMALL = 10.0
_LEAST = 9.0


def plain(text: str) -> str:
    """Return a text without the marks of subscripts: ``kin`` for ``k_in``."""
    return text.replace("_", "")


def text(
    words: str,
    x: float,
    y: float,
    *,
    size: float = BASE,
    anchor: str = "start",
    **attributes: object,
) -> str:
    """Return a line of text; an underscore begins a subscript, up to a blank.

    The anchor (``start``, ``middle``, ``end``) of its base line is at (x, y) [px].
    """
    return element(
        "text",
        " ".join(_lowered(word, size) for word in words.split(" ")),
        x=x,
        y=y,
        font_size=size,
        text_anchor=None if anchor == "start" else anchor,
        **attributes,
    )


def _lowered(word: str, size: float) -> str:
    head, _, low = word.partition("_")
    if not head or not low:
        return escape(word)
    down, small = number(0.22 * size), max(_LEAST, 0.78 * size)
    return (
        escape(head)
        + element("tspan", escape(low), dy=down, font_size=small)
        + element("tspan", "&#8203;", dy=f"-{down}")
    )


@dataclass(frozen=True, slots=True)
class Pin:
    """A pin of a cell."""

    side: str
    """``L`` or ``R``."""
    y: float
    """Distance below the top of the cell [px]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagramCell:
    """Size and pins of a block."""

    width: float
    """Width [px]."""
    height: float
    """Height [px]."""
    axis: float
    """Distance of the common line of a row below its top [px]."""
    pins: Mapping[str, Pin]
    """Pins by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedBlock:
    """A block on the page."""

    block: Block
    """The block."""
    x: float
    """Left edge of its cell [px]."""
    y: float
    """Top of its cell [px]."""
    cell: DiagramCell
    """Size and pins."""

    @property
    def right(self) -> float:
        """Right edge of its cell [px]."""
        return self.x + self.cell.width

    def pin(self, name: str) -> Point:
        """Return the position of a pin on the page [px]."""
        pin = self.cell.pins[name]
        return (self.right if pin.side == "R" else self.x, self.y + pin.y)


SUM_RADIUS = 15.0
# Spacing of the inputs of a long sum, and distance of the outer ones from its ends.
_APART = 19.0
_END = 16.0
# Offset of the second input of a round sum below the first, which is on its axis.
_LOWER = 10.5
_CAPTION = 15.0
_HEIGHTS = {"integrator": 36.0, "input": 26.0, "output": 26.0, "gain": 34.0}


def shape_width(block: Block) -> float:
    """Return the width of the symbol of a block, without its caption [px]."""
    label = text_width(plain(block.label), BASE)
    match block.kind:
        case "sum":
            return 2.0 * SUM_RADIUS
        case "integrator":
            return 34.0
        case "input" | "output":
            return label + 20.0
        case "gain":
            return label + (46.0 if block.role in ("spring", "damper") else 34.0)
        case _:
            return 56.0


def block_cell(block: Block, *, flipped: bool = False) -> DiagramCell:
    """Return the cell of a block, with pins ``out``, ``in0``, ``in1`` and so on.

    A flipped block is drawn from right to left. A sum of one or two inputs is round, with the
    second from below; a sum of more inputs is long.
    """
    into, out = ("R", "L") if flipped else ("L", "R")
    width, caption = shape_width(block), 0.0
    if block.kind == "sum":
        count = len(block.signs)
        if count <= 2:
            height = 2.0 * SUM_RADIUS
            heights = [SUM_RADIUS, SUM_RADIUS + _LOWER][:count]
        else:
            height = _APART * (count - 1) + 2.0 * _END
            heights = [_END + _APART * k for k in range(count)]
    else:
        height = _HEIGHTS.get(block.kind, 42.0)
        heights = [0.5 * height]
        if block.kind not in _HEIGHTS:
            caption, width = _CAPTION, max(width, text_width(plain(block.label), SMALL))
    pins = {"out": Pin(out, 0.5 * height)}
    pins |= {f"in{k}": Pin(into, y) for k, y in enumerate(heights)}
    return DiagramCell(width=width, height=height + caption, axis=0.5 * height, pins=pins)


def symbol(placed: PlacedBlock) -> str:
    """Return the symbol of a block; its title, a tooltip in browsers, is its meaning."""
    block = placed.block
    width = shape_width(block)
    x = placed.x + 0.5 * (placed.cell.width - width)
    edge, fill = COLOURS.get(block.role, COLOURS[""])
    parts = [element("title", escape(block.meaning))]
    parts += _stubs(placed, x, width)
    top, height = placed.y, 2.0 * placed.cell.axis
    style = {"fill": fill, "stroke": edge, "stroke_width": 1.4}
    match block.kind:
        case "sum":
            parts += _sum(placed, x, style)
        case "integrator":
            parts += _integrator(x, top, width, height, style)
        case "input" | "output":
            parts.append(_box(x, top, width, height, 0.5 * height, style))
            parts.append(
                text(block.label, x + 0.5 * width, top + 0.5 * height + 4, anchor="middle")
            )
        case "gain":
            parts += _gain(placed, x, width, style)
        case _:
            parts += _model(block, x, top, width, height, style)
            parts.append(
                text(block.label, x + 0.5 * width, top + height + 12.0, size=SMALL, anchor="middle")
            )
    return element("g", "".join(parts))


def _stubs(placed: PlacedBlock, x: float, width: float) -> list[str]:
    """Return lines from the edges of a cell to a narrower symbol."""
    if x - placed.x < 0.5:
        return []
    y = placed.y + placed.cell.axis
    right = placed.x + placed.cell.width
    out = []
    for a, b in ((placed.x, x), (x + width, right)):
        out.append(path([(a, y), (b, y)], stroke="#333333", stroke_width=1.3))
    return out


def _box(
    x: float, y: float, width: float, height: float, radius: float, style: dict[str, Any]
) -> str:
    return element("rect", x=x, y=y, width=width, height=height, rx=radius or None, **style)


def _sum(placed: PlacedBlock, x: float, style: dict[str, Any]) -> list[str]:
    block, cell = placed.block, placed.cell
    out = [_box(x, placed.y, 2.0 * SUM_RADIUS, cell.height, SUM_RADIUS, style)]
    for k, sign in enumerate(block.signs):
        pin = cell.pins[f"in{k}"]
        sign_text = "+" if sign > 0 else "−"
        # the sign of a low or high line is slightly towards the middle
        inner = min(max(pin.y, 7.0), cell.height - 7.0)
        y = placed.y + inner
        near = (8.0 if inner == pin.y else 9.5) + 0.6 * inset(placed, k)
        at = x + near if pin.side == "L" else x + 2.0 * SUM_RADIUS - near
        out.append(text(sign_text, at, y + 4.0, size=12.0, anchor="middle", font_weight="bold"))
    return out


def _inset(y: float) -> float:
    """Return the distance of a circle from the edge of its square at a height."""
    return SUM_RADIUS - math.sqrt(max(SUM_RADIUS**2 - (y - SUM_RADIUS) ** 2, 0.0))


def inset(placed: PlacedBlock, port: int) -> float:
    """Return the distance of the end of an input line from the edge of the cell [px]."""
    block, cell = placed.block, placed.cell
    if block.kind != "sum":
        return 0.5 * (cell.width - shape_width(block))
    y = cell.pins[f"in{port}"].y
    if y < SUM_RADIUS:
        return _inset(y)
    if y > cell.height - SUM_RADIUS:
        return _inset(y - cell.height + 2.0 * SUM_RADIUS)
    return 0.0


def _integrator(
    x: float, y: float, width: float, height: float, style: dict[str, Any]
) -> list[str]:
    middle = x + 0.5 * width
    return [
        _box(x, y, width, height, 0.0, style),
        text("1", middle, y + 0.5 * height - 4.0, anchor="middle"),
        path([(middle - 8.0, y + 0.5 * height), (middle + 8.0, y + 0.5 * height)],
             stroke="#222222", stroke_width=1.1),
        text("s", middle, y + 0.5 * height + 12.5, anchor="middle", font_style="italic"),
    ]  # fmt: skip


def _gain(placed: PlacedBlock, x: float, width: float, style: dict[str, Any]) -> list[str]:
    block, y, height = placed.block, placed.y, placed.cell.height
    middle = y + 0.5 * height
    if block.role in ("spring", "damper"):
        mark = _spring if block.role == "spring" else _damper
        return [
            _box(x, y, width, height, 3.0, style),
            mark(x + 6.0, middle, str(style["stroke"])),
            text(block.label, x + 0.5 * (width + 34.0), middle + 4.0, anchor="middle"),
        ]
    return [
        path(
            [(x, y), (x + width, middle), (x, y + height)], closed=True, stroke_linejoin="round",
            **style,
        ),
        text(block.label, x + 0.35 * width, middle + 4.0, anchor="middle"),
    ]  # fmt: skip


def _spring(x: float, y: float, colour: str) -> str:
    points: list[Point] = [(x, y), (x + 4.0, y)]
    points += [(x + 6.0 + 3.6 * k, y + (5.5 if k % 2 else -5.5)) for k in range(5)]
    points += [(x + 22.4, y), (x + 27.0, y)]
    return path(points, fill="none", stroke=colour, stroke_width=1.4)


def _damper(x: float, y: float, colour: str) -> str:
    style = {"fill": "none", "stroke": colour, "stroke_width": 1.4}
    return (
        path([(x, y), (x + 8.0, y)], **style)
        + path([(x + 19.0, y - 7.0), (x + 8.0, y - 7.0), (x + 8.0, y + 7.0), (x + 19.0, y + 7.0)],
               **style)
        + path([(x + 14.5, y - 4.5), (x + 14.5, y + 4.5)], **style)
        + path([(x + 14.5, y), (x + 27.0, y)], **style)
    )  # fmt: skip


def _model(
    block: Block, x: float, y: float, width: float, height: float, style: dict[str, Any]
) -> list[str]:
    middle_x, middle_y = x + 0.5 * width, y + 0.5 * height
    line = {"fill": "none", "stroke": style["stroke"], "stroke_width": 1.5}
    if block.kind == "amplifier":
        corners = [(x + 6.0, y), (x + width, middle_y), (x + 6.0, y + height)]
        return [
            path(corners, closed=True, stroke_linejoin="round", **style),
            path([(x, middle_y), (x + 6.0, middle_y)], **line),
        ]
    out = [_box(x, y, width, height, 3.0, style)]
    half = 0.5 * height - 7.0
    if block.kind == "hysteresis":
        up = [(t, -math.cos(math.pi * (0.5 + 0.5 * t) ** 1.6)) for t in _steps()]
        down = [(-t, -z) for t, z in up]
        loop = [(middle_x + 18.0 * t, middle_y - half * z) for t, z in up + down]
        out.append(path(loop, closed=True, stroke_linejoin="round", **line))
    elif block.kind == "creep":
        rise = [(1.0 + t) * 0.5 for t in _steps()]
        curve = [
            (x + 8.0 + (width - 16.0) * t, middle_y + half - 2.0 * half * (0.5 + 0.22 * z))
            for t, z in ((t, math.log10(1.0 + 150.0 * t)) for t in rise)
        ]
        out.append(path([(x + 8.0, middle_y + half), *curve], **line))
    else:
        out.append(element("circle", cx=middle_x, cy=middle_y + 5.0, r=half, **line))
        out.append(path([(middle_x, middle_y + 5.0), (middle_x + 8.0, middle_y - 5.0)], **line))
    return out


def _steps(count: int = 17) -> list[float]:
    return [-1.0 + 2.0 * k / (count - 1) for k in range(count)]
