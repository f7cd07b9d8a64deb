"""The models of a stage, each run as it is asked for."""

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
from flexstage.quantities.characteristic import Characteristics
from flexstage.stage import Stage
from flexstage.stage.contour import root_widths
from flexstage.stage.mass import mass_properties
from flexstage.studies.requests import AnalyseRequest, ModelOptions
from flexstage.studies.results import analysis_results
from flexstage.system import Analysis, analyse
from flexstage.system.requests import models_of

if TYPE_CHECKING:
    import pandas

    from flexstage.export.request import ExportRequest, StageExport
    from flexstage.fem import MeshSettings, Refinement, StageModel
    from flexstage.fem.stroke import FiniteStroke
    from flexstage.fem.superelement import SuperelementModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelRun:
    """What one model made of a stage."""

    analysis: Analysis
    """What it says of the stage."""
    mesh: "StageModel | None" = None
    """The finite-element model behind it, for pictures; None where there is none."""
    refinement: "Refinement | None" = None
    """How its mesh was refined, where an accuracy was asked for."""
    strokes: "tuple[FiniteStroke, ...]" = ()
    """Motion over the whole stroke with finite displacements, where it was asked for."""
    bars: Mapping[str, float] = field(default_factory=dict)
    """Axial load at which each bar between two notches buckles [N], where that was asked for."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        """Return all that the model found as plain data, with its frequency responses."""
        return analysis_results(self.analysis, responses=True) | self.beyond_analysis()

    def beyond_analysis(self) -> dict[str, Any]:
        """Return what a run has beyond its analysis, as plain data; SI units, frequencies in Hz.

        Only what there is of the meshes and their values, the path of each axis, and the buckling
        load of bars [N].
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
        return out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelRuns(Result):
    """What one model or several made of a stage."""

    runs: Mapping[str, ModelRun]
    """The run of each."""
    left_out: Mapping[str, str]
    """Of all models those that cannot be made of the stage, with the reason."""

    def data(self) -> dict[str, Any]:
        of_each = {name: run.data() for name, run in self.runs.items()}
        if len(of_each) == 1 and not self.left_out:
            return next(iter(of_each.values()))
        return {"models": of_each, "left_out": dict(self.left_out)}

    def to_frame(self) -> "pandas.DataFrame":
        every = (row for run in self.runs.values() for row in run.analysis.characteristics)
        return data_frame(Characteristics(every).columns())


def _lumped(stage: Stage, options: ModelOptions) -> ModelRun:
    return ModelRun(analysis=analyse(stage, lumped_system(stage, plane=options.plane)))


def _condensed(stage: Stage, options: ModelOptions, model: str) -> ModelRun:
    with progress.subtask(0.0, 0.5 if options.estimate else 1.0):
        if options.near is None:
            found = _superelements(stage, model, options)
        else:
            with progress.subtask(0.0, 0.5):
                found = near = _superelements_near(options.near, model, replace(options, near=None))
            if stage != options.near:
                with progress.subtask(0.5, 1.0):
                    found = _superelements(stage, model, options, near)
        analysis = analyse(stage, found.system)
    if options.estimate:
        from flexstage.fem.superelement import with_estimates

        with progress.subtask(0.5, 1.0):
            analysis = with_estimates(analysis, found, cache=options.cache)
    return ModelRun(analysis=analysis)


@lru_cache(maxsize=4)
def _superelements_near(stage: Stage, model: str, options: ModelOptions) -> "SuperelementModel":
    return _superelements(stage, model, options)


def _superelements(
    stage: Stage, model: str, options: ModelOptions, near: "SuperelementModel | None" = None
) -> "SuperelementModel":
    from flexstage.fem import superelement_model

    return superelement_model(
        stage,
        plane=options.plane,
        space=model == "superelement-3d",
        supports=options.supports,
        cache=options.cache,
        near=near,
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
    found = refine(
        build, REFINEMENT_MESHES[name], accuracy=options.accuracy, quantity=options.quantity
    )
    return ModelRun(analysis=found.analysis, mesh=found.model, refinement=found)


#: Models by name: each makes an analysis from a stage and what is asked for.
MODELS: Mapping[str, Callable[[Stage, ModelOptions], ModelRun]] = {
    "lumped": _lumped,
    "superelement": partial(_condensed, model="superelement"),
    "plane": _plane,
    "superelement-3d": partial(_condensed, model="superelement-3d"),
    "solid": _solid,
}

#: What each model can be asked for.
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "lumped": ("plane",),
    "superelement": ("plane", "supports", "estimate"),
    "plane": ("plane", "supports", "accuracy", "quantity", "stroke"),
    "superelement-3d": ("supports", "estimate"),
    "solid": ("supports", "accuracy", "quantity"),
}

