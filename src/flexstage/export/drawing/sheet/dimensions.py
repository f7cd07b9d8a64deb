"""Dimensions on a drawing: lines with arrows between two extension lines, and their numbers."""

from flexstage.export.drawing.sheet.canvas import THIN, Canvas, text_width

Pair = tuple[float, float]

_PAST = 1.5  # how far an extension line goes on past the dimension line [mm]
_OFF = 0.8  # gap between the part and an extension line [mm]
_TAIL = 5.0  # tail of an arrow that stands outside [mm]


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
