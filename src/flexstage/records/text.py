"""Text files of numbers in columns: CSV, tabs, spaces; of any country and of LabVIEW."""

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
    "; dates such as {} may begin with the month or the day, and none of them tells: write them as "
    "2026-05-31"
)
#: Letters of a text that are kept to tell it by.
_LETTERS = 30


@dataclass(slots=True, eq=False)
class _Table:
    """The rows of a file, and the text that stands beside the numbers."""

    values: Array
    lines: list[int] = field(default_factory=list)
    words: dict[tuple[int, int], str] = field(default_factory=dict)
    remarks: list[tuple[int, str]] = field(default_factory=list)


def read_text(path: Path, how: TextLayout) -> FileColumns:
    """Read the columns of a text file.

    Delimiter and decimal sign are found where not given. An empty field is not a number (NaN), nor
    is text, which is kept beside.
    """
    delimiters = _delimiters(how.delimiter)
    lines = text_lines(path)
    if lines[-1].strip() == "END":  # of what a network analyser writes between BEGIN and END
        lines.pop()
    row = first_row(lines, how.skip, delimiters, how.decimal)
    if row is None:
        raise RecordError(f"'{path}' has no row of numbers: is it the file that was meant?")
    first, layout = row
    heading = heading_of(lines[how.skip : first], layout.width, layout.delimiter)
    if layout.trailing and not heading.names:
        # the name of a last column in which nothing stands
        wider = heading_of(lines[how.skip : first], layout.width + 1, layout.delimiter)
        heading = replace(wider, names=wider.names[:-1], units=wider.units[:-1])
    one_name = len(heading.names) != 2 and lines[first - 1].strip().count(",") == 0
    if layout.delimiter == "," and layout.width == 2 and how.delimiter is how.decimal is None:
        layout, heading = _one_or_two(lines, first, layout, heading, one_name and first > how.skip)
    return _columns(_without_last(_numbers(lines, first, layout)), heading, layout)


def _delimiters(wanted: str | None) -> tuple[str | None, ...]:
    """Return what may divide the columns; None is any white space."""
    if wanted is None:
        return ("\t", ";", ",", None)
    if len(wanted) != 1 or wanted.isalnum() or wanted in '+-."\n\r':
        raise RecordError(
            f"columns are divided by one sign, or tab, comma, semicolon, space, got {wanted!r}"
        )
    return (None if wanted == " " else wanted,)


def _one_or_two(
    lines: list[str], first: int, layout: RowLayout, heading: Heading, one_name: bool
) -> tuple[RowLayout, Heading]:
    """Tell one column of decimal commas from two columns of integers, by the heading."""
    sample = [line for line in lines[first : first + 200] if line.strip()]
    if one_name and all(re.fullmatch(r"\s*[+-]?\d+,\d+\s*", line) for line in sample):
        single = RowLayout(delimiter=None, comma=True, width=1, trailing=False)
        return single, heading_of(lines[:first], 1, None)
    return layout, heading


def _numbers(lines: list[str], first: int, layout: RowLayout) -> _Table:
    """Read the rows; those that a fast reader refuses are read one by one, to say why."""
    body = lines[first:]
    if layout.trailing:
        mark = layout.delimiter or ""
        body = [line.rstrip().removesuffix(mark.strip() or mark) for line in body]
    block = "\n".join(body)
    # the sign in numbers of which only some have decimals
    comma = layout.delimiter != "," and "," in block
    plain = not (layout.words and any(m in block for m in COMMENT_MARKS if m != layout.delimiter))
    if plain and not (layout.stamps or '"' in block or (comma and "." in block)):
        beside = _text_beside(lines, first, layout) if layout.words else _Table(np.zeros(0))
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
            if beside is not None and values.shape[1] == len(used):
                beside.values = np.full((values.shape[0], layout.width), np.nan)
                beside.values[:, used] = values
                return beside
        except ValueError:
            pass
    return _numbers_slowly(lines, first, layout)


