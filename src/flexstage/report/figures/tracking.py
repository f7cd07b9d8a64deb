"""References that a stage follows: virtual with the inverse, by a plan, and by a command alone."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexstage.report.figures.responses import shown_lines
from flexstage.report.figures.style import (
    CYCLE,
    MUTED,
    NM,
    UM,
    add_legend,
    dress,
    entitle,
    new_figure,
    scale,
)
from flexstage.units import readable, readable_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.experiments.verbs.identify import IdentifiedStep
    from flexstage.experiments.verbs.verify import FollowedRun, VerifiedStep
    from flexstage.hysteresis import DriveModel, Feedforward
    from flexstage.studies.compensation import AxisExperiment


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
        _loop(loop, name, made)
        _residual(figure.add_subplot(grid[2 * i + 1, 0], sharex=loop), made)
        _over_reference(figure.add_subplot(grid[rows, 1]), made)
        _difference(figure.add_subplot(grid[rows, 2]), made)
    return figure


def draw_loop(made: "AxisExperiment") -> "Figure":
    """Draw the loop of one axis over its reference, without and with the inverse."""
    figure = new_figure(5.0, 2.8)
    axes = figure.subplots()
    _over_reference(axes, made)
    entitle(axes, f"{made.axis}: open loop and with the inverse, simulated")
    return figure


def _loop(axes: "Axes", name: str, made: "AxisExperiment") -> None:
    dress(axes)
    axes.plot(
        made.voltage, UM * made.measured, color=CYCLE[1], linewidth=2.2,
        label="virtual stage",
    )  # fmt: skip
    axes.plot(
        made.voltage, UM * made.modelled, color=CYCLE[0], linewidth=0.9, linestyle=(0, (4, 2)),
        label="Bouc-Wen",
    )  # fmt: skip
    axes.tick_params(labelbottom=False)
    axes.set_ylabel(f"{name} [µm]")
    add_legend(axes, loc="upper left")
    entitle(
        axes,
        f"{name}: {UM * made.width:.2f} µm wide, model within {UM * made.deviation:.2f} µm",
    )


def _residual(axes: "Axes", made: "AxisExperiment") -> None:
    dress(axes)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.plot(made.voltage, UM * (made.measured - made.modelled), color=CYCLE[0], linewidth=0.8)
    axes.set(xlabel="voltage [V]", ylabel="residual [µm]")


def _over_reference(axes: "Axes", made: "AxisExperiment") -> None:
    dress(axes)
    reference = UM * made.reference
    runs = (
        (made.open_output, CYCLE[1], f"open loop, {UM * made.open_loop.loop_width:.2f} µm"),
        *(
            (run.output, CYCLE[i], f"{run.title}, {UM * run.tracking.loop_width:.2f} µm")
            for run, i in zip(made.runs, (0, 2, 3, 4), strict=False)
        ),
    )
    for output, colour, label in runs:
        axes.plot(reference, UM * output, color=colour, linewidth=0.9, label=label)
    axes.set(xlabel="reference [µm]", ylabel="output [µm]")
    add_legend(axes, loc="upper left", size=7.0)
    share = np.ptp(made.reference) / made.stroke
    entitle(axes, f"without and with inverse, {100.0 * share:.0f} % of the stroke")


def _difference(axes: "Axes", made: "AxisExperiment") -> None:
    dress(axes)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    top = 0.0
    for run, i in zip(made.runs, (0, 2, 3, 4), strict=False):
        error = UM * (run.output - made.reference)
        top = max(top, float(np.abs(error).max()))
        axes.plot(
            made.time, error, color=CYCLE[i], linewidth=0.7,
            label=f"{run.title}: {1e3 * UM * run.tracking.rms:.0f} nm rms, "
            f"{1e3 * UM * run.tracking.largest:.0f} nm at most",
        )  # fmt: skip
    axes.set_xlim(made.time[0], made.time[-1])
    axes.set_ylim(-1.1 * top, 1.6 * top)
    axes.set(xlabel="time [s]", ylabel="output less reference [µm]")
    add_legend(axes, loc="upper left", size=7.0)
    entitle(axes, "error that the loop's width hides")


#: Colour of each way, the same in every figure.
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
    figure = new_figure(10.6, 3.4)
    grid = figure.subplots(
        1, 3 if learned else 2, squeeze=False,
        width_ratios=(1.0, 1.3, 0.7) if learned else (1.0, 1.5),
    )[0]  # fmt: skip
    _ways_over_reference(grid[0], step)
    _errors(grid[1], step)
    if learned:
        _trials(grid[2], learned[0])
    return figure


def _ways_over_reference(axes: "Axes", step: "VerifiedStep") -> None:
    dress(axes)
    for run in step.runs:
        at = _thin(run.time.size)
        axes.plot(
            UM * run.reference[at], UM * run.output[at], color=_COLOURS[run.way], linewidth=0.9,
            label=f"{run.way}, loop {_length(run.tracking.loop_width)}",
        )  # fmt: skip
    axes.set(xlabel="reference [µm]", ylabel="output [µm]")
    add_legend(axes, loc="upper left", size=7.0)
    entitle(axes, f"{step.axis}: {UM * step.stroke:.3g} µm at {step.rate_hz:g} Hz")


def _errors(axes: "Axes", step: "VerifiedStep") -> None:
    dress(axes)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    shown = [run for run in step.runs if run.way != "open loop"] or list(step.runs)
    top = 0.0
    for run in shown:
        at = _thin(run.time.size)
        error = NM * (run.output - run.reference)[at]
        top = max(top, float(np.abs(error).max()))
        axes.plot(
            run.time[at] - run.time[0], error, color=_COLOURS[run.way], linewidth=0.7,
            label=f"{run.way}: {_length(run.tracking.rms)} rms, "
            f"{_length(run.tracking.largest)} at most",
        )  # fmt: skip
    axes.set_ylim(-1.1 * top, (1.25 + 0.15 * len(shown)) * top)
    axes.set_xlim(0.0, max(float(np.ptp(run.time)) for run in shown))
    axes.set(xlabel="time [s]", ylabel="reading less reference [nm]")
    add_legend(axes, loc="upper left", size=7.0)
    entitle(axes, "error, which the width of a loop hides in part")


def _trials(axes: "Axes", run: "FollowedRun") -> None:
    from matplotlib.ticker import MaxNLocator, ScalarFormatter

    dress(axes)
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
    figure = new_figure(10.6, 3.2)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    at = _thin(step.time.size)
    dress(left)
    left.plot(
        step.voltage[at], UM * step.measured[at], color=CYCLE[1], linewidth=1.8, label="reading"
    )
    left.plot(
        step.voltage[at], UM * step.modelled[at], color=CYCLE[0], linewidth=0.8, label=step.kind,
        linestyle=(0, (4, 2)),
    )  # fmt: skip
    left.set(xlabel="voltage [V]", ylabel=f"{step.axis} [µm]")
    add_legend(left, loc="upper left")
    entitle(left, f"{step.name}: {step.kind} on axis {step.axis}")
    dress(right)
    right.axhline(0.0, color=MUTED, linewidth=0.6)
    right.plot(
        step.time[at], NM * (step.measured - step.modelled)[at], color=CYCLE[0], linewidth=0.6
    )
    # what is drawn in grey still remembers what was before the record
    right.axvspan(step.time[0], step.settled, color=MUTED, alpha=0.18, linewidth=0.0)
    right.set(xlabel="time [s]", ylabel="reading less model [nm]")
    entitle(right, f"model error, {_length(step.deviation)} at most after the grey part")
    return figure


def _thin(size: int) -> NDArray[np.intp]:
    # points of a curve, so that the page stays small
    points = 3000
    return np.arange(0, size, max(1, size // points))


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
    entitle(
        axes,
        f"{made.time.size} samples, {readable(model.input_unit, low, high, digits=4)}",
    )


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
        linestyle=(0, (5, 3)), label="in proportion",
    )  # fmt: skip
    axes.set(xlabel=f"wanted{unit}", ylabel=f"command{scale(model.input_unit)[0]}")
    add_legend(axes, loc="upper left")
    entitle(axes, "the loop that undoes the drive's")
