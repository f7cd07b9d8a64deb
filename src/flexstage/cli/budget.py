"""`flexstage budget`: dynamic error budget of a stage, from floor and noise to nanometres."""

from typing import TYPE_CHECKING

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
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.studies.requests import BudgetRequest

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.control.dynamic_budget import DynamicBudget, PointBudget, RequiredBandwidth


@from_docstring
def budget(
    stage: StageArgument,
    request: BudgetRequest,
    options: StageOptions = AS_DESCRIBED,
    figure: FigureFile = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Compute the rms that floor and noise leave, by source.

    Parameters
    ----------
    figure
        Draw the cumulative amplitude by source for the last loop (.svg, .png or .pdf).
    """
    from flexstage.studies.models import stage_budget

    described = options.stage(stage)
    with progress_bar("budget", quiet=quiet):
        result = stage_budget(described, request)
    files = write_picture(figure, result.plot)
    if json:
        print_result(result.to_dict(), files)
        return
    screen = console()
    print_budget(screen, result)
    print_notes(screen, result.notes, files)


def print_budget(screen: "Console", result: "DynamicBudget") -> None:
    """Print the tables of a budget, by point of interest."""
    for point in dict.fromkeys(b.point for b in result.budgets):
        _print_point(screen, result, [b for b in result.budgets if b.point == point])
    if result.required is not None:
        _print_required(screen, result.required)


def _print_required(screen: "Console", required: "RequiredBandwidth") -> None:
    from flexstage.quantities.quantity import number

    bandwidth = "none" if required.bandwidth_hz is None else number(required.bandwidth_hz, 3)
    least = number(1e9 * required.least, 3), number(required.least_bandwidth_hz, 3)
    print_table(
        screen,
        f"{required.point} by the gain of loop {required.loop}: {required.sentence}",
        ("<", "rms, nm", "crossover, Hz"),
        [("required", number(1e9 * required.rms, 3), bandwidth), ("least", *least)],
    )


def _print_point(screen: "Console", result: "DynamicBudget", budgets: "list[PointBudget]") -> None:
    from flexstage.quantities.quantity import number
    from flexstage.report.tables import loops_table, rms_unit, tree_table

    last = budgets[-1]
    factor, _ = rms_unit(budgets)
    if last.tree is not None:
        length, heads, lines = tree_table(budgets)
        print_table(screen, f"{last.point}: standard uncertainty in {length}", heads, lines)
    unit, heads, lines = loops_table(result, last.point)
    print_table(screen, f"{result.stage}, {last.point}: rms in {unit}", heads, lines)
    print_table(
        screen,
        f"{last.point} with loop {last.loop}: rms in {unit} by frequency",
        ("<source", *(f"{low:g} to {high:g} Hz" for low, high in last.bands)),
        [
            (s.name, *(number(factor * last.rms(s, band), 3) for band in last.bands))
            for s in last.sources
        ],
    )
    print_table(
        screen,
        f"{last.point} with loop {last.loop}: what to improve first",
        ("<1 % more of", "changes the total by, %"),
        [(name, f"{change:+.3f}") for name, change in last.ranking()],
    )
