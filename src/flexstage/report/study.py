"""The main job: every model of a stage, beside what others gave for it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from flexstage.characteristic import QUANTITIES, Characteristic, Characteristics
from flexstage.errors import ConvergenceError, ModelError
from flexstage.lumped import StrokePath, lumped_system, mechanism, stroke_path
from flexstage.report.comparison import Comparison, compare
from flexstage.stage import Stage
from flexstage.system import Analysis, analyse

__all__ = ["FUTURE_MODELS", "MODELS", "Plane", "Study", "analyse_model", "run_study"]

Plane = Literal["auto", "stress", "strain"]


def _lumped(stage: Stage, plane: Plane) -> Analysis:
    return analyse(stage, lumped_system(stage, plane=plane))


#: Models by name: each makes an analysis from a stage and the plane state of its notches.
MODELS: Mapping[str, Callable[[Stage, Plane], Analysis]] = {"lumped": _lumped}

_STEPS = 21  # states along a stroke

#: Models that have a name already, but nothing behind it yet.
FUTURE_MODELS: tuple[str, ...] = ("superelement", "plane", "solid")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Study:
    """A stage, what each model says of it, and what others gave for it.

    Parameters
    ----------
    stage : Stage
        The stage.
    analyses : Mapping
        Analysis by model.
    variants : Mapping
        The same models with another choice of plane stress or strain, by what they are called.
    paths : Mapping
        Motion over the whole stroke with finite rotations, by axis; of the lumped model.
    """

    stage: Stage
    analyses: Mapping[str, Analysis]
    variants: Mapping[str, Analysis]
    paths: Mapping[str, StrokePath]

    @property
    def characteristics(self) -> Characteristics:
        """What was published, then what each model gives."""
        ours = (row for analysis in self.analyses.values() for row in analysis.characteristics)
        return Characteristics((*self.stage.published, *ours))

    @property
    def comparison(self) -> Comparison:
        """All of it side by side."""
        return compare(
            self.characteristics,
            {name: analysis.characteristics for name, analysis in self.variants.items()},
        )

    @property
    def main(self) -> Analysis:
        """The analysis that figures are drawn of: that of the first model."""
        return next(iter(self.analyses.values()))


def analyse_model(stage: Stage, model: str, *, plane: Plane = "auto") -> Analysis:
    """Analyse a stage with one model.

    Parameters
    ----------
    stage : Stage
        The stage.
    model : str
        One of `MODELS`.
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by width of each notch against its neck.

    Returns
    -------
    Analysis
        What the model says of the stage.

    Raises
    ------
    ModelError
        There is no such model, or no such plane state.
    """
    if plane not in ("auto", "stress", "strain"):
        raise ModelError(f"unknown plane state '{plane}': expected auto, stress or strain")
    if model not in MODELS:
        what = "is not built yet" if model in FUTURE_MODELS else "is not known"
        raise ModelError(f"the model '{model}' {what}: choose from {', '.join(MODELS)}")
    return MODELS[model](stage, plane)


def run_study(stage: Stage, models: Sequence[str] = ("lumped",), *, plane: Plane = "auto") -> Study:
    """Run the models of a stage.

    Parameters
    ----------
    stage : Stage
        The stage.
    models : sequence of str
        Some of `MODELS`; figures are drawn of the first.
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by width of each notch against its neck.

    Returns
    -------
    Study
        The results, each model also with the other choice of plane state.

    Raises
    ------
    ModelError
        No model is named, or one that does not exist.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> study = run_study(design("vgtu-piezo"))
    >>> row = next(r for r in study.comparison.rows if r.quantity == "natural_frequency_hz")
    >>> print(f"{row.axis}: {row.value('published-analytic'):.0f} Hz")
    x: 339 Hz
    """
    if not models:
        raise ModelError(f"no model is named: choose from {', '.join(MODELS)}")
    analyses = {model: analyse_model(stage, model, plane=plane) for model in models}
    variants: dict[str, Analysis] = {}
    for model, analysis in analyses.items():
        used = analysis.provenance.settings.get("plane", "")
        # plane strain belongs to wide notches; where it was used plane stress is the other bound
        other: Plane = "stress" if "strain" in used else "strain"
        if used:
            variants[f"{model}, plane {other}"] = analyse_model(stage, model, plane=other)
    paths: Mapping[str, StrokePath] = {}
    if "lumped" in analyses:
        paths, analyses["lumped"] = _over_the_stroke(stage, analyses["lumped"], plane)
    return Study(stage=stage, analyses=analyses, variants=variants, paths=paths)


def _over_the_stroke(
    stage: Stage, analysis: Analysis, plane: Plane
) -> tuple[dict[str, StrokePath], Analysis]:
    """Follow each axis with finite rotations, and add its straightness to the characteristics."""
    bent = [h.name for h in stage.hinges if h.profile.flat_length > 0.0]
    if bent:
        # its chord is 0.6 d^2/L shorter than it is long, which one spring at its middle has not
        note = (
            f"No straightness: {', '.join(bent[:6])} bend over a length, and shorten as they do, "
            "which a hinge of the lumped model does not."
        )
        return {}, replace(analysis, validity=(*analysis.validity, note))
    model = mechanism(stage, plane=plane)
    paths: dict[str, StrokePath] = {}
    rows = list(analysis.characteristics)
    validity = list(analysis.validity)
    for axis in analysis.axes:
        steps = np.linspace(0.0, axis.input_displacement, _STEPS)
        try:
            path = stroke_path(model, axis.drive, axis.probe, steps)
        except ConvergenceError as error:
            validity.append(f"Axis {axis.axis} could not be followed over its stroke: {error}.")
            continue
        paths[axis.axis] = path
        straightness = Characteristic(
            quantity="straightness",
            axis=axis.axis,
            origin=analysis.system.model,
            value=path.straightness,
            unit=QUANTITIES["straightness"],
            note="finite rotations over the full stroke: largest less smallest distance from the "
            "least-squares straight line",
        )
        last = max(i for i, row in enumerate(rows) if row.axis == axis.axis)
        rows.insert(last + 1, straightness)
    return paths, replace(analysis, characteristics=Characteristics(rows), validity=tuple(validity))
