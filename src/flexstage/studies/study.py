"""Study: comparison of all models of a stage with published values and measurements."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from flexstage.base import progress
from flexstage.base.errors import ConvergenceError, ModelError, StageError
from flexstage.base.short_repr import short_repr
from flexstage.files.cache.cache import Cache, open_cache
from flexstage.files.cache.memory import Memory
from flexstage.files.plain import picked
from flexstage.files.request import request_of
from flexstage.files.result import Result
from flexstage.lumped import hinge_springs, mechanism, stroke_path
from flexstage.lumped.assemble import HingeSpring
from flexstage.lumped.large_displacement import StrokePath
from flexstage.quantities.characteristic import Characteristic, Characteristics
from flexstage.quantities.comparison import Comparison, compare
from flexstage.quantities.quantity import QUANTITIES
from flexstage.stage import Stage
from flexstage.stage.designs.vgtu import MOTION_ERROR_CLAIMS
from flexstage.studies.models import MODELS, ModelRun, open_budget, run_model
from flexstage.studies.requests import ModelOptions, Plane, StudyRequest
from flexstage.studies.results import analysis_results, characteristic_row
from flexstage.studies.virtual_experiments import carry_out
from flexstage.system import Analysis
from flexstage.system.environment import Environment, read_environment, ready_environment
from flexstage.system.requests import models_of

if TYPE_CHECKING:
    from flexstage.control.dynamic_budget import DynamicBudget
    from flexstage.experiments.campaign.results import Characterisation
    from flexstage.studies.compensation import AxisExperiment
    from flexstage.studies.measurement import MeasurementComparison
    from flexstage.studies.traditional import TraditionalComparison
    from flexstage.studies.virtual_experiments import CentringTrial
    from flexstage.virtual.neck_widths import NeckWidths

#: Options of the models in a study.
_OPTIONS: Mapping[str, ModelOptions] = {
    "superelement": ModelOptions(estimate=True),
    "plane": ModelOptions(accuracy=1e-3, stroke=True),
}

#: Models with a variant of the other plane state, which takes little time.
_WITH_VARIANT = ("lumped", "plane")

#: Three-dimensional models, without plane state.
_THREE_DIMENSIONAL = ("superelement-3d", "solid")

#: Models that are not cached: computing them is as fast as reading. Bodies of superelement-3d have
#: a cache, and stress matrices of all points would double its size.
_UNCACHED = ("lumped", "superelement-3d")

#: Relative computing times of the models, for the progress display.
_WEIGHTS: Mapping[str, float] = {
    "lumped": 0.1,
    "superelement": 1.0,
    "plane": 9.0,
    "superelement-3d": 5.0,
    "solid": 14.0,
}

#: Relative computing time of the comparison with traditional stages.
_TRADITIONAL = 0.6

#: Share of a model in the time of the model and its variant.
_BEFORE_VARIANT = 0.9

#: Share of experiments on the virtual stage in the total time.
_EXPERIMENT = 0.1

#: Models for figures of responses and modes, in the order of preference.
_MAIN_MODELS = ("superelement", "plane", "lumped", "superelement-3d", "solid")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Study(Result):
    """Result of a study: a stage with analyses, published values and measurements."""

    table_key: ClassVar[str] = "characteristics"

    stage: Stage
    """The stage."""
    analyses: Mapping[str, Analysis]
    """Analysis by model."""
    variants: Mapping[str, Analysis]
    """Variants with the other plane state, by name."""
    paths: Mapping[str, StrokePath]
    """Motion over the full stroke with finite rotations by the lumped model, by axis."""
    runs: Mapping[str, ModelRun] = field(default_factory=dict)
    """Run of each model, with its mesh."""
    skipped_models: Mapping[str, str] = field(default_factory=dict)
    """Skipped models and reasons."""
    experiments: "Mapping[str, AxisExperiment]" = field(default_factory=dict)
    """Identification and compensation of hysteresis on the virtual stage, by axis."""
    skipped_experiments: Mapping[str, str] = field(default_factory=dict)
    """Axes without these experiments and reasons."""
    measured: "Characterisation | None" = None
    """Measurements of the stage; the table contains them."""
    virtual: "MeasurementComparison | str | None" = None
    """Simulated measurements of the virtual stage, or the reason why there are none."""
    centring: "CentringTrial | str | None" = None
    """Simulated centring of an encoder scale, or the reason why there is none."""
    traditional: "TraditionalComparison | None" = None
    """Comparison of motion errors and drift with traditional stages, for claims of the study."""
    budget: "DynamicBudget | str | None" = None
    """Dynamic error budget without control, or the reason why there is none."""
    read: tuple[str, ...] = ()
    """Names of results from the cache."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        return {
            **picked(self.stage, "stage=name", "title", "notes"),
            "characteristics": [
                characteristic_row(row, self.stage.published) for row in self.characteristics
            ],
            "models": {
                name: _without_table(a)
                | self.runs.get(name, ModelRun(analysis=a)).beyond_analysis()
                for name, a in self.analyses.items()
            },
            "skipped_models": dict(self.skipped_models),
            "hysteresis": {axis: e.data() for axis, e in self.experiments.items()},
            "virtual_measurement": _or_reason(self.virtual),
            "centring": _or_reason(self.centring),
            "traditional": _or_reason(self.traditional),
            "budget": _or_reason(self.budget),
            "variants": {name: analysis_results(a) for name, a in self.variants.items()},
        }

    @property
    def characteristics(self) -> Characteristics:
        """Published values, then those of each model, then measured ones."""
        ours = (row for analysis in self.analyses.values() for row in analysis.characteristics)
        measured = () if self.measured is None else self.measured.characteristics
        return Characteristics((*self.stage.published, *ours, *measured))

    @property
    def comparison(self) -> Comparison:
        """Comparison of all characteristics."""
        return compare(
            self.characteristics,
            {name: analysis.characteristics for name, analysis in self.variants.items()},
        )

    @property
    def main(self) -> Analysis:
        """Analysis for figures: of the first available model of `_MAIN_MODELS`."""
        for name in _MAIN_MODELS:
            if name in self.analyses:
                return self.analyses[name]
        return next(iter(self.analyses.values()))

    @property
    def springs(self) -> tuple[HingeSpring, ...]:
        """Springs of the hinges with the options of the main analysis."""
        settings = self.main.provenance.settings
        used = settings.get("plane", "")
        return hinge_springs(
            self.stage,
            method=settings.get("method", "wedge"),
            plane=used if used in ("stress", "strain") else "auto",
        )

    @property
    def measurement_comparison(self) -> "MeasurementComparison | None":
        """Comparison of measurements with published values and models."""
        if self.measured is None:
            return None
        from flexstage.studies.measurement import compare_with_references

        others = Characteristics(r for r in self.characteristics if r.origin != "measured")
        return compare_with_references(self.measured, self.stage, others)

    def diagrams(self) -> dict[str, bytes]:
        """Return the block diagrams of the axes by the lumped model as SVG, by file.

        Stacks have the identified hysteresis, if any, else that of a typical stack.
        """
        from flexstage.export.diagram.svg import diagram_files
        from flexstage.hysteresis import dynamic_model

        identified = {axis: e.runs[0].identification.model for axis, e in self.experiments.items()}
        lumped = self.analyses["lumped"].system
        model = dynamic_model(self.stage, lumped, hysteresis=identified or "usual")
        return diagram_files(self.stage, model=model)


