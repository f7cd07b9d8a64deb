"""`flexstage new`: the designs that are built in, and a stage file to start from."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexstage.cli.options import JsonOption, from_docstring, refuse
from flexstage.cli.output import (
    OutputFile,
    OutputFolder,
    console,
    print_json,
    print_notes,
    print_table,
    stage_file,
    write_file,
)
from flexstage.cli.stage_options import designs_like

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexstage.stage import Stage
    from flexstage.stage.designs.parameters import ParameterSet

#: The picture with all of them on it.
_SHEET = "designs"


@from_docstring
def new(
    design: Annotated[
        str | None, typer.Argument(autocompletion=designs_like, show_default=False)
    ] = None,
    out: OutputFile = None,
    spelled_out: bool = False,
    force: bool = False,
    folder: OutputFolder = None,
    json: JsonOption = False,
) -> None:
    """List the designs, or write a stage file to start from.

    Parameters
    ----------
    design
        [DESIGN]: Name of a built-in design, whose dimensions are written with comments, as a stage
        file; without one, all designs are listed.
    out
        Write the stage file (default: DESIGN.yaml).
    spelled_out
        Describe the whole stage in the file: bodies, hinges, drives, probes.
    force
        Replace a file that exists.
    folder
        Draw DESIGN into this folder, or each design, and all of them on one sheet.
    """
    from flexstage.stage.designs.registry import DESIGNS, PARAMETER_SETS, known_design
    from flexstage.stage.designs.registry import design as built

    if design is None:
        refuse(
            out or spelled_out or force, "--out, --spelled-out and --force need a DESIGN: name one"
        )
        stages = {name: built(name) for name in DESIGNS}
        files = [] if folder is None else _drawn(stages, folder)
        _list(PARAMETER_SETS, stages, files, json=json)
        return
    from flexstage.stage.designs.source import design_text, spelled_out_text

    name = known_design(design)
    path = stage_file(out, f"{name}.yaml", force=force)
    text = spelled_out_text(name) if spelled_out else design_text(name)
    write_file(path, text.encode("utf-8"))
    files = [path, *([] if folder is None else _drawn({name: built(name)}, folder))]
    if json:
        print_json({"design": name, "files": [str(file) for file in files]})
        return
    print_notes(console(), (), files)


def _list(
    known: "Mapping[str, ParameterSet]",
    stages: "Mapping[str, Stage]",
    files: list[Path],
    *,
    json: bool,
) -> None:
    if json:
        rows = [
            {
                "design": name,
                "title": stage.title,
                "family": known[name].topology.name,
                "source": known[name].topology.source,
                "bodies": len(stage.bodies),
                "hinges": len(stage.hinges),
                "drives": len(stage.drives),
                "axes": [axis.name for axis in stage.axes],
            }
            for name, stage in stages.items()
        ]
        print_json({"designs": rows, "files": [str(file) for file in files]})
        return
    screen = console()
    print_table(
        screen,
        "Built-in designs; 'flexstage new DESIGN' writes a stage file of one",
        ("<design", "<title", "~bodies", "~hinges", "~drives", "<axes"),
        [
            (
                name,
                stage.title,
                len(stage.bodies),
                len(stage.hinges),
                len(stage.drives),
                ", ".join(axis.name for axis in stage.axes),
            )
            for name, stage in stages.items()
        ],
    )
    print_notes(screen, (), files)


def _drawn(stages: "Mapping[str, Stage]", folder: Path) -> list[Path]:
    """Draw stages, and where there are several all of them on one sheet."""
    from flexstage.files.write import write_files
    from flexstage.report.figures.drawing import draw_stage
    from flexstage.report.figures.drawn_stage import draw_contact_sheet
    from flexstage.report.figures.style import encode

    figures = {name: draw_stage(stage) for name, stage in stages.items()}
    if len(stages) > 1:
        figures[_SHEET] = draw_contact_sheet(stages)
    return write_files(folder, {f"{name}.png": encode(f, "png") for name, f in figures.items()})
