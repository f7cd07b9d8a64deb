"""What other programs read of each job: plain data, and tables of numbers with all digits."""

import csv
import io
import json
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.explore.deviations import KINDS
from flexstage.explore.figures import Figure
from flexstage.explore.optimise.front import Front
from flexstage.explore.optimise.optimum import Optimum
from flexstage.explore.optimise.problem import Problem
from flexstage.explore.sampling import SobolIndices
from flexstage.explore.sensitivity import Sensitivities
from flexstage.explore.spread import Shares, Spread, Yield
from flexstage.explore.sweep import Sweep
from flexstage.explore.tolerance import ToleranceStudy
from flexstage.explore.tolerance_choice import ToleranceChoice
from flexstage.explore.variables import Variable
from flexstage.files.plain import picked, plain
from flexstage.lazy import require_extra
from flexstage.units import DIMENSIONS


def optimum_results(found: Optimum) -> dict[str, Any]:
    """Return an optimum as plain data, in SI units, frequencies in Hz."""
    return {
        **_problem(found.problem),
        "met": found.met,
        "gain": found.gain,
        "variables": [
            {
                **picked(variable, "name", "dimension", "low", "high", "described=usual"),
                "start": float(start),
                "best": float(best),
            }
            for variable, start, best in zip(
                found.problem.family.variables, found.start, found.point, strict=True
            )
        ],
        "figures": [
            {
                "model": level.model,
                "start": _named(found.figures, level.start),
                "best": _named(found.figures, level.best),
            }
            for level in found.levels
        ],
        "excess": {
            r.text: plain(float(e))
            for r, e in zip(found.problem.all_requirements, found.excess, strict=True)
        },
        "held": [plain(held) for held in found.held if held.kind != "goal"],
        "rates_of_exchange": [
            {
                "goal": held.goal.text,
                "value": held.value,
                "rate": 0.0 if rate is None else rate.rate,
                "of": found.problem.goals[0].figure.name,
            }
            for held, rate in zip(found.problem.exchanged, found.exchange, strict=True)
        ],
        "ladder": [
            {
                **picked(rung, "model", "evaluations"),
                "point": plain(rung.point),
                "expected": _named(found.figures, rung.expected),
                "found": _named(found.figures, rung.found),
            }
            for rung in found.rungs
        ],
        "history": [plain(step) for step in found.trace],
        **picked(found, "free", "unexplained", "evaluations", "seconds", "seed", "notes"),
        **picked(found, "provenance"),
    }


def front_results(found: Front) -> dict[str, Any]:
    """Return a front as plain data, with the chosen design."""
    names = found.problem.family.names
    return {
        **_problem(found.problem),
        "front": [
            {
                "variables": dict(zip(names, plain(point), strict=True)),
                "lumped": _named(found.figures, values),
            }
            for point, values in zip(found.points, found.values, strict=True)
        ],
        "asked": [
            {"point": number, found.model: _named(found.figures, values)}
            for number, values in zip(found.asked, found.found, strict=True)
        ],
        **picked(found, "chosen", "generations", "evaluations"),
        "optimum": optimum_results(found.optimum),
    }


def _problem(problem: Problem) -> dict[str, Any]:
    return {
        "stage": problem.family.template.source,
        "goals": [goal.text for goal in problem.goals],
        "requirements": [r.text for r in problem.requirements],
        "required_unasked": [r.text for r in problem.usual],
    }


def _named(figures: tuple[Figure, ...], values: Array) -> dict[str, Any]:
    return {f.name: plain(float(v)) for f, v in zip(figures, values, strict=True)}


#: What the column is called that says why a point is no stage.
FAULT = "fault"


def sweep_csv(sweep: Sweep) -> bytes:
    """Return all points as text, a line each: variables, figures, and why it is no stage.

    Headings have the SI unit in brackets; numbers have the digits that give back the same bits.
    """
    heading = [*(f"{n} [{u}]" if u != "1" else n for n, u in _columns(sweep)), FAULT]
    points = zip(np.hstack((sweep.points, sweep.values)).tolist(), sweep.faults, strict=True)
    rows = ([*("" if math.isnan(v) else repr(v) for v in row), fault] for row, fault in points)
    return _csv(heading, rows, "\r\n").encode()


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
            | {"unit": _unit(v)}
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
        *((variable.name, _unit(variable)) for variable in sweep.variables),
        *((figure.name, figure.shown.unit) for figure in sweep.figures),
    ]


