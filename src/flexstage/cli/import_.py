"""`flexstage import`: a stage file from a drawing."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    OutputFile,
    console,
    count,
    display_table,
    print_json,
    print_notes,
    stage_file,
    write_file,
    write_picture,
)
from flexstage.files.names import file_name
from flexstage.stage.drawing.requests import DrawingOptions

if TYPE_CHECKING:
    from flexstage.stage.drawing.drawn_stage import DrawnStage


@from_docstring
def import_(
    drawing: Annotated[Path, typer.Argument()],
    *,
    out: OutputFile = None,
    force: bool = False,
    figure: FigureFile = None,
    options: DrawingOptions,
    json: JsonOption = False,
) -> None:
    """Make a stage file from a drawing: find bodies and necks.

    Parameters
    ----------
    drawing
        DRAWING: A DXF file with the contours of a plate, or a STEP file with a plate of one
        thickness.
    out
        Write the stage file (default: NAME.yaml).
    force
        Replace a file that exists.
    figure
        Draw the bodies, and each neck with its certainty (.svg, .png or .pdf).
    """
    from flexstage.report.figures.drawn_stage import draw_recognised
    from flexstage.stage.drawing.drawn_stage import read_drawing, stage_file_text

    recognised = read_drawing(drawing, options)
    path = stage_file(out, f"{file_name(recognised.stage.name)}.yaml", force=force)
    write_file(path, stage_file_text(recognised).encode("utf-8"))
    files = [path, *write_picture(figure, lambda: draw_recognised(recognised))]
    if json:
        print_json(_result(recognised, files))
    else:
        _print(recognised, files)


def _result(recognised: "DrawnStage", files: list[Path]) -> dict[str, Any]:
    from flexstage.files.plain import picked

    stage = recognised.stage
    return {
        "stage": stage.name,
        "unit": recognised.unit_name,
        "bodies": [
            {
                "name": b.name,
                "fixed": b.fixed,
                "mounting_holes": len(b.mounting_holes),
                # none is that of the plate
                "material": None if b.material is None else b.material.name,
                "rigid": b.rigid,
            }
            for b in stage.bodies
        ],
        "necks": [
            {
                "name": hinge.name,
                "bodies": list(hinge.bodies),
                "at": list(hinge.at),
                "direction": hinge.direction,
                "profile": hinge.profile.kind,
                "one_sided": hinge.profile.one_sided,
                "neck_thickness": hinge.profile.neck_thickness,
                **picked(neck, "certainty", "ratio", "off"),
            }
            for hinge, neck in zip(stage.hinges, recognised.necks, strict=True)
        ],
        "blanks": list(recognised.blanks),
        "ignored": dict(recognised.excluded),
        "files": [str(f) for f in files],
    }


def _print(recognised: "DrawnStage", files: list[Path]) -> None:
    from flexstage.report.tables import necks_table

    stage, screen = recognised.stage, console()
    fixed = ", ".join(b.name for b in stage.bodies if b.fixed)
    caption = (
        f"{stage.name}: {count(len(stage.bodies), 'body')} (fixed: {fixed}), "
        f"{count(len(stage.hinges), 'neck')}"
    )
    display_table(screen, necks_table(recognised, caption))
    notes = []
    if recognised.excluded:
        ignored = ", ".join(f"{n} x {kind}" for kind, n in recognised.excluded)
        notes.append(f"ignored in the drawing: {ignored}")
    if recognised.blanks:
        notes.append(f"not stated in the drawing: {', '.join(recognised.blanks)}")
    print_notes(screen, notes, files)
