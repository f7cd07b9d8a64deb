"""`flexstage analyse`: one model of a stage: characteristics, modes, stress, Bode data."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.common import (
    JsonOption,
    ModelOption,
    PlaneOption,
    StageArgument,
    console,
    folder_option,
    load_stage,
    make_table,
    print_json,
    progress_bar,
    relative,
)
from flexstage.errors import ModelError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from flexstage.report import Display, ModelRun
    from flexstage.system import Analysis

__all__ = ["analyse"]


def analyse(
    stage: StageArgument,
    model: ModelOption = "superelement",
    plane: PlaneOption = "auto",
    accuracy: Annotated[
        float | None,
        typer.Option(
            parser=relative,
            metavar="SHARE",
            help="Refine the mesh of the plane or solid model until --quantity has settled to this "
            "share of itself, such as 0.1%.",
        ),
    ] = None,
    quantity: Annotated[
        str,
        typer.Option(metavar="NAME", help="What --accuracy is asked of, such as max_stress."),
    ] = "natural_frequency_hz",
    supports: Annotated[
        str,
        typer.Option(
            metavar="rigid|elastic",
            help="Whether the frame gives way under drives that react on it (finite elements).",
        ),
    ] = "rigid",
    stroke: Annotated[
        bool,
        typer.Option(
            "--stroke",
            help="Follow each axis over its stroke with finite displacements (plane model): "
            "straightness, stiffening, buckling.",
        ),
    ] = False,
    out: Annotated[
        Path | None,
        folder_option("Write analysis.json, with the Bode data, and a Bode diagram of each axis."),
    ] = None,
    vtu: Annotated[
        bool,
        typer.Option(
            "--vtu",
            help="Write the states at full stroke and the modes for ParaView as well, into vtu/ of "
            "--out (plane and solid).",
        ),
    ] = False,
    json: JsonOption = False,
) -> None:
    """Compute characteristics, modes, stress and responses."""
    from flexstage.report import (
        Wanted,
        results_json,
        run_model,
        write_files,
    )

    described = load_stage(stage)
    wanted = Wanted(
        plane=plane,  # type: ignore[arg-type]
        accuracy=accuracy,
        quantity=quantity,
        supports=supports,  # type: ignore[arg-type]
        stroke=stroke,
    )
    if vtu and (out is None or model not in ("plane", "solid")):
        raise ModelError("--vtu needs --out DIR and a model with a mesh: plane or solid")
    with progress_bar():
        run = run_model(described, model, wanted)
    analysis = run.analysis
    files = []
    if out is not None:
        results = results_json(_results(run))
        files = write_files(out, {"analysis.json": results} | _diagrams(analysis))
        if vtu and run.mesh is not None:
            from flexstage.fem.vtu import vtu_files

            files += write_files(out / "vtu", vtu_files(run.mesh, analysis))
    if json:
        print_json(_results(run))
        return
    screen = console()
    _characteristics(screen, analysis)
    _modes(screen, analysis)
    _stress(screen, analysis)
    _responses(screen, analysis)
    _loads(screen, analysis)
    _bars(screen, run.bars)
    for note in analysis.validity:
        screen.print(f"note: {note}", style="dim", markup=False)
    for file in files:
        screen.print(f"wrote {file}", markup=False, soft_wrap=True)


def _results(run: "ModelRun") -> dict[str, Any]:
    from flexstage.report import analysis_results, run_results

    return analysis_results(run.analysis, responses=True) | run_results(run)


def _diagrams(analysis: "Analysis") -> dict[str, bytes]:
    from flexstage.cli.common import name_for_files
    from flexstage.report.figures import draw_bode, encode

    return {
        f"bode-{name_for_files(a.axis)}.svg": encode(draw_bode(analysis, a.axis), "svg")
        for a in analysis.axes
    }


def _characteristics(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.report import display

    model = analysis.system.model
    head = ["quantity", "<axis", "value", "<unit", "<condition"]
    known = any(row.uncertainty is not None for row in analysis.characteristics)
    if known:
        head.insert(3, "± mesh")
    table = make_table(f"{analysis.stage.name}: {model}", *head)
    for row in analysis.characteristics:
        shown = display(row.quantity)
        cells = [shown.label, row.axis, shown.text(row.value), shown.unit, row.note]
        if known:
            cells.insert(3, "" if row.uncertainty is None else _spread(row.uncertainty, shown))
        table.add_row(*cells)
    if analysis.characteristics:
        screen.print(table)


def _spread(uncertainty: float, shown: "Display") -> str:
    from flexstage.report import number

    return number(uncertainty * shown.factor, 2)


def _modes(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.report import number

    table = make_table(
        "natural frequencies in Hz", "mode", *(f"drives {name}" for name in analysis.modes)
    )
    columns = [found.frequency_hz[:6] for found in analysis.modes.values()]
    for k in range(max((column.size for column in columns), default=0)):
        cells = [number(float(c[k])) if k < c.size else "–" for c in columns]
        table.add_row(str(k + 1), *cells)
    screen.print(table)


def _stress(screen: "Console", analysis: "Analysis") -> None:
    stress = analysis.hinge_stress
    if not any(stress.values()):
        return
    table = make_table(
        "largest equivalent stress at full stroke in MPa",
        "hinge",
        *(f"drive of {axis}" for axis in stress),
    )
    for hinge in analysis.stage.hinges:
        table.add_row(hinge.name, *(f"{stress[axis][hinge.name] * 1e-6:.1f}" for axis in stress))
    screen.print(table)


def _loads(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.report import analysis_results, number

    found = {k: v["readings"] for k, v in analysis_results(analysis)["loads"].items()}
    if not found or not any(found.values()):
        return
    probes = list(next(iter(found.values())))
    table = make_table(
        "motion of the probes under loads on the whole stage, drives removed, in µm",
        "one unit of",
        "<unit",
        *probes,
    )
    for load in analysis.system.loads:
        if load.name not in found:
            continue
        cells = (
            number(1e6 * found[load.name][p], 3) if found[load.name][p] else "0" for p in probes
        )
        table.add_row(load.name, load.unit, *cells)
    screen.print(table)


def _bars(screen: "Console", bars: "Mapping[str, float]") -> None:
    from flexstage.report import number

    if not bars:
        return
    table = make_table("axial load at which bars between two notches buckle", "body", "load in N")
    for body, load in bars.items():
        table.add_row(body, number(load))
    screen.print(table)


def _responses(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.report import number

    if not analysis.responses:
        return
    table = make_table(
        "frequency responses (all points with --json or --out)",
        "drive",
        "<probe",
        "<input",
        "<drives",
        "at the lowest frequency",
        "largest",
        "at, Hz",
        "<unit",
    )
    for response in analysis.responses:
        size = abs(response.value)
        peak = int(size.argmax())
        table.add_row(
            response.drive,
            response.probe,
            response.input_kind,
            response.drives,
            number(float(size[0])),
            number(float(size[peak])),
            number(float(response.frequency_hz[peak])),
            response.unit,
        )
    screen.print(table)
