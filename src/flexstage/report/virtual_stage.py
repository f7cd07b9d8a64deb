"""The sections on the virtual stage: its measurement, and the scale that it centres."""

from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

from flexstage.characteristic import measured_value
from flexstage.quantities import beside, display
from flexstage.report.figures.centring import draw_polar
from flexstage.report.figures.modal_fit import draw_resonance
from flexstage.report.page import captioned, cells, drawn, row_of, table_html
from flexstage.studies.measurement import MeasurementComparison
from flexstage.studies.virtual_experiments import (
    ECCENTRICITY,
    HEAD_NOISE,
    HEADS,
    LINE_ERRORS,
    SCALE_RADIUS,
    CentringTrial,
)

if TYPE_CHECKING:
    from flexstage.estimate import Estimate

#: Quantities of the simulated measurement that the report of a study shows.
_MAIN = (
    "output_displacement",
    "natural_frequency_hz",
    "straightness",
    "straightness_out_of_plane",
    "resolution",
    "noise",
    "drift",
    "hysteresis_loop_width",
)


def bench_section(found: MeasurementComparison | str | None, file: str) -> str:
    """Write half a page on the simulated measurement, which has a page of its own.

    Empty where it was not asked for. The file is the name of that page, beside this one.
    """
    if found is None:
        return ""
    if isinstance(found, str):
        return f"<p>The virtual stage could not be measured: {escape(found)}.</p>"
    return (
        "<p>A stage with random manufacturing errors is simulated and read by sensors with the "
        "stated errors; its records are evaluated as measured ones are. Nothing here was measured. "
        "Stroke, straightness, loop width and natural frequencies of the simulated stage are set "
        "to the published values where there are any, so that they test the evaluation and no "
        f'model. All figures, curves and budgets: <a href="{escape(file, quote=True)}">'
        f"{escape(file)}</a>.</p>" + _main_figures(found) + row_of(_resonances(found), columns=2)
    )


def _main_figures(found: MeasurementComparison) -> str:
    """A row for each main quantity, a column for each axis."""
    axes = list(dict.fromkeys(r.figure.axis for r in found.rows if r.figure.quantity in _MAIN))
    lines = []
    for quantity in _MAIN:
        rows = {
            r.figure.axis: r.figure.estimate for r in found.rows if r.figure.quantity == quantity
        }
        if not rows:
            continue
        shown = display(quantity).fitting(max(abs(e.value) for e in rows.values()))
        shares = (_with_spread(rows[a], shown.factor) if a in rows else "–" for a in axes)
        lines.append(f'<tr><td class="text">{escape(shown.heading)}</td>{cells(shares)}</tr>')
    heads = ['<th class="text">Quantity</th>', *(f"<th>{escape(a)}</th>" for a in axes)]
    caption = "Simulated measurement: main figures, ± at 95 % with all contributions."
    return captioned(table_html(heads, lines), caption) if lines else ""


def _with_spread(estimate: "Estimate", factor: float) -> str:
    value, spread = beside(factor * estimate.value, factor * estimate.expanded)
    return f"{value} ± {spread}"


def _resonances(found: MeasurementComparison) -> Iterator[str]:
    published = () if found.stage is None else found.stage.published
    estimates = {(r.figure.quantity, r.figure.axis): r.figure.estimate for r in found.rows}
    for i, result in enumerate(found.found.results):
        fit = result.details.get("fit")
        if fit is None or not fit.modes:
            continue
        axis = result.test.axis
        known = measured_value(published, "natural_frequency_hz", axis)
        plot = draw_resonance(
            fit,
            axis=axis,
            label="simulated measurement",
            frequency_hz=estimates.get(("natural_frequency_hz", axis)),
            published_hz=known,
        )
        agree = (
            " The simulated stage is set to the published value, so that both agree."
            if known is not None
            else ""
        )
        words = f"Response of {escape(axis)}, simulated measurement.{agree}"
        yield drawn(plot, f"resonance-{i}", f"resonance of {axis}", words)


def centring_section(found: CentringTrial | str | None) -> str:
    """Write the section on the scale that was centred; empty where it was not asked for."""
    if found is None:
        return ""
    if isinstance(found, str):
        return f"<p>No scale could be centred: {escape(found)}.</p>"
    done = found.done
    rows = []
    for number_of, step in enumerate(done.steps):
        length = step.reading.length
        low, high = length.interval()
        expected = "" if step.predicted is None else f"{step.predicted.interval()[1] * 1e6:.3f}"
        places = (f"{value * 1e6:.3f}" for value in (*step.command, length.value))
        between = f"{low * 1e6:.3f} to {high * 1e6:.3f}"
        rows.append(f"<tr>{cells((number_of, step.kind, *places, between, expected))}</tr>")
    titles = (
        "", "step", "x [µm]", "y [µm]", "eccentricity [µm]", "95 % interval", "predicted, at most",
    )  # fmt: skip
    table = captioned(
        table_html((f"<th>{title}</th>" for title in titles), rows),
        "Centring step by step; simulated.",
    )
    words = "Graduation error read by the first head before and after centring; simulated."
    plot = draw_polar(found.fits, found.angles)
    shown = drawn(plot, "polar", "scale before and after", words)
    target = "met" if done.reached else "not met"
    return (
        f"<p>A scale of {2e3 * SCALE_RADIUS:g} mm diameter, {ECCENTRICITY * 1e6:g} µm off the "
        f"axis of a virtual table, read by {len(HEADS)} heads with {HEAD_NOISE:g} arcsec of noise; "
        f"its own lines are off by {LINE_ERRORS:g} arcsec (rms). The stage turns with the table, "
        "mounted at an "
        "unknown angle and mirrored, which trial moves find out. Each command is approached from "
        "the low end of both axes. "
        f"True residual eccentricity: {found.left * 1e9:.2g} nm (target {target}: "
        f"{escape(done.reason)}).</p>{table}{row_of([shown])}"
    )
