"""Drawing of a stage on one sheet: view, details of notches, tables, title block."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from flexstage.base.version import __version__
from flexstage.export.drawing.canvas import MEDIUM, PAPER, THICK, THIN, Box, Canvas, millimetres
from flexstage.export.drawing.contours import PlateContours, plate_contours
from flexstage.export.drawing.views import (
    CELL,
    View,
    draw_detail,
    draw_view,
    hinge_marks,
    notch_kinds,
    ratio,
    round_openings,
    scale_bar,
)
from flexstage.export.request import StageExport
from flexstage.export.svg import number, text_width, wrapped
from flexstage.stage import Stage

_COLUMN = 2.0 * CELL[0] + PAPER.gap  # width of the column of details and tables [mm]
_TITLE_HEIGHT = 5.0 * PAPER.title_row
_SHEETS = (("A3", 420.0, 297.0), ("A2", 594.0, 420.0), ("A1", 841.0, 594.0), ("A0", 1189.0, 841.0))
_SMALLEST_SCALE = 0.5  # below which a larger sheet is used

_HINGES = (("no.", 9.0), ("name", 18.0), ("x", 14.0), ("y", 14.0), ("dir.", 14.0))
_LONG_NAMES = (("no.", 9.0), ("name", 91.0), ("x", 14.0), ("y", 14.0), ("dir.", 14.0))
_NOTCHES = (("", 7.0), ("n", 8.0), ("profile", 25.0), ("neck", 14.0), ("dimensions", 88.0))
_HOLES = (("no.", 9.0), ("x", 14.0), ("y", 14.0), ("⌀", 11.0), ("type", 24.0))
_PORTS = (
    ("", 11.0),
    ("name", 15.0),
    ("kind", 12.0),
    ("body", 16.0),
    ("x", 14.0),
    ("y", 14.0),
    ("dir.", 14.0),
)


class _Blocks(NamedTuple):
    """The rows of all tables."""

    notches: list[list[str]]
    hinges: list[list[str]]
    holes: list[list[str]]
    ports: list[list[str]]
    notes: list[str]


def drawing_svg(stage: Stage) -> bytes:
    """Return the dimensioned drawing of a stage as SVG.

    It has the plate to scale with overall dimensions, drives, probes and the origin; an enlarged
    detail of every kind of notch, with neck, length, height and radius; tables of notches, hinges,
    holes, drives and probes; scale bar, notes and title block. The sheet is the smallest one from
    A3 to A0 with enough space. Lengths are in millimetres.

    Notes
    -----
    Validity: positions are rounded to a micrometre, dimensions of notches to a nanometre, contours
    to a tenth of a micrometre of paper. The drawing is for reading; use `dxf_files` for cutting.
    Outlines of the bodies have no dimensions.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> "4 ×   circular" in drawing_svg(design("parallelogram")).decode()
    True
    """
    plate = plate_contours(stage)
    kinds = notch_kinds(stage)
    marks = hinge_marks(stage, kinds)
    blocks = _blocks(stage, plate, marks)
    name, width, height, view = _sheet(plate, blocks)
    canvas = Canvas(width, height)
    frame = Box(PAPER.margin, PAPER.margin, width - PAPER.margin, height - PAPER.margin)
    _frame(canvas, frame)
    column = frame.right - PAPER.gap - _COLUMN
    y = frame.top + PAPER.gap
    for k, kind in enumerate(kinds):
        corner = (column + (k % 2) * (CELL[0] + PAPER.gap), y + (k // 2) * CELL[1])
        draw_detail(canvas, corner, kind)
    y += CELL[1] * math.ceil(len(kinds) / 2)
    if blocks.notches:
        y = table(canvas, (column, y), "Notches", _NOTCHES, blocks.notches)
        y = table(canvas, (column, y), "Hinges", *_hinge_layout(blocks))
    _title_block(canvas, frame, stage, name, view.scale)
    _write_notes(canvas, (column, frame.bottom - _TITLE_HEIGHT - _notes_height(blocks)), blocks)
    _lower_left(canvas, frame, blocks, view.scale)
    draw_view(canvas, view, stage, plate, marks)
    about = f"flexstage {__version__}. Lengths in millimetres."
    return canvas.svg(f"{stage.name}: {stage.title}" if stage.title else stage.name, about)


def _blocks(stage: Stage, plate: PlateContours, marks: dict[str, str]) -> _Blocks:
    mm = millimetres
    notches = [
        [k.letter, str(len(k.hinges)), k.profile.kind, mm(k.profile.neck_thickness), k.dimensions]
        for k in notch_kinds(stage)
    ]
    hinges = [
        [marks[h.name], h.name, mm(h.at[0], 3), mm(h.at[1], 3), _degrees(h.direction)]
        for h in stage.hinges
    ]
    holes = [
        [mark, mm(c.centre[0], 3), mm(c.centre[1], 3), mm(2.0 * c.radius, 3), what]
        for mark, c, what in round_openings(plate)
    ]
    port_rows = [("drive", d.name, d.kind, d.pushes, d.at[0], d.direction) for d in stage.drives]
    port_rows += [("probe", p.name, "", p.body, p.at, p.direction) for p in stage.probes]
    ports = [
        [*words, mm(x, 3), mm(y, 3), "rotation" if angle is None else _degrees(angle)]
        for *words, (x, y), angle in port_rows
    ]
    return _Blocks(notches, hinges, holes, ports, _notes(stage))


def _degrees(angle: float) -> str:
    return f"{number(math.degrees(angle), 2)}°"


def _notes(stage: Stage) -> list[str]:
    manufacture = stage.manufacture
    necks = [h.profile.neck_thickness for h in stage.hinges]
    thinnest = f", thinnest neck {millimetres(min(necks))}" if necks else ""
    lines = [
        "Lengths in mm from the origin 0, rounded to 0.001.",
        "Directions anticlockwise from the x axis, rounded to 0.01°.",
        f"Cut through the full thickness of {millimetres(stage.thickness)}. Slots from "
        f"{millimetres(manufacture.wire_width)}{thinnest}.",
        "Marks at hinges: letter of the notch, number in the table of hinges.",
        "The DXF file has contours in full precision.",
        *stage.material_notes,
    ]
    return [
        line
        for text in lines
        for line in wrapped(text, _COLUMN - PAPER.gap, PAPER.font, break_words=True)
    ]


def _hinge_layout(blocks: _Blocks) -> tuple[tuple[tuple[str, float], ...], list[list[str]], int]:
    """Return columns, rows and number of blocks of the table of hinges."""
    room = _HINGES[1][1] - 2.0 * PAPER.pad
    if all(text_width(row[1], PAPER.font) <= room for row in blocks.hinges):
        return _HINGES, blocks.hinges, 2
    return _LONG_NAMES, blocks.hinges, 1


def _hole_blocks(blocks: _Blocks) -> int:
    return 2 if len(blocks.holes) > 5 else 1


def _lower_height(blocks: _Blocks) -> float:
    """Return the height below the view: tables of holes, drives and probes, and scale bar."""
    holes = table_height(len(blocks.holes), _hole_blocks(blocks)) if blocks.holes else 0.0
    ports = table_height(len(blocks.ports)) if blocks.ports else 0.0
    return max(holes, ports + PAPER.bar)


def _notes_height(blocks: _Blocks) -> float:
    return 5.5 + PAPER.row * len(blocks.notes) + 2.0


def _column_height(blocks: _Blocks) -> float:
    height = PAPER.gap + _notes_height(blocks) + _TITLE_HEIGHT
    if blocks.notches:
        height += CELL[1] * math.ceil(len(blocks.notches) / 2)
        height += table_height(len(blocks.notches)) + table_height(
            len(blocks.hinges), _hinge_layout(blocks)[-1]
        )
    return height


def _sheet(plate: PlateContours, blocks: _Blocks) -> tuple[str, float, float, View]:
    """Return the smallest sheet with enough space, and the view on it."""
    column, lower = _column_height(blocks), _lower_height(blocks) + PAPER.gap
    for name, width, height in _SHEETS:
        view = _view(plate, width, height, lower)
        if (
            view is not None
            and view.scale >= _SMALLEST_SCALE
            and column <= height - 2.0 * PAPER.margin
        ):
            return name, width, height, view
    # too much for the largest sheet: a longer one
    _, width, height = _SHEETS[-1]
    height = max(height, math.ceil(2.0 * PAPER.margin + max(column, 2.0 * lower)))
    view = _view(plate, width, height, lower)
    assert view is not None
    return f"{width:.0f} × {height:.0f}", width, height, view


def _view(plate: PlateContours, width: float, height: float, lower: float) -> View | None:
    """Return the view of the plate next to the tables; None if there is too little space."""
    inner = height - 2.0 * PAPER.margin
    if lower > 0.6 * inner:
        return None
    right = width - PAPER.margin - 2.0 * PAPER.gap - _COLUMN
    return View.fitted(plate, Box(PAPER.margin, PAPER.margin, right, height - PAPER.margin - lower))


def _write_notes(canvas: Canvas, at: tuple[float, float], blocks: _Blocks) -> None:
    x, y = at
    canvas.text((x, y + 3.5), "Notes", 3.0, bold=True)
    for k, text in enumerate(blocks.notes, start=1):
        canvas.text((x, y + 4.5 + PAPER.row * k), text, PAPER.font)


def _frame(canvas: Canvas, frame: Box) -> None:
    left, top, right, bottom = frame
    for a, b in pairwise(((left, top), (right, top), (right, bottom), (left, bottom), (left, top))):
        canvas.line(a, b, THICK)


def _title_block(canvas: Canvas, frame: Box, stage: Stage, sheet: str, scale: float) -> None:
    """Draw the title block in the lower right corner."""
    width = _COLUMN + PAPER.gap
    left, top = frame.right - width, frame.bottom - _TITLE_HEIGHT
    half = 0.5 * width
    material = stage.material.name + (", see notes" if stage.other_bodies else "")
    rows = [
        [("", stage.name)],
        [("", stage.title or "-")],
        [("Material", material), ("Thickness", f"{millimetres(stage.thickness)} mm")],
        [("Scale", ratio(scale)), ("Sheet", sheet)],
        [("Units", "mm"), ("Software", f"flexstage {__version__}")],
    ]
    for k, row in enumerate(rows):
        y = top + PAPER.title_row * k
        canvas.line((left, y), (frame.right, y), THICK if k == 0 else MEDIUM)
        for column, (label, text) in enumerate(row):
            x = left + half * column
            room = (width if len(row) == 1 else half) - 2.0
            size = 4.2 if k == 0 else 3.2
            if label:
                canvas.text((x + 1.5, y + 4.2), label, 2.4, colour="#444")
                x, room = x + 18.0, room - 18.0
            lines = wrapped(text, room, size, break_words=True)
            words = lines[0] + ("…" if len(lines) > 1 else "") if lines else "-"
            canvas.text((x + 1.5, y + 4.5), words, size, bold=k == 0)
        if len(row) > 1:
            canvas.line((left + half, y), (left + half, y + PAPER.title_row), MEDIUM)
    canvas.line((left, top), (left, frame.bottom), THICK)


def _lower_left(canvas: Canvas, frame: Box, blocks: _Blocks, scale: float) -> None:
    """Draw the tables of drives, probes and holes below the view, and the scale bar."""
    x, y = frame.left + PAPER.gap, frame.bottom - _lower_height(blocks)
    scale_bar(canvas, (x + 2.0, frame.bottom - 4.0), scale)
    if blocks.ports:
        table(canvas, (x, y), "Drives and probes", _PORTS, blocks.ports)
        x += sum(w for _, w in _PORTS) + PAPER.gap
    else:
        x += PAPER.bar_room
    if blocks.holes:
        table(canvas, (x, y), "Round holes", _HOLES, blocks.holes, _hole_blocks(blocks))


def table_height(rows: int, blocks: int = 1) -> float:
    """Return the height of a table with title and gap [mm]; its rows are in parallel blocks."""
    return PAPER.heading + PAPER.row * (1 + -(-rows // blocks)) + 3.0


def table(
    canvas: Canvas,
    at: tuple[float, float],
    title: str,
    columns: Sequence[tuple[str, float]],
    rows: Sequence[Sequence[str]],
    blocks: int = 1,
) -> float:
    """Draw a table from its upper left corner; return its lower end with a gap [mm].

    Columns are heading and width [mm]. A text too long for its column ends in an ellipsis.
    """
    x0, y0 = at
    canvas.text((x0, y0 + 3.5), title, 3.0, bold=True)
    width = sum(w for _, w in columns)
    per_block = -(-len(rows) // blocks)
    top = y0 + PAPER.heading
    for block in range(blocks):
        part = rows[block * per_block : (block + 1) * per_block]
        if not part:
            continue
        left = x0 + block * (width + 3.0)
        bottom = top + PAPER.row * (1 + len(part))
        for k in range(len(part) + 2):
            weight = MEDIUM if k in (0, 1, len(part) + 1) else 0.5 * THIN
            canvas.line((left, top + PAPER.row * k), (left + width, top + PAPER.row * k), weight)
        x = left
        for column, (heading, w) in enumerate(columns):
            canvas.line((x, top), (x, bottom), MEDIUM if column == 0 else THIN)
            cells = [heading, *(row[column] for row in part)]
            for k, cell in enumerate(cells):
                where = (x + PAPER.pad, top + PAPER.row * (k + 1) - 1.2)
                canvas.text(where, _fitting(cell, w - 2.0 * PAPER.pad), PAPER.font, bold=k == 0)
            x += w
        canvas.line((x, top), (x, bottom), MEDIUM)
    return y0 + table_height(len(rows), blocks)


def _fitting(text: str, width: float) -> str:
    """Return a text, truncated if it is too long."""
    if text_width(text, PAPER.font) <= width:
        return text
    while text and text_width(text + "…", PAPER.font) > width:
        text = text[:-1]
    return text.rstrip() + "…"


def export(stage_export: StageExport) -> dict[str, bytes]:
    """Return the files of the format."""
    return {f"{stage_export.name}-drawing.svg": drawing_svg(stage_export.stage)}
