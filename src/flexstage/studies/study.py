"""The main job: every model of a stage, beside what others gave for it."""

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
from flexstage.studies.models import MODELS, ModelRun, run_model
from flexstage.studies.requests import ModelOptions, Plane, StudyRequest
from flexstage.studies.results import analysis_results, characteristic_row
from flexstage.studies.virtual_experiments import carry_out
from flexstage.system import Analysis
from flexstage.system.requests import models_of

if TYPE_CHECKING:
    from flexstage.experiments.campaign.results import Characterisation
    from flexstage.studies.compensation import AxisExperiment
    from flexstage.studies.measurement import MeasurementComparison
    from flexstage.studies.traditional import TraditionalComparison
    from flexstage.studies.virtual_experiments import CentringTrial

#: What a study asks of a model beyond its usual mesh.
_ASKED: Mapping[str, ModelOptions] = {
    "superelement": ModelOptions(estimate=True),
    "plane": ModelOptions(accuracy=1e-3, stroke=True),
}

#: Models of which the other choice of plane state is shown as well: it costs little.
_BOUNDED = ("lumped", "plane")

#: Models in space, which have no plane state to choose.
_IN_SPACE = ("superelement-3d", "solid")

#: Models that are made as fast as read: bodies in space are kept by themselves, and their stress at
#: all points by all coordinates would be as much again on disk.
_QUICK = ("lumped", "superelement-3d")

#: Time that the models take beside one another, for the progress that is told.
_WEIGHTS: Mapping[str, float] = {
    "lumped": 0.1,
    "superelement": 1.0,
    "plane": 9.0,
    "superelement-3d": 5.0,
    "solid": 14.0,
}

#: And the comparison with traditional stages beside them.
_TRADITIONAL = 0.6

#: Share of a model's time that is over before its other choice of plane state.
_BEFORE_OTHER = 0.9

#: Share of the time that experiments on the virtual stage take.
_EXPERIMENT = 0.1