def _without_last(table: _Table) -> _Table:
    """Leave out rows of empty fields at the end, as oscilloscopes write them."""
    held = np.flatnonzero(np.isfinite(table.values).any(axis=1))
    last = max(int(held[-1]) if held.size else -1, max((row for row, _ in table.words), default=-1))
    table.values = table.values[: last + 1]
    table.lines = table.lines[: last + 1]
    return table


def _text_beside(lines: list[str], first: int, layout: RowLayout) -> _Table | None:
    """Return the text of plain rows without their numbers; None where one is unlike the others."""
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
                table.words[len(table.lines), j] = _kept(text)
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
        fields, more = _fitted(fields, number, layout)
        if remark or more:
            table.remarks.append((number, remark or more))
        row = []
        for j, text in enumerate(fields):
            value = _value(text, j, layout)
            if value is None:
                table.words[len(rows), j] = _kept(text)
            elif j not in layout.stamps:
                signs |= {sign: number for sign in ".," if sign in text and sign not in signs}
            row.append(np.nan if value is None else value)
        if len(signs) > 1:
            raise RecordError(
                f"line {number} has a decimal comma where others have a point, or marks thousands: "
                "write the numbers with one sign"
            )
        rows.append(row)
        table.lines.append(number)
    table.values = np.array(rows, dtype=np.float64).reshape(len(rows), layout.width)
    return table


def _fitted(fields: list[str], number: int, layout: RowLayout) -> tuple[list[str], str]:
    """Return a field for each column, and the text behind the last."""
    count, width = len(fields), layout.width
    more = fields[width:]
    if any(NUMBER.fullmatch(f) for f in more) or not layout.words.issuperset(range(count, width)):
        raise RecordError(
            f"line {number} has {count} columns where the first row has {width}: correct the line, "
            "or leave lines above it out by --text skip=N"
        )
    return fields[:width] + [""] * (width - count), " ".join(more).strip()


def _value(text: str, column: int, layout: RowLayout) -> float | None:
    """Return the number in a field, NaN where it is missing; None for a text."""
    if is_missing(text):
        return np.nan
    if column in layout.stamps:
        return _seconds(text, layout)
    return float(text.replace(",", ".")) if NUMBER.fullmatch(text) else None


def _kept(text: str) -> str:
    return text if COMPLEX.fullmatch(text) else text[:_LETTERS]


def _seconds(text: str, layout: RowLayout) -> float | None:
    """Return the seconds that a date or a time of day is after a day has begun.

    Counted from that day, and not from 1970, a float keeps the nanoseconds.
    """
    own, found = day(text, layout.month_first), STAMP.fullmatch(text)
    if found is None or own < 0:
        return None
    hours = int(found["h"])
    if found["half"]:
        hours = hours % 12 + 12 * (found["half"] == "P")
    seconds = float(found["s"].replace(",", "."))
    return 86400.0 * (own - layout.first_day) + 3600.0 * hours + 60.0 * int(found["min"]) + seconds


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
            notes.append(f"dates of '{column.name}' are taken as seconds after the first")
        words = {row: text for (row, at), text in table.words.items() if at == j}
        if words and all(map(COMPLEX.fullmatch, words.values())):
            imaginary = np.where(np.isfinite(numbers), 0.0, np.nan)
            for row, text in words.items():
                value = complex(re.sub(r"\s", "", text.lower()).replace(",", ".").replace("i", "j"))
                numbers[row], imaginary[row] = value.real, value.imag
            columns += complex_parts(column, imaginary)
            continue
        if words:
            beside = np.zeros(numbers.size, dtype=f"<U{max(map(len, words.values()))}")
            beside[list(words)] = list(words.values())
            column = replace(column, words=beside)
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
    """Return names of columns of which LabVIEW wrote times before each channel.

    The times of the first are those of all, where they are the same.
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
        f"left out: text behind the numbers of {len(table.remarks)} rows, such as "
        f"'{text[:_LETTERS]}' in line {number}"
    ]
