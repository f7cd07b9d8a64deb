"""`flexstage export`: files of a stage for other programs."""

from itertools import islice
from pathlib import Path
from typing import Annotated, Any

from flexstage.base.errors import ModelError
from flexstage.cli.options import JsonOption, QuietOption, from_docstring, refuse
from flexstage.cli.output import (
    FOLDER,
    console,
    print_json,
    print_notes,
    print_table,
    progress_bar,
)
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.export.request import FORMATS, ExportRequest

_MOST_FILES = 8  # files of a format in the table


@from_docstring
def export(
    stage: StageArgument,
    request: ExportRequest,
    options: StageOptions = AS_DESCRIBED,
    out: Annotated[Path, FOLDER] = Path("exported"),
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Write a stage for Simulink, FMI, C, CAD and other tools.

    STAGE can also be a model of coupled drives from `flexstage identify`, for c and mat.

    Parameters
    ----------
    out
        Folder of the files; several formats get a subfolder each.
    """
    from flexstage.export.request import in_folders
    from flexstage.files.write import write_files
    from flexstage.hysteresis.coupled_drives.model_file import is_coupled_model
    from flexstage.studies.models import stage_export

    model = Path(stage)
    if is_coupled_model(model):
        other = options != AS_DESCRIBED or request != ExportRequest(to=request.to)
        refuse(other, "a model of coupled drives has no options of a stage: omit them", ModelError)
        from flexstage.export.coupled import coupled_files
        from flexstage.hysteresis.coupled_drives.model_file import read_coupled_model

        name, notes = model.stem, ()
        contents = coupled_files(read_coupled_model(model), name, request.to)
    else:
        stage_files = stage_export(options.stage(stage), request)
        with progress_bar("export", quiet=quiet):
            contents = stage_files.files()
        name, notes = stage_files.stage.name, stage_files.notes
    # all formats at once: if one cannot be written, none is
    written = iter(write_files(out, in_folders(contents)))
    files = {name: list(islice(written, len(data))) for name, data in contents.items()}
    if json:
        print_json(_results(name, notes, contents, files))
        return
    screen = console()
    print_table(
        screen,
        f"{name}: exported files",
        ("format", "<contents", "<files"),
        ((name, FORMATS[name].about, _file_lines(paths)) for name, paths in files.items()),
    )
    print_notes(screen, notes)


def _file_lines(paths: list[Path]) -> str:
    """Return a line for each file, at most for the first ones."""
    lines = [str(path) for path in paths]
    if len(lines) > _MOST_FILES:
        lines[_MOST_FILES - 1 :] = [f"and {len(lines) - _MOST_FILES + 1} more"]
    return "\n".join(lines)


def _results(
    name: str,
    notes: tuple[str, ...],
    contents: dict[str, dict[str, bytes]],
    files: dict[str, list[Path]],
) -> dict[str, Any]:
    import hashlib

    return {
        "stage": name,
        "files": [
            {
                "format": kind,
                "path": str(path),
                "bytes": len(content),
                "sha256": hashlib.sha256(content).hexdigest(),
            }
            for kind, paths in files.items()
            for path, content in zip(paths, contents[kind].values(), strict=True)
        ],
        "notes": list(notes),
    }
