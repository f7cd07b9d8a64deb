"""Text files of numbers in columns: CSV, tabs, spaces; of any country and of LabVIEW."""

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import RecordError
from flexstage.records.columns import Column, Columns, labelled
from flexstage.records.text_heading import COMMENT_MARKS, Heading, heading_of, split_line
from flexstage.records.text_lines import text_lines

__all__ = ["read_text"]

Array = NDArray[np.float64]

_LONGEST_HEADING = 5000
_NUMBER = re.compile(
    r"[+-]?(?:(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?|inf(?:inity)?|nan)", re.IGNORECASE
)
_MISSING = frozenset(("", "nan", "-nan", "na", "n/a", "null", "none", "--", "1.#qnan", "-1.#ind"))
_STAMP = re.compile(r"(?:\d{4}-\d\d-\d\d[ T])?\d\d?:\d\d:\d\d(?:[.,]\d{1,9})?Z?")
_DELIMITER_NAMES = {"tab": "\t", "comma": ",", "semicolon": ";", "space": None, " ": None}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """How a row of numbers is written."""

    delimiter: str | None
    comma: bool
    width: int
    trailing: bool
    stamps: tuple[int, ...] = ()
    first_day: int = 0


def read_text(
    path: Path,
    *,
    skip_lines: int = 0,
    delimiter: str | None = None,
    decimal: str | None = None,
) -> Columns:
    """Read the columns of a text file.

    Parameters
    ----------
    path : pathlib.Path
        The file: UTF-8, UTF-16 with a mark, or Latin-1.
    skip_lines : int
        How many lines at the start are not looked at.
    delimiter : str, optional
        What divides the columns, or tab, comma, semicolon, space; found where not given.
    decimal : str, optional
        ``"."`` or ``","``; found where not given.

    Returns
    -------
    Columns
        The columns. An empty field is not a number (NaN).

    Raises
    ------
    RecordError
        The file is no text, has no numbers, or a row unlike the others; the line is said.
    """
    if decimal not in (None, ".", ","):
        raise RecordError(f"the decimal sign must be '.' or ',', got {decimal!r}")
    if skip_lines < 0:
        raise RecordError(f"the lines to skip must be 0 or more, got {skip_lines}")
    delimiters = _delimiters(delimiter)
    lines = text_lines(path)
    first, layout = _first_row(path, lines, skip_lines, delimiters, decimal)
    heading = heading_of(lines[skip_lines:first], layout.width, layout.delimiter)
    one_name = len(heading.names) != 2 and lines[first - 1].strip().count(",") == 0
    if layout.delimiter == "," and layout.width == 2 and delimiter is decimal is None:
        layout, heading = _one_or_two(
            lines, first, layout, heading, one_name and first > skip_lines
        )
    values = _numbers(lines, first, layout)
    return _columns(values, heading, layout)


def _delimiters(wanted: str | None) -> tuple[str | None, ...]:
    """Return what may divide the columns; None is any white space."""
    if wanted is None:
        return ("\t", ";", ",", None)
    found = _DELIMITER_NAMES.get(wanted, wanted)
    if found is not None and (len(found) != 1 or found.isalnum() or found in '+-."\n\r'):
        raise RecordError(
            f"columns are divided by one sign, or {', '.join(_DELIMITER_NAMES)}, got {wanted!r}"
        )
    return (found,)


def _is_comment(line: str, delimiter: str | None = None) -> bool:
    return line.lstrip().startswith(tuple(m for m in COMMENT_MARKS if m != delimiter))


def _first_row(
    path: Path,
    lines: list[str],
    skip: int,
    delimiters: tuple[str | None, ...],
    decimal: str | None,
) -> tuple[int, _Layout]:
    """Return the number of the first row of numbers, and how it is written."""
    lone: tuple[int, _Layout] | None = None
    for number in range(skip, min(len(lines), skip + _LONGEST_HEADING)):
        line = lines[number]
        if not line.strip() or _is_comment(line, delimiters[0]):
            continue
        layout = _layout(line, delimiters, decimal)
        if layout is None:
            continue
        # a lone number above rows of several is how many rows there are
        if layout.width > 1:
            return number, layout
        if lone is not None:
            return lone
        lone = number, layout
    if lone is not None:
        return lone
    raise RecordError(f"'{path}' has no row of numbers: is it the file that was meant?")


def _layout(line: str, delimiters: tuple[str | None, ...], decimal: str | None) -> _Layout | None:
    """Return how a line is written, if it is a row of numbers."""
    for candidate in delimiters:
        if candidate is not None and candidate not in line and len(delimiters) > 1:
            continue
        fields = split_line(line, candidate)
        trailing = len(fields) > 1 and fields[-1] == ""
        fields = fields[:-1] if trailing else fields
        if not any(fields):
            continue
        stamps = tuple(i for i, f in enumerate(fields) if _STAMP.fullmatch(f))
        rest = [f for i, f in enumerate(fields) if f and i not in stamps]
        if not rest or not all(_NUMBER.fullmatch(f) or f.lower() in _MISSING for f in rest):
            continue
        comma = any("," in f for f in rest) or decimal == ","
        if (comma and candidate == "," and '"' not in line) or (comma and decimal == "."):
            continue
        return _Layout(
            delimiter=candidate,
            comma=comma,
            width=len(fields),
            trailing=trailing,
            stamps=stamps,
            first_day=_day(fields[stamps[0]]) if stamps else 0,
        )
    return None


