"""A sheet of paper for lines, arcs, words and dimensions, written as SVG in millimetres."""

import math
from collections.abc import Callable, Iterable
from html import escape
from typing import Literal, NamedTuple

from flexstage.export.svg_elements import LetterWidths, attributes
from flexstage.stage import Loop

Pair = tuple[float, float]
#: Widths of lines on technical drawings [mm].
THICK, MEDIUM, THIN = 0.5, 0.25, 0.18
#: Height of the box of a line of text, in font sizes; and how far it reaches below the baseline.
_RISE, _FALL = 0.78, 0.24
_WIDTHS = LetterWidths(
    narrow_letters=frozenset("iljtfrI.,:;'|!()[]/ -"),
    wide_letters=frozenset("mwMW%@"),
    narrow=0.42,
    wide=1.0,
    digit=0.65,
    other=0.72,
)
_PAST = 1.5  # how far an extension line goes on past the dimension line [mm]
_OFF = 0.8  # gap between the part and an extension line [mm]
_TAIL = 5.0  # tail of an arrow that stands outside [mm]


class Box(NamedTuple):
    """A rectangle on the sheet, y downwards [mm]."""

    left: float
    """Its left edge [mm]."""
    top: float
    """Its upper edge [mm]."""
    right: float
    """Its right edge [mm]."""
    bottom: float
    """Its lower edge [mm]."""

    def meets(self, other: "Box", gap: float = 0.0) -> bool:
        """Tell whether two boxes overlap, or come nearer than a gap."""
        return (
            self.left < other.right + gap
            and other.left < self.right + gap
            and self.top < other.bottom + gap
            and other.top < self.bottom + gap
        )


def text_width(text: str, size: float) -> float:
    """Return about how wide a line of text is in a sans-serif face [mm], rather too much.

    Examples
    --------
    >>> round(text_width("R1.5", 2.8), 2)
    6.83
    """
    return _WIDTHS.of(text, size)


class Canvas:
    """Collects the elements of a drawing; y points down, lengths in millimetres."""

    def __init__(self, width: float, height: float) -> None:
        self.width, self.height = width, height
        self.boxes: list[Box] = []
        self._parts: list[str] = []

    def line(
        self, a: Pair, b: Pair, width: float = THIN, *, colour: str = "#000", dash: str = ""
    ) -> None:
        """Draw a straight line; `dash` has lengths of dashes and gaps [mm], spaces between."""
        (x1, y1), (x2, y2) = a, b
        ends = attributes(x1=_n(x1), y1=_n(y1), x2=_n(x2), y2=_n(y2))
        style = attributes(stroke=colour, stroke_width=str(width), stroke_dasharray=dash or None)
        self._parts.append(f"<line{ends}{style}/>")

    def circle(
        self, centre: Pair, radius: float, width: float = THIN, *, fill: str = "none"
    ) -> None:
        """Draw a circle."""
        place = attributes(cx=_n(centre[0]), cy=_n(centre[1]), r=_n(radius))
        style = attributes(fill=fill, stroke="#000", stroke_width=str(width))
        self._parts.append(f"<circle{place}{style}/>")

    def loops(
        self,
        loops: Iterable[tuple[Loop, bool]],
        place: Callable[[Pair], Pair],
        width: float,
        *,
        fill: str = "none",
    ) -> None:
        """Draw lines of segments and arcs as one shape; holes in it stay empty.

        A loop comes with whether it is closed: of an open one the last segment is left out. It has
        y upwards, and `place` maps it to the sheet, which turns y over. A width of 0 draws no edge.
        """
        d = " ".join(_path(loop, place, closed) for loop, closed in loops)
        style = attributes(
            fill=fill,
            fill_rule="evenodd",
            stroke="#000" if width else "none",
            stroke_width=str(width) if width else None,
            stroke_linejoin="round",
        )
        self._parts.append(f"<path{attributes(d=d)}{style}/>")

    def arrow(self, tip: Pair, towards: Pair, *, size: float = 2.0, colour: str = "#000") -> None:
        """Draw the head of an arrow, which points along a direction of any length."""
        length = math.hypot(*towards)
        ux, uy = towards[0] / length, towards[1] / length
        back = (tip[0] - size * ux, tip[1] - size * uy)
        w = size / 6.0
        points = (tip, (back[0] - w * uy, back[1] + w * ux), (back[0] + w * uy, back[1] - w * ux))
        text = " ".join(f"{_n(x)},{_n(y)}" for x, y in points)
        self._parts.append(f"<polygon{attributes(points=text, fill=colour)}/>")

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
        """Write a line of text, and return the room that it takes, which is kept in `boxes`.

        The anchor says what of its base line is at the point [mm]; upright text is read from the
        right.
        """
        box = self.text_box(at, text, size, anchor=anchor, upright=upright)
        if not text:
            return box
        self.boxes.append(box)
        x, y = _n(at[0]), _n(at[1])
        style = attributes(
            font_size=_n(size),
            text_anchor=anchor,
            font_weight="bold" if bold else None,
            fill=None if colour == "#000" else colour,
            transform=f"rotate(-90 {x} {y})" if upright else None,
        )
        self._parts.append(f"<text{attributes(x=x, y=y)}{style}>{escape(text)}</text>")
        return box

    def text_box(
        self, at: Pair, text: str, size: float, *, anchor: str = "start", upright: bool = False
    ) -> Box:
        """Return the room that a line of text would take."""
        width = text_width(text, size)
        before = {"start": 0.0, "middle": 0.5 * width, "end": width}[anchor]
        x, y = at
        if upright:
            return Box(x - _RISE * size, y - width + before, x + _FALL * size, y + before)
        return Box(x - before, y - _RISE * size, x - before + width, y + _FALL * size)

    def svg(self, title: str, description: str) -> bytes:
        """Return the drawing."""
        w, h = _n(self.width), _n(self.height)
        head = (
            '<?xml version="1.0" encoding="UTF-8"?>\n'
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{w}mm" height="{h}mm" '
            f'viewBox="0 0 {w} {h}" font-family="Liberation Sans, Arial, Helvetica, sans-serif">\n'
            f"<title>{escape(title)}</title>\n<desc>{escape(description)}</desc>\n"
            f'<rect width="{w}" height="{h}" fill="#fff"/>\n'
        )
        return (head + "\n".join(self._parts) + "\n</svg>\n").encode()


