"""Characteristics as an Excel workbook."""

import datetime
import io
import math
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import flexstage
from flexstage.characteristic import Characteristic
from flexstage.comparison import Comparison, ComparisonRow, title_of
from flexstage.quantities import Quantity

if TYPE_CHECKING:
    from xlsxwriter.workbook import Workbook
    from xlsxwriter.worksheet import Worksheet

_MADE = datetime.datetime(1980, 1, 1)  # the same table gives the same file
_WIDEST = 60  # characters
_COLUMN = 15  # characters of a column of figures
_LINE = 15.0  # points, of a line of the usual letters
_FULL = ("quantity", "axis", "origin", "value", "unit", "uncertainty", "degrees of freedom", "note")


def workbook(
    title: str,
    characteristics: Sequence[Characteristic],
    table: Comparison,
    display: Callable[[str], Quantity],
    about: Mapping[str, str],
    notes: Sequence[str],
) -> bytes:
    """Write a workbook of three sheets; no text in it is ever a formula, a link or a number.

    ``Figures`` side by side in the units that people use, ``Values`` one a row in SI with all
    digits, and ``Provenance``.
    """
    from xlsxwriter import Workbook as Book

    content = io.BytesIO()
    # texts are written as such, never by what they look like
    with Book(content, {"in_memory": True}) as book:
        book.set_properties(
            {
                "title": title,
                "comments": f"Written by flexstage {flexstage.__version__}",
                "created": _MADE,
            }
        )
        styles = _styles(book)
        _figures(book.add_worksheet("Figures"), title, table, display, styles)
        _values(book.add_worksheet("Values"), characteristics, styles)
        _provenance(book.add_worksheet("Provenance"), title, about, notes, styles)
    return content.getvalue()


def _styles(book: "Workbook") -> dict[str, Any]:
    return {
        "title": book.add_format({"bold": True, "font_size": 14}),
        "head": book.add_format(
            {"bold": True, "bottom": 1, "text_wrap": True, "valign": "top", "bg_color": "#E8EDF2"}
        ),
        "text": book.add_format({"valign": "top"}),
        "wrap": book.add_format({"valign": "top", "text_wrap": True}),
        "right": book.add_format({"valign": "top", "align": "right"}),
        "full": book.add_format({"valign": "top", "num_format": "0.000000E+00"}),
        "percent": book.add_format({"valign": "top", "num_format": "+0.0;\\-0.0;0.0"}),
        "book": book,
        "numbers": {},
    }


def _number_style(styles: dict[str, Any], value: float, digits: int) -> Any:
    """Some significant digits, as people read them; the cell itself keeps all."""
    exponent = math.floor(math.log10(abs(value))) if value and math.isfinite(value) else 0
    form = f"0.{'0' * (digits - 1)}E+00"
    if -3 <= exponent < 6:
        decimals = max(digits - 1 - exponent, 0)
        form = "0" if decimals == 0 else "0." + "0" * decimals
    if form not in styles["numbers"]:
        styles["numbers"][form] = styles["book"].add_format({"valign": "top", "num_format": form})
    return styles["numbers"][form]


def _put(sheet: "Worksheet", row: int, column: int, value: object, style: Any) -> None:
    if value is None:
        sheet.write_blank(row, column, None, style)
    elif isinstance(value, float) and math.isfinite(value):
        sheet.write_number(row, column, value, style)
    else:  # a cell cannot hold what is not finite
        sheet.write_string(row, column, str(value), style)


