"""Computations, tables and state of the view Analyse; each model runs in a worker process."""

import time
import zipfile
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flexstage.base import progress
from flexstage.base.errors import ModelError
from flexstage.files.names import file_name
from flexstage.files.write import write_files, write_whole
from flexstage.quantities.characteristic import WHOLE_STAGE, Characteristic
from flexstage.quantities.comparison import compare, kind_text, title_of
from flexstage.quantities.quantity import Quantity, number
from flexstage.quantities.table import Cell, Table, table
from flexstage.report.figures.fields import draw_convergence
from flexstage.report.figures.noise import draw_cumulative
from flexstage.report.figures.surface import StageSurface, stage_surface
from flexstage.report.result_files import analysis_files
from flexstage.report.tables import cause_words, loops_table, percent, tree_table
from flexstage.studies.models import run_models
from flexstage.studies.requests import AnalyseRequest, BudgetRequest, ModelOptions
from flexstage.system import Analysis, DriveCondition, FrequencyResponse
from flexstage.system.environment import crossover_of, environment_from_text
from flexstage.system.requests import ModelName
from flexstage.system.response import default_frequencies_hz, response_of_modes
from flexstage.web.design.state import Variant
from flexstage.web.jobs import BackgroundJob
from flexstage.web.pictures import inline
from flexstage.web.sessions import Preferences


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelResult:
    """Result of one model for a stage, without its mesh."""

    variant: Variant
    """The stage."""
    options: ModelOptions
    """Options of the model."""
    analysis: Analysis
    """Analysis of the stage."""
    results: Mapping[str, Any]
    """The results as plain data, as `flexstage analyse --json` prints them."""
    surface: StageSurface
    """Surface of the stage with its states, for pictures."""
    responses: tuple[FrequencyResponse, ...]
    """Response of each probe to each drive, drives removed and in place."""
    convergence: str
    """Picture of the mesh refinement for a page; empty without one."""
    fields: Path | None
    """Folder of the fields for ParaView; None without them."""
    seconds: float
    """Duration [s]."""

    @property
    def model(self) -> str:
        """Name of the model."""
        return self.analysis.system.model


def analyse_variant(
    variant: Variant, model: str, options: ModelOptions, fields: Path | None = None
) -> ModelResult:
    """Analyse a variant by one model; write fields of its mesh into a folder, if any."""
    began = time.monotonic()
    with progress.subtask(0.0, 0.85):
        request = AnalyseRequest(model=(model,), options=options)  # type: ignore[arg-type]
        results = run_models(variant.stage(), request)
    (run,) = results.runs.values()
    analysis, refinement = run.analysis, run.refinement
    with progress.subtask(0.85, 0.95):
        surface = stage_surface(analysis, run.mesh)
    convergence = ""
    if refinement is not None:
        title = f"Convergence of the {model} model"
        convergence = inline(lambda: draw_convergence(refinement), f"convergence-{model}", title)
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
        results=results.to_dict(),
        surface=surface,
        responses=responses,
        convergence=convergence,
        fields=None if run.mesh is None else fields,
        seconds=time.monotonic() - began,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoiseResult:
    """Rms that an environment leaves at a stage, as `flexstage budget` prints it."""

    tables: tuple[Table, ...]
    """Rms by source and loop, and static errors, by point of interest."""
    picture: str
    """Cumulative amplitude of the last loop, for a page."""
    notes: tuple[str, ...]
    """Limits of validity."""


def noise_of_variant(
    variant: Variant, description: str, loops: str, model: ModelName, folder: Path
) -> NoiseResult:
    """Compute the budget of a variant from the text of an environment, kept in a folder.

    `loops` are crossovers or ``tune``, separated by commas. A browser names no files to read.
    """
    from flexstage.studies.models import stage_budget

    named = tuple(word.strip() for word in loops.split(",") if word.strip())
    for word in named:
        if word != "tune" and crossover_of(word) is None:
            raise ModelError(f"a loop is a crossover such as '100 Hz', or tune, got '{word[:60]}'")
    environment_from_text(description, folder=None)
    path = folder / "environment.yaml"
    write_whole(path, description.encode())
    request = BudgetRequest(environment=path, loop=named, model=model)
    result = stage_budget(variant.stage(), request)
    displayed = []
    for point in dict.fromkeys(b.point for b in result.budgets):
        unit, heads, rows = loops_table(result, point)
        displayed.append(table(f"{point}: rms in {unit}", heads, rows))
        budgets = [b for b in result.budgets if b.point == point]
        if budgets[-1].tree is not None:
            unit, heads, rows = tree_table(budgets)
            displayed.append(table(f"{point}: standard uncertainty in {unit}", heads, rows))
    last = result.budgets[-1]
    alt_text = f"Density and cumulative amplitude by source, loop {last.loop}"
    return NoiseResult(
        tables=tuple(displayed),
        picture=inline(lambda: draw_cumulative(result), "noise", alt_text),
        notes=result.notes,
    )


