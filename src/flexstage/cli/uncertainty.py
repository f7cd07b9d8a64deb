"""`flexstage uncertainty`: evaluation of a budget by the GUM and by Monte Carlo."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import JsonOption, QuietOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    console,
    print_notes,
    print_result,
    print_table,
    progress_bar,
    write_picture,
)
from flexstage.measure.requests import UncertaintyRequest

if TYPE_CHECKING:
    from rich.console import Console


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
        Draw the distribution and the budget (.svg, .png or .pdf).
    """
    from flexstage.measure.uncertainty.budget_file import evaluate_budget, read_budget

    budget = read_budget(file)
    with progress_bar("uncertainty", quiet=quiet):
        result = evaluate_budget(budget, request)
    files = write_picture(figure, result.plot)
    if json:
        print_result(result.to_dict(), files)
    else:
        _print(console(), result.to_dict(), files)


def _print(screen: "Console", result: dict[str, Any], files: list[Path]) -> None:
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
    gum, monte_carlo = result["gum"], result["monte_carlo"]
    u = gum["standard_uncertainty"] or monte_carlo["standard_uncertainty"]
    digits = max(0, 2 - math.floor(math.log10(u))) if u > 0.0 else 99
    for name, evaluation, ends in (
        ("GUM, first order", gum, gum["interval"]),
        ("Monte Carlo", monte_carlo, monte_carlo["interval"]),
        ("Monte Carlo, shortest", monte_carlo, monte_carlo["shortest_interval"]),
    ):
        numbers = (evaluation["value"], evaluation["standard_uncertainty"], *ends)
        cells = (f"{n:.{digits}f}" if digits < 16 else f"{n:.8g}" for n in numbers)
        summary.append((name, *cells))
    title = f"{result['quantity']}{',' if unit else ''}{unit}, {percent} intervals"
    print_table(screen, title, ("method", "value", "std. uncertainty", "from", "to"), summary)
    freedom = gum["degrees_of_freedom"]
    if freedom is not None:
        screen.print(f"effective degrees of freedom {freedom:.1f}", markup=False)
    screen.print(_agreement(result), markup=False)
    print_notes(screen, result["notes"], files)


def _agreement(result: dict[str, Any]) -> str:
    agreement, unit = result["agreement"], "" if result["unit"] == "1" else f" {result['unit']}"
    trials = f"{result['monte_carlo']['trials']} trials"
    difference = (
        f"the interval ends differ by {agreement['low']:.2g} and {agreement['high']:.2g}{unit}, "
        f"{agreement['tolerance']:.2g} is allowed"
    )
    if agreement["valid"]:
        return f"GUM and Monte Carlo ({trials}) agree: {difference}"
    return (
        f"GUM and Monte Carlo ({trials}) do not agree: {difference}; use the Monte Carlo interval"
    )
