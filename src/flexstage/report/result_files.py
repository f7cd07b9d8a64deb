"""The files of results, by their names: data, pictures and pages."""

import csv
import io
import json
import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.base.lazy import require_extra
from flexstage.control.dynamic_budget import DynamicBudget
from flexstage.files.names import file_names
from flexstage.files.plain import json_text
from flexstage.report.figures.body_motion import draw_reachable_area
from flexstage.report.figures.drives import draw_working_line
from flexstage.report.figures.responses import draw_bode
from flexstage.report.figures.style import encode
from flexstage.report.optimise import front_html
from flexstage.report.sweep import sweep_html
from flexstage.report.tolerance import tolerance_page
from flexstage.studies.explore.ensemble import Ensemble
from flexstage.studies.explore.optimise.front import Front
from flexstage.studies.explore.optimise.optimum import Optimum
from flexstage.studies.explore.sensitivity import Sensitivities
from flexstage.studies.explore.sweep import FAULT, Sweep
from flexstage.studies.explore.tolerance import ToleranceStudy
from flexstage.studies.results import results_json
from flexstage.studies.stacks import StackAtWork
from flexstage.system import Analysis

Files = dict[str, bytes]


def analysis_files(analysis: Analysis, results: Mapping[str, Any]) -> Files:
    """Return the files of one model by name; `results` are those of its `ModelRun`."""
    files = {"analysis.json": results_json(dict(results))} | bode_files(analysis)
    workspace = None if analysis.coupling is None else analysis.coupling.workspace
    if workspace is not None:
        files["workspace.svg"] = encode(draw_reachable_area(workspace), "svg")
    return files


def bode_files(analysis: Analysis, stem: str = "bode", kind: str = "svg") -> Files:
    """Return a Bode diagram of each axis, by the name of its file."""
    names = file_names([a.axis for a in analysis.axes])
    return {
        f"{stem}-{name}.{kind}": encode(draw_bode(analysis, a.axis), kind.lower())
        for name, a in zip(names, analysis.axes, strict=True)
    }


def working_line_files(stacks: Iterable[StackAtWork]) -> Files:
    """Return the working line of each stack, by the name of its file."""
    lines = [stack.line for stack in stacks]
    names = file_names([line.drive.name for line in lines])
    return {
        f"working-line-{name}.svg": encode(draw_working_line(line), "svg")
        for name, line in zip(names, lines, strict=True)
    }


def budget_files(budget: DynamicBudget) -> Files:
    """Return density and cumulative amplitude by source at each point, by the name of its file."""
    points = list(dict.fromkeys(b.point for b in budget.budgets))
    return {
        f"how-quiet-{name}.svg": encode(budget.plot(point=point), "svg")
        for name, point in zip(file_names(points), points, strict=True)
    }


def sweep_files(sweep: Sweep) -> tuple[Files, list[str]]:
    """Return the files of a sweep, and notes on those that could not be made."""
    makes: dict[str, Callable[[], bytes]] = {
        "sweep.csv": partial(sweep_csv, sweep),
        "sweep.parquet": partial(sweep_parquet, sweep),
        "sweep.json": lambda: json_text(sweep.summary()).encode(),
        "sweep.svg": lambda: encode(sweep.plot(), "svg"),
        "indices.svg": lambda: encode(sweep.plot("indices"), "svg"),
        "sweep.html": lambda: sweep_html(sweep).encode(),
    }
    if sweep.indices is None:
        del makes["indices.svg"]
    files: Files = {}
    notes: list[str] = []
    for name, make in makes.items():
        try:
            files[name] = make()
        except ModelError as error:
            notes.append(f"{name} was not written: {error}")
    return files, notes


def optimum_files(optimum: Optimum) -> Files:
    """Return the files of an optimum: its stage file, the result and pictures."""
    return {
        "best.yaml": optimum.text.encode(),
        "optimise.json": json_text(optimum.to_dict()).encode(),
    } | _optimum_pictures(optimum)


def front_files(front: Front) -> Files:
    """Return the files of a Pareto front and of its selected design."""
    page = {"front.html": front_html(front).encode()} if len(front.problem.goals) > 2 else {}
    return (
        {
            "best.yaml": front.optimum.text.encode(),
            "optimise.json": json_text(front.to_dict()).encode(),
            "front.svg": encode(front.plot(), "svg"),
        }
        | _optimum_pictures(front.optimum)
        | page
    )


def _optimum_pictures(optimum: Optimum) -> Files:
    views = {"history.svg": "history", "before-after.svg": "", "figures.svg": "figures"}
    return {name: encode(optimum.plot(view), "svg") for name, view in views.items()}


def ensemble_files(ensemble: Ensemble) -> Files:
    """Return the files of an ensemble: the stage file of each member, the result and a picture."""
    return {
        "reconstruct.json": json_text(ensemble.to_dict()).encode(),
        "ranges.svg": encode(ensemble.plot(), "svg"),
        "best.yaml": ensemble.text.encode(),
    } | {
        f"member-{k + 1:03}.yaml": ensemble.member_text(k).encode()
        for k in range(len(ensemble.points))
    }


def tolerance_files(study: ToleranceStudy, *, every: bool = False) -> Files:
    """Return the files of a tolerance analysis; with `every`, also the figures of each sample."""
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


def sensitivity_files(sensitivities: Sensitivities) -> Files:
    """Return the files of sensitivities."""
    return {
        "sensitivity.json": json_text(sensitivities.to_dict()).encode(),
        "sensitivity.csv": sensitivity_csv(sensitivities).encode(),
        "sensitivity.svg": encode(sensitivities.plot(), "svg"),
    }


def sweep_csv(sweep: Sweep) -> bytes:
    """Return all points as text, a line each: variables, figures, the fault of an infeasible one.

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

    descriptions = [v.description for v in sweep.variables] + [f.label for f in sweep.figures]
    fields = [
        pa.field(name, pa.float64(), metadata={"unit": unit, "description": words})
        for (name, unit), words in zip(sweep.column_units, descriptions, strict=True)
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


def sensitivity_csv(sensitivities: Sensitivities) -> str:
    """Return a line for each parameter: its value, the slope of each figure, and its part."""
    slopes = [f"d {f.name} [{f.display.unit}] / d parameter" for f in sensitivities.figures]
    parts = [f"d ln {f.name} / d ln parameter" for f in sensitivities.figures]
    columns = np.concatenate((sensitivities.slopes, sensitivities.elasticities)).T.tolist()
    rows = (
        [name, repr(variable.usual), variable.si_unit, *_numbers(numbers)]
        for variable, equivalent, numbers in zip(
            sensitivities.variables, sensitivities.equivalent, columns, strict=True
        )
        for name in equivalent
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
