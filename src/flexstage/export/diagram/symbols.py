"""Symbols of blocks: circles that add, boxes that integrate, springs, dampers, loops."""

import math
from html import escape
from typing import Any

from flexstage.export.diagram.graph import Block
from flexstage.export.diagram.markup import SMALL, text
from flexstage.export.diagram.page import PlacedBlock
from flexstage.export.diagram.shapes import SUM_RADIUS, shape_width
from flexstage.export.svg import element, path

Colour = str
Point = tuple[float, float]

#: Edge and fill of blocks by what they stand for (M. Okabe, K. Ito, 2002: told apart by all eyes).
COLOURS: dict[str, tuple[Colour, Colour]] = {
    "spring": ("#0072b2", "#e6f2fa"),
    "damper": ("#007d5c", "#e3f4ee"),
    "mass": ("#6f4a8e", "#f1ebf6"),
    "drive": ("#a85000", "#fdf1e3"),
    "": ("#333333", "#ffffff"),
}


def symbol(placed: PlacedBlock) -> str:
    """Draw a block; its title, which browsers show over it, is its meaning."""
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
    """Lines from the edges of a cell to a shape that is narrower."""
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
        shown = "+" if sign > 0 else "−"
        # a line that meets the rim low or high is told by a sign a little towards the middle
        inner = min(max(pin.y, 7.0), cell.height - 7.0)
        y = placed.y + inner
        near = (8.0 if inner == pin.y else 9.5) + 0.6 * inset(placed, k)
        at = x + near if pin.side == "L" else x + 2.0 * SUM_RADIUS - near
        out.append(text(shown, at, y + 4.0, size=12.0, anchor="middle", font_weight="bold"))
    return out


def _inset(y: float) -> float:
    """How far a circle lies inside its square at a height."""
    return SUM_RADIUS - math.sqrt(max(SUM_RADIUS**2 - (y - SUM_RADIUS) ** 2, 0.0))


def inset(placed: PlacedBlock, port: int) -> float:
    """Return how far inside its cell a block is met by the line of an input [px]."""
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
    if block.matrix is not None and block.matrix.shape == (1, 1):
        corners = [(x, y), (x + width, middle), (x, y + height)]
        at = x + 0.35 * width
        if placed.flipped:
            corners = [(x + width, y), (x, middle), (x + width, y + height)]
            at = x + 0.65 * width
        return [
            path(corners, closed=True, stroke_linejoin="round", **style),
            text(block.label, at, middle + 4.0, anchor="middle"),
        ]
    return [
        _box(x, y, width, height, 3.0, style),
        text(block.label, x + 0.5 * width, middle + 4.0, anchor="middle"),
    ]


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
