"""Lines of a text file: its heading, and the place and layout of its rows of numbers."""

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

from flexstage.base.errors import RecordError, UnitError
from flexstage.quantities.units import si_unit

COMMENT_MARKS = ("#", "%", ";", "//", "!")

# a word with the bracket after it, for headings with only spaces as delimiters
_WORD = re.compile(r"[^\s()\[\]]+(?:\s?(?:\([^()]*\)|\[[^\[\]]*\]))?")
END_OF_HEADER = "***End_of_Header***"
#: Name of a column of times in LabVIEW.
X_VALUE = "X_Value"


@dataclass(frozen=True, slots=True, kw_only=True)
class Heading:
    """Content of the lines above the numbers."""

    names: tuple[str, ...] = ()
    """Heading of each column; empty without a matching line."""
    units: tuple[str, ...] = ()
    """Unit of each column; empty without a line of units."""
    interval: float | None = None
    """Sample interval [s]."""
    start: float = 0.0
    """Time of the first sample [s]."""
    interval_source: str = ""
    """Place of the interval in the file."""
    empty_first: bool = False
    """Whether the first column is empty, as in LabVIEW files without times."""
    text: str = ""
    """The lines themselves."""


def split_line(line: str, delimiter: str | None) -> list[str]:
    """Return the fields of a line, without spaces and quotation marks around them."""
    if delimiter is None:
        return line.replace('"', "").split()
    if '"' in line:
        rows = list(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
        return [field.strip() for field in rows[0]] if rows else []
    return [field.strip() for field in line.split(delimiter)]


def heading_of(lines: Sequence[str], width: int, delimiter: str | None) -> Heading:
    """Parse the lines above the numbers.

    A LabVIEW file with more than one part is refused.
    """
    nonblank = [line for line in lines if line.strip()]
    text = "\n".join(nonblank)[:4000]
    if nonblank and nonblank[0].startswith("LabVIEW Measurement"):
        return _labview(nonblank, width, text)
    if not nonblank:
        return Heading()
    if len(nonblank) > 1 and (heading := _sequence(nonblank, width, delimiter, text)) is not None:
        return heading
    last = _names(nonblank[-1], width, delimiter)
    if len(nonblank) > 1 and last and _are_units(last):
        above = _names(nonblank[-2], width, delimiter)
        if above:
            return Heading(names=above, units=tuple(map(_bare, last)), text=text)
    return Heading(names=last, text=text)


def _sequence(lines: Sequence[str], width: int, delimiter: str | None, text: str) -> Heading | None:
    """Parse the heading of numbered samples of an oscilloscope, with the step next to the units."""
    names, units = (split_line(line, delimiter) for line in lines[-2:])
    while names and not names[-1]:
        names.pop()
    if names[width:] != ["Start", "Increment"] or len(units) < width + 2:
        return None
    return Heading(
        names=tuple(names[:width]),
        units=("", *units[1:width]),
        start=_number(units[width:]),
        interval=_number(units[width + 1 :]) or None,
        interval_source="'Increment'",
        text=text,
    )


def _names(line: str, width: int, delimiter: str | None) -> tuple[str, ...]:
    """Return the names of the columns in a line, if their number is that of the columns."""
    for mark in COMMENT_MARKS:
        if line.lstrip().startswith(mark):
            # an empty first field, if the delimiter is a comment mark too
            if mark != delimiter or len(split_line(line, delimiter)) != width:
                line = line.lstrip().lstrip(mark)
            break
    if delimiter is not None:
        names = split_line(line, delimiter)
        while len(names) > width and names[-1] in {"", "Comment"}:
            names.pop()
        if len(names) == width and any(names):
            return tuple(names)
        # names above numbers with spaces often have tabs or commas as delimiters
    for other in ("\t", ";", ","):
        names = split_line(line, other)
        if delimiter is None and width > 1 and len(names) == width and all(names):
            return tuple(names)
    words = _WORD.findall(line)
    if delimiter is None and len(words) != width:
        words = line.split()
    if len(words) == width:
        return tuple(word.strip('",') for word in words)
    return (line.strip(),) if width == 1 and 0 < len(line.strip()) <= 40 else ()


def _bare(unit: str) -> str:
    return unit.strip().strip("()[]").strip()


def _are_units(fields: Sequence[str]) -> bool:
    units = [_bare(field) for field in fields]
    for unit in units:
        try:
            if unit:
                si_unit(unit)
        except UnitError:
            return False
    return any(units)


def _labview(lines: Sequence[str], width: int, text: str) -> Heading:
    """Parse the heading of a LabVIEW measurement file."""
    if sum(line.startswith(END_OF_HEADER) for line in lines) > 2:
        raise RecordError("the LabVIEW file has several parts: save each part to its own file")
    keys: dict[str, list[str]] = {}
    delimiter = "," if "\t" not in text else "\t"
    for line in lines:
        words = [word.strip() for word in line.split(delimiter)]
        keys[words[0]] = words[1:]
    names = split_line(lines[-1], delimiter)
    while len(names) > width and names[-1] in {"Comment", ""}:
        names.pop()
    empty_first = keys.get("X_Columns", ["One"])[0] == "No"
    is_time = keys.get("X_Dimension", [""])[0] == "Time"
    # entries of a channel are in its column, whatever columns of times are between
    units = ["", *keys.get("Y_Unit_Label", []), *[""] * width][:width]
    if is_time and not empty_first:
        units = ["s" if n == X_VALUE else u for n, u in zip(names, units, strict=False)]
    if len(names) != width:
        units = []
    interval = None
    if empty_first and is_time:
        interval = _number(keys.get("Delta_X", []))
    return Heading(
        names=tuple(names) if len(names) == width else (),
        units=tuple(units),
        interval=interval or None,
        start=_number(keys.get("X0", [])),
        interval_source="'Delta_X'",
        empty_first=empty_first,
        text=text,
    )


def _number(words: Sequence[str]) -> float:
    try:
        return float(words[0].replace(",", "."))
    except (IndexError, ValueError):
        return 0.0


# control characters that do not occur in text; form feed, escape and the old end of file may
_BINARY = re.compile("[\x00-\x08\x0e-\x19\x1c-\x1f]")


def text_lines(path: Path) -> list[str]:
    """Return the lines of a text file, UTF-8, UTF-16 with a mark, or Latin-1."""
    data = path.read_bytes()
    if not data.strip():
        raise RecordError(f"'{path}' is empty: record or export it again")
    text = decoded(data)
    if not text or _BINARY.search(text):
        raise RecordError(
            f"'{path}' is not a text file: give its format, or save the columns as CSV"
        )
    return text.replace("\r\n", "\n").replace("\r", "\n").rstrip("\n\x1a \t").split("\n")


def decoded(data: bytes) -> str:
    """Return bytes as text, UTF-8, UTF-16 with a mark, or Latin-1; empty if incomplete."""
    wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    for encoding in ("utf-16",) if wide else ("utf-8-sig", "latin-1"):
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    return ""


NUMBER = re.compile(
    r"[+-]?(?:(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?|inf(?:inity)?|nan)", re.IGNORECASE
)
_PART = r"(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?"
# 1.5-2e-3j, (1+2i), 3j
COMPLEX = re.compile(
    rf"\(?\s*(?:[+-]?{_PART}\s*[+-]\s*{_PART}|[+-]?{_PART})\s*[ij]\s*\)?", re.IGNORECASE
)
STAMP = re.compile(
    r"(?:(?:\d{4}-\d\d-\d\d|\d\d?([./])\d\d?\1\d{4})[ T])?"
    r"(?P<h>\d\d?):(?P<min>\d\d):(?P<s>\d\d(?:[.,]\d{1,9})?)(?:Z| (?P<half>[AP])M)?"
)
_DAY = re.compile(
    r"(?P<y>\d{4})-(?P<m>\d\d)-(?P<d>\d\d)|(?P<a>\d\d?)(?P<sign>[./])(?P<b>\d\d?)[./](?P<c>\d{4})"
)
_SLASHED = re.compile(r"(?<![\d/])(\d\d?)/(\d\d?)/\d{4}[ T]\d")
_MISSING = frozenset(("", "nan", "-nan", "na", "n/a", "null", "none", "--", "1.#qnan", "-1.#ind"))
# a comment after numbers; a percent sign starts one only before a word
_REMARK = re.compile(r"(?:(?<=[\s,;])|^)(?:#|//|!|%(?=\s*[^\W\d]))")
_REMARK_OR_SEMICOLON = re.compile(_REMARK.pattern + r"|(?<=\s);")
# initial characters of a comment, absent in most lines
_MARK = re.compile("[#/!%;]")

_LONGEST_HEADING = 5000
#: Number of rows that determine the layout.
_SAMPLE = 400
#: Least number of lines of text and numbers that are rows, and not a heading.
_FEWEST = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class RowLayout:
    """Layout of a row."""

    delimiter: str | None
    """Delimiter of the columns; None for white space."""
    comma: bool
    """Whether numbers have a decimal comma."""
    width: int
    """Number of columns."""
    trailing: bool
    """Whether rows end in a delimiter."""
    stamps: tuple[int, ...] = ()
    """Columns of dates and times of day."""
    words: frozenset[int] = frozenset()
    """Columns with text and no numbers, in the examined rows."""
    first_day: int = 0
    """Number of the day of the first date."""
    month_first: bool = False
    """Whether dates with slashes begin with the month."""


def is_comment(line: str, delimiter: str | None = None) -> bool:
    """Return whether a line is a comment."""
    return line.lstrip().startswith(tuple(m for m in COMMENT_MARKS if m != delimiter))


def is_missing(field: str) -> bool:
    """Return whether a field marks a missing number."""
    return field.lower() in _MISSING


def row_of(line: str, delimiter: str | None) -> tuple[list[str], str]:
    """Return the fields of a line, and the comment after them, if any."""
    if _MARK.search(line) and '"' not in line and delimiter not in COMMENT_MARKS[:2]:
        mark = (_REMARK if delimiter == ";" else _REMARK_OR_SEMICOLON).search(line)
        if mark is not None:
            return split_line(line[: mark.start()], delimiter), line[mark.start() :].strip()
    return split_line(line, delimiter), ""


def day(field: str, month_first: bool = False) -> int:
    """Return the number of the day of a date.

    0 for a time alone, -1 for an invalid date.
    """
    parts = _DAY.match(field)
    if parts is None:
        return 0
    year, month, of_month = parts["y"] or parts["c"], parts["m"] or parts["b"], parts["d"]
    of_month = of_month or parts["a"]
    if month_first and parts["sign"] == "/":
        month, of_month = of_month, month
    try:
        return date(int(year), int(month), int(of_month)).toordinal()
    except ValueError:
        return -1


def is_month_first(lines: Iterable[str]) -> bool | None:
    """Return whether dates with slashes begin with the month; None if they are ambiguous.

    They are ambiguous if both numbers of each are at most 12, unless all are of one day.

    Examples
    --------
    >>> is_month_first(["11/27/2026 14:03:12"]), is_month_first(["5/6/2026 9:00", "5/7/2026 9:00"])
    (True, None)
    """
    dates = {pair for line in lines if "/" in line for pair in _SLASHED.findall(line)}
    largest = [max((int(pair[k]) for pair in dates), default=0) for k in (0, 1)]
    if max(largest) > 12:
        return largest[1] > 12
    return None if len(dates) > 1 else False


def first_row(
    lines: Sequence[str], skip: int, delimiters: Sequence[str | None], decimal: str | None
) -> tuple[int, RowLayout] | None:
    """Find the first row of numbers, or of numbers with text."""
    numeric = _numbers_alone(lines, skip, delimiters, decimal)
    if numeric is not None and numeric[1].width > 1:
        first, layout = numeric
        if labview := [n for n in range(skip, first) if lines[n].startswith(END_OF_HEADER)]:
            # names are below the heading, perhaps with units; the first row may have a comment
            below = range(labview[-1] + 2, first)
            first = next((n for n in below if _begins(lines[n], layout.delimiter)), first)
        return _final_layout(lines, _above(lines, skip, first, layout), layout)
    mixed = _with_text(lines, skip, delimiters, decimal)
    if mixed is not None and (numeric is None or mixed[1].width > 1):
        return _final_layout(lines, *mixed)
    return numeric


def _numbers_alone(
    lines: Sequence[str], skip: int, delimiters: Sequence[str | None], decimal: str | None
) -> tuple[int, RowLayout] | None:
    """Return the first line that contains only numbers."""
    lone: tuple[int, RowLayout] | None = None
    for number in range(skip, min(len(lines), skip + _LONGEST_HEADING)):
        line = lines[number]
        if not line.strip() or is_comment(line, delimiters[0]):
            continue
        layout = _layout(line, delimiters, decimal)
        if layout is None:
            continue
        # a single number above rows of several is the number of rows
        if layout.width > 1:
            return number, layout
        if lone is not None:
            return lone
        lone = number, layout
    return lone


def _layout(line: str, delimiters: Sequence[str | None], decimal: str | None) -> RowLayout | None:
    """Return the layout of a line, if it contains only numbers."""
    for candidate in delimiters:
        if candidate is not None and candidate not in line and len(delimiters) > 1:
            continue
        fields, _ = row_of(line, candidate)
        trailing = len(fields) > 1 and fields[-1] == ""
        fields = fields[:-1] if trailing else fields
        kinds = _kinds(fields)
        # a row needs more than times, at least a missing number
        if "t" in kinds or not any(f for f, k in zip(fields, kinds, strict=True) if k != "s"):
            continue
        comma = _has_comma([fields]) or decimal == ","
        if (comma and candidate == "," and '"' not in line) or (comma and decimal == "."):
            continue
        return RowLayout(delimiter=candidate, comma=comma, width=len(fields), trailing=trailing)
    return None


def _kinds(fields: Sequence[str]) -> str:
    """Return a letter for each field: missing, number, stamp of time, or text."""
    return "".join(
        "m" if is_missing(f) else "n" if NUMBER.fullmatch(f) else "s" if STAMP.fullmatch(f) else "t"
        for f in fields
    )


def _begins(line: str, delimiter: str | None) -> bool:
    """Return whether the first field of a line, apart from missing ones, is a number or a stamp."""
    return _kinds(row_of(line, delimiter)[0]).lstrip("m")[:1] in ("n", "s")


def _has_comma(rows: Sequence[Sequence[str]]) -> bool:
    return any("," in f and NUMBER.fullmatch(f) is not None for row in rows for f in row)


def _rows(lines: Sequence[str], delimiter: str | None) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines that are no comments, with their fields."""
    for number, line in enumerate(lines):
        if line.strip() and not is_comment(line, delimiter):
            yield number, row_of(line, delimiter)[0]


def _sample(lines: Sequence[str], first: int, delimiter: str | None) -> list[list[str]]:
    return [fields for _, fields in _rows(lines[first : first + _SAMPLE], delimiter)]


def _columns(rows: Sequence[Sequence[str]], width: int) -> list[str]:
    """Return the kinds of the fields of each column."""
    kinds = [_kinds(row[:width]).ljust(width, "m") for row in rows]
    return ["".join(column) for column in zip(*kinds, strict=True)]


def _final_layout(lines: Sequence[str], first: int, layout: RowLayout) -> tuple[int, RowLayout]:
    """Return the layout of all rows, from many of them."""
    rows = _sample(lines, first, layout.delimiter)
    count = Counter(map(len, rows)).most_common(1)[0][0]
    equal = [row for row in rows if len(row) == count]
    trailing = count > 1 and all(row[-1] == "" for row in equal)
    columns = _columns(equal, count - trailing)
    stamps = tuple(j for j, kinds in enumerate(columns) if 2 * kinds.count("s") > len(kinds))
    month_first = is_month_first(lines[first:]) if stamps else False
    words = frozenset(j for j, kinds in enumerate(columns) if "t" in kinds and "n" not in kinds)
    if month_first is None:  # they remain text, and their selection is refused with the reason
        stamps, words = (), words | set(stamps)
    days = (day(row[stamps[0]], month_first is True) for row in equal if stamps and row[stamps[0]])
    return first, replace(
        layout,
        width=count - trailing,
        trailing=trailing,
        stamps=stamps,
        words=words - set(stamps),
        first_day=next(days, 0),
        month_first=month_first is True,
    )


def _above(lines: Sequence[str], skip: int, first: int, layout: RowLayout) -> int:
    """Return the first of the rows with text above the first row of only numbers.

    A heading of words with a number each is similar, but has words in columns of numbers.
    """
    rows = _sample(lines, first, layout.delimiter)
    below = _columns(rows, max(map(len, rows)))
    has_text = any("t" in kinds for kinds in below)
    sure, top, count, fits = first, first, 0, True
    for number, fields in reversed(list(_rows(lines[skip:first], layout.delimiter))):
        line_kinds = _kinds(fields)
        beyond = line_kinds[layout.width :]
        if len(fields) < layout.width or "n" in beyond or "n" not in line_kinds:
            break
        pairs = zip(line_kinds, below, strict=False)
        fits = fits and not any(k == "t" and "n" in b and "t" not in b for k, b in pairs)
        top, count = skip + number, count + 1
        sure = top if fits and (has_text or count >= _FEWEST) else sure
    # number of lines that is too large for a heading
    many = 20
    return top if count >= many else sure


def _with_text(
    lines: Sequence[str], skip: int, delimiters: Sequence[str | None], decimal: str | None
) -> tuple[int, RowLayout] | None:
    """Return the first row of a file with text and numbers in every row."""
    best: tuple[RowLayout, list[int]] | None = None
    for candidate in delimiters:
        rows = _tail(lines[skip:], candidate)
        if len(rows) < 2:
            continue
        width = Counter(map(len, rows)).most_common(1)[0][0]
        equal = [row for row in rows if len(row) == width]
        numbers = [
            j
            for j, kinds in enumerate(_columns(equal, width))
            if kinds.count("n") > kinds.count("t")
        ]
        comma = _has_comma(equal) or decimal == ","
        if (comma and candidate == ",") or (comma and decimal == "."):
            continue
        if numbers and (best is None or len(numbers) > len(best[1])):
            layout = RowLayout(delimiter=candidate, comma=comma, width=width, trailing=False)
            best = layout, numbers
        if numbers and candidate in ("\t", ";"):  # which occur in no number and in few words
            break
    if best is None:
        return None
    layout, numbers = best
    first, run = None, 0
    for number, fields in _rows(lines[skip : skip + _LONGEST_HEADING], layout.delimiter):
        kinds = _kinds(fields)
        if len(fields) >= layout.width and all(kinds[j] in "nm" for j in numbers) and "n" in kinds:
            first, run = (skip + number if first is None else first), run + 1
        elif "n" not in kinds and run < _FEWEST:  # names of columns: the lines above are a heading
            first, run = None, 0
    return None if first is None else (first, layout)


def _tail(lines: Sequence[str], delimiter: str | None) -> list[list[str]]:
    """Return the last rows of a file, up to the heading in a short one."""
    rows: list[list[str]] = []
    for _, fields in reversed(list(_rows(lines[-_SAMPLE:], delimiter))):
        if "n" in _kinds(fields):
            rows.append(fields)
        elif len(rows) > 1:
            break
    return rows
