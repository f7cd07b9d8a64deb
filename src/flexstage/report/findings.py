"""The findings of a study in sentences: a summary with the main figures, and a line a chapter.

The summary compares the most complete model with the published values: what agrees with the
published finite elements, what agrees with the published measurement, and what does not agree. A
stage without published values is described by its size, motion and stress.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from flexstage.base.choose import listed
from flexstage.quantities.comparison import ComparisonRow
from flexstage.quantities.quantity import display, number
from flexstage.quantities.table import Cell, Picture, Table, table
from flexstage.report.figures.drawing import draw_stage
from flexstage.report.figures.responses import draw_bode
from flexstage.report.figures.tracking import draw_loop
from flexstage.report.stacks import seat_sentences
from flexstage.report.tables import MANUFACTURE, kind_cell, percent
from flexstage.stage.designs.vgtu import predicted_ranges
from flexstage.studies.measurement import MeasurementComparison

if TYPE_CHECKING:
    from flexstage.studies.study import Study

#: Names of models in texts, the most complete model first.
_MODELS = {
    "solid": "solid finite elements",
    "superelement-3d": "3D superelement model",
    "plane": "plane finite elements",
    "superelement": "superelement model",
    "lumped": "rigid-body model",
}
_RATIO = "transmission_ratio"
#: Quantities of the first table, in order.
_MAIN = ("output_displacement", _RATIO, "max_stress", "natural_frequency_hz")
#: Origins of published values.
_ANALYTIC, _FEM, _MEASURED = "published-analytic", "published-fem", "published-measured"
_PUBLISHED_TITLES = {_FEM: "published FEM", _MEASURED: "published, measured"}
_DIFFERENCE_TITLES = {
    _FEM: "difference to published FEM",
    _MEASURED: "prediction error, to measured",
}
#: A model that differs more from the measurement does not reproduce it [%].
_REPRODUCED_WITHIN = 5.0


# ------------------------------------------------------------------- the models and the stage


def best_model(study: "Study") -> str:
    """Return the most complete model of a study."""
    return next((m for m in _MODELS if m in study.analyses), next(iter(study.analyses)))


def model_name(model: str) -> str:
    """Return the name of a model in texts."""
    return _MODELS.get(model, model)


def _best_name(study: "Study") -> str:
    return model_name(best_model(study))


def size_and_mass(study: "Study") -> str:
    """Return the outer size of a stage, and the mass of all bodies and of the moving ones."""
    from flexstage.stage.mass import mass_properties, outer_size

    stage = study.stage
    sizes = " × ".join(f"{1e3 * v:.4g}" for v in outer_size(stage))
    masses = {name: properties.mass for name, properties in mass_properties(stage).items()}
    moving = sum(masses[b.name] for b in stage.bodies if not b.fixed)
    return (
        f"{sizes} mm, {number(sum(masses.values()), 3)} kg without drives, of which "
        f"{number(moving, 3)} kg move"
    )


def by_axis(study: "Study", quantity: str) -> str:
    """Return the values of a quantity on every axis, by the best model, with failed criteria."""
    unit = display(quantity)
    rows = study.analyses[best_model(study)].characteristics.select(quantity)
    symbol = f" {unit.shown_unit}" if unit.shown_unit else ""
    failing = (f" (fails: {r.failing})" if r.failing else "" for r in rows)
    return listed(
        f"{r.text(unit)}{symbol} in {r.axis}{fails}" for r, fails in zip(rows, failing, strict=True)
    )


# ------------------------------------------------------------------------------ the first page


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontPage:
    """The first page of a study."""

    summary: tuple[tuple[str, str], ...]
    """Sentences: the words before the colon that one begins with, and the remainder."""
    table: Table | None
    """The main figures; None without any."""
    drawing: Picture
    """The stage."""
    curves: tuple[Picture, ...]
    """Diagrams next to the drawing."""


def front_page(study: "Study") -> FrontPage:
    """Return the first page of a study."""
    drawing = Picture(
        result=partial(draw_stage, study.stage, key=False),
        title=f"drawing of {study.stage.name}",
        caption=f"The stage: {size_and_mass(study)}. Arrows: drives (orange) and probes (green).",
    )
    return FrontPage(
        summary=tuple(
            _split_lead(sentence)
            for sentence in (*summary(study), *seat_sentences(study.analyses[best_model(study)]))
        ),
        table=_main_figures(study),
        drawing=drawing,
        curves=tuple(_curves(study)),
    )


def summary(study: "Study") -> tuple[str, ...]:
    """Return the sentences of the first page.

    They report the agreement with the published values; without any, the main figures.
    """
    if not study.comparison.published:
        return tuple(_description(study))
    agreement = _Agreement(study=study, best=best_model(study))
    sentences = (
        agreement.fitted(),
        agreement.with_fem(),
        agreement.with_measurement(),
        _simulated_loops(study),
        agreement.missing(),
    )
    return tuple(s for s in sentences if s)


def _split_lead(sentence: str) -> tuple[str, str]:
    """Split a sentence at its colon, if it has one near its beginning."""
    sentence = sentence.replace(" %", "\u00a0%")
    match = re.match(r"([^:]{3,40}):(.*)", sentence, flags=re.DOTALL)
    return (match[1], match[2]) if match else ("", sentence)


def _description(study: "Study") -> Iterator[str]:
    """Yield sentences on a stage without published values."""
    yield f"Size and mass: {size_and_mass(study)}; {study.stage.materials}."
    strokes = ("output_displacement", "rotation_stroke")
    motion = listed(part for quantity in strokes if (part := by_axis(study, quantity)))
    if motion:
        frequency = by_axis(study, "natural_frequency_hz")
        with_stack = by_axis(study, "natural_frequency_with_stack_hz")
        if with_stack:
            frequency = f"without stack {frequency}, with stack {with_stack}"
        yield (
            f"Motion: {motion} at full stroke; natural frequency {frequency}; {_best_name(study)}."
        )
    largest, safety = by_axis(study, "max_stress"), by_axis(study, "safety_factor")
    if largest:
        against_yield = f"; safety against yield {safety}" if safety else ""
        yield f"Stress: at most {largest}{against_yield}."
    yield "No reference data for this stage."


def _curves(study: "Study") -> Iterator[Picture]:
    experiment = next(iter(study.experiments.values()), None)
    axes = [a.axis for a in study.main.axes]
    model = model_name(study.main.system.model)
    for axis in axes[: 1 if experiment is not None else 2]:
        yield Picture(
            result=partial(draw_bode, study.main, axis, conditions=("removed",), size=(5.0, 3.1)),
            title=f"Bode diagram of {axis}",
            caption=f"Bode diagram of {axis}, drives removed; {model}.",
        )
    if experiment is not None:
        yield Picture(
            result=partial(draw_loop, experiment),
            title=f"hysteresis loop of {experiment.axis}",
            caption=f"Hysteresis loop of {experiment.axis} without and with the inverse model; "
            "simulated stage.",
        )


def _main_figures(study: "Study") -> Table | None:
    """Return the first table: main figures, published and computed, with differences."""
    model, ranges = best_model(study), predicted_ranges(study.stage)
    published = [c for c in _PUBLISHED_TITLES if c in study.comparison.published]
    quantities = _MAIN if published else (*_MAIN, "safety_factor")
    displayed = [
        row
        for row in _rows(study, quantities)
        if model in row.cells and (set(published) & set(row.cells) or not published)
    ]
    # a column of figures that are all fitted to has no difference
    compared = [
        c for c in published if any(r.difference_percent(model, c) is not None for r in displayed)
    ]
    heads = ["Quantity", "Axis", *(_PUBLISHED_TITLES[c] for c in published)]
    heads += [f"computed, {model_name(model)}"]
    heads += ["<kind"] if published else []
    heads += [_DIFFERENCE_TITLES[c] for c in compared]
    rows: list[tuple[str | Cell, ...]] = []
    for row in displayed:
        cell = row.cells[model]
        unit = display(row.quantity)
        references = []
        for c in published:
            misprinted = row.quantity == _RATIO and _misprint(study, c, row.axis)
            mark = " †" if misprinted else ""
            references.append(f"{row.cells[c].text(unit)}{mark}" if c in row.cells else "–")
        computed = Cell(cell.text(unit), mark="ours", failing=cell.failing)
        kind = [kind_cell(row, unit, ranges)] if published else []
        differences = (percent(row.difference_percent(model, c)) or "–" for c in compared)
        rows.append((unit.heading, row.axis, *references, computed, *kind, *differences))
    misprints = [m for axis in study.stage.axes if (m := _misprint(study, _FEM, axis.name))]
    foot = f" † As printed; {misprints[0].text}." if misprints else ""
    if any(row.cells[c].fitted for row in displayed for c in published if c in row.cells):
        foot = (
            " A figure that was fitted to a published one has no difference from it; that from a "
            f"measured one, to which it was not fitted, is the error of a prediction.{foot}"
        )
    if ranges and any(isinstance(c, Cell) and c.small for line in rows for c in line):
        foot += f" {ranges.source}"
    return table(f"Main figures of the stage.{foot}", heads, rows) if rows else None


def _rows(study: "Study", quantities: Iterable[str] = _MAIN) -> list[ComparisonRow]:
    """Return the rows of quantities, in the order of these."""
    order = {name: i for i, name in enumerate(quantities)}
    rows = [row for row in study.comparison.rows if row.quantity in order]
    return sorted(rows, key=lambda row: order[row.quantity])


# ------------------------------------------------------- agreement with the published values


@dataclass(frozen=True, slots=True, kw_only=True)
class _Misprint:
    """A published ratio that is not the quotient of the published displacements."""

    axis: str
    """The axis."""
    printed: str
    """The ratio as printed."""
    quotient: float
    """Published output over published input displacement."""

    @property
    def text(self) -> str:
        """A clause on the quotient."""
        return f"the published displacements of {self.axis} give {number(self.quotient)}"


def _misprint(study: "Study", origin: str, axis: str) -> _Misprint | None:
    """Return the misprint of a published ratio, beyond rounding; None if the ratio is right."""
    quantities = (_RATIO, "output_displacement", "input_displacement")
    rows = [study.characteristics.select(quantity, axis, origin) for quantity in quantities]
    if not all(rows):
        return None
    ratio, out, into = (r[0].value for r in rows)
    printed = f"{ratio:.10g}"
    rounding = 0.5 * 10.0 ** -len(printed.partition(".")[2])
    if abs(ratio - out / into) <= 1.001 * rounding:
        return None
    return _Misprint(axis=axis, printed=printed, quotient=out / into)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Agreement:
    """Agreement of the models of a study with published values."""

    study: "Study"
    """The study."""
    best: str
    """The most complete model."""

    def fitted(self) -> str:
        """Return a sentence on figures that the geometry was fitted to; empty without any."""
        quantities = dict.fromkeys(
            display(row.quantity).label.lower()
            for row in self._comparable(_FEM)
            if _FEM in row.cells and row.cells[_FEM].fitted
        )
        if not quantities:
            return ""
        return (
            f"Fitted: the geometry, to {listed(quantities)} of the published finite elements. That "
            "these agree shows consistency and predicts nothing."
        )

    def with_fem(self) -> str:
        """Return a sentence on the published finite elements; empty without a common quantity."""
        nearest = self._largest_difference(self.best, _FEM)
        if nearest is None:
            return ""
        quantities = dict.fromkeys(
            display(row.quantity).label.lower()
            for row in self._comparable(_FEM)
            if row.difference_percent(self.best, _FEM) is not None
        )
        sentence = (
            f"Reproduced: {listed(quantities)} of the published finite elements, within "
            f"{abs(nearest[0]):.1f} % ({model_name(self.best)})"
        )
        if self.best != "lumped" and "lumped" in self.study.analyses:
            lumped = self._largest_difference("lumped", _FEM)
            if lumped is not None:
                difference, row = lumped
                sentence += (
                    f" and within {abs(difference):.1f} % ({model_name('lumped')}; {_label(row)})"
                )
        return f"{sentence}."

    def with_measurement(self) -> str:
        """Return a sentence on the published measurement; empty without a common quantity."""
        parts = []
        for quantity in ("output_displacement", "natural_frequency_hz"):
            computed = self._largest_difference(self.best, _MEASURED, (quantity,))
            published = self._largest_difference(_FEM, _MEASURED, (quantity,))
            if computed is not None:
                label = display(quantity).label.lower()
                fem = f" (published FEM: {abs(published[0]):.1f} %)" if published else ""
                parts.append(f"{label} within {abs(computed[0]):.1f} %{fem}")
        if not parts:
            return ""
        fitted = "; its geometry is fitted to the published FEM" if self.fitted() else ""
        return f"Prediction of the measurement: {listed(parts)}; {model_name(self.best)}{fitted}."

    def missing(self) -> str:
        """Return a sentence on published values that the models do not reproduce; or nothing."""
        parts = [
            *self._manufacturing_errors(),
            *self._far_values(),
            *self._misprinted_ratios(),
            *self._fitted_hysteresis(),
        ]
        if not parts:
            return ""
        return f"Not reproduced: {'; '.join(parts)}."

    def _manufacturing_errors(self) -> Iterator[str]:
        rows = (r for r in self.study.characteristics if r.origin == _MEASURED)
        errors = [q for q in dict.fromkeys(r.quantity for r in rows) if q in MANUFACTURE]
        if errors:
            labels = listed(display(q).label.lower() for q in errors)
            yield f"the measured motion errors ({labels}), which an ideal geometry does not have"

    def _far_values(self) -> Iterator[str]:
        far = [
            f"{_label(row)} ({percent(difference)})"
            for row in _rows(self.study)
            if (difference := row.difference_percent(self.best, _MEASURED)) is not None
            and abs(difference) > _REPRODUCED_WITHIN
        ]
        if far:
            yield f"the measured {listed(far)}"

    def _misprinted_ratios(self) -> Iterator[str]:
        for origin, title in ((_FEM, "FEM"), (_ANALYTIC, "analytic")):
            axes = (axis.name for axis in self.study.stage.axes)
            misprint = next(
                (m for axis in axes if (m := _misprint(self.study, origin, axis))), None
            )
            if misprint is not None:
                yield f"the printed {title} ratio {misprint.printed} ({misprint.text})"

    def _fitted_hysteresis(self) -> Iterator[str]:
        rows = self.study.characteristics
        if self.study.experiments and any(r.quantity == "hysteresis_loop_width" for r in rows):
            yield (
                "the hysteresis of the stacks, whose loop width is fitted to the published value "
                "and not predicted"
            )

    def _comparable(
        self, reference: str, quantities: Iterable[str] = _MAIN
    ) -> Iterator[ComparisonRow]:
        """Yield the rows of quantities, without misprinted ratios of the reference."""
        for row in _rows(self.study, quantities):
            if not (row.quantity == _RATIO and _misprint(self.study, reference, row.axis)):
                yield row

    def _largest_difference(
        self, column: str, reference: str, quantities: Iterable[str] = _MAIN
    ) -> tuple[float, ComparisonRow] | None:
        """Return the largest difference [%] of a column to a reference, and its row."""
        differences = [
            (value, row)
            for row in self._comparable(reference, quantities)
            if (value := row.difference_percent(column, reference)) is not None
        ]
        return max(differences, key=lambda pair: abs(pair[0]), default=None)


def _simulated_loops(study: "Study") -> str:
    """Return a sentence on the hysteresis loops of the simulated stage; empty without any."""
    reductions = listed(
        f"{experiment.runs[0].reduction_percent:.1f} % in {axis}"
        for axis, experiment in study.experiments.items()
    )
    if not reductions:
        return ""
    inverse = "the Bouc-Wen inverse narrows the hysteresis loop"
    return f"Simulated, not measured: {inverse} by {reductions}."


def _label(row: ComparisonRow) -> str:
    return f"{display(row.quantity).label.lower()} {row.axis}"


# --------------------------------------------------------------------- a line for each chapter


def theory(study: "Study") -> str:
    """Return the size of the lumped model."""
    lumped = study.analyses.get("lumped")
    order = f" with {lumped.system.order} coordinates" if lumped is not None else ""
    return (
        f"Lagrange's equations of {len(study.stage.bodies)} bodies and {len(study.stage.hinges)} "
        f"hinges{order}."
    )


def models(study: "Study") -> str:
    """Return the models, and the largest difference between their natural frequencies."""
    best = best_model(study)
    names = listed(model_name(m) for m in study.analyses)
    differences = [
        (value, row)
        for row in study.comparison.rows
        if row.quantity == "natural_frequency_hz"
        for model in study.analyses
        if (value := row.difference_percent(model, best))
    ]
    if not differences:
        return f"{names.capitalize()}."
    value, row = max(differences, key=lambda pair: abs(pair[0]))
    return (
        f"{names.capitalize()}: their natural frequencies are within {abs(value):.1f} % of the "
        f"{model_name(best)} (largest difference in {row.axis})."
    )


def statics(study: "Study") -> str:
    """Return the stroke and the transmission ratio of each axis."""
    stroke, ratio = by_axis(study, "output_displacement"), by_axis(study, _RATIO)
    name = _best_name(study)
    return f"Full stroke {stroke}; ratio {ratio}; {name}." if stroke else name


def dynamics(study: "Study") -> str:
    """Return the natural frequency of each axis."""
    frequency = by_axis(study, "natural_frequency_hz")
    if frequency:
        with_stack = by_axis(study, "natural_frequency_with_stack_hz")
        driven = f"; with stack {with_stack}" if with_stack else ""
        return f"Natural frequency {frequency}, drives removed{driven}; {_best_name(study)}."
    modes = study.main.modes["removed"].frequency_hz
    return f"Lowest natural frequency {number(float(modes[0]))} Hz." if modes.size else "No modes."


def stress(study: "Study") -> str:
    """Return the largest stress, and its safety factors against yield and fatigue."""
    largest, factor = by_axis(study, "max_stress"), by_axis(study, "safety_factor")
    if not largest:
        return "No stress was computed."
    fatigue = by_axis(study, "fatigue_safety")
    pulsating = f"; against fatigue by a pulsating stroke, {fatigue}" if fatigue else ""
    safety = f"; safety against yield {factor}{pulsating}" if factor else ""
    return f"Largest stress {largest}{safety}; {_best_name(study)}."


def measured(study: "Study") -> str:
    """Return the measured strokes and frequencies, of this study and published."""
    best, ranges = best_model(study), predicted_ranges(study.stage)

    def predicted(row: ComparisonRow, origin: str) -> str:
        error = percent(row.difference_percent(best, origin)) or "none"
        text = ranges.text(row.quantity, row.axis, display(row.quantity).factor) if ranges else ""
        return f"(prediction {error}{text and f'; geometry fitted, 95 %: {text}'})"

    parts = []
    for origin, title in (("measured", "Measured here"), ("published-measured", "Published")):
        values = [
            f"{display(row.quantity).label.lower()} of {row.axis} "
            f"{row.cells[origin].text(display(row.quantity))} {display(row.quantity).shown_unit} "
            f"{predicted(row, origin)}"
            for row in study.comparison.rows
            if row.quantity in ("output_displacement", "natural_frequency_hz")
            and origin in row.cells
            and best in row.cells
        ]
        if values:
            parts.append(f"{title}: {listed(values)}.")
    if isinstance(study.virtual, MeasurementComparison):
        parts.append("The simulated measurement has a report of its own.")
    return " ".join(parts) or "No measurement."


def traditional(study: "Study") -> str:
    """Return the assessment of the claim of smaller motion errors."""
    from flexstage.studies.traditional import claim_conclusion

    return "" if study.traditional is None else claim_conclusion(study.traditional)


def hysteresis(study: "Study") -> str:
    """Return the reduction of the hysteresis loop by each inverse model."""
    if not study.experiments:
        return "No axis could be compensated."
    reductions = [
        f"{axis}: {listed(f'{run.title} {run.reduction_percent:.1f} %' for run in e.runs)}"
        for axis, e in study.experiments.items()
    ]
    return f"Loop reduction by the inverse of a model, simulated stage: {'; '.join(reductions)}."


def centring(study: "Study") -> str:
    """Return the eccentricity of the scale before and after centring."""
    trial = study.centring
    if trial is None or isinstance(trial, str):
        return "No scale could be centred."
    before = trial.procedure.steps[0].reading.length.value
    return (
        f"An eccentricity of {1e6 * before:.1f} µm was reduced to {1e9 * trial.residual:.1f} nm "
        f"(simulated; {trial.procedure.reason})."
    )


def record(study: "Study") -> str:
    """Return the contents of the chapter on validity and provenance."""
    return f"Limits, versions and settings of {len(study.analyses)} models."