def _figures(
    sheet: "Worksheet",
    title: str,
    table: Comparison,
    display: Callable[[str], Quantity],
    styles: dict[str, Any],
) -> None:
    sheet.write_string(0, 0, title, styles["title"])
    columns: list[tuple[str, str]] = []
    for origin in table.columns:
        columns.append(("value", origin))
        if origin in table.uncertain:
            columns.append(("uncertainty", origin))
    # of ours, what leaves least out is set against what was published
    pairs = [(table.best, o) for o in table.published] if table.best != "virtual" else []
    head = ["Quantity", "Axis", "Unit", "Condition"]
    for kind, origin in columns:
        name = title_of(origin)
        head.append(name if kind == "value" else f"± {name} (standard)")
    head += [f"{title_of(a)} against {title_of(b)} [%]" for a, b in pairs]
    for column, name in enumerate(head):
        sheet.write_string(2, column, name, styles["head"])
    # only Excel makes a row as high as its text by itself
    sheet.set_row(2, _LINE * max(_lines(name) for name in head[4:] or head))
    for line, row in enumerate(table.rows, start=3):
        how = display(row.quantity)
        for column, text in enumerate((how.label, row.axis, how.shown_unit, row.remark)):
            sheet.write_string(line, column, text, styles["wrap" if column == 3 else "text"])
        for column, (kind, origin) in enumerate(columns, start=4):
            cell = row.cells.get(origin)
            value = None if cell is None else getattr(cell, kind)
            if value is None:
                continue
            seen = value * how.factor
            if kind == "value" and abs(value) < how.zero:
                sheet.write_string(line, column, "≈ 0", styles["right"])
            else:
                style = _number_style(styles, seen, 4 if kind == "value" else 2)
                _put(sheet, line, column, seen, style)
            if kind == "value" and cell is not None and cell.note:
                sheet.write_comment(line, column, cell.note, {"x_scale": 2.0})
        for column, (ours, other) in enumerate(pairs, start=4 + len(columns)):
            if (more := _difference(row, ours, other)) is not None:
                sheet.write_number(line, column, more, styles["percent"])
    sheet.freeze_panes(3, 2)
    conditions = any(row.remark for row in table.rows)
    for column, width in enumerate((34, 8, 8, 40 if conditions else 11)):
        sheet.set_column(column, column, width)
    sheet.set_column(4, len(head) - 1, _COLUMN)
    sheet.set_landscape()
    sheet.fit_to_pages(1, 0)
    sheet.repeat_rows(2)


def _lines(title: str) -> int:
    """Lines that a title is broken into, words being kept whole."""
    # bold letters are wider than the digits that a width counts
    return max(len(textwrap.wrap(title, _COLUMN - 3)), 1)


def _difference(row: ComparisonRow, ours: str, other: str) -> float | None:
    """Percent by which one is above another; None where that says nothing."""
    found = row.difference_percent(ours, other)
    return None if found is None or not math.isfinite(found) else found


def _values(
    sheet: "Worksheet", characteristics: Iterable[Characteristic], styles: dict[str, Any]
) -> None:
    for column, name in enumerate(_FULL):
        sheet.write_string(0, column, name, styles["head"])
    last = 0
    for line, c in enumerate(characteristics, start=1):
        row = (c.quantity, c.axis, c.origin, c.value, c.unit, c.uncertainty)
        for column, value in enumerate((*row, c.degrees_of_freedom, c.note)):
            style = styles["full" if column in (3, 5) else "wrap" if column == 7 else "text"]
            if value is not None:
                _put(sheet, line, column, value, style)
        last = line
    sheet.freeze_panes(1, 0)
    sheet.autofilter(0, 0, last, len(_FULL) - 1)
    for column, width in enumerate((28, 8, 20, 16, 8, 16, 12, _WIDEST)):
        sheet.set_column(column, column, width)


def _provenance(
    sheet: "Worksheet",
    title: str,
    about: Mapping[str, str],
    notes: Sequence[str],
    styles: dict[str, Any],
) -> None:
    sheet.write_string(0, 0, title, styles["title"])
    line = 2
    for name, value in about.items():
        sheet.write_string(line, 0, name, styles["text"])
        sheet.write_string(line, 1, value, styles["wrap"])
        line += 1
    for k, note in enumerate(notes):
        sheet.write_string(line + 1 + k, 0, "validity" if k == 0 else "", styles["text"])
        sheet.write_string(line + 1 + k, 1, note, styles["wrap"])
    sheet.set_column(0, 0, 24)
    sheet.set_column(1, 1, 100)