#: What is said where something else is asked of a model.
_REFUSALS: Mapping[str, str] = {
    "accuracy": "--accuracy works with --model plane or solid only, got {model}",
    "estimate": "--estimate works with --model superelement or superelement-3d only, got {model}: "
    "{instead}",
    "stroke": "only the plane model is followed over the stroke, not the {model} one: choose "
    "plane, or leave the stroke out",
    "plane": "the {model} model has no plane state, got '{given}': leave the option out",
    "supports": "the bodies of the {model} model are rigid, and so are its supports",
}


def fitting_options(model: str, options: ModelOptions) -> ModelOptions:
    """Return what a model can be asked for of some choices, with the usual one for all others.

    Examples
    --------
    >>> asked = ModelOptions(estimate=True, accuracy=0.001)
    >>> fitting_options("solid", asked) == ModelOptions(accuracy=0.001)
    True
    """
    known_model(model)
    return ModelOptions(
        cache=options.cache, **{name: getattr(options, name) for name in _CHOICES[model]}
    )


def run_model(stage: Stage, model: str, options: ModelOptions | None = None) -> ModelRun:
    """Analyse a stage with one of `MODELS`."""
    usual = ModelOptions()
    options = options or usual
    known_model(model)
    instead = "take --accuracy" if "accuracy" in _CHOICES[model] else "leave it out"
    for name, said in _REFUSALS.items():
        given = getattr(options, name)
        if name not in _CHOICES[model] and given != getattr(usual, name):
            raise ModelError(said.format(model=model, given=given, instead=instead))
    _require_computable(stage)
    return MODELS[model](stage, options)


def _require_computable(stage: Stage) -> None:
    """Refuse, before any time is spent, what no model can compute, by the names that it has."""
    # largest ratio of two masses that floats can be trusted with
    farthest_masses = 1e12
    for hinge in stage.hinges:
        require_sizes(hinge.profile, f" of hinge '{hinge.name}'")
        root_widths(stage, hinge)
    masses = {name: found.mass for name, found in mass_properties(stage).items()}
    fixed = {body.name for body in stage.bodies if body.fixed}
    by_mass = sorted((mass, name) for name, mass in masses.items() if name not in fixed)
    if by_mass and by_mass[-1][0] > farthest_masses * by_mass[0][0]:
        (light, lightest), (heavy, heaviest) = by_mass[0], by_mass[-1]
        raise ModelError(
            f"body '{heaviest}' has {heavy:.3g} kg and '{lightest}' {light:.3g} kg, too far apart "
            "to compute with: correct the masses"
        )


def known_model(model: str) -> None:
    """Refuse a model that there is not."""
    if model not in MODELS:
        raise ModelError(f"the model '{model}' is not known: choose from {', '.join(MODELS)}")


def run_models(stage: Stage, request: AnalyseRequest) -> ModelRuns:
    """Analyse a stage with several of `MODELS`."""
    names = models_of(request.model)
    if not names:
        raise ModelError(f"--model names no model: choose from {', '.join(MODELS)}")
    runs: dict[str, ModelRun] = {}
    left_out: dict[str, str] = {}
    for i, name in enumerate(names):
        with progress.subtask(i / len(names), (i + 1) / len(names)):
            try:
                runs[name] = run_model(stage, name, request.options)
            except FlexstageError as error:
                if "all" not in request.model:
                    raise
                left_out[name] = str(error)
    if not runs:
        raise ModelError(f"no model is possible: {next(iter(left_out.values()))}")
    return ModelRuns(request=request, runs=runs, left_out=left_out)


def analyse_model(stage: Stage, model: str, *, near: Stage | None = None) -> Analysis:
    """Analyse a stage with one of `MODELS`, without its mesh; `near` as of `ModelOptions`."""
    return run_model(stage, model, ModelOptions(near=near)).analysis


def stage_export(stage: Stage, request: "ExportRequest") -> "StageExport":
    """Return a stage for other programs, which is analysed where a format needs it."""
    from flexstage.export.request import StageExport

    def analysed(asked: "ExportRequest") -> "tuple[Analysis, StageModel | None]":
        run = run_model(stage, asked.model, ModelOptions(plane=asked.plane))
        return run.analysis, run.mesh

    return StageExport(stage=stage, request=request, analyse=analysed)
