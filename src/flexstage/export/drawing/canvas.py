"""Canvas of a drawing sheet: lines, arcs, text and dimensions in millimetres."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from html import escape
from typing import Literal, NamedTuple

from flexstage.export.svg import document, element, number, text_width
from flexstage.stage import Loop

Pair = tuple[float, float]
#: Line widths of technical drawings [mm].
THICK, MEDIUM, THIN = 0.5, 0.25, 0.18


@dataclass(frozen=True, slots=True)
class SheetSizes:
    """Sizes on a sheet [mm], unless a unit is given."""

    rise: float = 0.78
    """Height of the box of a line of text above its base line [font sizes]."""
    fall: float = 0.24
    """Depth of that box below the base line [font sizes]."""
    past: float = 1.5
    """Extension line beyond the dimension line."""
    off: float = 0.8
    """Gap between the part and an extension line, and between a line and its number."""
    tail: float = 5.0
    """Tail of an outside arrow."""
    shortest: float = 6.0
    """Shortest dimension with inside arrows."""
    left: float = 16.0
    """Space on the left of the view for its dimension."""
    below: float = 16.0
    """Space below the view for its dimension."""
    around: float = 5.0
    """Largest distance of labels beyond the plate."""
    label: float = 2.5
    """Font of labels."""
    label_gap: float = 0.5
    """Gap between labels."""
    label_line: float = 4.0
    """Additional distance of a label that is accepted to avoid one crossing line."""
    arrow: float = 9.0
    """Length of the arrow of a drive or a probe."""
    body: float = 3.0
    """Margin of the bodies around a notch."""
    row: float = 4.0
    """Height of a row of a table, and of the notes."""
    font: float = 2.6
    """Font of tables and notes."""
    pad: float = 0.6
    """Margin of the text of a cell."""
    heading: float = 5.5
    """Height of the title of a table."""
    margin: float = 8.0
    """Margin between the edge of the sheet and its frame."""
    gap: float = 4.0
    """Gap between blocks."""
    title_row: float = 6.0
    """Height of a row of the title block, which has five."""
    bar: float = 11.0
    """Height of the scale bar."""
    bar_room: float = 110.0
    """Width of the scale bar."""


PAPER = SheetSizes()


def millimetres(value: float, digits: int = 6) -> str:
    """Return a length [m] in millimetres, without unit and trailing zeros.

    Examples
    --------
    >>> millimetres(0.35e-3), millimetres(-0.0)
    ('0.35', '0')
    """
    return number(value * 1e3, digits)


class Box(NamedTuple):
    """A rectangle on the sheet, y downwards [mm]."""

    left: float
    """Left edge [mm]."""
    top: float
    """Upper edge [mm]."""
    right: float
    """Right edge [mm]."""
    bottom: float
    """Lower edge [mm]."""

    def meets(self, other: "Box", gap: float = 0.0) -> bool:
        """Return whether two boxes overlap or are closer than a gap."""
        return (
            self.left < other.right + gap
            and other.left < self.right + gap
            and self.top < other.bottom + gap
            and other.top < self.bottom + gap
        )


class Canvas:
    """Elements of a drawing; y points down, lengths are in millimetres."""

    def __init__(self, width: float, height: float) -> None:
        self.width, self.height = width, height
        self.boxes: list[Box] = []
        self._parts: list[str] = []

    def line(
        self, a: Pair, b: Pair, width: float = THIN, *, colour: str = "#000", dash: str = ""
    ) -> None:
        """Draw a straight line; `dash` has lengths of dashes and gaps [mm] separated by spaces."""
        (x1, y1), (x2, y2) = a, b
        style = {"stroke": colour, "stroke_width": width, "stroke_dasharray": dash or None}
        self._parts.append(element("line", x1=x1, y1=y1, x2=x2, y2=y2, **style))

    def circle(
        self, centre: Pair, radius: float, width: float = THIN, *, fill: str = "none"
    ) -> None:
        """Draw a circle."""
        x, y = centre
        style = {"fill": fill, "stroke": "#000", "stroke_width": width}
        self._parts.append(element("circle", cx=x, cy=y, r=radius, **style))

    def loops(
        self,
        loops: Iterable[tuple[Loop, bool]],
        place: Callable[[Pair], Pair],
        width: float,
        *,
        fill: str = "none",
    ) -> None:
        """Draw loops of segments and arcs as one shape with holes.

        Each loop has a flag: the last segment of an open one is omitted. Its y points up; `place`
        maps it to the sheet. A width of 0 draws no edge.
        """
        self._parts.append(
            element(
                "path",
                d=" ".join(_path(loop, place, closed) for loop, closed in loops),
                fill=fill,
                fill_rule="evenodd",
                stroke="#000" if width else "none",
                stroke_width=width or None,
                stroke_linejoin="round",
            )
        )

    def arrow(self, tip: Pair, towards: Pair, *, size: float = 2.0, colour: str = "#000") -> None:
        """Draw an arrow head in a direction."""
        length = math.hypot(*towards)
        ux, uy = towards[0] / length, towards[1] / length
        back = (tip[0] - size * ux, tip[1] - size * uy)
        w = size / 6.0
        points = (tip, (back[0] - w * uy, back[1] + w * ux), (back[0] + w * uy, back[1] - w * ux))
        text = " ".join(f"{number(x)},{number(y)}" for x, y in points)
        self._parts.append(element("polygon", points=text, fill=colour))

    def text(
        self,
        at: Pair,
        text: str,
        size: float,
        *,
        anchor: Literal["start", "middle", "end"] = "start",
        upright: bool = False,
        bold: bool = False,
        colour: str = "#000",
    ) -> Box:
        """Draw a line of text; return its box, which is added to `boxes`.

        The anchor of its base line is at the point [mm]; upright text is read from the right.
        """
        box = self.text_box(at, text, size, anchor=anchor, upright=upright)
        if not text:
            return box
        self.boxes.append(box)
        x, y = at
        self._parts.append(
            element(
                "text",
                escape(text),
                x=x,
                y=y,
                font_size=size,
                text_anchor=anchor,
                font_weight="bold" if bold else None,
                fill=None if colour == "#000" else colour,
                transform=f"rotate(-90 {number(x)} {number(y)})" if upright else None,
            )
        )
        return box

    def text_box(
        self, at: Pair, text: str, size: float, *, anchor: str = "start", upright: bool = False
    ) -> Box:
        """Return the box of a line of text."""
        width = text_width(text, size)
        before = {"start": 0.0, "middle": 0.5 * width, "end": width}[anchor]
        x, y = at
        if upright:
            return Box(x - PAPER.rise * size, y - width + before, x + PAPER.fall * size, y + before)
        return Box(x - before, y - PAPER.rise * size, x - before + width, y + PAPER.fall * size)

    def svg(self, title: str, description: str) -> bytes:
        """Return the drawing."""
        return document(
            self.width, self.height, self._parts, title=title, description=description, unit="mm"
        )


def _path(loop: Loop, place: Callable[[Pair], Pair], closed: bool) -> str:
    def point(p: Pair) -> str:
        return " ".join(map(number, place(p)))

    segments = loop.segments()
    parts = [f"M{point(segments[0][0])}"]
    for start, end, bulge in segments if closed else segments[:-1]:
        if bulge:
            chord = math.dist(place(start), place(end))
            radius = number(chord * (1.0 + bulge**2) / (4.0 * abs(bulge)))
            # left turns become right turns with y downwards
            large, sweep = int(abs(bulge) > 1.0), int(bulge < 0.0)
            parts.append(f"A{radius} {radius} 0 {large} {sweep} {point(end)}")
        else:
            parts.append(f"L{point(end)}")
    return " ".join(parts) + ("Z" if closed else "")


def dimension(
    canvas: Canvas, a: Pair, b: Pair, at: float, text: str, *, upright: bool = False
) -> None:
    """Draw the dimension of two points along x, with its line at a height of the sheet [mm].

    If upright, it is the dimension along y, with its line at a distance from the left edge [mm].
    """
    size = 2.8

    def place(along: float, across: float) -> Pair:
        # upright dimensions are read from the right
        return (across, -along) if upright else (along, across)

    ends = sorted((-y, x) if upright else (x, y) for x, y in (a, b))
    for along, across in ends:
        if across != at:
            sign = math.copysign(1.0, at - across)
            canvas.line(
                place(along, across + PAPER.off * sign), place(along, at + PAPER.past * sign)
            )
    first, last = (along for along, _ in ends)
    width = text_width(text, size)
    if last - first >= width + 1.0:
        middle = place(0.5 * (first + last), at - PAPER.off)
        canvas.text(middle, text, size, anchor="middle", upright=upright)
        outside = last - first < PAPER.shortest
    else:
        start = last + PAPER.tail
        canvas.line(place(start, at), place(start + width, at))
        canvas.text(place(start, at - PAPER.off), text, size, upright=upright)
        outside = True
    tail, way = (PAPER.tail, -1.0) if outside else (0.0, 1.0)
    canvas.line(place(first - tail, at), place(last + tail, at))
    canvas.arrow(place(first, at), place(-way, 0.0))
    canvas.arrow(place(last, at), place(way, 0.0))
