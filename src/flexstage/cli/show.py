"""`flexstage show`: draw a stage."""

from pathlib import Path

import typer

from flexstage.base.errors import ModelError
from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import OutputFile, print_json, writable, write_file
from flexstage.cli.stage_options import AS_DRAWN, DrawnStageOptions, StageArgument
from flexstage.files.names import file_name


@from_docstring
def show(
    stage: StageArgument,
    out: OutputFile = None,
    options: DrawnStageOptions = AS_DRAWN,
    json: JsonOption = False,
) -> None:
    """Draw a stage: bodies, hinges, drives and probes.

    Parameters
    ----------
    out
        Write the drawing (.svg, .png or .pdf; default: NAME.svg).
    """
    from flexstage.report.figures.drawing import draw_stage
    from flexstage.report.figures.style import FORMATS, encode

    described = options.stage(stage)
    path = out if out is not None else writable(Path(f"{file_name(described.name)}.svg"))
    kind = path.suffix.removeprefix(".").casefold()
    if kind not in FORMATS:
        endings = ", ".join(f".{name}" for name in FORMATS)
        raise ModelError(f"a drawing is written as {endings}, got '{path.name}': change its suffix")
    write_file(path, encode(draw_stage(described), kind))
    if json:
        print_json({"stage": described.name, "files": [str(path)]})
    else:
        typer.echo(f"wrote {path}")
