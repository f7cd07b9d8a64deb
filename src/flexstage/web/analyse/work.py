"""What the view Analyse has computed: by the library, each model in a process of its own."""

import time
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexstage.base import progress
from flexstage.files.names import file_name
from flexstage.files.write import write_files
from flexstage.quantities.characteristic import WHOLE_STAGE, Characteristic
from flexstage.quantities.comparison import compare, title_of
from flexstage.quantities.quantity import Quantity, number
from flexstage.quantities.table import Cell, Table, table
from flexstage.report.analysis_files import analysis_files
from flexstage.report.figures.fields import draw_convergence
from flexstage.report.figures.surface import StageSurface, stage_surface
from flexstage.report.tables import cause_words, percent
from flexstage.studies.models import run_models
from flexstage.studies.requests import AnalyseRequest, ModelOptions
from flexstage.system import Analysis, DriveCondition, FrequencyResponse
from flexstage.system.modes import modes
from flexstage.system.response import default_frequencies_hz, response_of_modes
from flexstage.web.design.state import Variant
from flexstage.web.pictures import inline
from flexstage.web.preferences import Preferences


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelResult:
    """What one model found of a stage; the mesh behind it stays where it was made."""

    variant: Variant
    """The stage."""
    options: ModelOptions
    """What was asked for."""
    analysis: Analysis
    """What it says of the stage."""
    results: Mapping[str, Any]
    """All of it as plain data, as `flexstage analyse --json` prints it."""
    surface: StageSurface
    """The stage with its states, for pictures."""
    responses: tuple[FrequencyResponse, ...]
    """Response of each probe to each drive, drives removed and in place."""
    convergence: str
    """How its mesh was refined, as a picture for a page; empty where it was not."""
    fields: Path | None
    """Folder with its fields for ParaView; None where they were not asked for."""
    seconds: float
    """How long it took [s]."""

    @property
    def model(self) -> str:
        """The model."""
        return self.analysis.system.model


def analyse_variant(
    variant: Variant, model: str, options: ModelOptions, fields: Path | None = None
) -> ModelResult:
    """Analyse a variant by one model; write fields of its mesh into a folder, if one is given."""
    began = time.monotonic()
    with progress.subtask(0.0, 0.85):
        request = AnalyseRequest(model=(model,), options=options)  # type: ignore[arg-type]
        found = run_models(variant.stage(), request)
    (run,) = found.runs.values()
    analysis, refinement = run.analysis, run.refinement
    with progress.subtask(0.85, 0.95):
        surface = stage_surface(analysis, run.mesh)
    drawn = ""
    if refinement is not None:
        said = f"Convergence of the {model} model"
        drawn = inline(lambda: draw_convergence(refinement), f"convergence-{model}", said)
    progress.update("responses", 0.95)
    responses = tuple(every_response(analysis))
    if fields is not None and run.mesh is not None:
        from flexstage.export import field_files

        progress.update("fields", 0.97)
        write_files(fields, field_files(analysis.stage, analysis, mesh=run.mesh))
    return ModelResult(
        variant=variant,
        options=options,
        analysis=analysis,
        results=found.to_dict(),
        surface=surface,
        responses=responses,
        convergence=drawn,
        fields=None if run.mesh is None else fields,
        seconds=time.monotonic() - began,
    )


def every_response(analysis: Analysis) -> Iterator[FrequencyResponse]:
    """Return the response of each probe to each drive, at the frequencies of the analysis."""
    system = analysis.system
    for condition, shown in analysis.modes.items():
        if condition == "locked" or not system.drives:
            continue
        every, f = modes(system, drives=condition, count=None), default_frequencies_hz(shown)
        for drive in system.drives:
            for probe in system.probes:
                yield response_of_modes(system, every, f, drive.name, probe.name)


def saved(folder: Path, found: Sequence[ModelResult]) -> Path:
    """Write the files of some analyses of one stage as one archive (ZIP), a folder for each model.

    Returns its path.
    """
    path = folder / f"{file_name(found[0].analysis.stage.name)}-analysis.zip"
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for done, one in enumerate(found):
            progress.update(one.model, done / len(found))
            for name, content in analysis_files(one.analysis, one.results).items():
                archive.writestr(zipfile.ZipInfo(f"{one.model}/{name}"), content)
            for file in sorted(one.fields.iterdir()) if one.fields else ():
                archive.write(file, f"{one.model}/vtu/{file.name}")
    return path


#: What is looked at first.
_FIRST = frozenset(
    (
        "transmission_ratio", "output_displacement", "rotation_stroke", "input_stiffness",
        "output_stiffness", "max_stress", "safety_factor", "natural_frequency_hz",
        "natural_frequency_with_stack_hz", "cross_coupling", "buckling_factor",
    )
)  # fmt: skip
# An estimate of an error is seen above this part of the value [1]: the half of four digits.
_SEEN = 5e-5