def every_response(analysis: Analysis) -> Iterator[FrequencyResponse]:
    """Return the response of each probe to each drive, at the frequencies of the analysis."""
    system = analysis.system
    for condition, lowest_modes in analysis.modes.items():
        if condition == "locked" or not system.drives:
            continue
        all_modes, f = analysis.every_mode[condition], default_frequencies_hz(lowest_modes)
        for drive in system.drives:
            for probe in system.probes:
                yield response_of_modes(system, all_modes, f, drive.name, probe.name)


def save_archive(folder: Path, results: Sequence[ModelResult]) -> Path:
    """Write the files of analyses of a stage into an archive (ZIP), with a folder for each model.

    Returns the path of the archive.
    """
    path = folder / f"{file_name(results[0].analysis.stage.name)}-analysis.zip"
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for count, result in enumerate(results):
            progress.update(result.model, count / len(results))
            for name, content in analysis_files(result.analysis, result.results).items():
                archive.writestr(zipfile.ZipInfo(f"{result.model}/{name}"), content)
            for file in sorted(result.fields.iterdir()) if result.fields else ():
                archive.write(file, f"{result.model}/vtu/{file.name}")
    return path


#: Figures of the main table.
_MAIN = frozenset(
    (
        "transmission_ratio", "output_displacement", "rotation_stroke", "input_stiffness",
        "output_stiffness", "max_stress", "safety_factor", "natural_frequency_hz",
        "natural_frequency_with_stack_hz", "cross_coupling", "buckling_factor",
    )
)  # fmt: skip
# Smallest displayed uncertainty relative to the value [1]: half a unit of the fourth digit.
_VISIBLE = 5e-5


def figures_tables(preferences: Preferences, results: Sequence[ModelResult]) -> tuple[Table, Table]:
    """Return the figures of models side by side: the main ones, and all others.

    For two models there is a column of the difference of the second from the first, and next to
    published figures of the stage one of the kind of each figure.
    """
    rows = compare(row for result in results for row in result.analysis.characteristics).rows
    models = [result.model for result in results]
    published = results[0].analysis.stage.published
    heads = ["figure", "<axis", *(["<kind"] if published else [])]
    heads += [title_of(model) for model in models]
    heads += ["difference"] if len(models) == 2 else []
    main, others = [], []
    for row in rows:
        quantity = preferences.displayed(row.quantity)
        axis = "" if row.axis == WHOLE_STAGE else row.axis
        cells = [Cell(quantity.heading, small=row.remark), axis]
        if published:
            cells.append(kind_text(next(iter(row.cells.values())), published))
        cells += [_cell(row.cells.get(model), quantity) for model in models]
        if len(models) == 2:
            cells.append(percent(row.difference_percent(models[1], models[0])) or "–")
        fails = any(cell.failing for cell in row.cells.values())
        (main if fails or row.quantity in _MAIN else others).append(cells)
    return table("", heads, main), table("", heads, others)


def _cell(row: Characteristic | None, quantity: Quantity) -> Cell:
    if row is None:
        return Cell("–")
    text, note = row.text(quantity), row.note
    uncertainty = row.uncertainty
    if uncertainty is not None:
        uncertainty_text = f"± {number(uncertainty * quantity.factor, 2)}"
        note = f"{uncertainty_text}; {note}" if note else uncertainty_text
        # an uncertainty below the last digit is not displayed
        if uncertainty > _VISIBLE * abs(row.value):
            text = f"{text} ± {number(uncertainty * quantity.factor, 1)}"
    return Cell(text, row.value, note, failing=row.failing)


def modes_table(results: Sequence[ModelResult], drives: DriveCondition) -> Table:
    """Return the lowest natural frequencies of models side by side, in one drive condition."""
    columns = [
        result.analysis.modes[drives] for result in results if drives in result.analysis.modes
    ]
    count = min(6, max((c.frequency_hz.size for c in columns), default=0))
    rows = []
    for k in range(count):
        cells: list[str | Cell] = [str(k + 1)]
        for computed in columns:
            if k >= computed.frequency_hz.size:
                cells.append(Cell("–"))
                continue
            value = float(computed.frequency_hz[k])
            uncertainty = computed.uncertainty_hz
            uncertainty_text = (
                "" if uncertainty is None else f" ± {number(float(uncertainty[k]), 1)}"
            )
            cells.append(Cell(number(value) + uncertainty_text, value))
        rows.append(cells)
    heads = ["mode", *(f"{title_of(result.model)} [Hz]" for result in results)]
    return table("", heads, rows)


