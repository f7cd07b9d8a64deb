"""References that a stage follows: virtual with the inverse, by a plan, and by a command alone."""

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
    dress,
    entitle,
    new_figure,
    one_panel,
    panels,
    scale,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.experiments.verbs.identify import IdentifiedStep
    from flexstage.experiments.verbs.verify import FollowedRun, VerifiedStep
    from flexstage.hysteresis import DriveModel, Feedforward
    from flexstage.studies.compensation import AxisExperiment


#: A curve with its colour and what the legend says of it.
_Curve = tuple[Array, Array, str, str]


def draw_compensation(experiments: "Mapping[str, AxisExperiment]") -> "Figure":
    """Draw the experiment of identification and compensation, a row for each axis.

    Simulated and modelled loop, with their difference; the loop over the reference without and with
    the inverse; and the difference from the reference over time.
    """
    figure = new_figure(10.6, 3.5 * len(experiments))
    grid = figure.add_gridspec(
        2 * len(experiments), 3, width_ratios=(1.0, 1.0, 1.15),
        height_ratios=(2.4, 1.0) * len(experiments),
    )  # fmt: skip
    for i, (name, made) in enumerate(experiments.items()):
        rows = slice(2 * i, 2 * i + 2)
        loop = figure.add_subplot(grid[2 * i, 0])
        loops = (made.voltage, UM * made.measured, UM * made.modelled)
        _loop(loop, loops, ("virtual stage", "Bouc-Wen"), (2.2, 0.9))
        loop.tick_params(labelbottom=False)
        loop.set_ylabel(f"{name} [µm]")
        deviation = f"{UM * made.width:.2f} µm wide, model within {UM * made.deviation:.2f} µm"
        entitle(loop, f"{name}: {deviation}")
        rest = figure.add_subplot(grid[2 * i + 1, 0], sharex=loop)
        _about_zero(rest, made.voltage, UM * (made.measured - made.modelled), 0.8)
        rest.set(xlabel="voltage [V]", ylabel="residual [µm]")
        _loops_of(figure.add_subplot(grid[rows, 1]), made)
        over = figure.add_subplot(grid[rows, 2])
        errors = [
            (
                made.time,
                UM * (run.output - made.reference),
                colour,
                f"{run.title}: {1e3 * UM * run.tracking.rms:.0f} nm rms, "
                f"{1e3 * UM * run.tracking.largest:.0f} nm at most",
            )
            for run, colour in zip(made.runs, _INVERSES, strict=False)
        ]
        _over_time(over, errors, 1.6)
        over.set(xlabel="time [s]", ylabel="output less reference [µm]")
        entitle(over, "error that the loop's width hides")
    return figure


def draw_loop(made: "AxisExperiment") -> "Figure":
    """Draw the loop of one axis over its reference, without and with the inverse."""
    figure, axes = one_panel(5.0, 2.8)
    _loops_of(axes, made)
    entitle(axes, f"{made.axis}: open loop and with the inverse, simulated")
    return figure


def _loops_of(axes: "Axes", made: "AxisExperiment") -> None:
    reference = UM * made.reference
    width = f"open loop, {UM * made.open_loop.loop_width:.2f} µm"
    curves = [(reference, UM * made.open_output, CYCLE[1], width)]
    curves += [
        (reference, UM * run.output, c, f"{run.title}, {UM * run.tracking.loop_width:.2f} µm")
        for run, c in zip(made.runs, _INVERSES, strict=False)
    ]
    _over_reference(axes, curves)
    share = np.ptp(made.reference) / made.stroke
    entitle(axes, f"without and with inverse, {100.0 * share:.0f} % of the stroke")


def _loop(
    axes: "Axes",
    loops: tuple[Array, Array, Array],
    labels: tuple[str, str],
    widths: tuple[float, float],
) -> None:
    """Draw a measured and a modelled loop over the voltage."""
    dress(axes)
    voltage, measured, modelled = loops
    axes.plot(voltage, measured, color=CYCLE[1], linewidth=widths[0], label=labels[0])
    look = {"color": CYCLE[0], "linewidth": widths[1], "linestyle": DASHED, "label": labels[1]}
    axes.plot(voltage, modelled, **look)
    add_legend(axes, loc="upper left")


def _about_zero(axes: "Axes", x: Array, rest: Array, width: float) -> None:
    dress(axes)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.plot(x, rest, color=CYCLE[0], linewidth=width)


def _over_reference(axes: "Axes", curves: Iterable[_Curve]) -> None:
    dress(axes)
    for reference, output, colour, label in curves:
        axes.plot(reference, output, color=colour, linewidth=0.9, label=label)
    axes.set(xlabel="reference [µm]", ylabel="output [µm]")
    add_legend(axes, loc="upper left", size=7.0)


