"""`flexstage equations`: the dynamic model of a stage in symbols."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import JsonOption, from_docstring, one_of
from flexstage.cli.output import OutputFile, print_json, write_file
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.errors import ModelError, StageError

if TYPE_CHECKING:
    from flexstage.lumped.reduction import ReducedModel
    from flexstage.lumped.symbolic import SymbolicModel
    from flexstage.lumped.transfer import TransferFunction
    from flexstage.stage import Stage

# a stage whose stiffness differs from its image by less is reduced as a symmetric one, which the
# output says: the frequencies change by the square of it
_ASYMMETRY = 0.02


@from_docstring
def equations(
    stage: StageArgument,
    form: Annotated[str, one_of(("text", "latex", "svg"))] = "text",
    reduce: Annotated[str, one_of(("auto", "symmetry", "condense", "none"))] = "auto",
    axis: str | None = None,
    damping: Annotated[str, one_of(("rayleigh", "hinge", "none"))] = "rayleigh",
    out: OutputFile = None,
    taken: StageOptions = AS_DESCRIBED,
    json: JsonOption = False,
) -> None:
    """Derive the equations of motion in symbols.

    Energies, Lagrange's equations, the matrices M, C and K, and transfer functions.

    Parameters
    ----------
    form
        --to: Plain text, a LaTeX document, or the structural diagram of an axis as a
        drawing.
    reduce
        Reduction of the coordinates for transfer functions; auto uses
        the symmetry of the stage if it leaves few enough coordinates, else condensation to drives
        and probes.
    axis
        NAME: Axis of the transfer function (default: all), or of the diagram.
    damping
        Damping model of the equations.
    out
        Write the equations to a file instead of the terminal.
    """
    described = taken.stage(stage)
    if axis is not None:
        described.axis(axis)
    if form == "svg":
        drawing = _drawing(described, axis)
        _put({"stage": described.name, "diagram": drawing} if json else None, drawing, out)
        return
    from flexstage.lumped.latex import latex_document, plain_text, sheet_data
    from flexstage.lumped.sheet import equation_sheet
    from flexstage.lumped.symbolic import symbolic_model

    model = symbolic_model(described, damping=damping)  # type: ignore[arg-type]
    reduced = None if reduce == "none" else _reduced(model, described, reduce, axis)
    transfer = [] if reduced is None else _transfer(reduced, described, axis)
    sheet = equation_sheet(model, reduced=reduced, transfer=transfer)
    title = f"Equations of motion of {described.name}"
    content = None
    if json:
        content = _data(described, model, reduced, transfer) | {"sections": sheet_data(sheet)}
    _put(content, (latex_document if form == "latex" else plain_text)(title, sheet), out)


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


def _reduced(
    model: "SymbolicModel", stage: "Stage", how: str, axis: str | None
) -> "ReducedModel | None":
    from flexstage.lumped.reduction import condense, find_mirror, reduce_by_symmetry
    from flexstage.lumped.transfer import LARGEST_ORDER

    drive = stage.drive_of(axis).name if axis is not None else None
    mirror = None if how == "condense" else find_mirror(model.source, tolerance=_ASYMMETRY)
    if how == "symmetry":
        return reduce_by_symmetry(model, drive=drive, mirror=mirror)
    if mirror is not None and model.drives:
        try:
            found = reduce_by_symmetry(model, drive=drive, mirror=mirror)
        except ModelError:
            found = None
        if found is not None and found.order <= LARGEST_ORDER:
            return found
    if not (model.drives or model.probes):
        return None
    return condense(model)


def _transfer(
    reduced: "ReducedModel", stage: "Stage", axis: str | None
) -> "list[TransferFunction]":
    from flexstage.lumped.transfer import LARGEST_ORDER, transfer_function

    if reduced.order > LARGEST_ORDER:
        return []
    drives = {p.name for p in reduced.drives}
    probes = {p.name for p in reduced.probes}
    return [
        transfer_function(reduced, drive, a.probe)
        for a in stage.axes
        for drive in a.moved_by
        if axis in (None, a.name) and drive in drives and a.probe in probes
    ]


def _data(
    stage: "Stage",
    model: "SymbolicModel",
    reduced: "ReducedModel | None",
    transfer: "list[TransferFunction]",
) -> dict[str, Any]:
    return {
        "stage": stage.name,
        "order": model.order,
        "coordinates": [x.name for x in model.coordinates],
        "values": {x.name: v for x, v in model.values.items()},
        "reduced": None
        if reduced is None
        else {"how": reduced.how, "coordinates": [x.name for x in reduced.coordinates]},
        "transfer_functions": [
            {
                "drive": tf.drive,
                "probe": tf.probe,
                "input_kind": tf.input_kind,
                "numerator": top.tolist(),
                "denominator": bottom.tolist(),
                "poles_hz": sorted({round(abs(p) / 6.283185307179586, 9) for p in tf.poles()}),
            }
            for tf in transfer
            for top, bottom in [tf.coefficients()]
        ],
    }
