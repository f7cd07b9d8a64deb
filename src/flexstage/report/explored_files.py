"""The files of what was found among many stages, by their names: data, pictures, pages."""

import csv
import io
import json
import math
from collections.abc import Callable, Iterable
from functools import partial

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.base.lazy import require_extra
from flexstage.files.plain import json_text
from flexstage.report.figures.style import encode
from flexstage.report.optimise import front_html
from flexstage.report.sweep import sweep_html
from flexstage.report.tolerance import tolerance_page
from flexstage.studies.explore.optimise.front import Front
from flexstage.studies.explore.optimise.optimum import Optimum
from flexstage.studies.explore.sensitivity import Sensitivities
from flexstage.studies.explore.sweep import FAULT, Sweep
from flexstage.studies.explore.tolerance import ToleranceStudy

Files = dict[str, bytes]


def sweep_files(found: Sweep) -> tuple[Files, list[str]]:
    """Return the files of a sweep, and in sentences which of them could not be made."""
    makes: dict[str, Callable[[], bytes]] = {
        "sweep.csv": partial(sweep_csv, found),
        "sweep.parquet": partial(sweep_parquet, found),
        "sweep.json": lambda: json_text(found.summary()).encode(),
        "sweep.svg": lambda: encode(found.plot(), "svg"),
        "indices.svg": lambda: encode(found.plot("indices"), "svg"),
        "sweep.html": lambda: sweep_html(found).encode(),
    }
    if found.indices is None:
        del makes["indices.svg"]
    files: Files = {}
    notes: list[str] = []
    for name, make in makes.items():
        try:
            files[name] = make()
        except ModelError as error:
            notes.append(f"{name} was not written: {error}")
    return files, notes


def optimum_files(found: Optimum) -> Files:
    """Return the files of a best stage: its stage file, and how it was found."""
    return {
        "best.yaml": found.text.encode(),
        "optimise.json": json_text(found.to_dict()).encode(),
    } | _optimum_pictures(found)


def front_files(found: Front) -> Files:
    """Return the files of a Pareto front and of the design that is chosen of it."""
    page = {"front.html": front_html(found).encode()} if len(found.problem.goals) > 2 else {}
    return (
        {
            "best.yaml": found.optimum.text.encode(),
            "optimise.json": json_text(found.to_dict()).encode(),
            "front.svg": encode(found.plot(), "svg"),
        }
        | _optimum_pictures(found.optimum)
        | page
    )


def _optimum_pictures(found: Optimum) -> Files:
    views = {"history.svg": "history", "before-after.svg": "", "figures.svg": "figures"}
    return {name: encode(found.plot(view), "svg") for name, view in views.items()}


def tolerance_files(study: ToleranceStudy, *, every: bool = False) -> Files:
    """Return the files of a lot; with those of `every` sample where asked for."""
    files = {
        "tolerance.html": tolerance_page(study).encode(),
        "tolerance.json": json_text(study.to_dict()).encode(),
        "figures.svg": encode(study.plot(), "svg"),
    }
    if study.shares:
        files["shares.svg"] = encode(study.plot("shares"), "svg")
    if every:
        files["samples.csv"] = samples_csv(study)
    return files


def sensitivity_files(found: Sensitivities) -> Files:
    """Return the files of sensitivities."""
    return {
        "sensitivity.json": json_text(found.to_dict()).encode(),
        "sensitivity.csv": sensitivity_csv(found).encode(),
        "sensitivity.svg": encode(found.plot(), "svg"),
    }


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
    heading = [f"{f.name} [{f.display.unit}]" for f in study.monte_carlo.figures]
    return _csv(heading, map(_numbers, study.values.tolist())).encode()


def sensitivity_csv(found: Sensitivities) -> str:
    """Return a line for each parameter: its value, the slope of each figure, and its part."""
    slopes = [f"d {f.name} [{f.display.unit}] / d parameter" for f in found.figures]
    parts = [f"d ln {f.name} / d ln parameter" for f in found.figures]
    columns = np.concatenate((found.slopes, found.elasticities)).T.tolist()
    rows = (
        [name, repr(variable.usual), variable.si_unit, *_numbers(numbers)]
        for variable, alike, numbers in zip(found.variables, found.equivalent, columns, strict=True)
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
