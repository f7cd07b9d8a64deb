"""`flexstage equations`: equations of motion of a stage in symbols."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from flexstage.base.errors import StageError
from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import OutputFile, print_json, write_file
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.system.requests import EquationsRequest

if TYPE_CHECKING:
    from flexstage.stage import Stage


@from_docstring
def equations(
    stage: StageArgument,
    request: EquationsRequest,
    out: OutputFile = None,
    options: StageOptions = AS_DESCRIBED,
    json: JsonOption = False,
) -> None:
    """Derive the equations of motion in symbols.

    Energies, Lagrange's equations, the matrices M, C and K, and transfer functions.

    Parameters
    ----------
    out
        Write the equations to a file instead of the terminal.
    """
    described = options.stage(stage)
    if request.axis is not None:
        described.axis(request.axis)
    if request.to == "svg":
        drawing = _diagram(described, request.axis)
        _write({"stage": described.name, "diagram": drawing} if json else None, drawing, out)
        return
    from flexstage.lumped.derivation import derive
    from flexstage.lumped.latex import latex_document, plain_text

    derivation = derive(described, request)
    title = f"Equations of motion of {described.name}"
    text = (latex_document if request.to == "latex" else plain_text)(title, derivation.sheet)
    _write(derivation.to_dict() if json else None, text, out)


def _write(content: dict[str, Any] | None, text: str, out: Path | None) -> None:
    """Write the text to a file, if one is named; print it, or the content as JSON, or its path."""
    if out is not None:
        write_file(out, text.encode())
    if content is not None:
        print_json(content if out is None else content | {"files": [str(out)]})
    elif out is None:
        typer.echo(text, nl=False)
    else:
        typer.echo(f"wrote {out}")


def _diagram(stage: "Stage", axis: str | None) -> str:
    """Return the structural diagram of an axis as SVG."""
    axes = [a.name for a in stage.axes if a.drive is not None]
    if axis is None and len(axes) != 1:
        raise StageError(
            "a structural diagram shows one axis: "
            + (f"--axis is one of {', '.join(axes)}" if axes else "no axis has a drive of its own")
        )
    from flexstage.export.diagram.stage_diagram import stage_diagram
    from flexstage.export.diagram.svg import diagram_svg

    return diagram_svg(stage_diagram(stage, axis=axis or axes[0])).decode()