def _without_table(analysis: Analysis) -> dict[str, Any]:
    """Return an analysis as plain data without characteristics, which are in the table."""
    results = analysis_results(analysis)
    del results["characteristics"]
    return results


def _or_reason(result: Any) -> dict[str, Any]:
    """Return a result as plain data, or the reason for its absence; empty if not requested."""
    if result is None:
        return {}
    return {"reason": result} if isinstance(result, str) else result.data()


def run_study(
    stage: Stage,
    request: StudyRequest | None = None,
    *,
    measured: "Characterisation | None" = None,
    cache: "Cache | Path | str | bool" = False,
    **fields: Any,
) -> Study:
    """Run a study of a stage.

    Parameters
    ----------
    stage : Stage
        The stage.
    request : StudyRequest, optional
        Models and further parts; by default the lumped model alone.
    measured : Characterisation, optional
        Measurements of the stage.
    cache : Cache or path or bool
        Cache of models and experiments, which are read if their input is unchanged: True for the
        user's cache (``$FLEXSTAGE_CACHE``), a directory, or False for none.
    **fields
        Fields of the request that replace its own.

    Returns
    -------
    Study
        The results, with variants of the other plane state. Of several models, impossible ones are
        skipped with the reason.

    Raises
    ------
    ModelError
        No model is named, or a model is unknown.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> study = run_study(design("vgtu-piezo"), model="lumped")
    >>> row = next(r for r in study.comparison.rows if r.quantity == "natural_frequency_hz")
    >>> print(f"{row.axis}: {row.value('published-analytic'):.0f} Hz")
    x: 339 Hz
    """
    request = request_of(StudyRequest, request or StudyRequest.of_models("lumped"), fields)
    models, plane = models_of(request.model), request.plane
    if not models:
        raise ModelError(f"no model is named: choose from {', '.join(MODELS)}")
    memory = Memory(open_cache(cache))
    environment = environment_of(stage, request)
    widths = None
    if request.widths is not None:
        from flexstage.virtual.neck_widths import measured_necks

        widths = measured_necks(request.widths, stage)
    runs: dict[str, ModelRun] = {}
    variants: dict[str, Analysis] = {}
    skipped: dict[str, str] = {}
    weights = [_WEIGHTS.get(model, 1.0) for model in models]
    with_traditional = "traditional" in request.parts and stage.name in MOTION_ERROR_CLAIMS
    total = (sum(weights) + _TRADITIONAL * with_traditional) / (
        1.0 - _EXPERIMENT if {"identification", "virtual"} & set(request.parts) else 1.0
    )
    done = 0.0
    for model, weight in zip(models, weights, strict=True):
        with progress.subtask(done / total, (done + weight) / total):
            model_plane: Plane = "auto" if model in _THREE_DIMENSIONAL else plane
            try:
                with progress.subtask(0.0, _BEFORE_VARIANT if model in _WITH_VARIANT else 1.0):
                    options = replace(_OPTIONS.get(model, ModelOptions()), plane=model_plane)
                    runs[model] = _recalled(memory, model, stage, options)
            except (ModelError, StageError) as error:
                if len(models) == 1:
                    raise
                skipped[model] = str(error)
                continue
            finally:
                done += weight
            used = runs[model].analysis.provenance.settings.get("plane", "")
            if model in _WITH_VARIANT and used:
                # plane strain is for wide notches, and plane stress is then the other bound
                other: Plane = "stress" if "strain" in used else "strain"
                with progress.subtask(_BEFORE_VARIANT, 1.0):
                    name = f"{model}, plane {other}"
                    options = ModelOptions(plane=other)
                    variants[name] = _recalled(memory, model, stage, options, name).analysis
    if not runs:
        raise ModelError("; ".join(f"{model}: {reason}" for model, reason in skipped.items()))
    analyses = {model: run.analysis for model, run in runs.items()}
    paths: Mapping[str, StrokePath] = {}
    if "lumped" in analyses:
        paths, analyses["lumped"] = _over_the_stroke(stage, analyses["lumped"], plane)
    traditional = None
    if with_traditional:
        with progress.subtask(done / total, (done + _TRADITIONAL) / total):
            traditional = _compared(stage, runs, request.seed, memory, widths)
    study = Study(
        request=request,
        stage=stage,
        analyses=analyses,
        variants=variants,
        paths=paths,
        runs=runs,
        skipped_models=skipped,
        measured=measured,
        traditional=traditional,
    )
    if environment is not None:
        study = replace(study, budget=_budget(stage, study.main, environment))
    with progress.subtask(1.0 - _EXPERIMENT, 1.0):
        experiments = carry_out(
            stage,
            study.main.system,
            measure="virtual" in request.parts,
            compensate="identification" in request.parts,
            seed=request.seed,
            memory=memory,
            strokes=runs["plane"].strokes if "plane" in runs else (),
            widths=widths,
        )
    of_stage = {verb: result for (verb, _), result in experiments.items() if verb != "verify"}
    of_axes = {axis: result for (verb, axis), result in experiments.items() if verb == "verify"}
    return replace(
        study,
        virtual=of_stage.get("characterise"),
        centring=of_stage.get("centre"),
        experiments={a: result for a, result in of_axes.items() if not isinstance(result, str)},
        skipped_experiments={a: reason for a, reason in of_axes.items() if isinstance(reason, str)},
        read=memory.read,
    )


