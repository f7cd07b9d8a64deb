"""What each chapter of a study found, in one line computed from its rows."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from flexstage.quantities import display, number
from flexstage.report.front_page import best_model, fails, listed, model_name
from flexstage.report.tables import percent
from flexstage.studies.measurement import MeasurementComparison

if TYPE_CHECKING:
    from flexstage.studies.study import Study


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
    moved, ratio = _of(study, "output_displacement"), _of(study, "transmission_ratio")
    return f"Full stroke {moved}; ratio {ratio}; {_best(study)}." if moved else _best(study)


def dynamics(study: "Study") -> str:
    """Say the natural frequency of each axis."""
    found = _of(study, "natural_frequency_hz")
    if found:
        driven = _of(study, "natural_frequency_with_stack_hz")
        more = f"; with stack {driven}" if driven else ""
        return f"Natural frequency {found}, drives removed{more}; {_best(study)}."
    first = study.main.modes["removed"].frequency_hz
    return f"Lowest natural frequency {number(float(first[0]))} Hz." if first.size else "No modes."


def stress(study: "Study") -> str:
    """Say how large the stress is, and how far from yield and fatigue."""
    stress, factor = _of(study, "max_stress"), _of(study, "safety_factor")
    if not stress:
        return "No stress is known."
    fatigue = _of(study, "fatigue_safety")
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
    from flexstage.studies.traditional import claim_verdict

    return "" if study.traditional is None else claim_verdict(study.traditional)


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
    first = found.done.steps[0].reading.length.value
    return (
        f"An eccentricity of {1e6 * first:.1f} µm was reduced to {1e9 * found.left:.1f} nm "
        f"(simulated; {found.done.reason})."
    )


def record(study: "Study") -> str:
    """Say what the chapter holds."""
    return f"Limits of the models, versions and settings of {len(study.analyses)} models."


def _best(study: "Study") -> str:
    return model_name(best_model(study))


def _of(study: "Study", quantity: str) -> str:
    """The values of a quantity on every axis, by the best model."""
    shown = display(quantity)
    unit = f" {shown.shown_unit}" if shown.shown_unit else ""
    rows: Iterable = study.analyses[best_model(study)].characteristics.select(quantity)
    return listed(f"{r.text(shown)}{unit} in {r.axis}{fails(r)}" for r in rows)


def _model_against(value: float | None) -> str:
    return "no model" if value is None else f"model {percent(value)}"