#: Responses and modes are drawn of the first of these that was run.
_DRAWN = ("superelement", "plane", "lumped", "superelement-3d", "solid")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Study(Result):
    """A stage, what each model says of it, and what others gave for it."""

    table_key: ClassVar[str] = "characteristics"

    stage: Stage
    """The stage."""
    analyses: Mapping[str, Analysis]
    """Analysis by model."""
    variants: Mapping[str, Analysis]
    """The same models with another choice of plane stress or strain, by what they are called."""
    paths: Mapping[str, StrokePath]
    """Motion over the whole stroke with finite rotations, by axis; of the lumped model."""
    runs: Mapping[str, ModelRun] = field(default_factory=dict)
    """Run of each model, with the mesh behind it."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Why a model could not be made of this stage, by model."""
    experiments: "Mapping[str, AxisExperiment]" = field(default_factory=dict)
    """Identification and compensation of hysteresis on the virtual stage, by axis."""
    experiments_left_out: Mapping[str, str] = field(default_factory=dict)
    """Why that could not be done, by axis."""
    measured: "Characterisation | None" = None
    """What was measured of the stage; its rows stand in the table."""
    virtual: "MeasurementComparison | str | None" = None
    """What measuring a virtual stage gave, or why that could not be done."""
    centring: "CentringTrial | str | None" = None
    """An encoder scale that was centred on the virtual table, or why that could not be done."""
    traditional: "TraditionalComparison | None" = None
    """Its motion errors and drift beside those of traditional stages, where any is claimed."""
    read: tuple[str, ...] = ()
    """What was read from the cache instead of being computed again."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        return {
            **picked(self.stage, "stage=name", "title", "notes"),
            "characteristics": [characteristic_row(row) for row in self.characteristics],
            "models": {
                name: _without_table(a)
                | self.runs.get(name, ModelRun(analysis=a)).beyond_analysis()
                for name, a in self.analyses.items()
            },
            "left_out": dict(self.left_out),
            "hysteresis": {axis: made.data() for axis, made in self.experiments.items()},
            "virtual_measurement": _or_reason(self.virtual),
            "centring": _or_reason(self.centring),
            "traditional": _or_reason(self.traditional),
            "variants": {name: analysis_results(a) for name, a in self.variants.items()},
        }

    @property
    def characteristics(self) -> Characteristics:
        """What was published, then what each model gives, then what was measured."""
        ours = (row for analysis in self.analyses.values() for row in analysis.characteristics)
        measured = () if self.measured is None else self.measured.characteristics
        return Characteristics((*self.stage.published, *ours, *measured))

    @property
    def comparison(self) -> Comparison:
        """All of it side by side."""
        return compare(
            self.characteristics,
            {name: analysis.characteristics for name, analysis in self.variants.items()},
        )

    @property
    def main(self) -> Analysis:
        """The analysis that figures are drawn of: of the model that comes first in `_DRAWN`."""
        for name in _DRAWN:
            if name in self.analyses:
                return self.analyses[name]
        return next(iter(self.analyses.values()))

    @property
    def springs(self) -> tuple[HingeSpring, ...]:
        """Springs of the hinges, as the model that figures are drawn of takes them."""
        settings = self.main.provenance.settings
        used = settings.get("plane", "")
        return hinge_springs(
            self.stage,
            method=settings.get("method", "wedge"),  # type: ignore[arg-type]
            plane=used if used in ("stress", "strain") else "auto",
        )

    @property
    def measured_beside(self) -> "MeasurementComparison | None":
        """What was measured of the stage, beside what was published and what each model gives."""
        if self.measured is None:
            return None
        from flexstage.studies.measurement import compare_with_references

        others = Characteristics(r for r in self.characteristics if r.origin != "measured")
        return compare_with_references(self.measured, self.stage, others)

    def diagrams(self) -> dict[str, bytes]:
        """Draw the structural diagrams of the axes by the lumped model as SVG, by file.

        Stacks have the hysteresis that was identified here, and that of usual ones otherwise.
        """
        from flexstage.export.diagram.svg import diagram_files
        from flexstage.hysteresis import dynamic_model

        identified = {
            axis: made.runs[0].identification.model for axis, made in self.experiments.items()
        }
        lumped = self.analyses["lumped"].system
        model = dynamic_model(self.stage, lumped, hysteresis=identified or "usual")
        return diagram_files(self.stage, model=model)


def _without_table(analysis: Analysis) -> dict[str, Any]:
    """All of an analysis but its characteristics, which stand in the table of the study."""
    results = analysis_results(analysis)
    del results["characteristics"]
    return results


def _or_reason(
    found: "MeasurementComparison | CentringTrial | TraditionalComparison | str | None",
) -> dict[str, Any]:
    """Return a result as plain data, or why there is none; nothing where it was not asked for."""
    if found is None:
        return {}
    return {"reason": found} if isinstance(found, str) else found.data()


def run_study(
    stage: Stage,
    request: StudyRequest | None = None,
    *,
    measured: "Characterisation | None" = None,
    cache: "Cache | Path | str | bool" = False,
    **asked: Any,
) -> Study:
    """Run the models of a stage.

    Parameters
    ----------
    stage : Stage
        The stage.
    request : StudyRequest, optional
        Models, and what is done beside them; the lumped model alone where None.
    measured : Characterisation, optional
        What was measured of the stage.
    cache : Cache or path or bool
        Where models and experiments are kept, and read where nothing changed that they depend on:
        True for the user's cache (``$FLEXSTAGE_CACHE``), a directory, or False for nowhere.
    **asked
        Fields of the request in place of its own.

    Returns
    -------
    Study
        The results, plane models also with the other choice of plane state. Of several models, one
        that cannot be made of this stage is left out, with the reason.

    Raises
    ------
    ModelError
        No model is named, or one that does not exist.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> study = run_study(design("vgtu-piezo"), model="lumped")
    >>> row = next(r for r in study.comparison.rows if r.quantity == "natural_frequency_hz")
    >>> print(f"{row.axis}: {row.value('published-analytic'):.0f} Hz")
    x: 339 Hz
    """
    request = request_of(StudyRequest, request or StudyRequest.of_models("lumped"), asked)
    models, plane = models_of(request.model), request.plane
    if not models:
        raise ModelError(f"no model is named: choose from {', '.join(MODELS)}")
    memory = Memory(open_cache(cache))
    runs: dict[str, ModelRun] = {}
    variants: dict[str, Analysis] = {}
    left_out: dict[str, str] = {}
    weights = [_WEIGHTS.get(model, 1.0) for model in models]
    beside = "traditional" in request.parts and stage.name in MOTION_ERROR_CLAIMS
    whole = (sum(weights) + _TRADITIONAL * beside) / (
        1.0 - _EXPERIMENT if {"identification", "virtual"} & set(request.parts) else 1.0
    )
    done = 0.0
    for model, weight in zip(models, weights, strict=True):
        with progress.subtask(done / whole, (done + weight) / whole):
            own: Plane = "auto" if model in _IN_SPACE else plane
            try:
                with progress.subtask(0.0, _BEFORE_OTHER if model in _BOUNDED else 1.0):
                    options = replace(_ASKED.get(model, ModelOptions()), plane=own)
                    runs[model] = _recalled(memory, model, stage, options)
            except (ModelError, StageError) as error:
                if len(models) == 1:
                    raise
                left_out[model] = str(error)
                continue
            finally:
                done += weight
            used = runs[model].analysis.provenance.settings.get("plane", "")
            if model in _BOUNDED and used:
                # plane strain belongs to wide notches; where it was used plane stress is the
                # other bound
                other: Plane = "stress" if "strain" in used else "strain"
                with progress.subtask(_BEFORE_OTHER, 1.0):
                    name = f"{model}, plane {other}"
                    options = ModelOptions(plane=other)
                    variants[name] = _recalled(memory, model, stage, options, name).analysis
    if not runs:
        raise ModelError("; ".join(f"{model}: {why}" for model, why in left_out.items()))
    analyses = {model: run.analysis for model, run in runs.items()}
    paths: Mapping[str, StrokePath] = {}
    if "lumped" in analyses:
        paths, analyses["lumped"] = _over_the_stroke(stage, analyses["lumped"], plane)
    compared = None
    if beside:
        with progress.subtask(done / whole, (done + _TRADITIONAL) / whole):
            compared = _compared(stage, runs, request.seed, memory)
    made = Study(
        request=request,
        stage=stage,
        analyses=analyses,
        variants=variants,
        paths=paths,
        runs=runs,
        left_out=left_out,
        measured=measured,
        traditional=compared,
    )
    with progress.subtask(1.0 - _EXPERIMENT, 1.0):
        found = carry_out(
            stage,
            made.main.system,
            measure="virtual" in request.parts,
            compensate="identification" in request.parts,
            seed=request.seed,
            memory=memory,
        )
    of_stage = {verb: given for (verb, _), given in found.items() if verb != "verify"}
    of_axes = {axis: given for (verb, axis), given in found.items() if verb == "verify"}
    return replace(
        made,
        virtual=of_stage.get("characterise"),
        centring=of_stage.get("centre"),
        experiments={a: given for a, given in of_axes.items() if not isinstance(given, str)},
        experiments_left_out={a: why for a, why in of_axes.items() if isinstance(why, str)},
        read=memory.read,
    )


def _recalled(
    memory: Memory, model: str, stage: Stage, options: ModelOptions, name: str = ""
) -> ModelRun:
    """Run a model, or read what it gave, where that saves time."""
    options = replace(options, cache=memory.cache or False)
    if model in _QUICK:
        return run_model(stage, model, options)
    return memory.recall(name or model, run_model, stage, model, options)


def _compared(
    stage: Stage, runs: Mapping[str, ModelRun], seed: int, memory: Memory
) -> "TraditionalComparison":
    """Compare with traditional stages, with what the models gave of this one."""
    from flexstage.studies.traditional import compare_traditional

    system = runs["superelement"].analysis.system if "superelement" in runs else None
    strokes = runs["plane"].strokes if "plane" in runs else ()
    return memory.recall(
        "traditional", compare_traditional, stage, system, strokes=strokes, seed=seed
    )


def _over_the_stroke(
    stage: Stage, analysis: Analysis, plane: Plane
) -> tuple[dict[str, StrokePath], Analysis]:
    """Follow each axis with finite rotations, and add its straightness to the characteristics."""
    states = 21  # along a stroke
    model = mechanism(stage, plane=plane)
    paths: dict[str, StrokePath] = {}
    rows = list(analysis.characteristics)
    validity = list(analysis.validity)
    for axis in analysis.axes:
        if len(axis.drives) > 1 or stage.probe(axis.probe).direction is None:
            # the line of one drive is followed, and what a point does
            continue
        steps = np.linspace(0.0, axis.input_displacement, states)
        try:
            path = stroke_path(model, axis.drive, axis.probe, steps)
        except (ConvergenceError, ModelError) as error:
            validity.append(f"Axis {axis.axis} could not be followed over its stroke: {error}.")
            continue
        paths[axis.axis] = path
        straightness = Characteristic(
            quantity="straightness",
            axis=axis.axis,
            origin=analysis.system.model,
            value=path.straightness,
            unit=QUANTITIES["straightness"].unit,
            note="finite rotations over the full stroke: largest less smallest distance from the "
            "least-squares straight line",
        )
        last = max(i for i, row in enumerate(rows) if row.axis == axis.axis)
        rows.insert(last + 1, straightness)
    return paths, replace(analysis, characteristics=Characteristics(rows), validity=tuple(validity))
