"""`flexstage new`: the built-in designs, and a stage file of one to start from."""

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

#: Name of the picture of all designs.
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
        [DESIGN]: Name of a built-in design: its dimensions are written to a stage file, with
        comments. Without a name, all designs are listed.
    out
        Write the stage file (default: DESIGN.yaml).
    spelled_out
        Write the full description to the file: bodies, hinges, drives, probes.
    force
        Replace a file that exists.
    folder
        Draw DESIGN to this folder; without a name, each design and one sheet of all.
    """
    from flexstage.stage.designs.registry import DESIGNS, PARAMETER_SETS, known_design
    from flexstage.stage.designs.registry import design as build_design

    if design is None:
        refuse(
            out or spelled_out or force, "--out, --spelled-out and --force need a DESIGN: name one"
        )
        stages = {name: build_design(name) for name in DESIGNS}
        files = [] if folder is None else _draw(stages, folder)
        _list(PARAMETER_SETS, stages, files, json=json)
        return
    from flexstage.stage.designs.source import design_text, spelled_out_text

    name = known_design(design)
    path = stage_file(out, f"{name}.yaml", force=force)
    text = spelled_out_text(name) if spelled_out else design_text(name)
    write_file(path, text.encode("utf-8"))
    files = [path, *([] if folder is None else _draw({name: build_design(name)}, folder))]
    if json:
        print_json({"design": name, "files": [str(file) for file in files]})
        return
    print_notes(console(), (), files)


def _list(
    parameter_sets: "Mapping[str, ParameterSet]",
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
                "family": parameter_sets[name].topology.name,
                "source": parameter_sets[name].topology.source,
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
        "Built-in designs; 'flexstage new DESIGN' writes a stage file",
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


def _draw(stages: "Mapping[str, Stage]", folder: Path) -> list[Path]:
    """Draw stages, and one sheet of all if there are several."""
    from flexstage.files.write import write_files
    from flexstage.report.figures.drawing import draw_stage
    from flexstage.report.figures.drawn_stage import draw_contact_sheet
    from flexstage.report.figures.style import encode

    figures = {name: draw_stage(stage) for name, stage in stages.items()}
    if len(stages) > 1:
        figures[_SHEET] = draw_contact_sheet(stages)
    return write_files(folder, {f"{name}.png": encode(f, "png") for name, f in figures.items()})
