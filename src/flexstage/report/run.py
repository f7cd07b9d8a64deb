"""The report of an experiment plan that was carried out: one HTML file that needs nothing else."""

from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

import flexstage
from flexstage.characteristic import Characteristics
from flexstage.experiment.campaign.plan import Campaign, Test
from flexstage.experiment.campaign.results import Characterisation, TestResult
from flexstage.plans.results import (
    CentredStep,
    CharacterisedStep,
    IdentifiedStep,
    PlanResult,
    VerifiedStep,
)
from flexstage.plans.step_results import FollowedRun
from flexstage.quantities import beside, display, number
from flexstage.report.figures.following import draw_drive_fit, draw_following
from flexstage.report.figures.style import inline_svg
from flexstage.report.measurement import MeasurementComparison, compare_with_references
from flexstage.report.measurement_html import measurement_section
from flexstage.report.page import figure, page_html

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
    items = "".join(f"<li>{escape(text)}</li>" for text in dict.fromkeys(said))
    return f'<div class="note"><ul>{items}</ul></div>' if items else ""


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
    return (
        "<p>Natural frequencies are those of the stage without its drives, except where this table "
        "says that they were in place. It lists those, and what a test gave again after another "
        "test.</p>"
        '<div class="scroll"><table><thead><tr><th class="text">Quantity</th>'
        '<th class="text">Axis</th><th class="text">Test</th><th>value</th>'
        '<th>±&nbsp;(95&nbsp;%)</th><th class="text">Unit</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _models(result: PlanResult, steps: list[IdentifiedStep]) -> str:
    rows, plots, warned = [], [], {}
    published = Characteristics(result.stage.published)
    for i, step in enumerate(steps):
        errors = "; ".join(f"{name} {value:.3g}" for name, value in step.errors_percent.items())
        # the study's own model is a Bouc-Wen model: no other is set beside what it printed
        known = published.select("hysteresis_deviation", step.axis, "published-measured")
        beside = _as_printed(known[0].value) if known and step.kind == "bouc-wen" else ""
        rows.append(
            f"<tr><th>{escape(step.name)}</th><td>{escape(step.axis)}</td>"
            f'<td class="text">{escape(step.kind)}</td><td class="text">{escape(errors)}</td>'
            f"<td>{number(_UM * step.deviation)}</td><td>{beside}</td></tr>"
        )
        svg = inline_svg(draw_drive_fit(step), f"model-{i}", f"{step.name}: record and model")
        name = escape(step.name)
        plots.append(figure(svg, f"Step {name}: record and identified model."))
        warned |= dict.fromkeys(f"{step.name}: {text}" for text in step.warnings)
    notes = "".join(f"<li>{escape(text)}</li>" for text in warned)
    return (
        '<div class="scroll"><table><thead><tr><th>Step</th><th>Axis</th>'
        '<th class="text">Model</th><th class="text">Errors [% of the stroke]</th>'
        "<th>Largest deviation [µm]</th><th>published [µm]</th></tr></thead>"
        f'<tbody>{"".join(rows)}</tbody></table></div><div class="plots">{"".join(plots)}</div>'
        + (f"<ul>{notes}</ul>" if notes else "")
    )


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
        svg = inline_svg(draw_following(step), f"following-{i}", title)
        plots.append(figure(svg, f"Step {escape(title)}."))
        told |= dict.fromkeys(
            f"{step.name}, {run.way}: {text}" for run in step.runs for text in run.notes
        )
    titles = "".join(f"<th>{title}</th>" for title in heads)
    notes = "".join(f"<li>{escape(text)}</li>" for text in told)
    return (
        "<p>Errors include the noise of the reading. The loop width hides every error that both "
        "branches share; therefore the error from the reference is given as well. In "
        "open loop the reading is shifted by its mean difference from the reference.</p>"
        f'<div class="scroll"><table><thead><tr>{titles}</tr></thead>'
        f'<tbody>{"".join(lines)}</tbody></table></div><div class="plots">{"".join(plots)}</div>'
        + (f"<ul>{notes}</ul>" if notes else "")
    )


def _run_row(step: VerifiedStep, run: FollowedRun) -> str:
    way = _WAYS[run.way].format(kind=step.kind)
    errors, less = run.tracking, run.reduction_percent
    cells = (
        number(_UM * step.stroke),
        number(step.rate_hz),
        number(_UM * errors.loop_width),
        "" if run.way == "open loop" or less is None else f"{less:.1f}",
        number(_NM * errors.rms),
        number(100.0 * errors.rms / step.stroke),
        number(_NM * errors.largest),
    )
    title = f"{step.name}, axis {step.axis}: {way}"
    return f"<tr><th>{escape(title)}</th>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _as_printed(length: float) -> str:
    """A published length in micrometres, with the digits that were printed."""
    return f"{_UM * length:.10g}"


def _published_rows(stage: "Stage", axis: str) -> list[str]:
    rows = Characteristics(stage.published)
    values = {}
    for quantity in ("hysteresis_loop_width", "compensated_loop_width", "output_displacement"):
        found = rows.select(quantity, axis, "published-measured")
        values[quantity] = found[0].value if found else None
    width, left, stroke = values.values()
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
    cells = (stroke, "", _as_printed(width), reduction, "", "", "")
    return f"<tr><th>{escape(title)}</th>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _centred(step: CentredStep) -> str:
    rows = []
    for i, move in enumerate(step.moves):
        expected = "" if move.predicted is None else f"{move.predicted * _UM:.3f}"
        cells = (
            f"<td>{move.command[0] * _UM:.3f}</td><td>{move.command[1] * _UM:.3f}</td>"
            f"<td>{move.length * _UM:.3f}</td><td>{move.uncertainty * _UM:.3f}</td>"
            f"<td>{expected}</td><td>{move.true_length * _UM:.3f}</td>"
        )
        rows.append(f"<tr><td>{i}</td><td>{escape(move.kind)}</td>{cells}</tr>")
    notes = "".join(f"<li>{escape(text)}</li>" for text in step.notes)
    heads = (
        "move", "kind", "x [µm]", "y [µm]", "eccentricity [µm]", "± (95 %)", "expected [µm]",
        "true [µm]",
    )  # fmt: skip
    titles = "".join(f"<th>{title}</th>" for title in heads)
    return (
        f"<p>Step {escape(step.name)}: target {step.target * _UM:.3g} µm; "
        f"{escape(step.reason)}. The scale and its heads are simulated, so the true one is "
        "known.</p>"
        f'<div class="scroll"><table><thead><tr>{titles}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>" + (f"<ul>{notes}</ul>" if notes else "")
    )


def _record(result: PlanResult) -> str:
    rows = []
    for step in result.records:
        record = step.record
        again = "" if step.repeated else "taken by an earlier run of this plan"
        rows.append(
            f'<tr><th>{escape(step.name)}</th><td class="text">{escape(step.axis)}</td>'
            f'<td class="text">{escape(step.test or "identification")}</td>'
            f"<td>{len(record.channels)}</td><td>{record.size}</td>"
            f"<td>{number(record.sample_rate_hz)}</td>"
            f'<td class="text">{escape(step.file.name)}</td><td class="text">{again}</td></tr>'
        )
    table = (
        '<div class="scroll"><table><thead><tr><th>Step</th><th class="text">Axis</th>'
        '<th class="text">Serves</th><th>Signals</th><th>Samples</th><th>Rate [Hz]</th>'
        '<th class="text">File</th><th></th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
        if rows
        else ""
    )
    identity = result.instrument
    settings = {
        "instrument": f"{identity.vendor} {identity.model}".strip(),
        "its serial number": identity.serial_number,
        "firmware": identity.firmware,
        **result.settings,
    }
    listed = "".join(
        f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>"
        for name, value in settings.items()
        if value
    )
    return f"{table}<dl>{listed}</dl>"
