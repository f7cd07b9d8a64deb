"""The report of an experiment plan that was carried out: one HTML file that needs nothing else."""

from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

import flexstage
from flexstage.characteristic import Characteristics, measured_value
from flexstage.experiments.campaign.plan import Campaign, Test
from flexstage.experiments.campaign.results import Characterisation, TestResult
from flexstage.experiments.results import PlanResult
from flexstage.experiments.verbs.centre import CentredStep
from flexstage.experiments.verbs.characterise import CharacterisedStep
from flexstage.experiments.verbs.identify import IdentifiedStep
from flexstage.experiments.verbs.verify import FollowedRun, VerifiedStep
from flexstage.quantities import beside, display, number
from flexstage.report.figures.tracking import draw_drive_fit, draw_following
from flexstage.report.measurement_html import measurement_section
from flexstage.report.page import bullets, cells, definitions, drawn, page_html, row_of, table_html
from flexstage.report.tables import LABEL_HEADS
from flexstage.studies.measurement import MeasurementComparison, compare_with_references

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
    """Write a page of what a plan gave."""
    parts = list(_parts(result))
    name = result.plan.title or f"experiments on {result.stage.name}"
    return page_html(
        title=f"{result.stage.name}: {name}",
        heading=f"{result.stage.name}: {name}",
        lead=_lead(result),
        version=flexstage.__version__,
        links=((key, title) for key, title, _ in parts),
        body="".join(
            f'<section id="{key}"><h2>{title}</h2>{content}</section>'
            for key, title, content in parts
        ),
        notes=_notes(result),
    )


def run_measurement_of(result: PlanResult) -> MeasurementComparison:
    """Set all figures of a plan beside what was published of the stage."""
    found: list[TestResult] = []
    instruments, sources, notes = {}, {}, {}
    for step in result.steps:
        if isinstance(step, CharacterisedStep):
            taken = {r.test.name for r in found}
            found += [r for r in step.found.results if r.test.name not in taken]
            instruments |= {i.name: i for i in step.found.campaign.instruments}
            sources |= step.found.sources
            notes |= dict.fromkeys(step.found.campaign.notes)
        elif isinstance(step, VerifiedStep) and step.figures:
            record = str(step.runs[0].file.name)
            test = Test(name=step.name, kind="motion", axis=step.axis, records=(record,))
            found.append(TestResult(test=test, figures=step.figures))
    campaign = Campaign(
        stage=result.plan.stage,
        origin=result.origin,
        instruments=tuple(instruments.values()),
        tests=tuple(r.test for r in found),
        notes=(),
    )
    whole = Characterisation(campaign=campaign, results=tuple(found), sources=sources)
    # a mode with the drives in place is another than that which was published
    in_place = {(f.quantity, f.axis) for f in whole.figures if result.drives_in_place(f)}
    published = Characteristics(
        row for row in result.stage.published if (row.quantity, row.axis) not in in_place
    )
    return compare_with_references(whole, result.stage, published)


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


def _notes(result: PlanResult) -> str:
    said = []
    if result.instrument.simulated:
        said.append(
            "The instrument is a simulation: nothing on this page was measured on a real stage."
        )
    if result.note:
        said.append(f"Note: {result.note}")
    said += [*result.plan.notes, *(n for n in result.notes if "is a simulation" not in n)]
    return f'<div class="note">{bullets(dict.fromkeys(said))}</div>' if said else ""


def _parts(result: PlanResult) -> Iterator[tuple[str, str, str]]:
    measured = run_measurement_of(result)
    if measured.found.results:
        yield "figures", "Figures", measurement_section(measured) + _further(result)
    models = [s for s in result.steps if isinstance(s, IdentifiedStep)]
    if models:
        yield "models", "Identified drives", _models(result, models)
    followed = [s for s in result.steps if isinstance(s, VerifiedStep)]
    if followed:
        yield "following", "Following a reference", _following(result, followed)
    centred = [s for s in result.steps if isinstance(s, CentredStep)]
    if centred:
        yield "centring", "Centring", "".join(_centred(step) for step in centred)
    yield "record", "What was recorded", _record(result)


