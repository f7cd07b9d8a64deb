"""Tracking of references: simulated with the inverse model, in a plan, and by a command."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from flexstage.base.arrays import Array
from flexstage.quantities.units import readable, readable_unit
from flexstage.report.figures.responses import shown_lines, thinned
from flexstage.report.figures.style import (
    CYCLE,
    DASHED,
    LONG_DASHED,
    MUTED,
    NM,
    UM,
    add_legend,
    new_figure,
    one_panel,
    panels,
    scale,
    set_title,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.control.moves import MoveResponse
    from flexstage.experiments.verbs.identify import IdentifiedStep
    from flexstage.experiments.verbs.verify import FollowedRun, VerifiedStep
    from flexstage.hysteresis import DriveModel, Feedforward
    from flexstage.studies.compensation import AxisExperiment
    from flexstage.studies.settling import SettlingStudy


#: A curve with its colour and its label in the legend.
_Curve = tuple[Array, Array, str, str]


def draw_compensation(experiments: "Mapping[str, AxisExperiment]") -> "Figure":
    """Draw the experiments of identification and compensation, a row for each axis.

    Simulated and modelled loop, with their difference; the loop over the reference without and with
    the inverse; and the tracking error over time.
    """
    figure = new_figure(10.6, 3.5 * len(experiments))
    grid = figure.add_gridspec(
        2 * len(experiments), 3, width_ratios=(1.0, 1.0, 1.15),
        height_ratios=(2.4, 1.0) * len(experiments),
    )  # fmt: skip
    for i, (name, experiment) in enumerate(experiments.items()):
        rows = slice(2 * i, 2 * i + 2)
        loop = figure.add_subplot(grid[2 * i, 0])
        loops = (experiment.voltage, UM * experiment.measured, UM * experiment.modelled)
        _loop(loop, loops, ("simulated stage", "Bouc-Wen"), (2.2, 0.9))
        loop.tick_params(labelbottom=False)
        loop.set_ylabel(f"{name} [µm]")
        deviation = (
            f"{UM * experiment.width:.2f} µm wide, model within {UM * experiment.deviation:.2f} µm"
        )
        set_title(loop, f"{name}: {deviation}")
        residual = figure.add_subplot(grid[2 * i + 1, 0], sharex=loop)
        _about_zero(
            residual, experiment.voltage, UM * (experiment.measured - experiment.modelled), 0.8
        )
        residual.set(xlabel="voltage [V]", ylabel="residual [µm]")
        _loops_of(figure.add_subplot(grid[rows, 1]), experiment)
        over = figure.add_subplot(grid[rows, 2])
        errors = [
            (
                experiment.time,
                UM * (run.output - experiment.reference),
                colour,
                f"{run.title}: {1e3 * UM * run.tracking.rms:.0f} nm rms, "
                f"{1e3 * UM * run.tracking.largest:.0f} nm at most",
            )
            for run, colour in zip(experiment.runs, _INVERSES, strict=False)
        ]
        _over_time(over, errors, 1.6)
        over.set(xlabel="time [s]", ylabel="output − reference [µm]")
        set_title(over, "tracking error")
    return figure


def draw_loop(experiment: "AxisExperiment") -> "Figure":
    """Draw the loop of one axis over its reference, without and with the inverse."""
    figure, axes = one_panel(5.0, 2.8)
    _loops_of(axes, experiment)
    set_title(axes, f"{experiment.axis}: open loop and with the inverse, simulated")
    return figure


def _loops_of(axes: "Axes", experiment: "AxisExperiment") -> None:
    reference = UM * experiment.reference
    width = f"open loop, {UM * experiment.open_loop.loop_width:.2f} µm"
    curves = [(reference, UM * experiment.open_output, CYCLE[1], width)]
    curves += [
        (reference, UM * run.output, c, f"{run.title}, {UM * run.tracking.loop_width:.2f} µm")
        for run, c in zip(experiment.runs, _INVERSES, strict=False)
    ]
    _over_reference(axes, curves)
    share = np.ptp(experiment.reference) / experiment.stroke
    set_title(axes, f"without and with inverse, {100.0 * share:.0f} % of the stroke")


def _loop(
    axes: "Axes",
    loops: tuple[Array, Array, Array],
    labels: tuple[str, str],
    widths: tuple[float, float],
) -> None:
    """Draw a measured and a modelled loop over the voltage."""
    style_axes(axes)
    voltage, measured, modelled = loops
    axes.plot(voltage, measured, color=CYCLE[1], linewidth=widths[0], label=labels[0])
    look = {"color": CYCLE[0], "linewidth": widths[1], "linestyle": DASHED, "label": labels[1]}
    axes.plot(voltage, modelled, **look)
    add_legend(axes, loc="upper left")


def _about_zero(axes: "Axes", x: Array, residual: Array, width: float) -> None:
    style_axes(axes)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.plot(x, residual, color=CYCLE[0], linewidth=width)


def _over_reference(axes: "Axes", curves: Iterable[_Curve]) -> None:
    style_axes(axes)
    for reference, output, colour, label in curves:
        axes.plot(reference, output, color=colour, linewidth=0.9, label=label)
    axes.set(xlabel="reference [µm]", ylabel="output [µm]")
    add_legend(axes, loc="upper left", size=7.0)


def _over_time(axes: "Axes", curves: Sequence[_Curve], head: float) -> None:
    """Draw errors over time, with room for the legend: `head` times the largest of them."""
    style_axes(axes)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    for time, error, colour, label in curves:
        axes.plot(time, error, color=colour, linewidth=0.7, label=label)
    top = max((float(np.abs(error).max()) for _, error, _, _ in curves), default=0.0)
    axes.set_ylim(-1.1 * top, head * top)
    if curves:
        axes.set_xlim(curves[0][0][0], max(float(time[-1]) for time, _, _, _ in curves))
    add_legend(axes, loc="upper left", size=7.0)


#: Colour of each inverse, and of each control mode, the same in every figure.
_INVERSES = (CYCLE[0], CYCLE[2], CYCLE[3], CYCLE[4])
_COLOURS = {
    "open loop": CYCLE[1],
    "inverse": CYCLE[0],
    "feedback": CYCLE[2],
    "both": CYCLE[3],
    "learning": CYCLE[4],
}


def draw_following(step: "VerifiedStep") -> "Figure":
    """Draw the tracking of a reference in each control mode.

    Output over reference; tracking error over time, without the open loop if there is another mode;
    and the error of each trial of learning.
    """
    learned = [run for run in step.runs if len(run.errors) > 1]
    count, ratios = (3, (1.0, 1.3, 0.7)) if learned else (2, (1.0, 1.5))
    figure, (loops, errors, *trials) = panels(10.6, 3.4, count, count, width_ratios=ratios)
    _over_reference(
        loops,
        (
            (
                UM * run.reference[at],
                UM * run.output[at],
                _COLOURS[run.mode],
                f"{run.mode}, loop {_length(run.tracking.loop_width)}",
            )
            for run in step.runs
            for at in (thinned(0, run.time.size),)
        ),
    )
    set_title(loops, f"{step.axis}: {UM * step.stroke:.3g} µm at {step.rate_hz:g} Hz")
    runs = [run for run in step.runs if run.mode != "open loop"] or list(step.runs)
    _over_time(errors, [_error(run) for run in runs], 1.25 + 0.15 * len(runs))
    errors.set_xlim(0.0, max(float(np.ptp(run.time)) for run in runs))
    errors.set(xlabel="time [s]", ylabel="reading − reference [nm]")
    set_title(errors, "tracking error")
    for axes in trials:
        _trials(axes, learned[0])
    return figure


def _error(run: "FollowedRun") -> _Curve:
    at = thinned(0, run.time.size)
    label = f"{run.mode}: {_length(run.tracking.rms)} rms, {_length(run.tracking.largest)} at most"
    error = NM * (run.output - run.reference)[at]
    return run.time[at] - run.time[0], error, _COLOURS[run.mode], label


def _trials(axes: "Axes", run: "FollowedRun") -> None:
    from matplotlib.ticker import MaxNLocator, ScalarFormatter

    errors = NM * np.asarray(run.errors)
    axes.plot(np.arange(errors.size), errors, "o-", color=_COLOURS["learning"], markersize=4)
    axes.set_yscale("log")
    for axis in ("set_major_formatter", "set_minor_formatter"):
        getattr(axes.yaxis, axis)(ScalarFormatter())
    axes.tick_params(axis="y", which="minor", labelsize=7)
    axes.set(xlabel="trial", ylabel="error [nm rms]")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    set_title(axes, "learning")


def draw_drive_fit(step: "IdentifiedStep") -> "Figure":
    """Draw a record and its identified model over voltage, and the residual over time."""
    figure, (left, right) = panels(10.6, 3.2, 2, 2, width_ratios=(1.0, 1.5))
    at = thinned(0, step.time.size)
    loops = (step.voltage[at], UM * step.measured[at], UM * step.modelled[at])
    _loop(left, loops, ("reading", step.kind), (1.8, 0.8))
    left.set(xlabel="voltage [V]", ylabel=f"{step.axis} [µm]")
    set_title(left, f"{step.name}: {step.kind} on axis {step.axis}")
    _about_zero(right, step.time[at], NM * (step.measured - step.modelled)[at], 0.6)
    # grey: the part that still depends on the history before the record
    right.axvspan(step.time[0], step.settled, color=MUTED, alpha=0.18, linewidth=0.0)
    right.set(xlabel="time [s]", ylabel="reading − model [nm]")
    set_title(right, f"model error, {_length(step.deviation)} at most after the grey part")
    return figure


def _length(value: float) -> str:
    if abs(value) < 0.995e-6:
        return f"{NM * value:.3g} nm"
    return f"{UM * value:.3g} µm"


def draw_feedforward(
    feedforward: "Feedforward", model: "DriveModel", band_percent: float | None = None
) -> "Figure":
    """Draw the command over time and over the reference, and the predicted error.

    `band_percent` is half the width of the band of 95 % of the held-out errors of the model,
    relative to its stroke [%]: the deviation of a measured drive from its model.
    """
    figure = new_figure(10.2, 4.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1.0))
    above = figure.add_subplot(grid[0, 0])
    _command(above, feedforward, model)
    _command_error(figure.add_subplot(grid[1, 0], sharex=above), feedforward, model, band_percent)
    _command_loop(figure.add_subplot(grid[:, 1]), feedforward, model)
    return figure


def _command(axes: "Axes", feedforward: "Feedforward", model: "DriveModel") -> None:
    style_axes(axes)
    at = shown_lines(feedforward.command)
    axes.plot(
        feedforward.time[at],
        feedforward.command[at],
        color=CYCLE[0],
        linewidth=1.0,
        label="command",
    )
    axes.set_ylabel(f"command{scale(model.input_unit)[0]}")
    axes.tick_params(labelbottom=False)
    axes.set_xlim(feedforward.time[0], feedforward.time[-1])
    low, high = float(feedforward.command.min()), float(feedforward.command.max())
    range_text = readable(model.input_unit, low, high, digits=4)
    set_title(axes, f"{feedforward.time.size} samples, {range_text}")


def _command_error(
    axes: "Axes", feedforward: "Feedforward", model: "DriveModel", band_percent: float | None
) -> None:
    style_axes(axes)
    error = feedforward.predicted - feedforward.requested
    band = 0.0
    if band_percent is not None and model.validity is not None:
        low, high = model.validity.output_range
        band = 0.01 * band_percent * (high - low)
    unit, factor = readable_unit(max(feedforward.largest_error, band), model.output_unit)
    at = shown_lines(error)
    if band:
        axes.axhspan(
            -factor * band, factor * band, color=CYCLE[0], alpha=0.12, linewidth=0.0,
            label="95 % of the model's held-out errors",
        )  # fmt: skip
    axes.plot(
        feedforward.time[at], factor * error[at], color=CYCLE[1], linewidth=0.8, label="predicted"
    )
    top = factor * max(feedforward.largest_error, band)
    axes.set_ylim(-1.15 * top or -1.0, 1.6 * top or 1.0)
    add_legend(axes, loc="upper right", ncols=2)
    axes.set_xlabel("time [s]")
    unit_text = f" [{unit.replace('um', 'µm')}]" if unit else ""
    axes.set_ylabel(f"predicted − desired{unit_text}")
    axes.set_xlim(feedforward.time[0], feedforward.time[-1])


def _command_loop(axes: "Axes", feedforward: "Feedforward", model: "DriveModel") -> None:
    style_axes(axes)
    unit, factor = scale(model.output_unit)
    at = np.unique(
        np.concatenate((shown_lines(feedforward.command), shown_lines(feedforward.requested)))
    )
    axes.plot(
        factor * feedforward.requested[at],
        feedforward.command[at],
        color=CYCLE[0],
        linewidth=0.9,
        label="command",
    )
    ends = [int(feedforward.requested.argmin()), int(feedforward.requested.argmax())]
    axes.plot(
        factor * feedforward.requested[ends], feedforward.command[ends], color=MUTED, linewidth=0.8,
        linestyle=LONG_DASHED, label="linear",
    )  # fmt: skip
    axes.set(xlabel=f"desired{unit}", ylabel=f"command{scale(model.input_unit)[0]}")
    add_legend(axes, loc="upper left")
    set_title(axes, "compensating loop")


def draw_settling(study: "SettlingStudy") -> "Figure":
    """Draw the largest distance from the end that is still to come, for each move.

    Open loop on the left, with feedback on the right; predictions are thin, simulations wide and
    pale.
    """
    figure, diagrams = panels(10.6, 4.2, 2, 2, sharey=True)
    for axes, feedback in zip(diagrams, (False, True), strict=True):
        for move, (colour, line) in zip(study.moves, _MOVES, strict=True):
            times = move.feedback if feedback else move.open_loop
            if times is not None:
                look = {"color": colour, "linestyle": line}
                axes.plot(*_approach(times.motion), linewidth=1.1, label=move.kind, **look)
                time, away = _approach(times.simulation)
                axes.plot(time, away, linewidth=2.6, alpha=0.35, **look)
        axes.axhline(NM * study.band, color=MUTED, linewidth=0.8, linestyle=DASHED)
        axes.set(xscale="log", yscale="log", xlabel="time [ms]")
        axes.set_xlim(left=1e3 * min(m.duration for m in study.moves if m.open_loop))
        axes.set_ylim(0.1 * NM * study.band, 2.0 * NM * study.distance)
    set_title(diagrams[0], "open loop, without creep")
    set_title(diagrams[1], "with feedback and creep")
    diagrams[0].set(ylabel="distance from the end [nm]")
    add_legend(diagrams[1], loc="upper right")
    return figure


#: Colour and line of each kind of move.
_MOVES = (*((c, "-") for c in CYCLE[:5]), *((c, DASHED) for c in CYCLE[:3]))


def _approach(motion: "MoveResponse") -> tuple[Array, Array]:
    """Return times [ms] and the largest distance from the end from then on [nm]."""
    away = np.abs(motion.position - motion.end)
    time, late = motion.time[1:], np.maximum.accumulate(away[::-1])[::-1][1:]
    # thinned evenly in the logarithm
    at = np.unique(np.geomspace(1, time.size, 600).astype(np.intp)) - 1
    return 1e3 * time[at], NM * late[at]