def figures_tables(preferences: Preferences, found: Sequence[ModelResult]) -> tuple[Table, Table]:
    """Set the figures of models side by side: those that are looked at first, and all others.

    Of two models there is the difference of the second to the first as well.
    """
    rows = compare(row for one in found for row in one.analysis.characteristics).rows
    models = [one.model for one in found]
    heads = ["figure", "<axis", *(title_of(model) for model in models)]
    heads += ["difference"] if len(models) == 2 else []
    first, others = [], []
    for row in rows:
        shown = preferences.shown(row.quantity)
        axis = "" if row.axis == WHOLE_STAGE else row.axis
        cells = [Cell(shown.heading, small=row.remark), axis]
        cells += [_cell(row.cells.get(model), shown) for model in models]
        if len(models) == 2:
            cells.append(percent(row.difference_percent(models[1], models[0])) or "–")
        fails = any(cell.failing for cell in row.cells.values())
        (first if fails or row.quantity in _FIRST else others).append(cells)
    return table("", heads, first), table("", heads, others)


def _cell(row: Characteristic | None, shown: Quantity) -> Cell:
    if row is None:
        return Cell("–")
    text, note = row.text(shown), row.note
    spread = row.uncertainty
    if spread is not None:
        told = f"± {number(spread * shown.factor, 2)}"
        note = f"{told}; {note}" if note else told
        # what is below the last digit is in no one's way
        if spread > _SEEN * abs(row.value):
            text = f"{text} ± {number(spread * shown.factor, 1)}"
    return Cell(text, row.value, note, failing=row.failing)


def modes_table(found: Sequence[ModelResult], drives: DriveCondition) -> Table:
    """Set the lowest natural frequencies of models side by side, in one condition of the drives."""
    columns = [one.analysis.modes[drives] for one in found if drives in one.analysis.modes]
    count = min(6, max((c.frequency_hz.size for c in columns), default=0))
    rows = []
    for k in range(count):
        cells: list[str | Cell] = [str(k + 1)]
        for each in columns:
            if k >= each.frequency_hz.size:
                cells.append(Cell("–"))
                continue
            value = float(each.frequency_hz[k])
            spread = each.uncertainty_hz
            more = "" if spread is None else f" ± {number(float(spread[k]), 1)}"
            cells.append(Cell(number(value) + more, value))
        rows.append(cells)
    heads = ["mode", *(f"{title_of(one.model)} [Hz]" for one in found)]
    return table("", heads, rows)


def hinges_table(one: ModelResult) -> Table:
    """Return the largest equivalent stress of each hinge at the full stroke of each axis."""
    stress = one.analysis.hinge_stress
    of = cause_words(one.analysis)
    rows = [
        [hinge.name, *(f"{stress[axis][hinge.name] * 1e-6:.1f}" for axis in stress)]
        for hinge in one.analysis.stage.hinges
        if any(stress.values())
    ]
    return table("", ["hinge", *(f"{of} {axis} [MPa]" for axis in stress)], rows)


def meshes_table(preferences: Preferences, one: ModelResult) -> Table:
    """Return the meshes of a model that was refined, and the quantity that was asked for."""
    found = one.results["refinement"]
    quantity = preferences.shown(found["quantity"])
    steps = found["steps"]
    axes = [v["axis"] for v in steps[-1]["values"] if v["quantity"] == quantity.name]
    rows = []
    for step in steps:
        values = {v["axis"]: v["value"] for v in step["values"] if v["quantity"] == quantity.name}
        rows.append(
            [
                str(step["order"]), number(step["neck_size"], 2), str(step["unknowns"]),
                number(step["seconds"], 2), *(quantity.text(values.get(axis)) for axis in axes),
            ]
        )  # fmt: skip
    heads = ["order", "element / neck [1]", "unknowns", "time [s]"]
    heads += [f"{quantity.heading}{'' if axis == WHOLE_STAGE else f', {axis}'}" for axis in axes]
    return table("", heads, rows)


def errors_table(preferences: Preferences, one: ModelResult) -> Table:
    """Return the estimated error of each figure of a model."""
    rows = []
    for row in one.analysis.characteristics:
        if not row.uncertainty:
            continue  # none is known, or nothing is uncertain
        shown = preferences.shown(row.quantity)
        share = f"{number(100.0 * row.uncertainty / abs(row.value), 2)} %" if row.value else "–"
        spread = number(row.uncertainty * shown.factor, 2)
        axis = "" if row.axis == WHOLE_STAGE else row.axis
        rows.append([shown.heading, axis, shown.text(row.value), spread, share])
    return table("", ["figure", "<axis", "value", "± estimate", "share"], rows)