def _over_time(axes: "Axes", curves: Sequence[_Curve], head: float) -> None:
    """Draw errors over time, with room for the legend: `head` times the largest of them."""
    dress(axes)
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
    """Draw how a reference was followed in each way.

    Output over reference; output less reference over time, without the open loop where there is
    another way; and the error of each trial where something was learned.
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
    entitle(loops, f"{step.axis}: {UM * step.stroke:.3g} µm at {step.rate_hz:g} Hz")
    shown = [run for run in step.runs if run.mode != "open loop"] or list(step.runs)
    _over_time(errors, [_error(run) for run in shown], 1.25 + 0.15 * len(shown))
    errors.set_xlim(0.0, max(float(np.ptp(run.time)) for run in shown))
    errors.set(xlabel="time [s]", ylabel="reading less reference [nm]")
    entitle(errors, "error, which the width of a loop hides in part")
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
    entitle(axes, "learning")


def draw_drive_fit(step: "IdentifiedStep") -> "Figure":
    """Draw a record and the model identified from it, over voltage, and its rest over time."""
    figure, (left, right) = panels(10.6, 3.2, 2, 2, width_ratios=(1.0, 1.5))
    at = thinned(0, step.time.size)
    loops = (step.voltage[at], UM * step.measured[at], UM * step.modelled[at])
    _loop(left, loops, ("reading", step.kind), (1.8, 0.8))
    left.set(xlabel="voltage [V]", ylabel=f"{step.axis} [µm]")
    entitle(left, f"{step.name}: {step.kind} on axis {step.axis}")
    _about_zero(right, step.time[at], NM * (step.measured - step.modelled)[at], 0.6)
    # what is drawn in grey still remembers what was before the record
    right.axvspan(step.time[0], step.settled, color=MUTED, alpha=0.18, linewidth=0.0)
    right.set(xlabel="time [s]", ylabel="reading less model [nm]")
    entitle(right, f"model error, {_length(step.deviation)} at most after the grey part")
    return figure


def _length(value: float) -> str:
    if abs(value) < 0.995e-6:
        return f"{NM * value:.3g} nm"
    return f"{UM * value:.3g} µm"


def draw_feedforward(
    made: "Feedforward", model: "DriveModel", band_percent: float | None = None
) -> "Figure":
    """Draw the command over time and over the reference, and what its prediction leaves.

    The band is half the width of that which holds 95 % of the held-out errors of the model, over
    its stroke [%]: so far a measured drive is away from its model.
    """
    figure = new_figure(10.2, 4.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1.0))
    above = figure.add_subplot(grid[0, 0])
    _command(above, made, model)
    _command_error(figure.add_subplot(grid[1, 0], sharex=above), made, model, band_percent)
    _command_loop(figure.add_subplot(grid[:, 1]), made, model)
    return figure


def _command(axes: "Axes", made: "Feedforward", model: "DriveModel") -> None:
    dress(axes)
    at = shown_lines(made.command)
    axes.plot(made.time[at], made.command[at], color=CYCLE[0], linewidth=1.0, label="command")
    axes.set_ylabel(f"command{scale(model.input_unit)[0]}")
    axes.tick_params(labelbottom=False)
    axes.set_xlim(made.time[0], made.time[-1])
    low, high = float(made.command.min()), float(made.command.max())
    shown = readable(model.input_unit, low, high, digits=4)
    entitle(axes, f"{made.time.size} samples, {shown}")


def _command_error(
    axes: "Axes", made: "Feedforward", model: "DriveModel", band_percent: float | None
) -> None:
    dress(axes)
    error = made.predicted - made.wanted
    band = 0.0
    if band_percent is not None and model.validity is not None:
        low, high = model.validity.output_range
        band = 0.01 * band_percent * (high - low)
    unit, factor = readable_unit(max(made.largest_error, band), model.output_unit)
    at = shown_lines(error)
    if band:
        axes.axhspan(
            -factor * band, factor * band, color=CYCLE[0], alpha=0.12, linewidth=0.0,
            label="95 % of the model's held-out errors",
        )  # fmt: skip
    axes.plot(made.time[at], factor * error[at], color=CYCLE[1], linewidth=0.8, label="predicted")
    top = factor * max(made.largest_error, band)
    axes.set_ylim(-1.15 * top or -1.0, 1.6 * top or 1.0)
    add_legend(axes, loc="upper right", ncols=2)
    axes.set_xlabel("time [s]")
    shown = f" [{unit.replace('um', 'µm')}]" if unit else ""
    axes.set_ylabel(f"predicted less wanted{shown}")
    axes.set_xlim(made.time[0], made.time[-1])


def _command_loop(axes: "Axes", made: "Feedforward", model: "DriveModel") -> None:
    dress(axes)
    unit, factor = scale(model.output_unit)
    at = np.unique(np.concatenate((shown_lines(made.command), shown_lines(made.wanted))))
    axes.plot(
        factor * made.wanted[at], made.command[at], color=CYCLE[0], linewidth=0.9, label="command"
    )
    ends = [int(made.wanted.argmin()), int(made.wanted.argmax())]
    axes.plot(
        factor * made.wanted[ends], made.command[ends], color=MUTED, linewidth=0.8,
        linestyle=LONG_DASHED, label="in proportion",
    )  # fmt: skip
    axes.set(xlabel=f"wanted{unit}", ylabel=f"command{scale(model.input_unit)[0]}")
    add_legend(axes, loc="upper left")
    entitle(axes, "the loop that undoes the drive's")
