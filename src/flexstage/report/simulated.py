"""Sections of the report on the virtual stage: its hysteresis, its measurement, a scale centred."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

from flexstage.characteristic import measured_value
from flexstage.quantities import beside, display, number
from flexstage.report.figures.centring import draw_polar
from flexstage.report.figures.tracking import draw_compensation
from flexstage.report.page import fragment
from flexstage.section import Content, Picture, Pictures
from flexstage.stage import Stage
from flexstage.stage.assumptions import CREEP, POSITION_NOISE
from flexstage.studies.measurement import MeasurementComparison
from flexstage.studies.virtual_experiments import (
    ECCENTRICITY,
    HEAD_NOISE,
    HEADS,
    LINE_ERRORS,
    SCALE_RADIUS,
    CentringTrial,
)
from flexstage.table import Column, Table, table

if TYPE_CHECKING:
    from flexstage.estimate import Estimate
    from flexstage.hysteresis.loops import Tracking
    from flexstage.studies.compensation import AxisExperiment
    from flexstage.studies.study import Study

_UM = 1e6
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


def hysteresis_section(study: "Study") -> Iterator[Content]:
    """Show the experiment on hysteresis, with what is published of the stage.

    Nothing where no axis has a piezo stack.
    """
    if study.experiments:
        yield fragment("hysteresis.html", creep=100.0 * CREEP, noise=1e9 * POSITION_NOISE)
        yield _deviations(study.stage, study.experiments)
        yield _loops(study.stage, study.experiments)
        shown = Picture(
            result=partial(draw_compensation, study.experiments),
            title="loops without and with the inverse",
            caption="Simulated stage. Left: loop over the full range of the voltage and the "
            "identified Bouc-Wen model, below their difference. Middle: output over the reference. "
            "Right: error over time.",
        )
        yield Pictures(shown=(shown,))
    for axis, why in study.experiments_left_out.items():
        yield f"Axis {axis} was left out: {why}."


def _deviations(stage: Stage, experiments: "Mapping[str, AxisExperiment]") -> str:
    words = []
    for axis, made in experiments.items():
        published = measured_value(stage.published, "hysteresis_deviation", axis)
        printed = "" if published is None else f" (published: {_UM * published:.10g} µm)"
        words.append(f"{_UM * made.deviation:.2f} µm in {axis}{printed}")
    return f"The identified Bouc-Wen model is within {', '.join(words)} of the loop."


def _loops(stage: Stage, experiments: "Mapping[str, AxisExperiment]") -> Table:
    rows = []
    for axis, made in experiments.items():
        rows.append(_loop(f"{axis}, open loop", made.open_loop.loop_width, None, made.open_loop))
        rows += [
            _loop(
                f"{axis}, inverse of {run.title}",
                run.tracking.loop_width,
                run.reduction_percent,
                run.tracking,
            )
            for run in made.runs
        ]
        width = measured_value(stage.published, "hysteresis_loop_width", axis)
        left = measured_value(stage.published, "compensated_loop_width", axis)
        if width is not None:
            rows.append(_loop(f"{axis}, published, open loop", width, None, None))
        if width is not None and left is not None:
            reduction = 100.0 * (1.0 - left / width)
            title = f"{axis}, published, inverse of Bouc-Wen"
            rows.append(_loop(title, left, reduction, None))
    heads = (
        Column("", "title"), "loop width [µm]", "narrowed by [%]", "error [nm rms]",
        "largest error [nm]",
    )  # fmt: skip
    caption = (
        "Loop widths and errors over the reference, which runs over 99 % of the stroke; the loop "
        "at full range is a little wider. Published rows were measured by the study."
    )
    return table(caption, heads, rows)


def _loop(
    title: str, width: float, reduction: float | None, errors: "Tracking | None"
) -> tuple[str, ...]:
    return (
        title,
        f"{_UM * width:.2f}",
        "" if reduction is None else f"{reduction:.1f}",
        "" if errors is None else number(1e3 * _UM * errors.rms, 3),
        "" if errors is None else number(1e3 * _UM * errors.largest, 3),
    )


def bench_section(found: MeasurementComparison | str | None, file: str) -> Iterator[Content]:
    """Show half a page on the simulated measurement, where there is one.

    The file is the name of the page that it has of its own, beside this one.
    """
    if isinstance(found, str):
        yield f"The virtual stage could not be measured: {found}."
    elif found is not None:
        yield fragment("bench.html", file=file)
        yield from _main_figures(found)
        yield Pictures(shown=tuple(_resonances(found)), columns=2)


def _main_figures(found: MeasurementComparison) -> Iterator[Table]:
    """A row for each main quantity, a column for each axis."""
    main = [row for row in found.rows if row.figure.quantity in _MAIN]
    figures = [row.figure for row in main if not row.assumed]
    axes = list(dict.fromkeys(figure.axis for figure in figures))
    rows = []
    for quantity in _MAIN:
        of = {f.axis: f.estimate for f in figures if f.quantity == quantity}
        if of:
            shown = display(quantity).fitting(max(abs(e.value) for e in of.values()))
            values = (_with_spread(of[a], shown.factor) if a in of else "–" for a in axes)
            rows.append((shown.heading, *values))
    if rows:
        caption = "Simulated measurement: main figures, ± at 95 % with all contributions."
        if len(figures) < len(main):
            caption += " Straightness that nobody has measured is assumed, and left out."
        yield table(caption, ("Quantity", *(Column(axis) for axis in axes)), rows)


def _with_spread(estimate: "Estimate", factor: float) -> str:
    value, spread = beside(factor * estimate.value, factor * estimate.expanded)
    return f"{value} ± {spread}"


def _resonances(found: MeasurementComparison) -> Iterator[Picture]:
    published = () if found.stage is None else found.stage.published
    estimates = {(r.figure.quantity, r.figure.axis): r.figure.estimate for r in found.rows}
    for result in found.found.results:
        fit = result.details.get("fit")
        if fit is None or not fit.modes:
            continue
        axis = result.test.axis
        known = measured_value(published, "natural_frequency_hz", axis)
        agree = (
            " The simulated stage is set to the published value, so that both agree."
            if known is not None
            else ""
        )
        yield Picture(
            result=fit,
            view="resonance",
            title=f"resonance of {axis}",
            caption=f"Response of {axis}, simulated measurement.{agree}",
            options={
                "axis": axis,
                "label": "simulated measurement",
                "frequency_hz": estimates.get(("natural_frequency_hz", axis)),
                "published_hz": known,
            },
        )


def centring_section(found: CentringTrial | str | None) -> Iterator[Content]:
    """Show the scale that was centred, where that was asked for."""
    if found is None:
        return
    if isinstance(found, str):
        yield f"No scale could be centred: {found}."
        return
    done = found.done
    rows = []
    for count, step in enumerate(done.steps):
        length = step.reading.length
        low, high = length.interval()
        expected = "" if step.predicted is None else f"{step.predicted.interval()[1] * 1e6:.3f}"
        places = (f"{value * 1e6:.3f}" for value in (*step.command, length.value))
        between = f"{low * 1e6:.3f} to {high * 1e6:.3f}"
        rows.append((count, step.kind, *places, between, expected))
    target = "met" if done.reached else "not met"
    yield (
        f"A scale of {2e3 * SCALE_RADIUS:g} mm diameter, {ECCENTRICITY * 1e6:g} µm off the axis of "
        f"a virtual table, read by {len(HEADS)} heads with {HEAD_NOISE:g} arcsec of noise; its own "
        f"lines are off by {LINE_ERRORS:g} arcsec (rms). The stage turns with the table, mounted "
        "at an unknown angle and mirrored, which trial moves find out. Each command is approached "
        f"from the low end of both axes. True residual eccentricity: {found.left * 1e9:.2g} nm "
        f"(target {target}: {done.reason})."
    )
    heads = (
        "", "step", "x [µm]", "y [µm]", "eccentricity [µm]", "95 % interval", "predicted, at most",
    )  # fmt: skip
    yield table("Centring step by step; simulated.", heads, rows)
    words = "Graduation error read by the first head before and after centring; simulated."
    draw = partial(draw_polar, found.fits, found.angles)
    yield Pictures(shown=(Picture(result=draw, title="scale before and after", caption=words),))
