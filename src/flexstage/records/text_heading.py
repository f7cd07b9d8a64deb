"""What stands above the numbers of a text file: names, units, the keys of LabVIEW."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

from flexstage.errors import RecordError, UnitError
from flexstage.units import si_unit

COMMENT_MARKS = ("#", "%", ";", "//", "!")

# a word with the bracket behind it, for headings that only spaces divide
_WORD = re.compile(r"[^\s()\[\]]+(?:\s?(?:\([^()]*\)|\[[^\[\]]*\]))?")
_END_OF_HEADER = "***End_of_Header***"
#: What LabVIEW calls a column of times.
X_VALUE = "X_Value"


@dataclass(frozen=True, slots=True, kw_only=True)
class Heading:
    """What the lines above the numbers say."""

    names: tuple[str, ...] = ()
    """Heading of each column; empty where there is none that fits."""
    units: tuple[str, ...] = ()
    """Unit of each column; empty where there is no line of units."""
    interval: float | None = None
    """Sample interval [s]."""
    start: float = 0.0
    """Time of the first sample [s]."""
    interval_source: str = ""
    """Where the interval stands."""
    empty_first: bool = False
    """Whether the first column is left empty, as LabVIEW does where it writes no times."""
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
    """Understand the lines above the numbers.

    A file of LabVIEW that holds more than one part is refused.
    """
    written = [line for line in lines if line.strip()]
    text = "\n".join(written)[:4000]
    if written and written[0].startswith("LabVIEW Measurement"):
        return _labview(written, width, text)
    if not written:
        return Heading()
    if len(written) > 1 and (found := _sequence(written, width, delimiter, text)) is not None:
        return found
    last = _names(written[-1], width, delimiter)
    if len(written) > 1 and last and _are_units(last):
        above = _names(written[-2], width, delimiter)
        if above:
            return Heading(names=above, units=tuple(map(_bare, last)), text=text)
    return Heading(names=last, text=text)


def _sequence(lines: Sequence[str], width: int, delimiter: str | None, text: str) -> Heading | None:
    """Understand an oscilloscope's numbered samples, whose step stands beside the units."""
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
    """Return the names of the columns in a line, if it holds as many as there are columns."""
    for mark in COMMENT_MARKS:
        if line.lstrip().startswith(mark):
            # an empty field, where what divides the fields would mark a remark too
            if mark != delimiter or len(split_line(line, delimiter)) != width:
                line = line.lstrip().lstrip(mark)
            break
    if delimiter is not None:
        names = split_line(line, delimiter)
        while len(names) > width and names[-1] in {"", "Comment"}:
            names.pop()
        if len(names) == width and any(names):
            return tuple(names)
        # numbers in columns of spaces often stand under names that tabs or commas divide
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
    """Understand the heading of a LabVIEW measurement file."""
    if sum(line.startswith(_END_OF_HEADER) for line in lines) > 2:
        raise RecordError("the file contains several parts of LabVIEW: save each to its own file")
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
    # what is said of a channel stands in its column, whatever columns of times are between
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