def environment_of(stage: Stage, request: StudyRequest) -> Environment | None:
    """Return the environment of a study: the one given, or the assumed one of a built-in stage."""
    if request.environment is not None:
        return read_environment(request.environment)
    return None if request.parts == ("none",) else ready_environment(stage)


def _budget(stage: Stage, main: Analysis, environment: Environment) -> "DynamicBudget | str":
    try:
        return open_budget(stage, main.system, environment)
    except ModelError as error:
        return str(error)


def _recalled(
    memory: Memory, model: str, stage: Stage, options: ModelOptions, name: str = ""
) -> ModelRun:
    """Run a model, or read its result from the cache if that saves time."""
    options = replace(options, cache=memory.cache or False)
    if model in _UNCACHED:
        return run_model(stage, model, options)
    return memory.recall(name or model, run_model, stage, model, options)


def _compared(
    stage: Stage,
    runs: Mapping[str, ModelRun],
    seed: int,
    memory: Memory,
    widths: "NeckWidths | None",
) -> "TraditionalComparison":
    """Compare with traditional stages, with results of the models."""
    from flexstage.studies.traditional import compare_traditional
    from flexstage.virtual.imperfections import Scatter

    scatter = Scatter() if widths is None else widths.scattered(Scatter())
    system = runs["superelement"].analysis.system if "superelement" in runs else None
    strokes = runs["plane"].strokes if "plane" in runs else ()
    return memory.recall(
        "traditional",
        compare_traditional,
        stage,
        system,
        strokes=strokes,
        seed=seed,
        scatter=scatter,
    )


