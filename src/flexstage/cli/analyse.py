"""`flexstage analyse`: characteristics, modes, stress and Bode data of a stage."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from flexstage.base.errors import ModelError
from flexstage.cli.options import JsonOption, QuietOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    OutputFolder,
    console,
    display_table,
    print_notes,
    print_result,
    print_table,
    progress_bar,
)
from flexstage.cli.stage_options import AS_DRAWN, DrawnStageOptions, StageArgument
from flexstage.studies.requests import AnalyseRequest
from flexstage.system.requests import models_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from flexstage.control.dynamic_budget import DynamicBudget
    from flexstage.studies import ModelRun
    from flexstage.studies.models import ModelRuns
    from flexstage.system import Analysis

#: Motion under a load, relative to the largest one, below which it is rounding [1].
_ROUNDING = 1e-5


@from_docstring
def analyse(
    stage: StageArgument,
    request: AnalyseRequest,
    options: DrawnStageOptions = AS_DRAWN,
    folder: OutputFolder = None,
    vtu: bool = False,
    figure: FigureFile = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Compute characteristics, modes, stress and responses.

    Several models are printed one after the other. With all, models that do not apply to the stage
    are skipped with a note.

    Parameters
    ----------
    folder
        Write analysis.json with the Bode data, a Bode diagram of each axis, the workspace of all
        drives together, with --rate the working line of each stack, and with --environment density
        and cumulative amplitude by source.
    vtu
        Also write static shapes at full stroke and mode shapes for ParaView, to vtu/ in --folder
        (plane and solid models).
    figure
        Draw the Bode diagram of each axis to a file NAME-AXIS (.svg, .png or .pdf).
    """
    from flexstage.studies.models import run_models

    described = options.stage(stage)
    if vtu and (folder is None or not {"plane", "solid"} & set(models_of(request.model))):
        raise ModelError("--vtu needs --folder and a model with a mesh: plane or solid")
    with progress_bar("analyse", quiet=quiet):
        runs = run_models(described, request)
    files = _write_files(runs, folder, figure, vtu=vtu)
    if json:
        print_result(runs.to_dict(), files)
        return
    screen = console()
    for name, run in runs.runs.items():
        _print(screen, run, runs.budgets.get(name))
    skipped = (f"{name} model skipped: {why}" for name, why in runs.skipped_models.items())
    print_notes(screen, skipped, files)


def _write_files(
    results: "ModelRuns", folder: Path | None, figure: Path | None, *, vtu: bool
) -> list[Path]:
    """Write the requested files; each of several models has a folder of its name."""
    if folder is None and figure is None:
        return []
    from flexstage.files.write import write_files
    from flexstage.report.result_files import (
        analysis_files,
        bode_files,
        budget_files,
        working_line_files,
    )

    files: list[Path] = []
    runs = results.runs
    for name, run in runs.items():
        within = folder / name if folder is not None and len(runs) > 1 else folder
        if within is not None:
            single = replace(results, runs={name: run}, skipped_models={})
            written = analysis_files(run.analysis, single.to_dict())
            budget = results.budgets.get(name)
            pictures = {} if budget is None else budget_files(budget)
            files += write_files(within, written | working_line_files(run.stacks) | pictures)
            if vtu and run.mesh is not None:
                from flexstage.export import field_files

                fields = field_files(run.analysis.stage, run.analysis, mesh=run.mesh)
                files += write_files(within / "vtu", fields)
        if figure is not None:
            stem = f"{figure.stem}-{name}" if len(runs) > 1 else figure.stem
            kind = figure.suffix.lstrip(".")
            files += write_files(figure.parent, bode_files(run.analysis, stem, kind))
    return files


def _print(screen: "Console", run: "ModelRun", budget: "DynamicBudget | None") -> None:
    from flexstage.report.stacks import seat_sentences, stack_tables

    analysis = run.analysis
    _characteristics(screen, analysis)
    _modes(screen, analysis)
    _stress(screen, analysis)
    _coupling(screen, analysis)
    _responses(screen, analysis)
    _loads(screen, analysis)
    _bars(screen, run.bars)
    for table in stack_tables(run.stacks):
        display_table(screen, table)
    notes = (*analysis.validity, *seat_sentences(analysis))
    if budget is not None:
        from flexstage.cli.budget import print_budget

        print_budget(screen, budget)
        notes += tuple(f"{note[:1].upper()}{note[1:]}." for note in budget.notes)
    print_notes(screen, notes)


def _characteristics(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.quantities.comparison import compare
    from flexstage.quantities.quantity import QUANTITIES
    from flexstage.report.tables import characteristics_table

    title = f"{analysis.stage.name}: {analysis.system.model}"
    comparison_table = characteristics_table(compare(analysis.characteristics), QUANTITIES, title)
    if comparison_table is not None:
        display_table(screen, comparison_table)


def _modes(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.quantities.quantity import number, within_digits

    heads, columns = ["mode"], []
    for name, modes in analysis.modes.items():
        heads.append(f"drives {name}")
        columns.append(texts := [number(float(f)) for f in modes.frequency_hz[:6]])
        if modes.uncertainty_hz is not None:
            heads.append("± mesh")
            pairs = zip(texts, modes.uncertainty_hz[:6], strict=True)
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

    if analysis.coupling is not None:
        for table in coupling_tables(analysis.coupling):
            display_table(screen, table)


def _loads(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.quantities.quantity import number
    from flexstage.studies.results import analysis_results

    motion_by_load = {k: v["readings"] for k, v in analysis_results(analysis)["loads"].items()}
    if not motion_by_load or not any(motion_by_load.values()):
        return
    probes = list(next(iter(motion_by_load.values())))
    # a motion far below those by gravity and temperature is rounding
    largest = max(abs(motion[p]) for motion in motion_by_load.values() for p in probes)
    turns = any(analysis.system.probe(probe).unit == "rad" for probe in probes)
    rows = []
    for load in analysis.system.loads:
        if (motion := motion_by_load.get(load.name)) is not None:
            values = (motion[p] if abs(motion[p]) >= _ROUNDING * largest else 0.0 for p in probes)
            cells = (number(1e6 * v, 3) if v else "≈ 0" for v in values)
            rows.append((load.name, load.unit, *cells))
    print_table(
        screen,
        "displacement of the probes per unit load on the stage, drives removed, in µm"
        + (" and µrad" if turns else ""),
        ("load", "<unit", *probes),
        rows,
    )


def _bars(screen: "Console", bars: "Mapping[str, float]") -> None:
    from flexstage.quantities.quantity import number

    if not bars:
        return
    print_table(
        screen,
        "buckling load of bars between two notches",
        ("body", "load in N"),
        ((body, number(load)) for body, load in bars.items()),
    )


def _responses(screen: "Console", analysis: "Analysis") -> None:
    from flexstage.quantities.quantity import number

    if not analysis.responses:
        return
    heads = "drive", "<probe", "<input", "<drives", "at the lowest frequency", "peak", "peak at, Hz"
    rows = []
    for response in analysis.responses:
        size = abs(response.value)
        peak = int(size.argmax())
        figures = (number(float(v)) for v in (size[0], size[peak], response.frequency_hz[peak]))
        names = (response.drive, response.probe, response.input_kind, response.drives)
        rows.append((*names, *figures, response.unit))
    title = "frequency responses (all points with --json or --folder)"
    print_table(screen, title, (*heads, "<unit"), rows)