def _further(result: PlanResult) -> str:
    """Figures of tests that repeat a quantity of an axis, and of modes with the drives in place."""
    rows = []
    own = [f for f in result.figures if result.drives_in_place(f)]
    for found in (*own, *result.further_figures):
        shown = display(found.quantity)
        label = shown.label + (", drives in place" if result.drives_in_place(found) else "")
        value, spread = beside(found.value * shown.factor, found.estimate.expanded * shown.factor)
        rows.append(
            f'<tr><td class="text">{escape(label)}</td><td class="text">{escape(found.axis)}</td>'
            f'<td class="text">{escape(found.test)}</td><td>{value}</td><td>{spread}</td>'
            f'<td class="text">{escape(shown.shown_unit)}</td></tr>'
        )
    if not rows:
        return ""
    heads = (
        *LABEL_HEADS, '<th class="text">Test</th><th>value</th><th>±&nbsp;(95&nbsp;%)</th>',
        '<th class="text">Unit</th>',
    )  # fmt: skip
    return (
        "<p>Natural frequencies are those of the stage without its drives, except where this table "
        "says that they were in place. It lists those, and what a test gave again after another "
        "test.</p>" + table_html(heads, rows)
    )


def _models(result: PlanResult, steps: list[IdentifiedStep]) -> str:
    rows, plots, warned = [], [], {}
    for i, step in enumerate(steps):
        errors = "; ".join(f"{name} {value:.3g}" for name, value in step.errors_percent.items())
        # the study's own model is a Bouc-Wen model: no other is set beside what it printed
        known = measured_value(result.stage.published, "hysteresis_deviation", step.axis)
        beside = _as_printed(known) if known is not None and step.kind == "bouc-wen" else ""
        rows.append(
            f"<tr><th>{escape(step.name)}</th><td>{escape(step.axis)}</td>"
            f'<td class="text">{escape(step.kind)}</td><td class="text">{escape(errors)}</td>'
            f"<td>{number(_UM * step.deviation)}</td><td>{beside}</td></tr>"
        )
        words = f"Step {escape(step.name)}: record and identified model."
        title = f"{step.name}: record and model"
        plots.append(drawn(draw_drive_fit(step), f"model-{i}", title, words))
        warned |= dict.fromkeys(f"{step.name}: {text}" for text in step.warnings)
    heads = (
        "<th>Step</th><th>Axis</th>",
        '<th class="text">Model</th><th class="text">Errors [% of the stroke]</th>',
        "<th>Largest deviation [µm]</th><th>published [µm]</th>",
    )
    return table_html(heads, rows) + row_of(plots) + bullets(warned)


def _following(result: PlanResult, steps: list[VerifiedStep]) -> str:
    heads = (
        "", "stroke [µm]", "rate [Hz]", "loop width [µm]", "narrowed by [%]", "error [nm rms]",
        "[% of the stroke]", "largest error [nm]",
    )  # fmt: skip
    lines, plots, told = [], [], {}
    shown: set[str] = set()
    for i, step in enumerate(steps):
        lines += [_run_row(step, run) for run in step.runs]
        if step.axis not in shown:
            lines += _published_rows(result.stage, step.axis)
            shown.add(step.axis)
        title = f"{step.name}: a reference followed in {len(step.runs)} ways"
        words = f"Step {escape(title)}."
        plots.append(drawn(draw_following(step), f"following-{i}", title, words))
        told |= dict.fromkeys(
            f"{step.name}, {run.way}: {text}" for run in step.runs for text in run.notes
        )
    return (
        "<p>Errors include the noise of the reading. The loop width hides every error that both "
        "branches share; therefore the error from the reference is given as well. In "
        "open loop the reading is shifted by its mean difference from the reference.</p>"
        + table_html((f"<th>{title}</th>" for title in heads), lines)
        + row_of(plots)
        + bullets(told)
    )


