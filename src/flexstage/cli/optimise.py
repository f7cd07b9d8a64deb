"""`flexstage optimise`: optimal dimensions of a stage under requirements."""

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
    print_result,
    print_tables,
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
    options: ParameterOptions = NOTHING_SET,
    sharing: WorkerRequest = USUAL_WORKERS,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Optimise dimensions under requirements, or match targets.

    The search uses the lumped model; finer models correct it and confirm the optimum. The output
    compares the figures of start and optimum, and lists the active constraints with their
    sensitivities.

    Parameters
    ----------
    folder
        Write the best stage as best.yaml (dimensions rounded to 0.001 mm), the result as
        optimise.json, and pictures.
    figure
        Draw the stage before and after, or the Pareto front (.svg, .png or .pdf).
    """
    from flexstage.report.optimise import (
        front_notes,
        front_tables,
        optimum_notes,
        optimum_tables,
    )
    from flexstage.report.result_files import front_files, optimum_files
    from flexstage.studies.explore.optimise.front import Front
    from flexstage.studies.explore.prepare import ready_optimise

    run = ready_optimise(request, options.template(stage))
    with progress_bar("optimise", quiet=quiet), sharing.open() as workers:
        result = run(workers)
    if isinstance(result, Front):
        make, tables, notes = (
            partial(front_files, result),
            front_tables(result),
            front_notes(result),
        )
        best = result.optimum
    else:
        make, best = partial(optimum_files, result), result
        tables, notes = optimum_tables(result), optimum_notes(result)
    files = write_folder(folder, make)
    files += write_picture(figure, result.plot)
    if json:
        print_result(result.to_dict(), files)
    else:
        print_tables(tables, notes, files)
    if not best.met:  # a requirement is missed
        raise typer.Exit(1)