def hinges_table(result: ModelResult) -> Table:
    """Return the largest equivalent stress of each hinge at full stroke of each axis."""
    stress = result.analysis.hinge_stress
    label = cause_words(result.analysis)
    rows = [
        [hinge.name, *(f"{stress[axis][hinge.name] * 1e-6:.1f}" for axis in stress)]
        for hinge in result.analysis.stage.hinges
        if any(stress.values())
    ]
    return table("", ["hinge", *(f"{label} {axis} [MPa]" for axis in stress)], rows)


def meshes_table(preferences: Preferences, result: ModelResult) -> Table:
    """Return the meshes of a refinement, with the values of its quantity."""
    refinement = result.results["refinement"]
    quantity = preferences.displayed(refinement["quantity"])
    steps = refinement["steps"]
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


def errors_table(preferences: Preferences, result: ModelResult) -> Table:
    """Return the estimated error of each figure of a model."""
    rows = []
    for row in result.analysis.characteristics:
        if not row.uncertainty:
            continue  # unknown or zero
        quantity = preferences.displayed(row.quantity)
        share = f"{number(100.0 * row.uncertainty / abs(row.value), 2)} %" if row.value else "–"
        uncertainty = number(row.uncertainty * quantity.factor, 2)
        axis = "" if row.axis == WHOLE_STAGE else row.axis
        rows.append([quantity.heading, axis, quantity.text(row.value), uncertainty, share])
    return table("", ["figure", "<axis", "value", "± estimate", "share"], rows)


Key = tuple[Variant, str]


@dataclass
class Display:
    """Displayed part of the results."""

    part: str = "Shapes"
    """Open tab."""
    folds: dict[str, bool] = field(default_factory=dict)
    """Open folded sections, by title."""
    model: str = ""
    """Model of the displayed shapes."""
    state: str = ""
    """Displayed state: a static one by its axis, a mode by its number."""
    drives: DriveCondition = "removed"
    """Condition of the drives of the modes."""
    colour: str = "stress"
    """Quantity of the colours of a static state: ``stress`` or ``displacement``."""
    pair: tuple[str, str] | None = None
    """Drive and probe of the Bode diagram."""
    bode_drives: DriveCondition = "in place"
    """Condition of the drives of the Bode diagram."""
    cursors: list[float] = field(default_factory=list)
    """Frequencies of its two cursors [Hz]."""


@dataclass
class AnalyseState:
    """State of the view Analyse in one browser."""

    selected_models: list[str] = field(default_factory=lambda: ["lumped", "superelement"])
    """Selected models."""
    options: ModelOptions = ModelOptions()
    """Options of the models; each model uses those that it supports."""
    fields: bool = False
    """Write fields for ParaView."""
    display: Display = field(default_factory=Display)
    """Displayed part of the results."""
    environments: dict[str, str] = field(default_factory=dict)
    """Text of the environment of a stage, by its name."""
    loops: str = ""
    """Loops to compare, separated by commas."""
    noise_model: str = "lumped"
    """Model of the noise."""
    noise: dict[Variant, NoiseResult] = field(default_factory=dict)
    """Noise of the last stage."""
    jobs: dict[Key, BackgroundJob] = field(default_factory=dict)
    """Running jobs."""
    errors: dict[Key, str] = field(default_factory=dict)
    """Messages of failed models."""
    revision: int = 0
    """Number of finished jobs, by which each page of a browser notices a change."""
    _results: OrderedDict[Key, ModelResult] = field(default_factory=OrderedDict)

    def result(self, variant: Variant, model: str) -> ModelResult | None:
        """Return the result of a model for a variant, or None."""
        return self._results.get((variant, model))

    def collect(self) -> None:
        """Collect the results of finished jobs."""
        finished = [key for key, job in self.jobs.items() if job.is_over]
        for key in finished:
            job = self.jobs.pop(key)
            self.errors.pop(key, None)
            if job.state == "done":
                # the job need not keep the result
                self._results[key], job.result = job.result, None
                self._results.move_to_end(key)
            elif job.state == "failed":
                self.errors[key] = job.error
        while len(self._results) > 20:  # a few MB each, with their pictures
            self._results.popitem(last=False)
        self.revision += len(finished)