def _run_row(step: VerifiedStep, run: FollowedRun) -> str:
    way = _WAYS[run.way].format(kind=step.kind)
    errors, less = run.tracking, run.reduction_percent
    values = (
        number(_UM * step.stroke),
        number(step.rate_hz),
        number(_UM * errors.loop_width),
        "" if run.way == "open loop" or less is None else f"{less:.1f}",
        number(_NM * errors.rms),
        number(100.0 * errors.rms / step.stroke),
        number(_NM * errors.largest),
    )
    title = f"{step.name}, axis {step.axis}: {way}"
    return f"<tr><th>{escape(title)}</th>{cells(values)}</tr>"


def _as_printed(length: float) -> str:
    """A published length in micrometres, with the digits that were printed."""
    return f"{_UM * length:.10g}"


def _published_rows(stage: "Stage", axis: str) -> list[str]:
    width, left, stroke = (
        measured_value(stage.published, quantity, axis)
        for quantity in ("hysteresis_loop_width", "compensated_loop_width", "output_displacement")
    )
    if width is None:
        return []
    first = "" if stroke is None else _as_printed(stroke)
    lines = [_published_row(f"published, axis {axis}: open loop", first, width, "")]
    if left is not None:
        title = f"published, axis {axis}: inverse of Bouc-Wen"
        reduction = f"{100.0 * (1.0 - left / width):.1f}"
        lines.append(_published_row(title, first, left, reduction))
    return lines


def _published_row(title: str, stroke: str, width: float, reduction: str) -> str:
    values = (stroke, "", _as_printed(width), reduction, "", "", "")
    return f"<tr><th>{escape(title)}</th>{cells(values)}</tr>"


def _centred(step: CentredStep) -> str:
    rows = []
    for i, move in enumerate(step.moves):
        lengths = (*move.command, move.length, move.uncertainty, move.predicted, move.true_length)
        shown = ("" if length is None else f"{length * _UM:.3f}" for length in lengths)
        rows.append(f"<tr>{cells((i, escape(move.kind), *shown))}</tr>")
    heads = (
        "move", "kind", "x [µm]", "y [µm]", "eccentricity [µm]", "± (95 %)", "expected [µm]",
        "true [µm]",
    )  # fmt: skip
    return (
        f"<p>Step {escape(step.name)}: target {step.target * _UM:.3g} µm; "
        f"{escape(step.reason)}. The scale and its heads are simulated, so the true one is "
        "known.</p>"
        + table_html((f"<th>{title}</th>" for title in heads), rows)
        + bullets(step.notes)
    )


def _record(result: PlanResult) -> str:
    rows = []
    for step in result.records:
        record = step.record
        again = "" if step.repeated else "taken by an earlier run of this plan"
        rows.append(
            f'<tr><th>{escape(step.name)}</th><td class="text">{escape(step.axis)}</td>'
            f'<td class="text">{escape(step.test or "identification")}</td>'
            f"{cells((len(record.channels), record.size, number(record.sample_rate_hz)))}"
            f'<td class="text">{escape(step.file.name)}</td><td class="text">{again}</td></tr>'
        )
    heads = (
        '<th>Step</th><th class="text">Axis</th>',
        '<th class="text">Serves</th><th>Signals</th><th>Samples</th><th>Rate [Hz]</th>',
        '<th class="text">File</th><th></th>',
    )
    table = table_html(heads, rows) if rows else ""
    identity = result.instrument
    settings = {
        "instrument": f"{identity.vendor} {identity.model}".strip(),
        "its serial number": identity.serial_number,
        "firmware": identity.firmware,
        **result.settings,
    }
    return table + definitions((name, value) for name, value in settings.items() if value)
