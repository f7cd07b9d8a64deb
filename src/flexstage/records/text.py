"""Text files of numbers in columns: CSV, tabs, spaces; with any decimal sign, and of LabVIEW."""

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.records.columns import FileColumn, FileColumns, complex_parts, labelled
from flexstage.records.read_options import TextLayout
from flexstage.records.text_rows import (
    COMMENT_MARKS,
    COMPLEX,
    NUMBER,
    STAMP,
    X_VALUE,
    Heading,
    RowLayout,
    day,
    first_row,
    heading_of,
    is_comment,
    is_missing,
    row_of,
    text_lines,
)

_OPEN_DATES = (
    "; dates such as {} may begin with the month or the day, and none of them is unambiguous: "
    "write them as 2026-05-31"
)
#: Largest number of stored letters of a text.
_LETTERS = 30


@dataclass(slots=True, eq=False)
class _Table:
    """Rows of a file, and the text next to its numbers."""

    values: Array
    lines: list[int] = field(default_factory=list)
    words: dict[tuple[int, int], str] = field(default_factory=dict)
    remarks: list[tuple[int, str]] = field(default_factory=list)


def read_text(path: Path, how: TextLayout) -> FileColumns:
    """Read the columns of a text file.

    Delimiter and decimal sign are recognised if not given. An empty field is not a number (NaN),
    nor is text, which is stored separately.
    """
    delimiters = _delimiters(how.delimiter)
    lines = text_lines(path)
    if lines[-1].strip() == "END":  # a network analyser writes between BEGIN and END
        lines.pop()
    row = first_row(lines, how.skip, delimiters, how.decimal)
    if row is None:
        raise RecordError(f"'{path}' contains no numeric rows: is it the right file?")
    first, layout = row
    heading = heading_of(lines[how.skip : first], layout.width, layout.delimiter)
    if layout.trailing and not heading.names:
        # the last column has a name but no values
        wider = heading_of(lines[how.skip : first], layout.width + 1, layout.delimiter)
        heading = replace(wider, names=wider.names[:-1], units=wider.units[:-1])
    one_name = len(heading.names) != 2 and lines[first - 1].strip().count(",") == 0
    if layout.delimiter == "," and layout.width == 2 and how.delimiter is how.decimal is None:
        layout, heading = _one_or_two(lines, first, layout, heading, one_name and first > how.skip)
    return _columns(_without_last(_numbers(lines, first, layout)), heading, layout)


def _delimiters(requested: str | None) -> tuple[str | None, ...]:
    """Return the possible delimiters of columns; None is any white space."""
    if requested is None:
        return ("\t", ";", ",", None)
    if len(requested) != 1 or requested.isalnum() or requested in '+-."\n\r':
        raise RecordError(
            "the delimiter must be one character, or tab, comma, semicolon or space, got "
            f"{requested!r}"
        )
    return (None if requested == " " else requested,)


def _one_or_two(
    lines: list[str], first: int, layout: RowLayout, heading: Heading, one_name: bool
) -> tuple[RowLayout, Heading]:
    """Distinguish one column of decimal commas from two columns of integers, by the heading."""
    sample = [line for line in lines[first : first + 200] if line.strip()]
    if one_name and all(re.fullmatch(r"\s*[+-]?\d+,\d+\s*", line) for line in sample):
        single = RowLayout(delimiter=None, comma=True, width=1, trailing=False)
        return single, heading_of(lines[:first], 1, None)
    return layout, heading


def _numbers(lines: list[str], first: int, layout: RowLayout) -> _Table:
    """Read the rows, one by one if the fast reader refuses them."""
    body = lines[first:]
    if layout.trailing:
        mark = layout.delimiter or ""
        body = [line.rstrip().removesuffix(mark.strip() or mark) for line in body]
    block = "\n".join(body)
    # the decimal sign, even if only some numbers have decimals
    comma = layout.delimiter != "," and "," in block
    plain = not (layout.words and any(m in block for m in COMMENT_MARKS if m != layout.delimiter))
    if plain and not (layout.stamps or '"' in block or (comma and "." in block)):
        table = _text_columns(lines, first, layout) if layout.words else _Table(np.zeros(0))
        used = [j for j in range(layout.width) if j not in layout.words]
        try:
            with io.StringIO(block.replace(",", ".") if comma else block) as stream:
                values = np.loadtxt(
                    stream,
                    delimiter=layout.delimiter,
                    comments=None,
                    ndmin=2,
                    dtype=np.float64,
                    usecols=used if layout.words else None,
                )
            if table is not None and values.shape[1] == len(used):
                table.values = np.full((values.shape[0], layout.width), np.nan)
                table.values[:, used] = values
                return table
        except ValueError:
            pass
    return _numbers_slowly(lines, first, layout)


def _without_last(table: _Table) -> _Table:
    """Remove rows of empty fields at the end, as oscilloscopes write them."""
    numeric = np.flatnonzero(np.isfinite(table.values).any(axis=1))
    last_number = int(numeric[-1]) if numeric.size else -1
    last = max(last_number, max((row for row, _ in table.words), default=-1))
    table.values = table.values[: last + 1]
    table.lines = table.lines[: last + 1]
    return table


def _text_columns(lines: list[str], first: int, layout: RowLayout) -> _Table | None:
    """Return the text of plain rows without their numbers; None if a row differs."""
    table = _Table(np.zeros(0))
    for number, line in enumerate(lines[first:], start=first + 1):
        if not line.strip():
            continue
        fields = line.split(layout.delimiter)
        if len(fields) != layout.width + layout.trailing:
            return None
        for j in layout.words:
            text = fields[j].strip()
            if not is_missing(text):
                table.words[len(table.lines), j] = _stored_text(text)
        table.lines.append(number)
    return table


