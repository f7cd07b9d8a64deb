"""Experiments on the virtual stage that a study shows: it is measured, and centres a scale."""

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.arrays import Array
from flexstage.characteristic import Characteristics, measured_value
from flexstage.errors import FlexstageError
from flexstage.quantities import beside, display
from flexstage.report.figures.centring import draw_polar
from flexstage.report.figures.modal_fit import draw_resonance
from flexstage.report.measurement import MeasurementComparison, compare_with_references
from flexstage.report.page import captioned, cells, drawn, row_of, table_html

if TYPE_CHECKING:
    from flexstage.centring.harmonic_fit import HarmonicFit
    from flexstage.centring.procedure import Centring
    from flexstage.estimate import Estimate
    from flexstage.stage import Stage

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

#: The scale that is centred: where it is read [m], how far it is off at first [m], and its heads.
_RADIUS, _OFF = 50e-3, 50e-6
_HEADS = (0.0, 1.6, 3.1, 4.8)
#: Noise of a head, and errors of the lines of the scale [arcsec].
_NOISE, _LINES = 1.0, 2.0
#: Direction that the scale is off in, in the axes of the stage: one that both can push [rad].
_DIRECTION = 0.8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentringTrial:
    """A scale that was centred on the virtual table."""

    done: "Centring"
    """The procedure, step by step."""
    left: float
    """Eccentricity that is truly left [m]."""
    fits: "tuple[HarmonicFit, HarmonicFit]"
    """Readings of the first head before and after."""
    angles: tuple[Array, Array]
    """Angles of their samples [rad]."""


def run_measurement(stage: "Stage", *, seed: int) -> MeasurementComparison | str:
    """Measure a virtual stage; a text says why that could not be done.

    It is made from published values and random errors, so that its figures are compared with none.
    The seed is that of the virtual stage and of its measurement.
    """
    from flexstage.experiment.campaign.evaluate import evaluate
    from flexstage.experiment.virtual.as_built import as_built
    from flexstage.experiment.virtual.campaign import virtual_campaign

    try:
        made = virtual_campaign(as_built(stage, seed=seed), seed=seed)
        found = evaluate(made.campaign, lambda test: [made.records[n] for n in test.records])
    except FlexstageError as error:
        return str(error)
    return compare_with_references(found, stage, Characteristics())


def run_centring(stage: "Stage", *, seed: int) -> CentringTrial | str:
    """Centre a scale with the virtual stage on a virtual table; a text says why it failed.

    The seed is that of noise and of the lines of the scale.
    """
    from flexstage.centring import ARCSEC, fit_harmonics
    from flexstage.centring.positioner import VirtualPositioner
    from flexstage.centring.procedure import centre
    from flexstage.centring.rotary_table import VirtualBench
    from flexstage.centring.virtual_table import VirtualTable, scale_errors

    try:
        positioner = VirtualPositioner(
            stage, start=(-1.0, -1.0), mounting_angle=0.7, mirrored=True, seed=seed
        )
        towards = positioner.matrix @ np.array((np.cos(_DIRECTION), np.sin(_DIRECTION)))
        mount = -_OFF * towards / np.hypot(*towards) - positioner.true_position
        table = VirtualTable(
            radius=_RADIUS,
            heads=_HEADS,
            eccentricity=(float(mount[0]), float(mount[1])),
            noise=_NOISE * ARCSEC,
            scale=scale_errors(range(2, 20), _LINES * ARCSEC, seed=seed),
            seed=seed,
        )
        bench = VirtualBench(table, positioner)

        def turn(index: int) -> tuple[Array, Any]:
            x, y = positioner.true_position
            record = table.moved(float(x), float(y)).record(index=index)
            angle, error = (channel.values for channel in record.channels[:2])
            return angle, fit_harmonics(angle, error, orders=12)

        before = turn(1000)
        done = centre(bench, positioner)
        after = turn(1001)
    except FlexstageError as error:
        return str(error)
    return CentringTrial(
        done=done,
        left=float(np.hypot(*bench.true_eccentricity)),
        fits=(before[1], after[1]),
        angles=(before[0], after[0]),
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
        f"<p>A scale of {2e3 * _RADIUS:g} mm diameter, {_OFF * 1e6:g} µm off the axis of a "
        f"virtual table, read by {len(_HEADS)} heads with {_NOISE:g} arcsec of noise; its own "
        f"lines are off by {_LINES:g} arcsec (rms). The stage turns with the table, mounted at an "
        "unknown angle and mirrored, which trial moves find out. Each command is approached from "
        "the low end of both axes. "
        f"True residual eccentricity: {found.left * 1e9:.2g} nm (target {target}: "
        f"{escape(done.reason)}).</p>{table}{row_of([shown])}"
    )


def centring_results(found: CentringTrial | str | None) -> dict[str, Any]:
    """Return what is left of the eccentricity [m] and every step as plain data; or why not."""
    if found is None:
        return {}
    if isinstance(found, str):
        return {"left_out": found}
    return {
        "kind": "virtual experiment",
        "left": found.left,
        "reached": found.done.reached,
        "reason": found.done.reason,
        "steps": [
            {
                "kind": step.kind,
                "command": list(step.command),
                "eccentricity": step.reading.length.value,
                "interval": list(step.reading.length.interval()),
                "predicted": None if step.predicted is None else step.predicted.value,
            }
            for step in found.done.steps
        ],
    }
