"""`flexstage reconstruct`: stages that agree with given figures, and their other figures."""

from pathlib import Path

from flexstage.cli.options import JsonOption, QuietOption, from_docstring
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
from flexstage.studies.explore.requests import USUAL_WORKERS, ReconstructRequest, WorkerRequest


@from_docstring
def reconstruct(
    stage: TemplateArgument,
    request: ReconstructRequest,
    folder: OutputFolder = None,
    figure: FigureFile = None,
    options: ParameterOptions = NOTHING_SET,
    sharing: WorkerRequest = USUAL_WORKERS,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Infer dimensions and other figures from given figures.

    Many stages have the same few figures. The output gives the range of every figure and dimension
    over the stages that agree with the given ones, and the measurement that would narrow it most.
    Ctrl-C ends the members, and the output is that of those so far.

    Parameters
    ----------
    folder
        Write each member as member-N.yaml, the most probable stage as best.yaml, reconstruct.json
        and a picture; members of an earlier run are removed.
    figure
        Draw the range of every figure (.svg, .png or .pdf).
    """
    from flexstage.report.reconstruct import ensemble_notes, ensemble_tables
    from flexstage.report.result_files import ensemble_files
    from flexstage.studies.explore.prepare import ready_reconstruct

    run = ready_reconstruct(request, options.template(stage))
    with progress_bar("reconstruct", quiet=quiet), sharing.open() as workers:
        ensemble = run(workers)
    earlier = _members_in(folder)
    files = write_folder(folder, lambda: ensemble_files(ensemble))
    for path in earlier:
        if path not in files:
            path.unlink(missing_ok=True)
    files += write_picture(figure, ensemble.plot)
    if json:
        print_result(ensemble.to_dict(), files)
        return
    print_tables(ensemble_tables(ensemble), ensemble_notes(ensemble), _listed(files))


def _members_in(folder: Path | None) -> list[Path]:
    """Return the members of an earlier run in a folder."""
    if folder is None or not (folder / "reconstruct.json").exists():
        return []
    return [p for p in folder.glob("member-*.yaml") if p.stem.removeprefix("member-").isdigit()]


def _listed(files: list[Path]) -> list[str]:
    """Return the names of files, those of the members in one line."""
    members = [file for file in files if file.name.startswith("member-")]
    others = [str(file) for file in files if file not in members]
    ends = [f"{members[0]} to {members[-1]}"] if len(members) > 1 else [str(m) for m in members]
    return [*others, *ends]
