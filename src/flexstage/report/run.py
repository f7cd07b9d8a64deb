"""The report of an experiment plan that was carried out: one HTML file that needs nothing else."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import flexstage
from flexstage.experiments.results import PlanResult
from flexstage.experiments.verbs import VERBS
from flexstage.quantities import beside, display
from flexstage.report.measurement import measurement_section
from flexstage.report.page import page_html
from flexstage.section import Content, Definitions, Section
from flexstage.studies.measurement import compare_plan
from flexstage.table import table


def run_text(result: PlanResult) -> str:
    """Return a page of what a plan gave."""
    name = result.plan.title or f"experiments on {result.stage.name}"
    return page_html(
        heading=f"{result.stage.name}: {name}",
        lead=_lead(result),
        version=flexstage.__version__,
        sections=_sections(result),
        notes=_notes(result),
    )


def _lead(result: PlanResult) -> str:
    by = f" by {result.operator}" if result.operator else ""
    number_of = f", serial number {result.serial_number}" if result.serial_number else ""
    identity = " ".join(w for w in (result.instrument.vendor, result.instrument.model) if w)
    steps = "1 step" if len(result.steps) == 1 else f"{len(result.steps)} steps"
    return (
        f"{steps} on {identity}{number_of}; {_moment(result.started)} to "
        f"{_moment(result.finished)} UTC{by}; intervals are those of 95 %"
    )


def _moment(text: str) -> str:
    """Date and time without what a reader does not need."""
    return text[:19].replace("T", " ")


def _notes(result: PlanResult) -> Sequence[str]:
    said = []
    if result.instrument.simulated:
        said.append(
            "The instrument is a simulation: nothing on this page was measured on a real stage."
        )
    if result.note:
        said.append(f"Note: {result.note}")
    said += [*result.plan.notes, *(n for n in result.notes if "is a simulation" not in n)]
    return tuple(dict.fromkeys(said))


def _sections(result: PlanResult) -> Iterator[Section]:
    measured = compare_plan(result)
    if measured.rows or measured.found.results:
        whole = measurement_section(measured, *_further(result))
        yield Section(key="figures", title="Figures", content=whole.content, notes=whole.notes)
    records = Section(key="record", title="What was recorded", content=())
    for word, verb in VERBS.items():
        steps = result.of(word)
        section = verb.section(steps, result) if steps else None
        if section is None:
            continue
        if section.key == records.key:
            records = section
        else:
            yield section
    identity = result.instrument
    settings = {
        "instrument": f"{identity.vendor} {identity.model}".strip(),
        "its serial number": identity.serial_number,
        "firmware": identity.firmware,
        **result.settings,
    }
    defined = Definitions({name: value for name, value in settings.items() if value})
    yield replace(records, content=(*records.content, defined))


def _further(result: PlanResult) -> Iterator[Content]:
    """Figures of tests that repeat a quantity of an axis, and of modes with the drives in place."""
    rows = []
    own = [f for f in result.figures if result.drives_in_place(f)]
    for found in (*own, *result.further_figures):
        shown = display(found.quantity)
        label = shown.label + (", drives in place" if result.drives_in_place(found) else "")
        value, spread = beside(found.value * shown.factor, found.estimate.expanded * shown.factor)
        rows.append((label, found.axis, found.test, value, spread, shown.shown_unit))
    if not rows:
        return
    yield (
        "Natural frequencies are those of the stage without its drives, except where this table "
        "says that they were in place. It lists those, and what a test gave again after another "
        "test."
    )
    heads = ("Quantity", "<Axis", "<Test", "value", "±\u00a0(95\u00a0%)", "<Unit")
    yield table("", heads, rows)
