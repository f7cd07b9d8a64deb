"""`flexstage optimise`: the best stage of a family, or the one that has stated figures."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from flexstage.cli.options import (
    JsonOption,
    QuietOption,
    from_docstring,
)
from flexstage.cli.output import (
    FigureFile,
    OutputFolder,
    console,
    print_json,
    print_notes,
    print_shown,
    progress_bar,
    write_folder,
    write_picture,
)
from flexstage.cli.stage_options import NOTHING_SET, ParameterOptions, TemplateArgument
from flexstage.explore.requests import USUAL_WORKERS, OptimiseRequest, WorkerRequest

if TYPE_CHECKING:
    from flexstage.explore import Front, Optimum


@from_docstring
def optimise(
    stage: TemplateArgument,
    request: OptimiseRequest,
    folder: OutputFolder = None,
    figure: FigureFile = None,
    taken: ParameterOptions = NOTHING_SET,
    sharing: WorkerRequest = USUAL_WORKERS,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Find the best dimensions, or those of stated figures.

    The lumped model is searched, finer ones correct it and confirm what is found. Printed are the
    figures before and after, which limit holds the best stage, and what it would give to relax it.

    Parameters
    ----------
    folder
        Write the best stage as best.yaml, its dimensions rounded to 0.001 mm, the result as
        optimise.json, and pictures.
    figure
        Draw the stage before and after, or the Pareto front. (.svg, .png or .pdf)
    """
    from flexstage.explore.optimise.front import Front
    from flexstage.explore.prepare import ready_optimise

    run = ready_optimise(request, taken.template(stage))
    with progress_bar("optimise", quiet=quiet), sharing.open() as workers:
        found = run(workers)
    if isinstance(found, Front):
        _tell_front(found, folder, figure, json=json)
        found = found.optimum
    else:
        _tell(found, folder, figure, json=json)
    if not found.met:  # a requirement is missed
        raise typer.Exit(1)


def _tell(found: "Optimum", folder: Path | None, figure: Path | None, *, json: bool) -> None:
    from flexstage.explore.results import optimum_results
    from flexstage.report.explored_files import optimum_files
    from flexstage.report.figures.optimum import draw_before_after
    from flexstage.report.optimise import optimum_notes, optimum_tables

    files = write_folder(folder, partial(optimum_files, found))
    files += write_picture(figure, partial(draw_before_after, found))
    if json:
        print_json(optimum_results(found) | {"files": [str(file) for file in files]})
        return
    _print(optimum_tables(found), optimum_notes(found), files)


def _tell_front(found: "Front", folder: Path | None, figure: Path | None, *, json: bool) -> None:
    from flexstage.explore.results import front_results
    from flexstage.report.explored_files import front_files
    from flexstage.report.figures.optimum import draw_front
    from flexstage.report.optimise import front_notes, front_tables

    files = write_folder(folder, partial(front_files, found))
    files += write_picture(figure, partial(draw_front, found))
    if json:
        print_json(front_results(found) | {"files": [str(file) for file in files]})
        return
    _print(front_tables(found), front_notes(found), files)


def _print(tables: Any, notes: tuple[str, ...], files: list[Path]) -> None:
    screen = console()
    for shown in tables:
        print_shown(screen, shown)
    print_notes(screen, notes, files)
