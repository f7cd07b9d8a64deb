"""Models of a stage by name, with their options."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

from flexstage.base import progress
from flexstage.base.errors import FlexstageError, ModelError
from flexstage.base.lazy import data_frame
from flexstage.base.short_repr import short_repr
from flexstage.files.plain import picked, plain
from flexstage.files.result import Result
from flexstage.hinges.compliance import require_sizes
from flexstage.lumped import lumped_system
from flexstage.measure.requests import TuneRequest
from flexstage.quantities.characteristic import Characteristics
from flexstage.stage import Stage
from flexstage.stage.contour import root_widths
from flexstage.stage.mass import mass_properties
from flexstage.studies.requests import AnalyseRequest, BudgetRequest, ModelOptions
from flexstage.studies.results import analysis_results
from flexstage.system import Analysis, MechanicalSystem, analyse
from flexstage.system.requests import models_of

if TYPE_CHECKING:
    import pandas

    from flexstage.control.dynamic_budget import DynamicBudget
    from flexstage.control.measured_response import ResponseDesign
    from flexstage.control.tuning import AxesDesign
    from flexstage.export.request import ExportRequest, StageExport
    from flexstage.fem import MeshSettings, Refinement, StageModel
    from flexstage.fem.stroke import FiniteStroke
    from flexstage.fem.superelement import SuperelementModel
    from flexstage.studies.stacks import StackAtWork
    from flexstage.system.environment import Environment


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelRun:
    """Result of one model of a stage."""

    analysis: Analysis
    """The analysis."""
    mesh: "StageModel | None" = None
    """The finite-element model, for pictures; None for other models."""
    refinement: "Refinement | None" = None
    """Refinement of the mesh, if an accuracy was requested."""
    strokes: "tuple[FiniteStroke, ...]" = ()
    """Motion over the full stroke with finite displacements, if requested."""
    bars: Mapping[str, float] = field(default_factory=dict)
    """Buckling load of each bar between two notches [N], if requested."""
    stacks: "tuple[StackAtWork, ...]" = ()
    """Stacks at work, if a rate was requested."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        """Return all results as plain data, with frequency responses."""
        return analysis_results(self.analysis, responses=True) | self.beyond_analysis()

    def beyond_analysis(self) -> dict[str, Any]:
        """Return all results except the analysis as plain data; SI units, frequencies in Hz.

        These are meshes and their values, the path of each axis, and the buckling loads of bars
        [N], if available.
        """
        out: dict[str, Any] = {}
        if self.refinement is not None:
            out["refinement"] = {
                **picked(self.refinement, "quantity", "accuracy", "estimate"),
                "steps": [
                    {
                        **picked(step.settings, "order", "neck_size"),
                        "unknowns": step.unknowns,
                        "seconds": round(step.seconds, 3),
                        "values": [
                            {"quantity": quantity, "axis": axis, "value": plain(value)}
                            for (quantity, axis), value in step.values.items()
                        ],
                    }
                    for step in self.refinement.steps
                ],
            }
        if self.strokes:
            out["strokes"] = {
                path.axis: picked(
                    path,
                    "displacement",
                    "force",
                    "along",
                    "across",
                    "rotation",
                    "natural_frequency_hz_at_full_stroke=frequency_hz",
                    "ratio_change",
                )
                for path in self.strokes
            }
        if self.bars:
            out["bar_buckling_load"] = plain(self.bars)
        if self.stacks:
            out["stacks"] = {s.line.drive.name: s.data() for s in self.stacks}
        return out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelRuns(Result):
    """Results of one or several models of a stage."""

    runs: Mapping[str, ModelRun]
    """Result by model."""
    skipped_models: Mapping[str, str]
    """Skipped models and reasons."""
    budgets: "Mapping[str, DynamicBudget]" = field(default_factory=dict)
    """Dynamic error budget by model, if an environment was given."""

    def data(self) -> dict[str, Any]:
        models = {name: run.data() for name, run in self.runs.items()}
        for name in models.keys() & self.budgets.keys():
            models[name]["budget"] = self.budgets[name].data()
        if len(models) == 1 and not self.skipped_models:
            return next(iter(models.values()))
        return {"models": models, "skipped_models": dict(self.skipped_models)}

    def to_frame(self) -> "pandas.DataFrame":
        every = (row for run in self.runs.values() for row in run.analysis.characteristics)
        return data_frame(Characteristics(every).columns())


def _lumped(stage: Stage, options: ModelOptions) -> ModelRun:
    return ModelRun(analysis=analyse(stage, lumped_system(stage, plane=options.plane)))


def _condensed(stage: Stage, options: ModelOptions, model: str) -> ModelRun:
    with progress.subtask(0.0, 0.5 if options.estimate else 1.0):
        if options.near is None:
            condensed = _superelements(stage, model, options)
        else:
            with progress.subtask(0.0, 0.5):
                near = _superelements_near(options.near, model, replace(options, near=None))
            condensed = near
            if stage != options.near:
                with progress.subtask(0.5, 1.0):
                    condensed = _superelements(stage, model, options, near)
        analysis = analyse(stage, condensed.system)
    if options.estimate:
        from flexstage.fem.superelement import with_estimates

        with progress.subtask(0.5, 1.0):
            analysis = with_estimates(analysis, condensed, cache=options.cache)
    return ModelRun(analysis=analysis)


@lru_cache(maxsize=4)
def _superelements_near(stage: Stage, model: str, options: ModelOptions) -> "SuperelementModel":
    return _superelements(stage, model, options)


def _moved_superelements(stage: Stage, model: str, near: Stage) -> "SuperelementModel":
    base = _superelements_before(near, model)
    return base if stage == near else _superelements(stage, model, ModelOptions(), base, moved=True)


@lru_cache(maxsize=2)
def _superelements_before(stage: Stage, model: str) -> "SuperelementModel":
    return _superelements(stage, model, ModelOptions(), moved=True)


def _superelements(
    stage: Stage,
    model: str,
    options: ModelOptions,
    near: "SuperelementModel | None" = None,
    *,
    moved: bool = False,
) -> "SuperelementModel":
    from flexstage.fem.superelement import BODIES, MOVED_BODIES, superelement_model

    return superelement_model(
        stage,
        MOVED_BODIES if moved else BODIES,
        plane=options.plane,
        space=model == "superelement-3d",
        supports=options.supports,
        cache=options.cache,
        near=near,
        moved=moved,
    )


def _plane(stage: Stage, options: ModelOptions) -> ModelRun:
    from flexstage.fem import plane_model
    from flexstage.fem.stroke import bar_buckling_load, two_notch_bars, with_stroke

    with progress.subtask(0.0, 0.4 if options.stroke else 1.0):
        run = _meshed(
            stage,
            options,
            "plane",
            lambda mesh: plane_model(stage, mesh, plane=options.plane, supports=options.supports),
        )
    if not options.stroke or run.mesh is None:
        return run
    with progress.subtask(0.4, 0.9):
        analysis, strokes = with_stroke(run.analysis, run.mesh)
    with progress.subtask(0.9, 1.0):
        bars = {body: bar_buckling_load(stage, body) for body in two_notch_bars(stage)}
    return replace(run, analysis=analysis, strokes=strokes, bars=bars)


def _solid(stage: Stage, options: ModelOptions) -> ModelRun:
    from flexstage.fem import solid_model

    return _meshed(
        stage, options, "solid", lambda mesh: solid_model(stage, mesh, supports=options.supports)
    )


def _meshed(
    stage: Stage,
    options: ModelOptions,
    name: str,
    build: "Callable[[MeshSettings | None], StageModel]",
) -> ModelRun:
    from flexstage.fem import REFINEMENT_MESHES, refine

    if options.accuracy is None:
        model = build(None)
        return ModelRun(analysis=analyse(stage, model.system), mesh=model)
    refinement = refine(
        build, REFINEMENT_MESHES[name], accuracy=options.accuracy, quantity=options.quantity
    )
    return ModelRun(analysis=refinement.analysis, mesh=refinement.model, refinement=refinement)


#: Models by name: functions of a stage and options.
MODELS: Mapping[str, Callable[[Stage, ModelOptions], ModelRun]] = {
    "lumped": _lumped,
    "superelement": partial(_condensed, model="superelement"),
    "plane": _plane,
    "superelement-3d": partial(_condensed, model="superelement-3d"),
    "solid": _solid,
}

#: Options of each model.
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "lumped": ("plane",),
    "superelement": ("plane", "supports", "estimate"),
    "plane": ("plane", "supports", "accuracy", "quantity", "stroke"),
    "superelement-3d": ("supports", "estimate"),
    "solid": ("supports", "accuracy", "quantity"),
}

#: Messages for options that a model does not have.
_ERRORS: Mapping[str, str] = {
    "accuracy": "--accuracy works with --model plane or solid only, got {model}",
    "estimate": "--estimate works with --model superelement or superelement-3d only, got {model}: "
    "{instead}",
    "stroke": "only the plane model can be computed over the stroke, not the {model} one: choose "
    "plane, or omit the stroke",
    "plane": "the {model} model has no plane state, got '{value}': omit the option",
    "supports": "the supports of the {model} model are rigid, like its bodies",
}


def fitting_options(model: str, options: ModelOptions) -> ModelOptions:
    """Return the options that a model has, with default values for all others.

    Examples
    --------
    >>> options = ModelOptions(estimate=True, accuracy=0.001)
    >>> fitting_options("solid", options) == ModelOptions(accuracy=0.001)
    True
    """
    known_model(model)
    return ModelOptions(
        cache=options.cache,
        bench=options.bench,
        **{name: getattr(options, name) for name in _CHOICES[model]},
    )


def run_model(stage: Stage, model: str, options: ModelOptions | None = None) -> ModelRun:
    """Analyse a stage with one of `MODELS`."""
    defaults = ModelOptions()
    options = options or defaults
    known_model(model)
    instead = "use --accuracy" if "accuracy" in _CHOICES[model] else "omit it"
    for name, message in _ERRORS.items():
        value = getattr(options, name)
        if name not in _CHOICES[model] and value != getattr(defaults, name):
            raise ModelError(message.format(model=model, value=value, instead=instead))
    if options.bench is not None:
        stage = replace(stage, bench=options.bench)
    _require_computable(stage)
    return MODELS[model](stage, options)


def _require_computable(stage: Stage) -> None:
    """Reject a stage that no model can compute, before any computation."""
    # largest ratio of two masses, for the precision of floating-point numbers
    largest_ratio = 1e12
    for hinge in stage.hinges:
        require_sizes(hinge.profile, f" of hinge '{hinge.name}'")
        root_widths(stage, hinge)
    masses = {name: body.mass for name, body in mass_properties(stage).items()}
    fixed = {body.name for body in stage.bodies if body.fixed}
    by_mass = sorted((mass, name) for name, mass in masses.items() if name not in fixed)
    if by_mass and by_mass[-1][0] > largest_ratio * by_mass[0][0]:
        (light, lightest), (heavy, heaviest) = by_mass[0], by_mass[-1]
        raise ModelError(
            f"body '{heaviest}' has {heavy:.3g} kg and '{lightest}' {light:.3g} kg, too "
            "different to compute: correct the masses"
        )


def known_model(model: str) -> None:
    """Reject an unknown model."""
    if model not in MODELS:
        raise ModelError(f"the model '{model}' is unknown: choose from {', '.join(MODELS)}")


def run_models(stage: Stage, request: AnalyseRequest) -> ModelRuns:
    """Analyse a stage with several of `MODELS`."""
    from flexstage.studies.stacks import heated_by_stacks, stacks_at_work

    stage = heated_by_stacks(stage, request.stacks)
    names = models_of(request.model)
    if not names:
        raise ModelError(f"--model names no model: choose from {', '.join(MODELS)}")
    environment = None
    if request.environment is not None:
        from flexstage.system.environment import read_environment

        environment = read_environment(request.environment)
    runs: dict[str, ModelRun] = {}
    budgets: dict[str, DynamicBudget] = {}
    skipped: dict[str, str] = {}
    for i, name in enumerate(names):
        with progress.subtask(i / len(names), (i + 1) / len(names)):
            try:
                run = run_model(stage, name, request.options)
                stacks = stacks_at_work(run.analysis, request.stacks)
                if environment is not None:
                    budgets[name] = open_budget(stage, run.analysis.system, environment)
                runs[name] = replace(run, stacks=stacks)
            except FlexstageError as error:
                if "all" not in request.model:
                    raise
                skipped[name] = str(error)
    if not runs:
        raise ModelError(f"no model is possible: {next(iter(skipped.values()))}")
    return ModelRuns(request=request, runs=runs, skipped_models=skipped, budgets=budgets)


def analyse_model(stage: Stage, model: str, *, near: Stage | None = None) -> Analysis:
    """Analyse a stage with one of `MODELS`, without its mesh; `near` as of `ModelOptions`."""
    return run_model(stage, model, ModelOptions(near=near)).analysis


def stage_budget(stage: Stage, request: BudgetRequest) -> "DynamicBudget":
    """Return the dynamic error budget of a stage by the model of a request."""
    from flexstage.control.dynamic_budget import dynamic_budget
    from flexstage.system.environment import read_environment

    environment = read_environment(request.environment)
    budget = dynamic_budget(
        stage,
        analyse_model(stage, request.model).system,
        environment,
        request.loop,
        axis=request.axis,
        exposure=request.exposure,
        duration=request.duration,
        wanted_rms=request.wanted_rms,
    )
    return replace(budget, request=request)


def stage_tuning(stage: Stage, request: TuneRequest) -> "ResponseDesign | AxesDesign":
    """Return the position control for the model of a stage."""
    from flexstage.control.tuning import tune_stage

    return tune_stage(stage, analyse_model(stage, request.model).system, request)


def open_budget(
    stage: Stage, system: MechanicalSystem, environment: "Environment"
) -> "DynamicBudget":
    """Return the dynamic error budget without control, by default at the probe of every axis."""
    from flexstage.control.dynamic_budget import dynamic_budget
    from flexstage.system.environment import Point, SensorNoise

    read = {s.spectrum.unit for s in environment.sources if isinstance(s, SensorNoise)}
    # noise of a sensor does nothing without control, but belongs to an axis of its unit
    suitable = (a.name for a in stage.axes if read <= {stage.probe(a.probe).unit})
    every = tuple(Point(name=axis.name, probe=axis.probe) for axis in stage.axes)
    at = replace(environment, points=environment.points or every)
    return dynamic_budget(stage, system, at, axis=next(suitable, None))


def analyse_moved(stage: Stage, model: str, near: Stage) -> Analysis:
    """Analyse a stage with superelements on the moved meshes of another, for their difference.

    The mesh of each body is that of `near`, of a lower order than usual and moved with its outline,
    so that differences between such analyses are free of the scatter between meshes.
    """
    _require_computable(stage)
    return analyse(stage, _moved_superelements(stage, model, near).system)


def stage_export(stage: Stage, request: "ExportRequest") -> "StageExport":
    """Return the export of a stage, which is analysed if a format needs it."""
    from flexstage.export.request import StageExport

    def analyse_for(request: "ExportRequest") -> "tuple[Analysis, StageModel | None]":
        run = run_model(stage, request.model, ModelOptions(plane=request.plane))
        return run.analysis, run.mesh

    return StageExport(stage=stage, request=request, analyse=analyse_for)
