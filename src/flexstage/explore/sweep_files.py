"""A sweep as tables for other programs, and as plain data: SI units, all digits."""

import csv
import io
import json
import math
from typing import Any

import numpy as np

from flexstage.errors import ModelError
from flexstage.explore.sobol_indices import SobolIndices
from flexstage.explore.sweep import Sweep
from flexstage.files.plain import picked, plain
from flexstage.lazy import require_extra
from flexstage.units import DIMENSIONS

#: What the column is called that says why a point is no stage.
FAULT = "fault"


def sweep_csv(sweep: Sweep) -> bytes:
    """Return all points as text, a line each: variables, figures, and why it is no stage.

    Headings have the SI unit in brackets; numbers have the digits that give back the same bits.
    """
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\r\n")
    rows.writerow([*(f"{n} [{u}]" if u != "1" else n for n, u in _columns(sweep)), FAULT])
    for numbers, fault in zip(np.hstack((sweep.points, sweep.values)), sweep.faults, strict=True):
        rows.writerow([*("" if math.isnan(v) else repr(v) for v in numbers.tolist()), fault])
    return text.getvalue().encode()


def sweep_parquet(sweep: Sweep) -> bytes:
    """Return all points as a Parquet file, for data-frame libraries.

    A column is called as its variable or figure; its metadata have ``unit`` (SI) and
    ``description``. Those of the file have, under ``flexstage``, what `sweep_results` gives as
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
        for (name, unit), words in zip(_columns(sweep), told, strict=True)
    ]
    about = {"flexstage": json.dumps(sweep_results(sweep), ensure_ascii=False)}
    numbers = np.hstack((sweep.points, sweep.values)).T
    # a number that there is not is none, and not one that is no number
    columns = [pa.array(column, mask=np.isnan(column)) for column in np.ascontiguousarray(numbers)]
    faults = pa.array([fault or None for fault in sweep.faults], pa.string())
    schema = pa.schema([*fields, pa.field(FAULT, pa.string())], metadata=about)
    out = io.BytesIO()
    parquet.write_table(pa.table([*columns, faults], schema=schema), out)
    return out.getvalue()


def sweep_results(sweep: Sweep, *, columns: bool = False) -> dict[str, Any]:
    """Return a sweep as plain data, in SI units: what was done, and what was found in short.

    With all points and their figures, a list for each column, where asked for.
    """
    names = [variable.name for variable in sweep.variables]
    correlations = sweep.correlations
    out: dict[str, Any] = {
        **picked(sweep, "stage", "model"),
        "plan": picked(sweep.plan, "sampling", "samples", "seed", "indices")
        | picked(sweep, "counts"),
        "variables": [
            picked(v, "name", "low", "high", "described=usual")
            | {"unit": _unit(v.dimension)}
            | picked(v, "description")
            for v in sweep.variables
        ],
        "points": {"all": len(sweep.points), "possible": int(sweep.possible.sum())},
        "impossible": [picked(reason, "count", "text") for reason in sweep.reasons],
        "figures": [
            {
                **picked(figure, "name", "quantity", "axis", "unit=shown.unit"),
                "described": plain(float(sweep.described[k])),
                "varies": not bool(sweep.still[k]),
                "least": _at(sweep, k, sweep.least[k]),
                "greatest": _at(sweep, k, sweep.greatest[k]),
                "rank_correlation": dict(zip(names, plain(correlations[k]), strict=True)),
            }
            for k, figure in enumerate(sweep.figures)
        ],
        "indices": None if sweep.indices is None else _indices(sweep, sweep.indices),
        **picked(sweep, "notes", "provenance"),
    }
    if columns:
        numbers = np.hstack((sweep.points, sweep.values)).T
        named = (name for name, _ in _columns(sweep))
        out["columns"] = {name: plain(column) for name, column in zip(named, numbers, strict=True)}
        out["columns"][FAULT] = list(sweep.faults)
    return out


def _at(sweep: Sweep, figure: int, row: int) -> dict[str, Any]:
    """Value of a figure, and at which point it is found."""
    point = zip((v.name for v in sweep.variables), plain(sweep.points[row]), strict=True)
    return {"value": plain(float(sweep.values[row, figure])), "row": row, "at": dict(point)}


def _indices(sweep: Sweep, found: SobolIndices) -> dict[str, Any]:
    """Sobol' indices by figure and variable."""
    shares: dict[str, Any] = {}
    for k, figure in enumerate(sweep.figures):
        shares[figure.name] = {
            variable.name: {
                order: {
                    "value": plain(float(value[k, i])),
                    "low": plain(float(low[k, i])),
                    "high": plain(float(high[k, i])),
                }
                for order, value, low, high in (
                    ("first", found.first, found.first_low, found.first_high),
                    ("total", found.total, found.total_low, found.total_high),
                )
            }
            for i, variable in enumerate(sweep.variables)
        }
    return picked(found, "samples", "left_out", "confidence") | {"shares": shares}


def _columns(sweep: Sweep) -> list[tuple[str, str]]:
    """Name and SI unit of each column of numbers."""
    return [
        *((variable.name, _unit(variable.dimension)) for variable in sweep.variables),
        *((figure.name, figure.shown.unit) for figure in sweep.figures),
    ]


def _unit(dimension: str) -> str:
    return DIMENSIONS[dimension].si if dimension else "1"
