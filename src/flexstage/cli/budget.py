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

    from flexstage.control.dynamic_budget import DynamicBudget, PointBudget


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
    for point in dict.fromkeys(b.point for b in result.budgets):
        _print_point(screen, result, [b for b in result.budgets if b.point == point])
    print_notes(screen, result.notes, files)


def _print_point(screen: "Console", result: "DynamicBudget", budgets: "list[PointBudget]") -> None:
    from flexstage.quantities.quantity import number, prefixed

    factor, prefix = prefixed(max(b.total for b in budgets), 1.0)
    unit, last = f"{prefix}{budgets[0].unit}", budgets[-1]

    def size(value: float) -> str:
        return number(factor * value, 3)

    rows = [
        (source.name, source.kind, *(size(b.rms(b.sources[k])) for b in budgets))
        for k, source in enumerate(last.sources)
    ]
    rows.append(("total", "", *(size(b.total) for b in budgets)))
    if result.exposure is not None:
        exposed = [b.exposed(result.exposure) for b in budgets]
        over = f"{1e3 * result.exposure:g} ms"
        rows.append((f"average over {over}", "", *(size(average) for average, _ in exposed)))
        rows.append((f"deviation in {over}", "", *(size(deviation) for _, deviation in exposed)))
    peaks = ["1" if b.margins is None else number(b.margins.sensitivity_peak, 3) for b in budgets]
    rows.append(("largest sensitivity", "1", *peaks))
    caption = f"{result.stage}, {last.point}: rms in {unit}"
    print_table(screen, caption, ("<source", "<acts", *(b.loop for b in budgets)), rows)
    print_table(
        screen,
        f"{last.point} with loop {last.loop}: rms in {unit} by frequency",
        ("<source", *(f"{low:g} to {high:g} Hz" for low, high in last.bands)),
        [(s.name, *(size(last.rms(s, band)) for band in last.bands)) for s in last.sources],
    )
    print_table(
        screen,
        f"{last.point} with loop {last.loop}: what to improve first",
        ("<1 % more of", "changes the total by, %"),
        [(name, f"{change:+.3f}") for name, change in last.ranking()],
    )