def _over_the_stroke(
    stage: Stage, analysis: Analysis, plane: Plane
) -> tuple[dict[str, StrokePath], Analysis]:
    """Compute each axis with finite rotations, and add its straightness to the characteristics."""
    states = 21  # along a stroke
    model = mechanism(stage, plane=plane)
    paths: dict[str, StrokePath] = {}
    rows = list(analysis.characteristics)
    validity = list(analysis.validity)
    for axis in analysis.axes:
        if len(axis.drives) > 1 or stage.probe(axis.probe).direction is None:
            # the path needs a single drive and a probe of displacement
            continue
        steps = np.linspace(0.0, axis.input_displacement, states)
        try:
            path = stroke_path(model, axis.drive, axis.probe, steps)
        except (ConvergenceError, ModelError) as error:
            validity.append(f"Axis {axis.axis} could not be computed over its stroke: {error}.")
            continue
        paths[axis.axis] = path
        straightness = Characteristic(
            quantity="straightness",
            axis=axis.axis,
            origin=analysis.system.model,
            value=path.straightness,
            unit=QUANTITIES["straightness"].unit,
            note="finite rotations over the full stroke: peak to valley about the least-squares "
            "straight line",
        )
        last = max(i for i, row in enumerate(rows) if row.axis == axis.axis)
        rows.insert(last + 1, straightness)
    return paths, replace(analysis, characteristics=Characteristics(rows), validity=tuple(validity))
