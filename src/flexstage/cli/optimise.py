"""`flexstage optimise`: dimensions that optimise a figure, or match values."""

from functools import partial

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
    print_notes,
    print_result,
    print_shown,
    progress_bar,
    write_folder,
    write_picture,
)
from flexstage.cli.stage_options import NOTHING_SET, ParameterOptions, TemplateArgument
from flexstage.studies.explore.requests import USUAL_WORKERS, OptimiseRequest, WorkerRequest


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
    """Optimise a figure subject to constraints, or match values.

    Finer models correct a search of the lumped model and confirm its optimum. The result has the
    figures before and after, the active constraints and their sensitivities.

    Parameters
    ----------
    folder
        Write the optimised stage as best.yaml, with dimensions rounded to 0.001 mm, the result as
        optimise.json, and pictures.
    figure
        Draw the stage before and after, or the Pareto front. (.svg, .png or .pdf)
    """
    from flexstage.report.explored_files import front_files, optimum_files
    from flexstage.report.optimise import (
        front_notes,
        front_tables,
        optimum_notes,
        optimum_tables,
    )
    from flexstage.studies.explore.optimise.front import Front
    from flexstage.studies.explore.prepare import ready_optimise

    run = ready_optimise(request, taken.template(stage))
    with progress_bar("optimise", quiet=quiet), sharing.open() as workers:
        found = run(workers)
    if isinstance(found, Front):
        make, tables, notes = partial(front_files, found), front_tables(found), front_notes(found)
        best = found.optimum
    else:
        make, best = partial(optimum_files, found), found
        tables, notes = optimum_tables(found), optimum_notes(found)
    files = write_folder(folder, make)
    files += write_picture(figure, found.plot)
    if json:
        print_result(found.to_dict(), files)
    else:
        screen = console()
        for shown in tables:
            print_shown(screen, shown)
        print_notes(screen, notes, files)
    if not best.met:  # a requirement is missed
        raise typer.Exit(1)
