"""Reports of coordinate measuring machines as columns over repeated measurements."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexstage.errors import RecordError
from flexstage.records.cmm_report import has_report, read_report
from flexstage.records.cmm_words import (
    ANGLES,
    AXES,
    CoordinateReading,
    axis_name,
    decimal_sign,
    is_difference,
    printed_number,
    printed_unit,
    role,
)
from flexstage.records.columns import FileColumn, FileColumns
from flexstage.records.text_heading import split_line
from flexstage.records.text_rows import text_lines

_NEEDED = ("feature", "axis", "nominal", "measured")
_DELIMITERS = ("\t", ";", "|", ",", None)
_HEADING = re.compile(r"(.*?)\s*(?:[\[(]\s*([^\])]+?)\s*[\])]|(?:\s/|\sin)\s+(\S+))\s*")
_LONGEST_HEADING = 200
# how many lines of titles may stand above the heading
_LONGEST_TITLE = 60


def is_coordinate_report(head: str) -> bool:
    r"""Say whether a text begins as a report of a coordinate measuring machine does.

    It has a heading over features, axes, nominal and measured values, or a table of PC-DMIS.

    Examples
    --------
    >>> is_coordinate_report("Merkmal;Achse;Sollwert;Istwert\nSPH1;X;10,0;10,0012")
    True
    """
    lines = head.splitlines()
    try:
        return has_report(lines) or find_table(lines) is not None
    except RecordError:
        return True


def read_coordinates(
    path: Path,
    dataset: str | None = None,
    *,
    skip_lines: int = 0,
    delimiter: str | None = None,
    decimal: str | None = None,
) -> FileColumns:
    r"""Read a report of a coordinate measuring machine: a table, or the text that PC-DMIS writes.

    `dataset` names features, with commas between; delimiter and decimal sign are found where not
    given. Angles are in degrees; the unit of lengths is that of the report, and the group
    ``length`` stands for all of them.

    Each feature and axis is two columns, ``SPH1.X`` and ``SPH1.X nominal``. Row k is the k-th
    measurement of all features, as at successive positions of a stage. Distances and errors of form
    are called by their dimension, ``DIST1.M``.

    Validity
    --------
    Values as printed, with the digits of the report. Tolerances are not read, and neither are rows
    of true position, whose nominal value is none.

    Examples
    --------
    >>> import tempfile
    >>> rows = ["feature;axis;nominal;measured (mm)", "SPH1;X;10,0;10,0025", "SPH1;X;12,5;12,498"]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "points.csv"
    ...     _ = file.write_text("\n".join(rows))
    ...     columns = read_coordinates(file)
    >>> columns.columns[0].name, columns.columns[0].values, columns.columns[0].unit
    ('SPH1.X', array([10.0025, 12.498 ]), 'mm')
    """
    if skip_lines < 0:
        raise RecordError(f"the lines to skip must be 0 or more, got {skip_lines}")
    lines = text_lines(path)
    lines[:skip_lines] = [""] * len(lines[:skip_lines])
    left_out: tuple[str, ...] = ()
    if has_report(lines):
        readings, left_out = read_report(lines, decimal)
    else:
        table = find_table(lines, {"tab": "\t", "space": None}.get(delimiter or "", delimiter))
        if table is None:
            raise RecordError(
                "there is no heading with feature, axis, nominal and measured, and no table of "
                "PC-DMIS: name the columns so, or read the file by the format text"
            )
        readings = read_table(lines, table, decimal)
    columns, notes = _columns(_chosen(readings, dataset))
    if left_out:
        notes.append(f"rows left out, as they are no coordinates: {', '.join(left_out)}")
    lengths = [i for i, c in enumerate(columns) if _axis(c) not in ANGLES]
    return FileColumns(
        columns=tuple(columns),
        notes=tuple(notes),
        attributes={"features": ", ".join(dict.fromkeys(_feature(c) for c in columns))},
        over="point",
        groups={"length": tuple(lengths)},
    )


def _chosen(readings: Sequence[CoordinateReading], dataset: str | None) -> list[CoordinateReading]:
    if dataset is None:
        return list(readings)
    wanted = [word.strip() for word in dataset.split(",")]
    features = list(dict.fromkeys(r.feature for r in readings))
    for word in wanted:
        if word not in features:
            raise RecordError(
                f"there is no feature '{word}': the report has {', '.join(features[:40])}"
            )
    return [r for r in readings if r.feature in wanted]


def _columns(readings: Sequence[CoordinateReading]) -> tuple[list[FileColumn], list[str]]:
    """Return measured and nominal values of each feature and axis, row by row."""
    series: dict[tuple[str, str], list[CoordinateReading]] = {}
    for reading in readings:
        if reading.axis not in AXES:
            raise RecordError(
                f"the axis '{reading.axis[:20]}' of feature '{reading.feature}' is unknown: "
                f"expected one of {', '.join(sorted(AXES))}"
            )
        series.setdefault((reading.feature, reading.axis), []).append(reading)
    _require_equal(series)
    columns: list[FileColumn] = []
    for (feature, axis), found in series.items():
        unit = _unit(feature, axis, found)
        name = f"{feature}.{axis}"
        measured = np.array([r.measured for r in found])
        nominal = np.array([r.nominal for r in found])
        columns.append(FileColumn(name=name, values=measured, unit=unit))
        columns.append(FileColumn(name=f"{name} nominal", values=nominal, unit=unit))
    count = len(next(iter(series.values())))
    return columns, [f"{len(series)} coordinates, each measured {count} times"]


def _require_equal(series: dict[tuple[str, str], list[CoordinateReading]]) -> None:
    counts = {key: len(found) for key, found in series.items()}
    (first, usual), *others = counts.items()
    for key, count in others:
        if count != usual:
            raise RecordError(
                f"{'.'.join(first)} is measured {usual} times and {'.'.join(key)} {count} times: "
                "every feature and axis must be there equally often; choose features by the option "
                "dataset"
            )
    if usual < 2:
        raise RecordError(
            "each feature is measured once, and a record needs two rows at least: put the reports "
            "of successive positions into one file, one below the other"
        )


def _unit(feature: str, axis: str, found: Sequence[CoordinateReading]) -> str:
    units = {r.unit for r in found}
    if len(units) > 1:
        raise RecordError(
            f"{feature}.{axis} is in {' and in '.join(sorted(u or 'no unit' for u in units))}: "
            "export all of its rows in one unit"
        )
    (unit,) = units
    return "deg" if axis in ANGLES and unit not in ("rad", "mrad") else unit


def _feature(column: FileColumn) -> str:
    return column.name.removesuffix(" nominal").rpartition(".")[0]


def _axis(column: FileColumn) -> str:
    return column.name.removesuffix(" nominal").rpartition(".")[2]


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
