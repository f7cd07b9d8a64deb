"""Tables of plans and runs: what a plan would do, what it gave, what is in the catalogue."""

from collections.abc import Iterable
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from flexstage.characteristic import in_order
from flexstage.quantities import beside, display, number
from flexstage.table import Table, table

if TYPE_CHECKING:
    from flexstage.characteristic import MeasuredCharacteristic
    from flexstage.experiments import DryRun, PlanResult
    from flexstage.experiments.verb import PlannedMotion
    from flexstage.instruments.catalogue.entries import RunEntry


def dry_run_table(found: "DryRun", title: str) -> Table:
    """Return the steps of a plan with what each would send."""
    planned: list[tuple[str, ...]] = []
    for step in found.steps:
        lasting = step.duration or step.command_duration
        time = f"{lasting:.2f}" if lasting else ""
        rows: list[PlannedMotion | None] = [*step.motions] if step.verb == "excite" else []
        for k, motion in enumerate(rows or [None]):
            head = (step.name, step.verb, step.what, time) if k == 0 else ("", "", "", "")
            planned.append((*head, *_motion(motion)))
    heads = "step", "~<verb", "<what", "time, s", "<axis", "from", "to", "slope", "<allowed"
    caption = f"{title}, {found.stage}: {found.duration:.0f} s of motion and records"
    return table(caption, heads, planned)


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
    """Write a number with up to four digits, and a long one without an exponent."""
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"


def figures_table(result: "PlanResult") -> Table:
    """Return the figures that a plan gave, with their intervals and what was published."""
    every = in_order((*result.figures, *result.further_figures))
    heads = "quantity", "<axis", "value", "95 %", "<unit", "<step", "published"
    caption = f"{result.stage.name}, {result.origin}"
    return table(caption, heads, (_figure(result, figure) for figure in every))


def _figure(result: "PlanResult", figure: "MeasuredCharacteristic") -> tuple[str, ...]:
    """Return the row of a figure, with the digits that its uncertainty leaves."""
    shown = display(figure.quantity)
    value = figure.value * shown.factor
    expanded = figure.estimate.expanded * shown.factor
    known = [r for r in result.published_of(figure) if r.origin == "published-measured"]
    label = shown.label + (", drives in place" if result.drives_in_place(figure) else "")
    return (
        label[:1].lower() + label[1:],
        figure.axis,
        *beside(value, expanded),
        shown.shown_unit,
        figure.test,
        number(known[0].value * shown.factor) if known else "",
    )


def runs_table(found: "Iterable[RunEntry]", caption: str) -> Table:
    """Return runs of a catalogue."""
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
        for entry in found
    )
    return table(caption, (*heads, "<origin", "~<step"), rows)


def shown_time(time: datetime) -> str:
    """Return a date and time as tables show it, in UTC."""
    return time.astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S")
