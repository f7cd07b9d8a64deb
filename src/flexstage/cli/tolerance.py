"""`flexstage tolerance`: scatter and yield of a stage, and the tolerance to tighten."""

from pathlib import Path
from typing import TYPE_CHECKING

from flexstage.cli.options import (
    JsonOption,
    QuietOption,
    from_docstring,
    refuse,
)
from flexstage.cli.output import (
    FigureFile,
    OutputFolder,
    console,
    display_table,
    print_notes,
    print_result,
    progress_bar,
    write_folder,
    write_picture,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.studies.explore.requests import USUAL_WORKERS, ToleranceRequest, WorkerRequest

if TYPE_CHECKING:
    from flexstage.studies.explore.tolerance import ToleranceStudy


@from_docstring
def tolerance(
    stage: StageArgument,
    request: ToleranceRequest,
    options: StageOptions = AS_DESCRIBED,
    figure: FigureFile = None,
    folder: OutputFolder = None,
    every_sample: bool = False,
    sharing: WorkerRequest = USUAL_WORKERS,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Monte Carlo tolerance analysis: scatter and yield.

    Parameters
    ----------
    figure
        Draw the distribution of every figure (.svg, .png or .pdf).
    folder
        Write tolerance.html, tolerance.json and pictures. An interrupted run resumes from the
        finished batches in this folder.
    every_sample
        Also write the figures of every sample, as samples.csv.
    """
    from flexstage.report.result_files import tolerance_files
    from flexstage.studies.explore.batches import finished_batches
    from flexstage.studies.explore.prepare import ready_tolerance

    refuse(every_sample and folder is None, "--every-sample writes a file: give a --folder for it")
    run = ready_tolerance(request, options.stage(stage))
    with finished_batches(folder) as keep:
        with progress_bar("tolerance", quiet=quiet), sharing.open() as workers:
            study = run(workers, keep)
        files = write_folder(folder, lambda: tolerance_files(study, every=every_sample))
    files += write_picture(figure, study.plot)
    if json:
        print_result(study.to_dict(), files)
        return
    _print(study, files)


def _print(study: "ToleranceStudy", files: list[Path]) -> None:
    from flexstage.report.tolerance import choice_table, share_table, spread_table, yield_table

    screen, choice = console(), study.choice
    display_table(screen, spread_table(study))
    if study.yields:
        display_table(screen, yield_table(study.yields))
    if study.shares:
        display_table(screen, share_table(study))
    if choice is not None:
        if choice.available:
            display_table(screen, choice_table(choice))
        screen.print(choice.conclusion, markup=False)
    print_notes(screen, (f"figures by the {study.model}", *study.notes), files)