def _numbers_slowly(lines: list[str], first: int, layout: RowLayout) -> _Table:
    rows: list[list[float]] = []
    table = _Table(np.zeros(0))
    signs: dict[str, int] = {}
    for number, line in enumerate(lines[first:], start=first + 1):
        if not line.strip() or is_comment(line, layout.delimiter):
            continue
        fields, remark = row_of(line, layout.delimiter)
        fields, excess = _fitted(fields, number, layout)
        if remark or excess:
            table.remarks.append((number, remark or excess))
        row = []
        for j, text in enumerate(fields):
            value = _value(text, j, layout)
            if value is None:
                table.words[len(rows), j] = _stored_text(text)
            elif j not in layout.stamps:
                signs |= {sign: number for sign in ".," if sign in text and sign not in signs}
            row.append(np.nan if value is None else value)
        if len(signs) > 1:
            raise RecordError(
                f"line {number} has a decimal comma where others have a point, or a thousands "
                "separator: write the numbers with one decimal sign"
            )
        rows.append(row)
        table.lines.append(number)
    table.values = np.array(rows, dtype=np.float64).reshape(len(rows), layout.width)
    return table


def _fitted(fields: list[str], number: int, layout: RowLayout) -> tuple[list[str], str]:
    """Return a field for each column, and the text after the last."""
    count, width = len(fields), layout.width
    excess = fields[width:]
    if any(NUMBER.fullmatch(f) for f in excess) or not layout.words.issuperset(range(count, width)):
        raise RecordError(
            f"line {number} has {count} columns where the first row has {width}: correct the line, "
            "or skip lines above it by --text skip=N"
        )
    return fields[:width] + [""] * (width - count), " ".join(excess).strip()


def _value(text: str, column: int, layout: RowLayout) -> float | None:
    """Return the number in a field, NaN if it is missing; None for a text."""
    if is_missing(text):
        return np.nan
    if column in layout.stamps:
        return _seconds(text, layout)
    return float(text.replace(",", ".")) if NUMBER.fullmatch(text) else None


def _stored_text(text: str) -> str:
    return text if COMPLEX.fullmatch(text) else text[:_LETTERS]


def _seconds(text: str, layout: RowLayout) -> float | None:
    """Return a date or a time of day, in seconds from the beginning of the first day.

    Counted from that day, and not from 1970, a float resolves nanoseconds.
    """
    date, stamp = day(text, layout.month_first), STAMP.fullmatch(text)
    if stamp is None or date < 0:
        return None
    hours = int(stamp["h"])
    if stamp["half"]:
        hours = hours % 12 + 12 * (stamp["half"] == "P")
    seconds = float(stamp["s"].replace(",", "."))
    return 86400.0 * (date - layout.first_day) + 3600.0 * hours + 60.0 * int(stamp["min"]) + seconds


def _columns(table: _Table, heading: Heading, layout: RowLayout) -> FileColumns:
    names: Sequence[str] = _x_named(heading.names, table.values) or [""] * layout.width
    units: Sequence[str] = heading.units or [""] * layout.width
    notes = _remarks(table)
    columns: list[FileColumn] = []
    for j in range(layout.width):
        numbers = np.ascontiguousarray(table.values[:, j])
        if heading.empty_first and j == 0 and np.isnan(numbers).all():
            continue
        column = labelled(names[j] or f"column {j}", numbers, units[j])
        if j in layout.stamps:
            origin = numbers[np.isfinite(numbers).argmax()]
            column = FileColumn(name=column.name, values=numbers - origin, unit="s")
            notes.append(f"dates of '{column.name}' are read as seconds after the first")
        words = {row: text for (row, at), text in table.words.items() if at == j}
        if words and all(map(COMPLEX.fullmatch, words.values())):
            imaginary = np.where(np.isfinite(numbers), 0.0, np.nan)
            for row, text in words.items():
                value = complex(re.sub(r"\s", "", text.lower()).replace(",", ".").replace("i", "j"))
                numbers[row], imaginary[row] = value.real, value.imag
            columns += complex_parts(column, imaginary)
            continue
        if words:
            texts = np.zeros(numbers.size, dtype=f"<U{max(map(len, words.values()))}")
            texts[list(words)] = list(words.values())
            column = replace(column, words=texts)
        columns.append(column)
    dates = (f"'{text}'" for text in table.words.values() if "/" in text and STAMP.fullmatch(text))
    example = next(dates, "")
    return FileColumns(
        columns=tuple(columns),
        hint=example and _OPEN_DATES.format(example),
        sample_rate_hz=None if heading.interval is None else 1.0 / heading.interval,
        start=heading.start,
        rate_source=heading.interval_source,
        notes=tuple(notes),
        attributes={"heading": heading.text} if heading.text else {},
        lines=np.array(table.lines) if table.words else None,
    )


def _x_named(names: Sequence[str], values: Array) -> Sequence[str]:
    """Return names of columns for which LabVIEW wrote times before each channel.

    The times of the first channel are used for all with equal times.
    """
    xs = [j for j, name in enumerate(names) if name == X_VALUE]
    if len(xs) < 2:
        return names
    # a channel that ends before others has no times there
    apart = np.abs(values[:, xs] - values[:, xs[:1]])
    same = bool(np.all((apart == 0.0) | np.isnan(apart))) and np.isfinite(values[:, xs[0]]).all()
    return [
        f"{X_VALUE} of {names[j + 1]}" if j in xs[int(same) :] and j + 1 < len(names) else name
        for j, name in enumerate(names)
    ]


def _remarks(table: _Table) -> list[str]:
    if not table.remarks:
        return []
    number, text = table.remarks[0]
    return [
        f"skipped text after the numbers of {len(table.remarks)} rows, such as "
        f"'{text[:_LETTERS]}' in line {number}"
    ]
