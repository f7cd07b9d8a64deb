"""Tables for other programs: numbers with all digits, as CSV and Parquet."""

import csv
import io
import json
import math
from collections.abc import Iterable

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.base.lazy import require_extra
from flexstage.studies.explore.sensitivity import Sensitivities
from flexstage.studies.explore.sweep import FAULT, Sweep
from flexstage.studies.explore.tolerance import ToleranceStudy


def sweep_csv(sweep: Sweep) -> bytes:
    """Return all points as text, a line each: variables, figures, and why it is no stage.

    Headings have the SI unit in brackets; numbers have the digits that give back the same bits.
    """
    heading = [*(f"{n} [{u}]" if u != "1" else n for n, u in sweep.column_units), FAULT]
    points = zip(np.hstack((sweep.points, sweep.values)).tolist(), sweep.faults, strict=True)
    rows = ([*("" if math.isnan(v) else repr(v) for v in row), fault] for row, fault in points)
    return _csv(heading, rows, "\r\n").encode()


def sweep_parquet(sweep: Sweep) -> bytes:
    """Return all points as a Parquet file, for data-frame libraries.

    A column is called as its variable or figure; its metadata have ``unit`` (SI) and
    ``description``. Those of the file have, under ``flexstage``, what `Sweep.summary` gives as
    JSON.

    Raises
    ------
    ModelError
        pyarrow is not installed.
    """
    require_extra("explore", "pyarrow", "a Parquet file", ModelError)
    import pyarrow as pa
    from pyarrow import parquet

    told = [v.description for v in sweep.variables] + [f.label for f in sweep.figures]
    fields = [
        pa.field(name, pa.float64(), metadata={"unit": unit, "description": words})
        for (name, unit), words in zip(sweep.column_units, told, strict=True)
    ]
    about = {"flexstage": json.dumps(sweep.summary(), ensure_ascii=False)}
    numbers = np.hstack((sweep.points, sweep.values)).T
    # a number that there is not is none, and not one that is no number
    columns = [pa.array(column, mask=np.isnan(column)) for column in np.ascontiguousarray(numbers)]
    faults = pa.array([fault or None for fault in sweep.faults], pa.string())
    schema = pa.schema([*fields, pa.field(FAULT, pa.string())], metadata=about)
    out = io.BytesIO()
    parquet.write_table(pa.table([*columns, faults], schema=schema), out)
    return out.getvalue()


def samples_csv(study: ToleranceStudy) -> bytes:
    """Return the figures of every sample, a line each; nothing where it has none.

    Headings have the SI unit in brackets; numbers have the digits that give back the same bits.
    """
    heading = [f"{f.name} [{f.shown.unit}]" for f in study.lot.figures]
    return _csv(heading, map(_numbers, study.values.tolist())).encode()


def sensitivity_csv(found: Sensitivities) -> str:
    """Return a line for each parameter: its value, the slope of each figure, and its part."""
    slopes = [f"d {f.name} [{f.shown.unit}] / d parameter" for f in found.figures]
    parts = [f"d ln {f.name} / d ln parameter" for f in found.figures]
    columns = np.concatenate((found.slopes, found.elasticities)).T.tolist()
    rows = (
        [name, repr(variable.usual), variable.si_unit, *_numbers(numbers)]
        for variable, alike, numbers in zip(found.variables, found.alike, columns, strict=True)
        for name in alike
    )
    return _csv(["parameter", "value", "unit", *slopes, *parts], rows)


def _numbers(values: Iterable[float]) -> list[str]:
    """Return the cells of numbers; empty of what is none."""
    return [repr(v) if math.isfinite(v) else "" for v in values]


def _csv(heading: Iterable[str], rows: Iterable[Iterable[str]], end: str = "\n") -> str:
    text = io.StringIO()
    lines = csv.writer(text, lineterminator=end)
    lines.writerow(heading)
    lines.writerows(rows)
    return text.getvalue()
