"""What a study found, in sentences: on its first page with main figures, and of each chapter."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from flexstage.base.choose import listed
from flexstage.quantities.comparison import ComparisonRow
from flexstage.quantities.quantity import display, number
from flexstage.quantities.section import Picture
from flexstage.quantities.table import Cell, Table, table
from flexstage.report.figures.drawing import draw_stage
from flexstage.report.figures.responses import draw_bode
from flexstage.report.figures.tracking import draw_loop
from flexstage.report.tables import MANUFACTURE, percent, published_loop
from flexstage.studies.measurement import MeasurementComparison

if TYPE_CHECKING:
    from flexstage.studies.study import Study

#: The rows of the first table.
_MAIN = ("output_displacement", "transmission_ratio", "max_stress", "natural_frequency_hz")
#: What models are called in a sentence; the one that leaves the least out comes first.
_MODELS = {
    "solid": "solid finite elements",
    "superelement-3d": "model of superelements in space",
    "plane": "plane finite elements",
    "superelement": "superelement model",
    "lumped": "rigid-body model",
}
_FEM, _MEASURED = "published-fem", "published-measured"


def best_model(study: "Study") -> str:
    """Return the model of a study that leaves the least out."""
    return next((m for m in _MODELS if m in study.analyses), next(iter(study.analyses)))


def model_name(model: str) -> str:
    """Return what a model is called in a sentence."""
    return _MODELS.get(model, model)


def size_and_mass(study: "Study") -> str:
    """Return the outer size of a stage, and the mass of all bodies and of those that move."""
    from flexstage.stage.mass import mass_properties, outer_size

    stage = study.stage
    sizes = " × ".join(f"{1e3 * v:.4g}" for v in outer_size(stage))
    masses = {name: found.mass for name, found in mass_properties(stage).items()}
    moving = sum(masses[b.name] for b in stage.bodies if not b.fixed)
    return (
        f"{sizes} mm, {number(sum(masses.values()), 3)} kg without drives, of which "
        f"{number(moving, 3)} kg move"
    )


def verdict(study: "Study") -> tuple[str, ...]:
    """Say in sentences what was reproduced, how well, and what was not, from the rows of the study.

    Of a stage with nothing published, what is known of it.
    """
    if not study.comparison.published:
        return tuple(_known(study))
    return tuple(s for s in (_to_fem(study), _to_measured(study), _not_reproduced(study)) if s)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontPage:
    """What the first page shows."""

    verdict: tuple[tuple[str, str], ...]
    """Sentences: the words before the colon that one begins with, and the rest."""
    table: Table | None
    """The main figures; None where there are none."""
    drawing: Picture
    """The stage."""
    curves: tuple[Picture, ...]
    """Beside it."""


def front_page(study: "Study") -> FrontPage:
    """Return what the first page shows."""
    drawing = Picture(
        result=partial(draw_stage, study.stage, key=False),
        title=f"drawing of {study.stage.name}",
        caption=f"The stage: {size_and_mass(study)}. Arrows: drives (orange) and probes (green).",
    )
    return FrontPage(
        verdict=tuple(_led(sentence) for sentence in verdict(study)),
        table=_table(study),
        drawing=drawing,
        curves=tuple(_curves(study)),
    )


def _led(sentence: str) -> tuple[str, str]:
    """Part a sentence behind the words before the colon that it begins with."""
    sentence = sentence.replace(" %", "\u00a0%")
    found = re.match(r"([^:]{3,40}):(.*)", sentence, flags=re.DOTALL)
    return (found[1], found[2]) if found else ("", sentence)


def _curves(study: "Study") -> Iterator[Picture]:
    made = next(iter(study.experiments.values()), None)
    axes = [a.axis for a in study.main.axes]
    model = model_name(study.main.system.model)
    for axis in axes[: 1 if made is not None else 2]:
        yield Picture(
            result=partial(draw_bode, study.main, axis, conditions=("removed",), size=(5.0, 3.1)),
            title=f"Bode diagram of {axis}",
            caption=f"Bode diagram of {axis}, drives removed; {model}.",
        )
    if made is not None:
        yield Picture(
            result=partial(draw_loop, made),
            title=f"loop of {made.axis}",
            caption=f"Loop of {made.axis} without and with the inverse; simulated stage.",
        )


def _rows(study: "Study", quantities: Iterable[str] = _MAIN) -> list[ComparisonRow]:
    found = [row for row in study.comparison.rows if row.quantity in quantities]
    order = {name: i for i, name in enumerate(quantities)}
    return sorted(found, key=lambda row: order[row.quantity])


def _table(study: "Study") -> Table | None:
    model = best_model(study)
    published = [c for c in (_FEM, _MEASURED) if c in study.comparison.published]
    quantities = _MAIN if published else (*_MAIN, "safety_factor")
    titles = {_FEM: "published FEM", _MEASURED: "published, measured"}
    heads = ["Quantity", "Axis", *(titles[c] for c in published), f"here, {model_name(model)}"]
    heads += [f"difference to {titles[c]}" for c in published]
    rows: list[tuple[str | Cell, ...]] = []
    for row in _rows(study, quantities):
        cell = row.cells.get(model)
        if cell is None or not (set(published) & set(row.cells) or not published):
            continue
        shown = display(row.quantity)
        printed = []
        for c in published:
            slip = " †" if _slip(study, c, row.axis) and row.quantity == _RATIO else ""
            printed.append(f"{row.cells[c].text(shown)}{slip}" if c in row.cells else "–")
        ours = Cell(cell.text(shown), mark="ours", failing=cell.failing)
        differences = (percent(row.difference_percent(model, c)) or "–" for c in published)
        rows.append((shown.heading, row.axis, *printed, ours, *differences))
    rows += _loops(study, len(published))
    slips = [s for axis in _axes(study) if (s := _slip(study, _FEM, axis))]
    foot = f" † Printed so; {slips[0]}." if slips else ""
    return table(f"Main figures of the stage.{foot}", heads, rows) if rows else None


def _loops(study: "Study", published: int) -> Iterator[tuple[str | Cell, ...]]:
    """Rows on the loop that the inverse leaves, which the simulated stage gives."""
    for axis, made in study.experiments.items():
        printed = _printed_reduction(study, axis)
        here = made.runs[0].reduction_percent
        if printed is None or published < 2:
            continue
        ours = Cell(f"{here:.1f} (simulated)", mark="ours")
        # a simulation and a measurement of two loops are not subtracted
        title = "Loop narrowed by inverse [%]"
        yield (title, axis, "–", f"{printed:.1f}", ours, "–", "–")


def _printed_reduction(study: "Study", axis: str) -> float | None:
    return published_loop(study.characteristics, axis)[-1]


_RATIO = "transmission_ratio"


def _axes(study: "Study") -> list[str]:
    return [axis.name for axis in study.stage.axes]


def _slip(study: "Study", origin: str, axis: str) -> str:
    """Say where a published ratio is not that of its own output and input, beyond rounding."""
    rows = study.characteristics
    found = [
        rows.select(quantity, axis, origin)
        for quantity in (_RATIO, "output_displacement", "input_displacement")
    ]
    if not all(found):
        return ""
    ratio, out, into = (f[0].value for f in found)
    printed = f"{ratio:.10g}"
    rounding = 0.5 * 10.0 ** -len(printed.partition(".")[2])
    own = out / into
    if abs(ratio - own) <= 1.001 * rounding:
        return ""
    return f"its own displacements of {axis} give {number(own)}"


def _largest(
    study: "Study", column: str, reference: str, quantities: Iterable[str] = _MAIN
) -> tuple[float, ComparisonRow] | None:
    """The largest difference of a column to a reference, printed slips left out."""
    found = []
    for row in _rows(study, quantities):
        if row.quantity == _RATIO and _slip(study, reference, row.axis):
            continue
        value = row.difference_percent(column, reference)
        if value is not None:
            found.append((value, row))
    return max(found, key=lambda pair: abs(pair[0]), default=None)


def _named(row: ComparisonRow) -> str:
    return f"{display(row.quantity).label.lower()} {row.axis}"


def _to_fem(study: "Study") -> str:
    best = best_model(study)
    near = _largest(study, best, _FEM)
    if near is None:
        return ""
    kinds = dict.fromkeys(
        display(row.quantity).label.lower()
        for row in _rows(study)
        if row.difference_percent(best, _FEM) is not None
        and not (row.quantity == _RATIO and _slip(study, _FEM, row.axis))
    )
    said = (
        f"Reproduced: {listed(kinds)} of the published finite elements, within "
        f"{abs(near[0]):.1f} % ({model_name(best)})"
    )
    if best != "lumped" and "lumped" in study.analyses:
        far = _largest(study, "lumped", _FEM)
        if far is not None:
            said += f" and within {abs(far[0]):.1f} % ({model_name('lumped')}; {_named(far[1])})"
    loops = [
        (axis, made.runs[0].reduction_percent, printed)
        for axis, made in study.experiments.items()
        if (printed := _printed_reduction(study, axis)) is not None
    ]
    if loops:
        here = listed(f"{value:.1f} % in {axis}" for axis, value, _ in loops)
        printed = listed(f"{value:.1f} %" for *_, value in loops)
        said += (
            f"; the Bouc-Wen inverse narrows the simulated hysteresis loop by {here} "
            f"(published, measured: {printed})"
        )
    return said + "."


def _to_measured(study: "Study") -> str:
    best = best_model(study)
    parts = []
    for quantity in ("output_displacement", "natural_frequency_hz"):
        ours = _largest(study, best, _MEASURED, (quantity,))
        theirs = _largest(study, _FEM, _MEASURED, (quantity,))
        if ours is not None:
            own = f" (published FEM: {abs(theirs[0]):.1f} %)" if theirs is not None else ""
            word = display(quantity).label.lower()
            parts.append(f"{word} within {abs(ours[0]):.1f} %{own}")
    if not parts:
        return ""
    return f"Against the published measurement: {listed(parts)}; {model_name(best)}."


def _not_reproduced(study: "Study") -> str:
    # A model whose difference from the measurement is larger has not reproduced it [%]
    far_percent = 5.0
    best = best_model(study)
    rows = study.characteristics
    parts = []
    errors = dict.fromkeys(r.quantity for r in rows if r.origin == _MEASURED)
    errors = [q for q in errors if q in MANUFACTURE]
    if errors:
        words = listed(display(q).label.lower() for q in errors)
        parts.append(f"the measured motion errors ({words}), which no ideal geometry has")
    far = [
        f"{_named(row)} ({percent(value)})"
        for row in _rows(study)
        if (value := row.difference_percent(best, _MEASURED)) is not None
        and abs(value) > far_percent
    ]
    if far:
        parts.append(f"the measured {listed(far)}")
    for origin, word in ((_FEM, "FEM"), ("published-analytic", "analytic")):
        slips = {axis: s for axis in _axes(study) if (s := _slip(study, origin, axis))}
        if slips:
            axis, said = next(iter(slips.items()))
            printed = f"{rows.select(_RATIO, axis, origin)[0].value:.10g}"
            parts.append(f"the printed {word} ratio {printed} ({said})")
    if study.experiments and any(r.quantity == "hysteresis_loop_width" for r in rows):
        parts.append(
            "the stacks' own hysteresis, whose loop width is set to the published one and not "
            "predicted"
        )
    parts = parts or ["nothing that was published"]
    return f"Not reproduced: {'; '.join(parts)}."


def _known(study: "Study") -> Iterator[str]:
    """What is known of a stage of which nothing was published."""
    model = best_model(study)

    def said(quantity: str) -> str:
        return by_axis(study, quantity)

    yield f"Size and mass: {size_and_mass(study)}; {study.stage.material.name}."
    strokes = ("output_displacement", "rotation_stroke")
    motion = listed(part for quantity in strokes if (part := said(quantity)))
    if motion:
        frequency, driven = said("natural_frequency_hz"), said("natural_frequency_with_stack_hz")
        if driven:
            frequency = f"without stack {frequency}, with stack {driven}"
        yield (
            f"Motion: {motion} at full stroke; natural frequency {frequency}; {model_name(model)}."
        )
    stress, safety = said("max_stress"), said("safety_factor")
    if stress:
        against = f"; safety against yield {safety}" if safety else ""
        yield f"Stress: at most {stress}{against}."
    yield "Nothing was published or measured of this stage, so that no difference is shown."


def by_axis(study: "Study", quantity: str) -> str:
    """Say the values of a quantity on every axis, by the best model, with criteria that fail."""
    shown = display(quantity)
    unit = f" {shown.shown_unit}" if shown.shown_unit else ""
    rows = study.analyses[best_model(study)].characteristics.select(quantity)
    failing = (f" (fails: {r.failing})" if r.failing else "" for r in rows)
    return listed(
        f"{r.text(shown)}{unit} in {r.axis}{fails}" for r, fails in zip(rows, failing, strict=True)
    )


def theory(study: "Study") -> str:
    """Say what the lumped model consists of."""
    lumped = study.analyses.get("lumped")
    order = f" with {lumped.system.order} coordinates" if lumped is not None else ""
    return (
        f"Lagrange's equations of {len(study.stage.bodies)} bodies and {len(study.stage.hinges)} "
        f"hinges{order}."
    )


def models(study: "Study") -> str:
    """Say by how much the models differ among themselves."""
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
    """Say how far each axis goes, and by what ratio."""
    moved, ratio = by_axis(study, "output_displacement"), by_axis(study, "transmission_ratio")
    return f"Full stroke {moved}; ratio {ratio}; {_best(study)}." if moved else _best(study)


def dynamics(study: "Study") -> str:
    """Say the natural frequency of each axis."""
    found = by_axis(study, "natural_frequency_hz")
    if found:
        driven = by_axis(study, "natural_frequency_with_stack_hz")
        more = f"; with stack {driven}" if driven else ""
        return f"Natural frequency {found}, drives removed{more}; {_best(study)}."
    first = study.main.modes["removed"].frequency_hz
    return f"Lowest natural frequency {number(float(first[0]))} Hz." if first.size else "No modes."


def stress(study: "Study") -> str:
    """Say how large the stress is, and how far from yield and fatigue."""
    stress, factor = by_axis(study, "max_stress"), by_axis(study, "safety_factor")
    if not stress:
        return "No stress is known."
    fatigue = by_axis(study, "fatigue_safety")
    more = f"; against fatigue, stroke from nothing to full, {fatigue}" if fatigue else ""
    safety = f"; safety against yield {factor}{more}" if factor else ""
    return f"Largest stress {stress}{safety}; {_best(study)}."


def measured(study: "Study") -> str:
    """Say what was measured, and by whom."""
    rows = study.comparison.rows
    best = best_model(study)
    parts = []
    for origin, title in (("measured", "Measured here"), ("published-measured", "Published")):
        words = [
            f"{display(row.quantity).label.lower()} of {row.axis} "
            f"{row.cells[origin].text(display(row.quantity))} {display(row.quantity).shown_unit} "
            f"({_model_against(row.difference_percent(best, origin))})"
            for row in rows
            if row.quantity in ("output_displacement", "natural_frequency_hz")
            and origin in row.cells
            and best in row.cells
        ]
        if words:
            parts.append(f"{title}: {listed(words)}.")
    if isinstance(study.virtual, MeasurementComparison):
        parts.append("The simulated measurement is a report of its own.")
    return " ".join(parts) or "Nothing was measured."


def traditional(study: "Study") -> str:
    """Say what becomes of the claim of smaller motion errors."""
    from flexstage.studies.traditional import claim_conclusion

    return "" if study.traditional is None else claim_conclusion(study.traditional)


def hysteresis(study: "Study") -> str:
    """Say by how much inverses narrow the loop."""
    if not study.experiments:
        return "No axis could be tried."
    words = [
        f"{axis}: {listed(f'{run.title} {run.reduction_percent:.1f} %' for run in m.runs)}"
        for axis, m in study.experiments.items()
    ]
    return f"Loop narrowed by the inverse of a model, simulated stage: {'; '.join(words)}."


def centring(study: "Study") -> str:
    """Say how well the scale was centred."""
    found = study.centring
    if found is None or isinstance(found, str):
        return "No scale could be centred."
    first = found.procedure.steps[0].reading.length.value
    return (
        f"An eccentricity of {1e6 * first:.1f} µm was reduced to {1e9 * found.residual:.1f} nm "
        f"(simulated; {found.procedure.reason})."
    )


def record(study: "Study") -> str:
    """Say what the chapter holds."""
    return f"Limits of the models, versions and settings of {len(study.analyses)} models."


def _best(study: "Study") -> str:
    return model_name(best_model(study))


def _model_against(value: float | None) -> str:
    return "no model" if value is None else f"model {percent(value)}"