def _one_or_two(
    lines: list[str], first: int, layout: _Layout, heading: Heading, one_name: bool
) -> tuple[_Layout, Heading]:
    """Tell one column of decimal commas from two columns of integers, by the heading."""
    sample = [line for line in lines[first : first + 200] if line.strip()]
    if one_name and all(re.fullmatch(r"\s*[+-]?\d+,\d+\s*", line) for line in sample):
        single = _Layout(delimiter=None, comma=True, width=1, trailing=False)
        return single, heading_of(lines[:first], 1, None)
    return layout, heading


def _numbers(lines: list[str], first: int, layout: _Layout) -> Array:
    """Read the rows; those that a fast reader refuses are read one by one, to say why."""
    body = lines[first:]
    if layout.trailing:
        mark = layout.delimiter or ""
        body = [line.rstrip().removesuffix(mark.strip() or mark) for line in body]
    block = "\n".join(body)
    # the sign in numbers of which only some have decimals
    comma = layout.delimiter != "," and "," in block
    if not layout.stamps and '"' not in block and not (comma and "." in block):
        try:
            with io.StringIO(block.replace(",", ".") if comma else block) as stream:
                values = np.loadtxt(
                    stream, delimiter=layout.delimiter, comments=None, ndmin=2, dtype=np.float64
                )
            if values.shape[1] == layout.width:
                return values
        except ValueError:
            pass
    return _numbers_slowly(lines, first, layout)


def _numbers_slowly(lines: list[str], first: int, layout: _Layout) -> Array:
    rows: list[list[float]] = []
    seen_comma = seen_point = False
    for number, line in enumerate(lines[first:], start=first + 1):
        if not line.strip() or _is_comment(line, layout.delimiter):
            continue
        fields = split_line(line, layout.delimiter)
        if layout.trailing and fields[-1] == "":
            fields.pop()
        if len(fields) != layout.width:
            raise RecordError(
                f"line {number} has {len(fields)} columns where the first row has {layout.width}: "
                "mend the line, or leave lines above it out by skip_lines"
            )
        seen_comma |= any("," in f for f in fields)
        seen_point |= any("." in f for f in fields)
        if seen_comma and seen_point and not layout.stamps:
            raise RecordError(
                f"line {number} has a decimal comma where others have a point, or marks thousands: "
                "write the numbers with one sign"
            )
        rows.append([_value(f, number, j, layout) for j, f in enumerate(fields)])
    return np.array(rows, dtype=np.float64).reshape(len(rows), layout.width)


def _value(field: str, line: int, column: int, layout: _Layout) -> float:
    if field.lower() in _MISSING:
        return np.nan
    if column in layout.stamps:
        return _seconds(field, line, layout.first_day)
    if not _NUMBER.fullmatch(field):
        shown = field if len(field) <= 30 else field[:27] + "..."
        raise RecordError(
            f"line {line}, column {column}: '{shown}' is not a number: mend it, or leave lines "
            "out by skip_lines"
        )
    return float(field.replace(",", "."))


def _seconds(field: str, line: int, first_day: int) -> float:
    """Return the seconds that a date or a time of day is after a day has begun.

    Counted from that day, and not from 1970, a float keeps the nanoseconds.
    """
    if not _STAMP.fullmatch(field):
        raise RecordError(f"line {line}: '{field[:30]}' is no date or time as those above it are")
    day = _day(field)
    if day < 0:
        raise RecordError(f"line {line}: there is no date '{field}'")
    hours, minutes, seconds = re.split("[T ]", field.replace(",", ".").rstrip("Z"))[-1].split(":")
    return 86400.0 * (day - first_day) + 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)


def _day(field: str) -> int:
    """Return the number of the day of a date, 0 for a time alone, -1 for a date that is none."""
    if len(field) < 10 or field[4] != "-":
        return 0
    try:
        return date.fromisoformat(field[:10]).toordinal()
    except ValueError:
        return -1


def _columns(values: Array, heading: Heading, layout: _Layout) -> Columns:
    names: Sequence[str] = heading.names or [""] * layout.width
    units: Sequence[str] = heading.units or [""] * layout.width
    notes = []
    columns: list[Column] = []
    for j in range(layout.width):
        numbers = np.ascontiguousarray(values[:, j])
        if heading.empty_first and j == 0 and np.isnan(numbers).all():
            continue
        column = labelled(names[j] or f"column {j}", numbers, units[j])
        if j in layout.stamps:
            column = Column(name=column.name, values=numbers - numbers[0], unit="s")
            notes.append(f"dates of '{column.name}' are taken as seconds after the first")
        columns.append(column)
    return Columns(
        columns=tuple(columns),
        sample_rate_hz=None if heading.interval is None else 1.0 / heading.interval,
        start=heading.start,
        rate_source=heading.interval_source,
        notes=tuple(notes),
        attributes={"heading": heading.text} if heading.text else {},
    )
