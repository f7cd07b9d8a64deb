"""`flexstage analyse`: models of a stage: characteristics, modes, stress, Bode data."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from flexstage.base.errors import ModelError
from flexstage.cli.options import JsonOption, QuietOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    OutputFolder,
    console,
    print_notes,
    print_result,
    print_shown,
    print_table,
    progress_bar,
)
from flexstage.cli.stage_options import AS_DRAWN, DrawnStageOptions, StageArgument
from flexstage.studies.requests import AnalyseRequest
from flexstage.system.requests import models_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from flexstage.studies import ModelRun
    from flexstage.studies.models import ModelRuns
    from flexstage.system import Analysis

#: Motion under a load that is rounding, in parts of the largest of all loads and probes [1].
_NOTHING = 1e-5


@from_docstring
def analyse(
    stage: StageArgument,
    request: AnalyseRequest,
    taken: DrawnStageOptions = AS_DRAWN,
    folder: OutputFolder = None,
    vtu: bool = False,
    figure: FigureFile = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Compute characteristics, modes, stress and responses.

    Several models are printed in sequence; all leaves out, with a note, those that are impossible.

    Parameters
    ----------
    folder
        Write analysis.json, with the Bode data, a Bode diagram of each axis, and a picture of what
        all drives reach together.
    vtu
        Also write the states at full stroke and the modes for ParaView, into vtu/ of --folder
        (plane and solid models).
    figure
        Draw the Bode diagram of each axis, in files NAME-AXIS. (.svg, .png or .pdf)
    """
    from flexstage.studies.models import run_models

    described = taken.stage(stage)
    if vtu and (folder is None or not {"plane", "solid"} & set(models_of(request.model))):
        raise ModelError("--vtu needs --folder and a model with a mesh: plane or solid")
    with progress_bar("analyse", quiet=quiet):
        found = run_models(described, request)
    files = _written(found, folder, figure, vtu=vtu)
    if json:
        print_result(found.to_dict(), files)
        return
    screen = console()
    for run in found.runs.values():
        _print(screen, run)
    left = (f"the {name} model was skipped: {why}" for name, why in found.skipped_models.items())
    print_notes(screen, left, files)


def _written(
    found: "ModelRuns", folder: Path | None, figure: Path | None, *, vtu: bool
) -> list[Path]:
    """Write what was asked for: of several models each into a folder of its name."""
    from flexstage.files.write import write_files
    from flexstage.report.analysis_files import analysis_files, bode_files

    files: list[Path] = []
    runs = found.runs
    for name, run in runs.items():
        within = folder / name if folder is not None and len(runs) > 1 else folder
        if within is not None:
            alone = replace(found, runs={name: run}, skipped_models={})
            files += write_files(within, analysis_files(run.analysis, alone.to_dict()))
            if vtu and run.mesh is not None:
                from flexstage.export import field_files

                fields = field_files(run.analysis.stage, run.analysis, mesh=run.mesh)
                files += write_files(within / "vtu", fields)
        if figure is not None:
            stem = f"{figure.stem}-{name}" if len(runs) > 1 else figure.stem
            kind = figure.suffix.lstrip(".")
            files += write_files(figure.parent, bode_files(run.analysis, stem, kind))
    return files


def _print(screen: "Console", run: "ModelRun") -> None:
    analysis = run.analysis
    _characteristics(screen, analysis)
    _modes(screen, analysis)
    _stress(screen, analysis)
    _coupling(screen, analysis)
    _responses(screen, analysis)
    _loads(screen, analysis)
    _bars(screen, run.bars)
    print_notes(screen, analysis.validity)


def _characteristics(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.quantities.comparison import compare
    from flexstage.quantities.quantity import QUANTITIES
    from flexstage.report.tables import characteristics_table

    title = f"{analysis.stage.name}: {analysis.system.model}"
    shown = characteristics_table(compare(analysis.characteristics), QUANTITIES, title)
    if shown is not None:
        print_shown(screen, shown)


def _modes(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.quantities.quantity import number, within_digits

    heads, columns = ["mode"], []
    for name, found in analysis.modes.items():
        heads.append(f"drives {name}")
        columns.append(texts := [number(float(f)) for f in found.frequency_hz[:6]])
        if found.uncertainty_hz is not None:
            heads.append("± mesh")
            pairs = zip(texts, found.uncertainty_hz[:6], strict=True)
            columns.append([within_digits(text, float(u)) for text, u in pairs])
    print_table(
        screen,
        "natural frequencies in Hz",
        heads,
        (
            (k + 1, *(c[k] if k < len(c) else "–" for c in columns))
            for k in range(max(map(len, columns), default=0))
        ),
    )


def _stress(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.report.tables import cause_words

    stress = analysis.hinge_stress
    if not any(stress.values()):
        return
    of = cause_words(analysis)
    print_table(
        screen,
        "largest equivalent stress at full stroke in MPa",
        ("hinge", *(f"{of} {axis}" for axis in stress)),
        (
            (hinge.name, *(f"{of[hinge.name] * 1e-6:.1f}" for of in stress.values()))
            for hinge in analysis.stage.hinges
        ),
    )


def _coupling(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.report.tables import coupling_tables

    for shown in coupling_tables(analysis.coupling) if analysis.coupling is not None else ():
        print_shown(screen, shown)


def _loads(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.quantities.quantity import number
    from flexstage.studies.results import analysis_results

    found = {k: v["readings"] for k, v in analysis_results(analysis)["loads"].items()}
    if not found or not any(found.values()):
        return
    probes = list(next(iter(found.values())))
    # beside gravity and temperature, what is far below them is rounding
    largest = max(abs(read[p]) for read in found.values() for p in probes)
    turns = any(analysis.system.probe(probe).unit == "rad" for probe in probes)
    rows = []
    for load in analysis.system.loads:
        if (read := found.get(load.name)) is not None:
            seen = (read[p] if abs(read[p]) >= _NOTHING * largest else 0.0 for p in probes)
            cells = (number(1e6 * v, 3) if v else "≈ 0" for v in seen)
            rows.append((load.name, load.unit, *cells))
    print_table(
        screen,
        "motion of the probes under loads on the whole stage, drives removed, in µm"
        + (" and µrad" if turns else ""),
        ("one unit of", "<unit", *probes),
        rows,
    )


def _bars(screen: "Console", bars: "Mapping[str, float]") -> None:
    from flexstage.quantities.quantity import number

    if not bars:
        return
    print_table(
        screen,
        "axial load at which bars between two notches buckle",
        ("body", "load in N"),
        ((body, number(load)) for body, load in bars.items()),
    )


def _responses(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.quantities.quantity import number

    if not analysis.responses:
        return
    heads = "drive", "<probe", "<input", "<drives", "at the lowest frequency", "largest", "at, Hz"
    rows = []
    for response in analysis.responses:
        size = abs(response.value)
        peak = int(size.argmax())
        figures = (number(float(v)) for v in (size[0], size[peak], response.frequency_hz[peak]))
        named = (response.drive, response.probe, response.input_kind, response.drives)
        rows.append((*named, *figures, response.unit))
    title = "frequency responses (all points with --json or --folder)"
    print_table(screen, title, (*heads, "<unit"), rows)
