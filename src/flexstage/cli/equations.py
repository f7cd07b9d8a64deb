"""`flexstage equations`: the dynamic model of a stage in symbols."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from flexstage.base.errors import StageError
from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import OutputFile, print_json, write_file
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.lumped.requests import EquationsRequest

if TYPE_CHECKING:
    from flexstage.stage import Stage


@from_docstring
def equations(
    stage: StageArgument,
    request: EquationsRequest,
    out: OutputFile = None,
    taken: StageOptions = AS_DESCRIBED,
    json: JsonOption = False,
) -> None:
    """Derive the equations of motion in symbols.

    Energies, Lagrange's equations, the matrices M, C and K, and transfer functions.

    Parameters
    ----------
    out
        Write the equations to a file instead of the terminal.
    """
    described = taken.stage(stage)
    if request.axis is not None:
        described.axis(request.axis)
    if request.to == "svg":
        drawing = _drawing(described, request.axis)
        _put({"stage": described.name, "diagram": drawing} if json else None, drawing, out)
        return
    from flexstage.lumped.derivation import derive
    from flexstage.lumped.latex import latex_document, plain_text

    found = derive(described, request)
    title = f"Equations of motion of {described.name}"
    text = (latex_document if request.to == "latex" else plain_text)(title, found.sheet)
    _put(found.to_dict() if json else None, text, out)


def _put(content: dict[str, Any] | None, text: str, out: Path | None) -> None:
    """Write the text where it is wanted, and print it, or the content as JSON, or where it is."""
    if out is not None:
        write_file(out, text.encode())
    if content is not None:
        print_json(content if out is None else content | {"files": [str(out)]})
    elif out is None:
        typer.echo(text, nl=False)
    else:
        typer.echo(f"wrote {out}")


def _drawing(stage: "Stage", axis: str | None) -> str:
    """The equations of an axis as blocks and lines."""
    axes = [a.name for a in stage.axes if a.drive is not None]
    if axis is None and len(axes) != 1:
        raise StageError(
            "a structural diagram is that of one axis: "
            + (f"--axis is one of {', '.join(axes)}" if axes else "no axis has a drive of its own")
        )
    from flexstage.export.diagram.stage_diagram import stage_diagram
    from flexstage.export.diagram.svg import diagram_svg

    return diagram_svg(stage_diagram(stage, axis=axis or axes[0])).decode()