def tolerance_results(
    study: ToleranceStudy, choice: ToleranceChoice | None = None
) -> dict[str, Any]:
    """Return a lot as plain data: spreads, shares, yields, and the tolerances that were chosen."""
    found = {
        **picked(study, "stage=stage.name", "samples", "seed=lot.seed", "model"),
        "scatter": picked(study.scatter, *(kind.name for kind in KINDS)),
        "figures": [_spread(spread) for spread in study.spreads],
        "variance": [_shares(of) for of in study.shares],
        "yields": [_yield(y) for y in study.yields],
        **picked(study, "notes", "provenance"),
    }
    if choice is not None:
        found["tighten"] = {
            **picked(choice, "target", "reached", "verdict", "cost"),
            "scatter": picked(choice.chosen, *choice.kinds),
            "yields": [_yield(y) for y in choice.after],
        }
    return found


def samples_csv(study: ToleranceStudy) -> bytes:
    """Return the figures of every sample, a line each; nothing where it has none.

    Headings have the SI unit in brackets; numbers have the digits that give back the same bits.
    """
    heading = [f"{f.name} [{f.shown.unit}]" for f in study.lot.figures]
    return _csv(heading, map(_numbers, study.values.tolist())).encode()


def _spread(spread: Spread) -> dict[str, Any]:
    return {
        **picked(spread, "name=figure.name", "quantity=figure.quantity", "axis=figure.axis"),
        **picked(spread, "unit=figure.shown.unit", "nominal", "mean", "standard_deviation"),
        **picked(spread, "count", "apart", "percentiles"),
        "histogram": picked(spread, "edges", "counts"),
    }


def _shares(of: Shares) -> dict[str, Any]:
    return {
        **picked(of, "figure=figure.name", "explained"),
        "contributions": [
            {**picked(c, "kind", "share", "slope"), "largest": plain(dict(c.largest))}
            for c in of.contributions
        ],
    }


def _yield(found: Yield) -> dict[str, Any]:
    required = found.requirement
    return {
        "required": "all" if required is None else required.text,
        **picked(found, "met", "count", "share", "low", "high"),
    }


def sensitivity_results(found: Sensitivities, length: float | None = None) -> dict[str, Any]:
    """Return sensitivities as plain data: slopes, parts, and changes by the steps of a table."""
    slopes, parts, changes = found.slopes.T, found.elasticities.T, found.changes(length).T
    steps = found.steps(length)
    return {
        **picked(found, "stage", "model"),
        "figures": [
            {**picked(f, "name", "quantity", "axis"), "value": plain(v), "unit": f.shown.unit}
            for f, v in zip(found.figures, found.values, strict=True)
        ],
        "parameters": [
            {
                "name": variable.name,
                "alike": list(found.alike[k]),
                "value": variable.usual,
                "unit": _unit(variable),
                "slopes": plain(slopes[k]),
                "elasticities": plain(parts[k]),
                "step": plain(steps[k]),
                "changes": plain(changes[k]),
            }
            for k, variable in enumerate(found.variables)
        ],
        "left_out": found.left_out,
        "provenance": plain(found.provenance),
    }


def sensitivity_csv(found: Sensitivities) -> str:
    """Return a line for each parameter: its value, the slope of each figure, and its part."""
    slopes = [f"d {f.name} [{f.shown.unit}] / d parameter" for f in found.figures]
    parts = [f"d ln {f.name} / d ln parameter" for f in found.figures]
    columns = np.concatenate((found.slopes, found.elasticities)).T.tolist()
    rows = (
        [name, repr(variable.usual), _unit(variable), *_numbers(numbers)]
        for variable, alike, numbers in zip(found.variables, found.alike, columns, strict=True)
        for name in alike
    )
    return _csv(["parameter", "value", "unit", *slopes, *parts], rows)


def _unit(variable: Variable) -> str:
    return DIMENSIONS[variable.dimension].si if variable.dimension else "1"


def _numbers(values: Iterable[float]) -> list[str]:
    """Return the cells of numbers; empty of what is none."""
    return [repr(v) if math.isfinite(v) else "" for v in values]


def _csv(heading: Iterable[str], rows: Iterable[Iterable[str]], end: str = "\n") -> str:
    text = io.StringIO()
    lines = csv.writer(text, lineterminator=end)
    lines.writerow(heading)
    lines.writerows(rows)
    return text.getvalue()
