"""Tables of plans and runs, and the report of a plan as a self-contained HTML file."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from flexstage.base.version import __version__
from flexstage.experiments.results import PlanResult
from flexstage.experiments.verbs import VERBS
from flexstage.quantities.characteristic import in_order
from flexstage.quantities.quantity import display, number, value_and_uncertainty
from flexstage.quantities.table import Content, Definitions, Section, Table, table
from flexstage.report.measurement import measurement_section
from flexstage.report.page import page_html
from flexstage.studies.measurement import compare_plan

if TYPE_CHECKING:
    from flexstage.experiments import DryRun, PlanResult
    from flexstage.experiments.verb import PlannedMotion
    from flexstage.instruments.catalogue.entries import RunEntry
    from flexstage.quantities.characteristic import MeasuredCharacteristic


def run_text(result: PlanResult) -> str:
    """Return the report of a plan."""
    name = result.plan.title or f"experiments on {result.stage.name}"
    return page_html(
        heading=f"{result.stage.name}: {name}",
        lead=_lead(result),
        version=__version__,
        sections=_sections(result),
        notes=_notes(result),
    )


def _lead(result: PlanResult) -> str:
    by = f" by {result.run.operator}" if result.run.operator else ""
    number_of = f", serial number {result.run.serial_number}" if result.run.serial_number else ""
    identity = " ".join(w for w in (result.run.instrument.vendor, result.run.instrument.model) if w)
    steps = "1 step" if len(result.steps) == 1 else f"{len(result.steps)} steps"
    return (
        f"{steps} on {identity}{number_of}; {_moment(result.run.started)} to "
        f"{_moment(result.finished)} UTC{by}; 95 % intervals"
    )


def _moment(text: str) -> str:
    """Return date and time to the second."""
    return text[:19].replace("T", " ")


def _notes(result: PlanResult) -> Sequence[str]:
    notes = []
    if result.run.instrument.simulated:
        notes.append("Simulated instrument: no value on this page was measured on a real stage.")
    if result.run.note:
        notes.append(f"Note: {result.run.note}")
    notes += [
        *result.plan.notes,
        *(n for n in result.notes if not n.startswith("simulated instrument")),
    ]
    return tuple(dict.fromkeys(notes))


def _sections(result: PlanResult) -> Iterator[Section]:
    measured = compare_plan(result)
    if measured.rows or measured.characterisation.results:
        figures = measurement_section(measured, *_further(result))
        yield Section(
            key="figures", title="Characteristics", content=figures.content, notes=figures.notes
        )
    recording = Section(key="record", title="Recording", content=())
    for word, verb in VERBS.items():
        steps = result.of(word)
        section = verb.section(steps, result) if steps else None
        if section is None:
            continue
        if section.key == recording.key:
            recording = replace(section, title=recording.title)
        else:
            yield section
    identity = result.run.instrument
    settings = {
        "instrument": f"{identity.vendor} {identity.model}".strip(),
        "serial number": identity.serial_number,
        "firmware": identity.firmware,
        **result.run.settings,
    }
    definitions = Definitions({name: value for name, value in settings.items() if value})
    yield replace(recording, content=(*recording.content, definitions))


def _further(result: PlanResult) -> Iterator[Content]:
    """Yield the repeated figures of an axis, and those of modes with the drives in place."""
    rows = []
    with_drives = [f for f in result.figures if result.drives_in_place(f)]
    for figure in (*with_drives, *result.further_figures):
        quantity = display(figure.quantity)
        label = quantity.label + (", drives in place" if result.drives_in_place(figure) else "")
        value, spread = value_and_uncertainty(
            figure.value * quantity.factor, figure.estimate.expanded * quantity.factor
        )
        rows.append((label, figure.axis, figure.test, value, spread, quantity.shown_unit))
    if not rows:
        return
    yield (
        "Natural frequencies are those of the stage without its drives, unless this table says "
        "drives in place. It also lists figures that a later test gave again."
    )
    heads = ("Quantity", "<Axis", "<Test", "value", "±\u00a0(95\u00a0%)", "<Unit")
    yield table("", heads, rows)


def dry_run_table(rehearsal: "DryRun", title: str) -> Table:
    """Return the steps of a plan with the motions that each would command."""
    lines: list[tuple[str, ...]] = []
    for step in rehearsal.steps:
        lasting = step.duration or step.command_duration
        time = f"{lasting:.2f}" if lasting else ""
        rows: list[PlannedMotion | None] = [*step.motions] if step.verb == "excite" else []
        for k, motion in enumerate(rows or [None]):
            head = (step.name, step.verb, step.what, time) if k == 0 else ("", "", "", "")
            lines.append((*head, *_motion(motion)))
    heads = "step", "~<verb", "<description", "time, s", "<axis", "from", "to", "slope", "<allowed"
    caption = f"{title}, {rehearsal.stage}: {rehearsal.duration:.0f} s of motion and recording"
    return table(caption, heads, lines)


def _motion(motion: "PlannedMotion | None") -> tuple[str, ...]:
    if motion is None:
        return ("", "", "", "", "")
    scale, unit = (1.0, "V") if motion.unit == "V" else (1e6, "um")
    low, high = (scale * v for v in motion.limits)
    about = "about " if motion.estimated else ""
    limit = "" if motion.rate_limit is None else f", {_plain(scale * motion.rate_limit)} {unit}/s"
    return (
        motion.axis,
        f"{_plain(scale * motion.low)} {unit}",
        f"{_plain(scale * motion.high)} {unit}",
        f"{_plain(scale * motion.largest_rate)} {unit}/s",
        f"{about}{_plain(low)} to {_plain(high)} {unit}{limit}",
    )


def _plain(value: float) -> str:
    """Return a number with up to four digits, a long one without an exponent."""
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"


def figures_table(result: "PlanResult") -> Table:
    """Return the figures of a plan, with their intervals and published values."""
    every = in_order((*result.figures, *result.further_figures))
    heads = "quantity", "<axis", "value", "95 %", "<unit", "<step", "published"
    caption = f"{result.stage.name}, {result.origin}"
    return table(caption, heads, (_figure_row(result, figure) for figure in every))


def _figure_row(result: "PlanResult", figure: "MeasuredCharacteristic") -> tuple[str, ...]:
    """Return the row of a figure, with the digits that its uncertainty leaves."""
    quantity = display(figure.quantity)
    value = figure.value * quantity.factor
    expanded = figure.estimate.expanded * quantity.factor
    published = [r for r in result.published_of(figure) if r.origin == "published-measured"]
    label = quantity.label + (", drives in place" if result.drives_in_place(figure) else "")
    return (
        label[:1].lower() + label[1:],
        figure.axis,
        *value_and_uncertainty(value, expanded),
        quantity.shown_unit,
        figure.test,
        number(published[0].value * quantity.factor) if published else "",
    )


def runs_table(entries: "Iterable[RunEntry]", caption: str) -> Table:
    """Return a table of the runs of a catalogue."""
    heads = "run", "<start, UTC", "<stage", "~<serial", "<kind", "<axis", "~samples", "<status"
    rows = (
        (
            entry.identifier[:8],
            shown_time(entry.started),
            entry.stage.name,
            entry.stage.serial_number,
            entry.kind,
            entry.axis,
            entry.samples,
            entry.status,
            "virtual" if entry.simulated else "measured",
            entry.step,
        )
        for entry in entries
    )
    return table(caption, (*heads, "<origin", "~<step"), rows)


def shown_time(time: datetime) -> str:
    """Return a date and time as tables show it, in UTC."""
    return time.astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S")
