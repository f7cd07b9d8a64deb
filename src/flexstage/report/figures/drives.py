"""Drives: working line of a stack with the line of its stage, and coupled drives."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.base.arrays import Array
from flexstage.report.figures.style import (
    CYCLE,
    DASHED,
    INK,
    LONG_DASHED,
    MUTED,
    UM,
    add_legend,
    label_axes,
    one_panel,
    panels,
    scale,
    set_title,
)
from flexstage.system.seated_drives import WorkingLine

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexstage.hysteresis.coupled_drives.identify import CoupledDriveIdentification
    from flexstage.hysteresis.coupled_drives.inverse import CoupledCommand
    from flexstage.hysteresis.coupled_drives.prediction import CoupledPredictions, PredictedModel


def draw_working_line(line: WorkingLine) -> "Figure":
    """Draw the line of a stack at full voltage, the load of the stage, and where they meet."""
    drive = line.drive
    figure, axes = one_panel(5.4, 3.6)
    top = max(line.drive.blocked_force, drive.stiffness * drive.free_stroke)
    axes.plot(
        [0.0, UM * drive.free_stroke], [drive.stiffness * drive.free_stroke, 0.0],
        color=CYCLE[0], linewidth=1.6, label="stack, full voltage",
    )  # fmt: skip
    axes.plot([0.0], [line.drive.blocked_force], "s", color=CYCLE[0], markersize=4.5,
              label="blocking force", clip_on=False)  # fmt: skip
    # twice the force at work, as far as the diagram shows
    force = np.linspace(0.0, min(2.0 * line.force, top), 81)
    load = line.force / line.stroke
    loads = "stage and spring" if line.preload_stiffness else "stage"
    way = np.array([f / load + line.seat_approach(float(f)) for f in force])
    label = f"{loads}, with seats" if drive.seats else loads
    axes.plot(UM * way, force, color=CYCLE[1], linewidth=1.6, label=label)
    if drive.seats:
        axes.plot(UM * force / load, force, color=CYCLE[1], linewidth=1.0, linestyle=DASHED,
                  label=loads)  # fmt: skip
    if line.preload_stiffness:
        axes.plot(UM * way, line.preload_stiffness * force / load, color=CYCLE[2], linewidth=1.0,
                  linestyle=LONG_DASHED, label="preload spring")  # fmt: skip
    at = UM * (line.stroke + line.seat_approach(line.force))
    axes.plot([at, at], [0.0, line.force], color=MUTED, linewidth=0.8, linestyle=DASHED)
    axes.plot([at], [line.force], "o", color=INK, markersize=5.0, zorder=4)
    axes.set_xlim(0.0, 1.05 * UM * drive.free_stroke)
    axes.set_ylim(0.0, 1.1 * top)
    label_axes(axes, "elongation of the stack [µm]", "force [N]")
    add_legend(axes, loc="upper right")
    set_title(
        axes,
        f"Working line of {drive.name}: {UM * line.stroke:.3g} µm of "
        f"{UM * drive.free_stroke:.3g} µm left,\n"
        f"at {line.force:.3g} N, {100.0 * line.force_share:.3g} % of the blocking force",
    )
    return figure


def draw_coupled_drives(result: "CoupledDriveIdentification") -> "Figure":
    """Draw the errors at each level, and the change of each natural frequency with the level."""
    figure, (left, right) = panels(9.6, 3.9, 2, 2)
    levels, model = result.levels, result.model
    unit, factor = scale(model.output_unit)
    rms = [level.input_rms for level in levels]
    lines = [
        ("outputs", [level.output_rms for level in levels], INK, "-"),
        ("linear system of each level", [level.linear_error for level in levels], CYCLE[0], "-"),
        ("one model of all levels", [level.error for level in levels], CYCLE[1], "-"),
        ("the same, held out", result.held_out or [np.nan] * len(levels), CYCLE[1], "--"),
        ("floor of linear systems", [level.floor for level in levels], MUTED, "--"),
        ("noise", [level.noise for level in levels], MUTED, ":"),
    ]
    for label, values, colour, style in lines:
        if np.isfinite(values).any():
            scaled = factor * np.array(values)
            left.plot(rms, scaled, style, color=colour, marker="o", markersize=3.5, label=label)
    left.set_yscale("log")
    left.set_ylim(top=8.0 * left.get_ylim()[1])  # the legend is above all lines
    label_axes(left, f"rms of an input [{model.input_unit}]", f"rms{unit}")
    set_title(left, "Outputs and errors")
    add_legend(left, loc="upper left", ncols=2)
    for k, level in enumerate(levels):
        shift = 100.0 * (level.frequency_hz / levels[0].frequency_hz - 1.0)
        label = f"{level.input_rms:.3g} {model.input_unit} rms"
        right.plot(
            level.frequency_hz, shift, "o", color=CYCLE[k % len(CYCLE)], markersize=4, label=label
        )
    label_axes(right, "natural frequency [Hz]", "change from the weakest level [%]")
    set_title(right, "Modes")
    add_legend(right)
    return figure


#: Samples that are drawn of a prediction: more than a period of the lowest mode of most stages.
_SAMPLES = 600


def draw_coupled_prediction(result: "CoupledPredictions") -> "Figure":
    """Draw the end of the first record: each output as measured, and its error."""
    prediction, model = result.predictions[0], result.model
    measured, end = prediction.measured, slice(-_SAMPLES, None)
    lines = {"measured": measured, "measured less predicted": measured - prediction.predicted}
    last = {label: values[end] for label, values in lines.items()}
    return _draw_outputs(prediction.time[end], last, model, prediction.source)


def draw_coupled_command(result: "CoupledCommand") -> "Figure":
    """Draw the reference of each output with its predicted error, and the commands."""
    lines = {
        "reference": result.reference,
        "predicted less reference": result.predicted - result.reference,
    }
    return _draw_outputs(result.time, lines, result.model, "", result)


def _draw_outputs(
    time: Array,
    lines: dict[str, Array],
    model: "PredictedModel",
    title: str,
    sent: "CoupledCommand | None" = None,
) -> "Figure":
    """Draw lines of all outputs, one diagram each, and the commands sent in a diagram below."""
    outputs = len(model.outputs)
    count = outputs + (sent is not None)
    figure, plots = panels(9.6, 0.6 + 1.7 * count, count, 1)
    unit, factor = scale(model.output_unit)
    for i, (axes, name) in enumerate(zip(plots, model.outputs, strict=False)):
        for (label, values), colour in zip(lines.items(), (INK, CYCLE[1]), strict=True):
            axes.plot(time, factor * values[:, i], color=colour, linewidth=1.0, label=label)
        label_axes(axes, "", f"{name}{unit}")
    add_legend(plots[0], loc="upper right", ncols=2)
    if sent is not None:
        for i, name in enumerate(sent.model.inputs):
            colour = CYCLE[i % len(CYCLE)]
            plots[-1].plot(time, sent.command[:, i], color=colour, linewidth=1.0, label=name)
        add_legend(plots[-1], loc="upper right", ncols=len(sent.model.inputs))
        label_axes(plots[-1], "", f"command [{sent.model.input_unit}]")
    plots[-1].set_xlabel("time [s]", fontsize=8.5)
    set_title(plots[0], title)
    return figure
