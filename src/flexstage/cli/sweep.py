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
    print_result,
    print_tables,
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
    options: ParameterOptions = NOTHING_SET,
    sharing: WorkerRequest = USUAL_WORKERS,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Parameter sweep: figures of a stage over its parameters.

    Parameters
    ----------
    folder
        Write all points as sweep.csv and sweep.parquet, the summary as sweep.json, pictures, and
        sweep.html with parallel coordinates. An interrupted sweep resumes from this folder.
    figure
        Draw the figures over the parameters: curves, maps or diagrams (.svg, .png or .pdf).
    """
    from flexstage.studies.explore.batches import finished_batches
    from flexstage.studies.explore.prepare import ready_sweep

    run = ready_sweep(request, options.template(stage))
    with finished_batches(folder) as keep:
        with progress_bar("sweep", quiet=quiet), sharing.open() as workers:
            result = run(workers=workers, keep=keep)
        files, notes = _write_files(result, folder, figure)
    if json:
        summary = result.to_dict()
        summary["notes"] += notes
        print_result(summary, files)
        return
    from flexstage.report.sweep import sweep_notes, sweep_tables

    print_tables(sweep_tables(result), (*sweep_notes(result), *notes), files)


def _write_files(
    sweep: "Sweep", folder: Path | None, figure: Path | None
) -> tuple[list[Path], list[str]]:
    """Write the requested files; return them, and notes on those that could not be made."""
    from flexstage.files.write import write_files
    from flexstage.report.result_files import sweep_files

    files: list[Path] = []
    notes: list[str] = []
    if figure is not None:
        try:
            files += write_picture(figure, sweep.plot)
        except ModelError as error:
            notes.append(f"{figure.name} was not written: {error}")
    if folder is not None:
        contents, missing = sweep_files(sweep)
        files += write_files(folder, contents)
        notes += missing
    return files, notes
