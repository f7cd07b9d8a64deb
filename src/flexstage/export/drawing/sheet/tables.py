"""Tables, notes and the title block of a drawing."""

from collections.abc import Sequence

from flexstage.export.drawing.sheet.canvas import MEDIUM, THIN, Canvas, text_width

#: Height of a row, and font size [mm].
ROW, SIZE = 4.0, 2.6
_PAD = 0.6
_TITLE = 5.5


def table_height(rows: int, blocks: int = 1) -> float:
    """Return how high a table is, with title and gap [mm]; blocks share its rows, side by side."""
    return _TITLE + ROW * (1 + -(-rows // blocks)) + 3.0


def table(
    canvas: Canvas,
    at: tuple[float, float],
    title: str,
    columns: Sequence[tuple[str, float]],
    rows: Sequence[Sequence[str]],
    blocks: int = 1,
) -> float:
    """Draw a table from its upper left corner on; return where it ends, with a gap [mm].

    Columns are heading and width [mm]. A cell too long for its column ends in an ellipsis.
    """
    x0, y0 = at
    canvas.text((x0, y0 + 3.5), title, 3.0, bold=True)
    width = sum(w for _, w in columns)
    per_block = -(-len(rows) // blocks)
    top = y0 + _TITLE
    for block in range(blocks):
        part = rows[block * per_block : (block + 1) * per_block]
        if not part:
            continue
        left = x0 + block * (width + 3.0)
        bottom = top + ROW * (1 + len(part))
        for k in range(len(part) + 2):
            weight = MEDIUM if k in (0, 1, len(part) + 1) else 0.5 * THIN
            canvas.line((left, top + ROW * k), (left + width, top + ROW * k), weight)
        x = left
        for column, (heading, w) in enumerate(columns):
            canvas.line((x, top), (x, bottom), MEDIUM if column == 0 else THIN)
            cells = [heading, *(row[column] for row in part)]
            for k, cell in enumerate(cells):
                where = (x + _PAD, top + ROW * (k + 1) - 1.2)
                canvas.text(where, _fitting(cell, w - 2.0 * _PAD), SIZE, bold=k == 0)
            x += w
        canvas.line((x, top), (x, bottom), MEDIUM)
    return y0 + table_height(len(rows), blocks)


def fits(text: str, width: float) -> bool:
    """Tell whether a text has room in a column of a width [mm]."""
    return text_width(text, SIZE) <= width - 2.0 * _PAD


def _fitting(text: str, width: float) -> str:
    """Cut a text off where it is too long."""
    if text_width(text, SIZE) <= width:
        return text
    while text and text_width(text + "…", SIZE) > width:
        text = text[:-1]
    return text.rstrip() + "…"


def wrapped(text: str, width: float, size: float = SIZE) -> list[str]:
    """Break a text into lines no wider than a width [mm]; a word longer than a line is broken."""
    lines: list[str] = []
    line = ""
    for word in text.split():
        rest = word
        while rest:
            trial = f"{line} {rest}".strip()
            if text_width(trial, size) <= width:
                line, rest = trial, ""
            elif line:
                lines.append(line)
                line = ""
            else:
                keep = len(rest)
                while keep > 1 and text_width(rest[:keep], size) > width:
                    keep -= 1
                lines.append(rest[:keep])
                rest = rest[keep:]
    return [*lines, line] if line else lines
