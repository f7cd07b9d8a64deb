"""`flexstage export`: a stage for other programs."""

from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from flexstage.cli.options import JsonOption, QuietOption, from_docstring
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

if TYPE_CHECKING:
    from flexstage.export.request import StageExport

_SHOWN = 8  # files of a format in the table


@from_docstring
def export(
    stage: StageArgument,
    request: ExportRequest,
    taken: StageOptions = AS_DESCRIBED,
    out: Annotated[Path, FOLDER] = Path("exported"),
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Write a stage for Simulink, FMI, C, CAD and other tools.

    Parameters
    ----------
    out
        Folder of the files; several formats get a subfolder each.
    """
    from flexstage.export.request import in_folders
    from flexstage.files.write import write_files
    from flexstage.studies.models import stage_export

    given = stage_export(taken.stage(stage), request)
    with progress_bar("export", quiet=quiet):
        made = given.files()
    # all formats at once: where one cannot be written, none is
    written = iter(write_files(out, in_folders(made)))
    files = {name: list(islice(written, len(contents))) for name, contents in made.items()}
    if json:
        print_json(_results(given, made, files))
        return
    screen = console()
    print_table(
        screen,
        f"{given.stage.name} for other programs",
        ("format", "<what", "<files"),
        ((name, FORMATS[name].about, _shown(paths)) for name, paths in files.items()),
    )
    print_notes(screen, given.notes)


def _shown(paths: list[Path]) -> str:
    """A line for each file, and where there are very many for the first ones."""
    lines = [str(path) for path in paths]
    if len(lines) > _SHOWN:
        lines[_SHOWN - 1 :] = [f"and {len(lines) - _SHOWN + 1} more beside these"]
    return "\n".join(lines)


def _results(
    given: "StageExport", made: dict[str, dict[str, bytes]], files: dict[str, list[Path]]
) -> dict[str, Any]:
    import hashlib

    return {
        "stage": given.stage.name,
        "files": [
            {
                "format": name,
                "path": str(path),
                "bytes": len(content),
                "sha256": hashlib.sha256(content).hexdigest(),
            }
            for name, paths in files.items()
            for path, content in zip(paths, made[name].values(), strict=True)
        ],
        "notes": list(given.notes),
    }
