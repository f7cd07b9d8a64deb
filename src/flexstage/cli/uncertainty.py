"""`flexstage uncertainty`: a budget file, by the GUM and by Monte Carlo."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import JsonOption, QuietOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    console,
    print_json,
    print_notes,
    print_table,
    progress_bar,
    write_picture,
)
from flexstage.files.plain import picked, plain
from flexstage.measure.requests import UncertaintyRequest

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.measure.uncertainty.budget_file import Budget
    from flexstage.measure.uncertainty.monte_carlo import MonteCarlo, Validation
    from flexstage.measure.uncertainty.propagate import Propagated


@from_docstring
def uncertainty(
    file: Annotated[Path, typer.Argument()],
    request: UncertaintyRequest,
    figure: FigureFile = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Propagate an uncertainty budget by GUM and Monte Carlo.

    Parameters
    ----------
    file
        FILE: An uncertainty budget in YAML: quantity, unit, equation, influences, correlations.
    figure
        Draw the distribution and the budget. (.svg, .png or .pdf)
    """
    from flexstage.measure.uncertainty.budget_file import read_budget
    from flexstage.measure.uncertainty.monte_carlo import validate
    from flexstage.report.figures.distributions import draw_budget

    budget = read_budget(file)
    propagated = budget.propagate()
    with progress_bar("uncertainty", quiet=quiet):
        drawn = budget.monte_carlo(request)
    verdict = validate(propagated, drawn)
    named = {"quantity": budget.quantity, "unit": budget.unit, "factor": budget.factor}
    files = write_picture(figure, lambda: draw_budget(propagated, drawn, **named))
    result = _result(budget, propagated, drawn, verdict, files)
    if json:
        print_json(result)
    else:
        _print(console(), result)


def _result(
    budget: "Budget",
    propagated: "Propagated",
    drawn: "MonteCarlo",
    verdict: "Validation",
    files: list[Path],
) -> dict[str, Any]:
    scale = 1.0 / budget.factor

    def scaled(ends: tuple[float, float]) -> list[float]:
        return [scale * end for end in ends]

    ends = propagated.interval(drawn.confidence)
    u = propagated.uncertainty
    return {
        "quantity": budget.quantity,
        "unit": budget.unit,
        "equation": budget.equation.text,
        "confidence": drawn.confidence,
        "influences": [
            {
                **picked(line, "name", "value", "standard_uncertainty=uncertainty"),
                **picked(line, "unit", "degrees_of_freedom", "distribution", "kind"),
                "sensitivity": scale * line.sensitivity,
                "contribution": scale * line.contribution,
                **picked(line, "share", "source"),
            }
            for line in propagated.lines
        ],
        "correlations": [
            {"between": [first, second], "coefficient": r}
            for first, second, r in budget.correlations
        ],
        "gum": {
            "value": scale * propagated.value,
            "standard_uncertainty": scale * u,
            "degrees_of_freedom": plain(propagated.degrees_of_freedom),
            "coverage_factor": 0.5 * (ends[1] - ends[0]) / u if u > 0.0 else None,
            "expanded_uncertainty": scale * 0.5 * (ends[1] - ends[0]),
            "interval": scaled(ends),
        },
        "monte_carlo": {
            "value": scale * drawn.value,
            "standard_uncertainty": scale * drawn.uncertainty,
            "interval": scaled(drawn.symmetric),
            "shortest_interval": scaled(drawn.shortest),
            "trials": drawn.trials,
            "seed": drawn.seed,
            "tolerance": None if drawn.tolerance is None else scale * drawn.tolerance,
        },
        "agreement": {
            "valid": verdict.valid,
            "tolerance": scale * verdict.tolerance,
            "low": scale * verdict.low,
            "high": scale * verdict.high,
        },
        "notes": [*_constants(budget), *propagated.notes, *filter(None, [budget.notes])],
        "files": [str(file) for file in files],
    }


def _constants(budget: "Budget") -> list[str]:
    exact = [i.name for i in budget.influences if i.standard_uncertainty == 0.0]
    if not exact:
        return []
    are = "is taken as a constant" if len(exact) == 1 else "are taken as constants"
    return [f"{', '.join(exact)} {are}, known exactly"]


def _print(screen: "Console", result: dict[str, Any]) -> None:
    unit = "" if result["unit"] == "1" else f" {result['unit']}"
    heads = "influence", "value", "std. uncertainty", "<unit", "~<distribution", "~<kind", "~dof"
    shares = "sensitivity", f"contribution,{unit or ' 1'}", "share, %"
    rows = (
        (
            row["name"],
            f"{row['value']:.8g}",
            f"{row['standard_uncertainty']:.3g}",
            row["unit"],
            row["distribution"],
            row["kind"],
            "" if row["degrees_of_freedom"] is None else f"{row['degrees_of_freedom']:.3g}",
            f"{row['sensitivity']:.4g}",
            f"{row['contribution']:.3g}",
            f"{100.0 * row['share']:.1f}",
        )
        for row in result["influences"]
    )
    print_table(screen, f"{result['quantity']} = {result['equation']}", (*heads, *shares), rows)
    percent = f"{100.0 * result['confidence']:g} %"
    summary = []
    gum, drawn = result["gum"], result["monte_carlo"]
    u = gum["standard_uncertainty"] or drawn["standard_uncertainty"]
    digits = max(0, 2 - math.floor(math.log10(u))) if u > 0.0 else 99
    for name, one, ends in (
        ("GUM, first order", gum, gum["interval"]),
        ("Monte Carlo", drawn, drawn["interval"]),
        ("Monte Carlo, shortest", drawn, drawn["shortest_interval"]),
    ):
        numbers = (one["value"], one["standard_uncertainty"], *ends)
        shown = (f"{n:.{digits}f}" if digits < 16 else f"{n:.8g}" for n in numbers)
        summary.append((name, *shown))
    title = f"{result['quantity']}{',' if unit else ''}{unit}, intervals of {percent}"
    print_table(screen, title, ("by", "value", "std. uncertainty", "from", "to"), summary)
    freedom = gum["degrees_of_freedom"]
    if freedom is not None:
        screen.print(f"effective degrees of freedom {freedom:.1f}", markup=False)
    screen.print(_verdict(result), markup=False)
    print_notes(screen, result["notes"], result["files"])


def _verdict(result: dict[str, Any]) -> str:
    one, unit = result["agreement"], "" if result["unit"] == "1" else f" {result['unit']}"
    apart = f"the ends differ by {one['low']:.2g} and {one['high']:.2g}{unit}"
    trials = f"{result['monte_carlo']['trials']} trials"
    if one["valid"]:
        return f"GUM and Monte Carlo ({trials}) agree: {apart}, {one['tolerance']:.2g} is allowed"
    return (
        f"GUM and Monte Carlo ({trials}) do not agree: {apart}, {one['tolerance']:.2g} is allowed; "
        "take the Monte Carlo interval"
    )
