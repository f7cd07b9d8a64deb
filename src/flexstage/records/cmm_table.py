"""Tables of a coordinate measuring machine: feature, axis, nominal and measured in columns."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from flexstage.errors import RecordError
from flexstage.records.cmm_numbers import decimal_sign, is_difference, printed_number
from flexstage.records.cmm_words import CoordinateReading, axis_name, printed_unit, role
from flexstage.records.text_heading import split_line

_NEEDED = ("feature", "axis", "nominal", "measured")
_DELIMITERS = ("\t", ";", "|", ",", None)
_HEADING = re.compile(r"(.*?)\s*(?:[\[(]\s*([^\])]+?)\s*[\])]|(?:\s/|\sin)\s+(\S+))\s*")
_LONGEST_HEADING = 200
# how many lines of titles may stand above the heading
_LONGEST_TITLE = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportTable:
    """Where a table is in a text, and what its columns are."""

    line: int
    """Number of the line of its heading, from 0."""
    delimiter: str | None
    """What divides the columns; None is any white space."""
    width: int
    """Number of columns."""
    places: dict[str, int]
    """Number of the column of each role."""
    units: dict[str, str]
    """Unit in the heading of each role."""


def find_table(lines: Sequence[str], delimiter: str | None = None) -> ReportTable | None:
    """Return where a table of features, axes, nominal and measured values begins."""
    wanted = _DELIMITERS if delimiter is None else (delimiter,)
    for number, line in enumerate(lines[:_LONGEST_TITLE]):
        for sign in wanted:
            if sign is not None and sign not in line:
                continue
            table = _table(line.lstrip("\ufeff# "), number, sign)
            if table is not None:
                return table
    return None


def _table(line: str, number: int, delimiter: str | None) -> ReportTable | None:
    headings = split_line(line, delimiter)
    while headings and not headings[-1]:
        headings.pop()
    found: dict[str, list[int]] = {}
    units: dict[str, str] = {}
    for place, heading in enumerate(headings):
        name, unit = _split(heading)
        found.setdefault(role(name), []).append(place)
        units.setdefault(role(name), unit)
    if any(name not in found for name in _NEEDED):
        return None
    for name in (*_NEEDED, "deviation", "unit"):
        if len(found.get(name, ())) > 1:
            listed = " and ".join(f"'{headings[place]}'" for place in found[name])
            raise RecordError(
                f"line {number + 1}: the columns {listed} are both {name}: leave one out"
            )
    return ReportTable(
        line=number,
        delimiter=delimiter,
        width=len(headings),
        places={name: places[0] for name, places in found.items() if name},
        units=units,
    )


def _split(heading: str) -> tuple[str, str]:
    """Return a heading without its unit, and the unit."""
    short = " ".join(heading.split())
    found = _HEADING.fullmatch(short) if len(short) < _LONGEST_HEADING else None
    if found is None:
        return short, ""
    return found[1], printed_unit(found[2] or found[3])


def read_table(
    lines: Sequence[str], table: ReportTable, decimal: str | None
) -> list[CoordinateReading]:
    """Read the rows of a table."""
    rows = _rows(lines, table)
    values = ("nominal", "measured", "deviation")
    shown = [place for name, place in table.places.items() if name in values]
    sign = decimal_sign(((n, row[place]) for n, row in rows for place in shown), decimal)
    return [_reading(number, row, table, sign) for number, row in rows]


def _rows(lines: Sequence[str], table: ReportTable) -> list[tuple[int, list[str]]]:
    rows = []
    for number, line in enumerate(lines[table.line + 1 :], start=table.line + 2):
        fields = split_line(line, table.delimiter)
        if not any(fields):
            continue
        while len(fields) > table.width and not fields[-1]:
            fields.pop()
        if len(fields) < table.width and len(fields) > max(table.places.values()):
            fields += [""] * (table.width - len(fields))
        if len(fields) != table.width:
            comma = (
                ": is it a decimal comma in a file whose columns commas divide?"
                if table.delimiter == "," and len(fields) > table.width
                else ":"
            )
            raise RecordError(
                f"line {number} has {len(fields)} columns, its heading has {table.width}{comma} "
                "export it with semicolons between, or correct the line"
            )
        rows.append((number, fields))
    if not rows:
        raise RecordError("there are no rows below the heading: export the report again")
    return rows


def _reading(number: int, row: Sequence[str], table: ReportTable, sign: str) -> CoordinateReading:
    place = table.places
    where = f"line {number}"
    feature, axis = row[place["feature"]], row[place["axis"]]
    if not feature or not axis:
        raise RecordError(f"{where} names no {'axis' if feature else 'feature'}: correct the line")
    nominal, measured = (
        printed_number(row[place[name]], sign, f"{where}, {name}")
        for name in ("nominal", "measured")
    )
    if "deviation" in place and table.units["deviation"] == table.units["measured"]:
        given = row[place["deviation"]]
        if given and not is_difference(given, row[place["measured"]], row[place["nominal"]], sign):
            raise RecordError(
                f"{where}: the deviation {given} is not measured minus nominal "
                f"({row[place['measured']]} and {row[place['nominal']]}): correct the line"
            )
    stated = printed_unit(row[place["unit"]]) if "unit" in place else ""
    units = {u for u in (stated, table.units["nominal"], table.units["measured"]) if u}
    if len(units) > 1:
        raise RecordError(
            f"{where}: nominal and measured value are in different units ({', '.join(units)}): "
            "export them in one"
        )
    return CoordinateReading(
        feature=" ".join(feature.split()),
        axis=axis_name(axis),
        nominal=nominal,
        measured=measured,
        unit=next(iter(units), ""),
    )
