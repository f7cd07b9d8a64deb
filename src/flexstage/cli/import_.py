"""`flexstage import`: make a stage file of a drawing."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    OutputFile,
    console,
    count,
    print_json,
    print_notes,
    print_shown,
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
    taken: DrawingOptions,
    json: JsonOption = False,
) -> None:
    """Make a stage file of a drawing: find its bodies and necks.

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
        Draw what was found: bodies, and necks with how sure each is. (.svg, .png or .pdf)
    """
    from flexstage.report.figures.drawn_stage import draw_found
    from flexstage.stage.drawing.drawn_stage import read_drawing, stage_file_text

    drawn = read_drawing(drawing, taken)
    path = stage_file(out, f"{file_name(drawn.stage.name)}.yaml", force=force)
    write_file(path, stage_file_text(drawn).encode("utf-8"))
    files = [path, *write_picture(figure, lambda: draw_found(drawn))]
    if json:
        print_json(_plain(drawn, files))
    else:
        _printed(drawn, files)


def _plain(drawn: "DrawnStage", files: list[Path]) -> dict[str, Any]:
    from flexstage.files.plain import picked

    stage = drawn.stage
    return {
        "stage": stage.name,
        "unit": drawn.unit_name,
        "bodies": [
            {"name": b.name, "fixed": b.fixed, "mounting_holes": len(b.mounting_holes)}
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
            for hinge, neck in zip(stage.hinges, drawn.necks, strict=True)
        ],
        "blanks": list(drawn.blanks),
        "left_out": dict(drawn.excluded),
        "files": [str(f) for f in files],
    }


def _printed(drawn: "DrawnStage", files: list[Path]) -> None:
    from flexstage.report.tables import necks_table

    stage, screen = drawn.stage, console()
    held = ", ".join(b.name for b in stage.bodies if b.fixed)
    caption = (
        f"{stage.name}: {count(len(stage.bodies), 'body')} (held: {held}), "
        f"{count(len(stage.hinges), 'neck')}"
    )
    print_shown(screen, necks_table(drawn, caption))
    notes = []
    if drawn.excluded:
        left = ", ".join(f"{n} x {what}" for what, n in drawn.excluded)
        notes.append(f"left out of the drawing: {left}")
    if drawn.blanks:
        notes.append(f"the drawing does not say: {', '.join(drawn.blanks)}")
    print_notes(screen, notes, files)