def _n(value: float) -> str:
    """Write a length to a tenth of a micrometre of paper."""
    text = f"{value:.4f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _path(loop: Loop, place: Callable[[Pair], Pair], closed: bool) -> str:
    segments = loop.segments()
    x, y = place(segments[0][0])
    parts = [f"M{_n(x)} {_n(y)}"]
    for first, last, bulge in segments if closed else segments[:-1]:
        start, end = place(first), place(last)
        if bulge:
            radius = math.dist(start, end) * (1.0 + bulge**2) / (4.0 * abs(bulge))
            # what turns left with y upwards turns right with y downwards
            large, sweep = int(abs(bulge) > 1.0), int(bulge < 0.0)
            parts.append(f"A{_n(radius)} {_n(radius)} 0 {large} {sweep} {_n(end[0])} {_n(end[1])}")
        else:
            parts.append(f"L{_n(end[0])} {_n(end[1])}")
    return " ".join(parts) + ("Z" if closed else "")


def horizontal(canvas: Canvas, a: Pair, b: Pair, y: float, text: str, size: float = 2.8) -> None:
    """Draw the distance of two points along x, a on the left, with its line at y [mm]."""
    for x, from_y in (a, b):
        sign = 1.0 if y > from_y else -1.0
        canvas.line((x, from_y + _OFF * sign), (x, y + _PAST * sign))
    width = text_width(text, size)
    if b[0] - a[0] >= width + 1.0:
        canvas.text((0.5 * (a[0] + b[0]), y - 0.8), text, size, anchor="middle")
        _arrows(canvas, (a[0], y), (b[0], y), outside=b[0] - a[0] < 6.0)
    else:
        _arrows(canvas, (a[0], y), (b[0], y), outside=True)
        canvas.line((b[0] + _TAIL, y), (b[0] + _TAIL + width, y))
        canvas.text((b[0] + _TAIL, y - 0.8), text, size)


def vertical(canvas: Canvas, a: Pair, b: Pair, x: float, text: str, size: float = 2.8) -> None:
    """Draw the distance of two points along y, a above, with its line at x [mm]."""
    for from_x, y in (a, b):
        if x != from_x:
            sign = 1.0 if x > from_x else -1.0
            canvas.line((from_x + _OFF * sign, y), (x + _PAST * sign, y))
    width = text_width(text, size)
    if b[1] - a[1] >= width + 1.0:
        canvas.text((x - 0.8, 0.5 * (a[1] + b[1])), text, size, anchor="middle", upright=True)
        _arrows(canvas, (x, a[1]), (x, b[1]), outside=b[1] - a[1] < 6.0)
    else:
        _arrows(canvas, (x, a[1]), (x, b[1]), outside=True)
        canvas.line((x, a[1] - _TAIL), (x, a[1] - _TAIL - width))
        canvas.text((x - 0.8, a[1] - _TAIL), text, size, upright=True)


def _arrows(canvas: Canvas, a: Pair, b: Pair, *, outside: bool) -> None:
    """Draw a dimension line with its arrows between its ends, or outside where there is no room."""
    length = max(abs(b[0] - a[0]), abs(b[1] - a[1]))
    ux, uy = (b[0] - a[0]) / length, (b[1] - a[1]) / length
    if not outside:
        canvas.line(a, b, THIN)
        canvas.arrow(a, (-ux, -uy))
        canvas.arrow(b, (ux, uy))
        return
    canvas.line((a[0] - _TAIL * ux, a[1] - _TAIL * uy), (b[0] + _TAIL * ux, b[1] + _TAIL * uy))
    canvas.arrow(a, (ux, uy))
    canvas.arrow(b, (-ux, -uy))
