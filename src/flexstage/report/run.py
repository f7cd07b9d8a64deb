"""The report of an experiment plan that was carried out: one HTML file that needs nothing else."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import flexstage
from flexstage.characteristic import measured_value
from flexstage.experiments.results import PlanResult
from flexstage.experiments.verbs.centre import CentredStep
from flexstage.experiments.verbs.identify import IdentifiedStep
from flexstage.experiments.verbs.verify import FollowedRun, VerifiedStep
from flexstage.quantities import beside, display, number
from flexstage.report.measurement import measurement_section
from flexstage.report.page import page_html
from flexstage.section import Bullets, Content, Definitions, Picture, Pictures, Section
from flexstage.studies.measurement import compare_plan
from flexstage.table import Column, table

if TYPE_CHECKING:
    from flexstage.stage import Stage

_UM, _NM = 1e6, 1e9
#: How the ways of following a reference are told.
_WAYS = {
    "open loop": "open loop, voltage in proportion",
    "inverse": "inverse of {kind}",
    "feedback": "feedback",
    "both": "feedback and inverse of {kind}",
    "learning": "learned over trials",
}


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
    if measured.found.results:
        whole = measurement_section(measured, *_further(result))
        yield Section(key="figures", title="Figures", content=whole.content, notes=whole.notes)
    models = [s for s in result.steps if isinstance(s, IdentifiedStep)]
    if models:
        yield Section(
            key="models", title="Identified drives", content=tuple(_models(result, models))
        )
    followed = [s for s in result.steps if isinstance(s, VerifiedStep)]
    if followed:
        yield Section(
            key="following",
            title="Following a reference",
            content=tuple(_following(result, followed)),
        )
    centred = [s for s in result.steps if isinstance(s, CentredStep)]
    if centred:
        content = tuple(part for step in centred for part in _centred(step))
        yield Section(key="centring", title="Centring", content=content)
    yield Section(key="record", title="What was recorded", content=tuple(_record(result)))


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


def _models(result: PlanResult, steps: Sequence[IdentifiedStep]) -> Iterator[Content]:
    rows, shown, warned = [], [], {}
    for step in steps:
        errors = "; ".join(f"{name} {value:.3g}" for name, value in step.errors_percent.items())
        # the study's own model is a Bouc-Wen model: no other is set beside what it printed
        known = measured_value(result.stage.published, "hysteresis_deviation", step.axis)
        printed = _as_printed(known) if known is not None and step.kind == "bouc-wen" else ""
        deviation = number(_UM * step.deviation)
        rows.append((step.name, step.axis, step.kind, errors, deviation, printed))
        title = f"{step.name}: record and model"
        words = f"Step {step.name}: record and identified model."
        shown.append(Picture(result=step, title=title, caption=words))
        warned |= dict.fromkeys(f"{step.name}: {text}" for text in step.warnings)
    heads = (
        Column("Step", "title"), "Axis", "<Model", "<Errors [% of the stroke]",
        "Largest deviation [µm]", "published [µm]",
    )  # fmt: skip
    yield table("", heads, rows)
    yield Pictures(shown=tuple(shown))
    yield Bullets(tuple(warned))


def _following(result: PlanResult, steps: Sequence[VerifiedStep]) -> Iterator[Content]:
    rows, shown, told = [], [], {}
    axes: set[str] = set()
    for step in steps:
        rows += [_run_row(step, run) for run in step.runs]
        if step.axis not in axes:
            rows += _published_rows(result.stage, step.axis)
            axes.add(step.axis)
        title = f"{step.name}: a reference followed in {len(step.runs)} ways"
        shown.append(Picture(result=step, title=title, caption=f"Step {title}."))
        told |= dict.fromkeys(
            f"{step.name}, {run.way}: {text}" for run in step.runs for text in run.notes
        )
    yield (
        "Errors include the noise of the reading. The loop width hides every error that both "
        "branches share; therefore the error from the reference is given as well. In "
        "open loop the reading is shifted by its mean difference from the reference."
    )
    heads = (
        Column("", "title"), "stroke [µm]", "rate [Hz]", "loop width [µm]", "narrowed by [%]",
        "error [nm rms]", "[% of the stroke]", "largest error [nm]",
    )  # fmt: skip
    yield table("", heads, rows)
    yield Pictures(shown=tuple(shown))
    yield Bullets(tuple(told))


def _run_row(step: VerifiedStep, run: FollowedRun) -> tuple[str, ...]:
    way = _WAYS[run.way].format(kind=step.kind)
    errors, less = run.tracking, run.reduction_percent
    return (
        f"{step.name}, axis {step.axis}: {way}",
        number(_UM * step.stroke),
        number(step.rate_hz),
        number(_UM * errors.loop_width),
        "" if run.way == "open loop" or less is None else f"{less:.1f}",
        number(_NM * errors.rms),
        number(100.0 * errors.rms / step.stroke),
        number(_NM * errors.largest),
    )


def _as_printed(length: float) -> str:
    """A published length in micrometres, with the digits that were printed."""
    return f"{_UM * length:.10g}"


def _published_rows(stage: "Stage", axis: str) -> Iterator[tuple[str, ...]]:
    width, left, stroke = (
        measured_value(stage.published, quantity, axis)
        for quantity in ("hysteresis_loop_width", "compensated_loop_width", "output_displacement")
    )
    if width is None:
        return
    first = "" if stroke is None else _as_printed(stroke)
    title = f"published, axis {axis}"
    yield (f"{title}: open loop", first, "", _as_printed(width), "", "", "", "")
    if left is not None:
        less = f"{100.0 * (1.0 - left / width):.1f}"
        yield (f"{title}: inverse of Bouc-Wen", first, "", _as_printed(left), less, "", "", "")


def _centred(step: CentredStep) -> Iterator[Content]:
    rows = []
    for i, move in enumerate(step.moves):
        lengths = (*move.command, move.length, move.uncertainty, move.predicted, move.true_length)
        shown = ("" if length is None else f"{length * _UM:.3f}" for length in lengths)
        rows.append((i, move.kind, *shown))
    heads = (
        "move", "kind", "x [µm]", "y [µm]", "eccentricity [µm]", "± (95 %)", "expected [µm]",
        "true [µm]",
    )  # fmt: skip
    yield (
        f"Step {step.name}: target {step.target * _UM:.3g} µm; {step.reason}. The scale and its "
        "heads are simulated, so the true one is known."
    )
    yield table("", heads, rows, notes=step.notes)


def _record(result: PlanResult) -> Iterator[Content]:
    rows = []
    for step in result.records:
        record = step.record
        again = "" if step.repeated else "taken by an earlier run of this plan"
        size = (len(record.channels), record.size, number(record.sample_rate_hz))
        serves = step.test or "identification"
        rows.append((step.name, step.axis, serves, *size, step.file.name, again))
    heads = (
        Column("Step", "title"), "<Axis", "<Serves", "Signals", "Samples", "Rate [Hz]", "<File",
        "<",
    )  # fmt: skip
    if rows:
        yield table("", heads, rows)
    identity = result.instrument
    settings = {
        "instrument": f"{identity.vendor} {identity.model}".strip(),
        "its serial number": identity.serial_number,
        "firmware": identity.firmware,
        **result.settings,
    }
    yield Definitions({name: value for name, value in settings.items() if value})
