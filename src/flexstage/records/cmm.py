"""Reports of coordinate measuring machines as columns over repeated measurements."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flexstage.errors import RecordError
from flexstage.records.cmm_report import has_report, read_report
from flexstage.records.cmm_table import find_table, read_table
from flexstage.records.cmm_words import ANGLES, AXES, CoordinateReading
from flexstage.records.columns import Column, FileColumns
from flexstage.records.text_lines import text_lines


def is_coordinate_report(head: str) -> bool:
    r"""Say whether a text begins as a report of a coordinate measuring machine does.

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


def _columns(readings: Sequence[CoordinateReading]) -> tuple[list[Column], list[str]]:
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
    columns: list[Column] = []
    for (feature, axis), found in series.items():
        unit = _unit(feature, axis, found)
        name = f"{feature}.{axis}"
        measured = np.array([r.measured for r in found])
        nominal = np.array([r.nominal for r in found])
        columns.append(Column(name=name, values=measured, unit=unit))
        columns.append(Column(name=f"{name} nominal", values=nominal, unit=unit))
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


def _feature(column: Column) -> str:
    return column.name.removesuffix(" nominal").rpartition(".")[0]


def _axis(column: Column) -> str:
    return column.name.removesuffix(" nominal").rpartition(".")[2]
