"""Reports of PC-DMIS as columns over repeated measurements."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flexstage.errors import RecordError
from flexstage.records.cmm_report import ANGLES, CoordinateReading, has_report, read_report
from flexstage.records.columns import FileColumn, FileColumns
from flexstage.records.text_rows import text_lines


def read_coordinates(
    path: Path, dataset: str | None = None, *, skip_lines: int = 0, decimal: str | None = None
) -> FileColumns:
    r"""Read the text report of a coordinate measuring machine that PC-DMIS writes in English.

    `dataset` names features, with commas between; the decimal sign is found where not given. Angles
    are in degrees; the unit of lengths is that of the report, and the group ``length`` stands for
    all of them.

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
    >>> table = "DIM L1= LOCATION OF SPHERE SPH1  UNITS=MM\nAX NOMINAL MEAS\nX {} {}\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "points.txt"
    ...     _ = file.write_text(table.format(10.0, 10.0025) + table.format(12.5, 12.498))
    ...     columns = read_coordinates(file)
    >>> columns.columns[0].name, columns.columns[0].values, columns.columns[0].unit
    ('SPH1.X', array([10.0025, 12.498 ]), 'mm')
    """
    if skip_lines < 0:
        raise RecordError(f"the lines to skip must be 0 or more, got {skip_lines}")
    lines = text_lines(path)
    lines[:skip_lines] = [""] * len(lines[:skip_lines])
    if not has_report(lines):
        raise RecordError(
            "there is no table as PC-DMIS prints it in English, with AX, NOMINAL and MEAS in its "
            "heading: export a table with a column for each coordinate, and leave the format out"
        )
    readings, left_out = read_report(lines, decimal)
    series = _series(_chosen(readings, dataset))
    columns: list[FileColumn] = []
    for (feature, axis), found in series.items():
        name, unit = f"{feature}.{axis}", _unit(feature, axis, found)
        measured = np.array([r.measured for r in found])
        nominal = np.array([r.nominal for r in found])
        columns.append(FileColumn(name=name, values=measured, unit=unit))
        columns.append(FileColumn(name=f"{name} nominal", values=nominal, unit=unit))
    count = len(next(iter(series.values())))
    notes = [f"{len(series)} coordinates, each measured {count} times"]
    if left_out:
        notes.append(f"rows left out, as they are no coordinates: {', '.join(left_out)}")
    axes = [axis for _, axis in series for _ in ("measured", "nominal")]
    return FileColumns(
        columns=tuple(columns),
        notes=tuple(notes),
        attributes={"features": ", ".join(dict.fromkeys(feature for feature, _ in series))},
        over="point",
        groups={"length": tuple(i for i, axis in enumerate(axes) if axis not in ANGLES)},
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


def _series(
    readings: Sequence[CoordinateReading],
) -> dict[tuple[str, str], list[CoordinateReading]]:
    """Return the readings of each feature and axis, which are as many of each."""
    series: dict[tuple[str, str], list[CoordinateReading]] = {}
    for reading in readings:
        series.setdefault((reading.feature, reading.axis), []).append(reading)
    (first, usual), *others = ((key, len(found)) for key, found in series.items())
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
    return series


def _unit(feature: str, axis: str, found: Sequence[CoordinateReading]) -> str:
    units = {r.unit for r in found}
    if len(units) > 1:
        raise RecordError(
            f"{feature}.{axis} is in {' and in '.join(sorted(u or 'no unit' for u in units))}: "
            "export all of its rows in one unit"
        )
    return "deg" if axis in ANGLES else units.pop()
