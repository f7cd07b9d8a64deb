"""`flexstage sweep`: figures of a stage over its parameters."""

from pathlib import Path
from typing import TYPE_CHECKING

from flexstage.base.errors import ModelError
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
    write_picture,
)
from flexstage.cli.stage_options import NOTHING_SET, ParameterOptions, TemplateArgument
from flexstage.studies.explore.requests import USUAL_WORKERS, SweepRequest, WorkerRequest

if TYPE_CHECKING:
    from flexstage.studies.explore import Sweep


@from_docstring
def sweep(
    stage: TemplateArgument,
    request: SweepRequest,
    folder: OutputFolder = None,
    figure: FigureFile = None,
    taken: ParameterOptions = NOTHING_SET,
    sharing: WorkerRequest = USUAL_WORKERS,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Run a parameter sweep: figures of a stage over its parameters.

    Parameters
    ----------
    folder
        Write all points as sweep.csv and sweep.parquet, the summary as sweep.json, pictures, and
        sweep.html with parallel coordinates. An interrupted sweep can be resumed there.
    figure
        Draw the figures over the parameters: curves, maps or diagrams. (.svg, .png or .pdf)
    """
    from flexstage.studies.explore.batches import finished_batches
    from flexstage.studies.explore.prepare import ready_sweep

    run = ready_sweep(request, taken.template(stage))
    with finished_batches(folder) as keep:
        with progress_bar("sweep", quiet=quiet), sharing.open() as workers:
            found = run(workers=workers, keep=keep)
        files, notes = _written(found, folder, figure)
    if json:
        result = found.to_dict()
        result["notes"] += notes
        print_result(result, files)
        return
    from flexstage.report.sweep import sweep_notes, sweep_tables

    screen = console()
    for shown in sweep_tables(found):
        print_shown(screen, shown)
    print_notes(screen, (*sweep_notes(found), *notes), files)


def _written(
    found: "Sweep", folder: Path | None, figure: Path | None
) -> tuple[list[Path], list[str]]:
    """Write what was asked for; return the files, and what could not be made."""
    from flexstage.files.write import write_files
    from flexstage.report.explored_files import sweep_files

    files: list[Path] = []
    notes: list[str] = []
    if figure is not None:
        try:
            files += write_picture(figure, found.plot)
        except ModelError as error:
            notes.append(f"{figure.name} was not written: {error}")
    if folder is not None:
        whole, missing = sweep_files(found)
        files += write_files(folder, whole)
        notes += missing
    return files, notes
