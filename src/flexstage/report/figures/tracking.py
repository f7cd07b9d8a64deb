"""A stage that follows its reference: virtual, with the inverse of its hysteresis; or by a plan."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexstage.report.figures.style import CYCLE, INK, MUTED, dress, entitle, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.experiments.verbs.identify import IdentifiedStep
    from flexstage.experiments.verbs.verify import FollowedRun, VerifiedStep
    from flexstage.studies.compensation import AxisExperiment


_UM = 1e6


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
        made.voltage, _UM * made.measured, color=CYCLE[1], linewidth=2.2,
        label="virtual stage",
    )  # fmt: skip
    axes.plot(
        made.voltage, _UM * made.modelled, color=CYCLE[0], linewidth=0.9, linestyle=(0, (4, 2)),
        label="Bouc-Wen",
    )  # fmt: skip
    axes.tick_params(labelbottom=False)
    axes.set_ylabel(f"{name} [µm]", color=INK)
    axes.legend(loc="upper left", fontsize=7.5, frameon=False, labelcolor=INK)
    entitle(
        axes,
        f"{name}: {_UM * made.width:.2f} µm wide, model within {_UM * made.deviation:.2f} µm",
    )


def _residual(axes: "Axes", made: "AxisExperiment") -> None:
    dress(axes)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.plot(made.voltage, _UM * (made.measured - made.modelled), color=CYCLE[0], linewidth=0.8)
    axes.set_xlabel("voltage [V]", color=INK)
    axes.set_ylabel("residual [µm]", color=INK)


def _over_reference(axes: "Axes", made: "AxisExperiment") -> None:
    dress(axes)
    reference = _UM * made.reference
    runs = (
        (made.open_output, CYCLE[1], f"open loop, {_UM * made.open_loop.loop_width:.2f} µm"),
        *(
            (run.output, CYCLE[i], f"{run.title}, {_UM * run.tracking.loop_width:.2f} µm")
            for run, i in zip(made.runs, (0, 2, 3, 4), strict=False)
        ),
    )
    for output, colour, label in runs:
        axes.plot(reference, _UM * output, color=colour, linewidth=0.9, label=label)
    axes.set_xlabel("reference [µm]", color=INK)
    axes.set_ylabel("output [µm]", color=INK)
    axes.legend(loc="upper left", fontsize=7.0, frameon=False, labelcolor=INK)
    share = np.ptp(made.reference) / made.stroke
    entitle(axes, f"without and with inverse, {100.0 * share:.0f} % of the stroke")


def _difference(axes: "Axes", made: "AxisExperiment") -> None:
    dress(axes)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    top = 0.0
    for run, i in zip(made.runs, (0, 2, 3, 4), strict=False):
        error = _UM * (run.output - made.reference)
        top = max(top, float(np.abs(error).max()))
        axes.plot(
            made.time, error, color=CYCLE[i], linewidth=0.7,
            label=f"{run.title}: {1e3 * _UM * run.tracking.rms:.0f} nm rms, "
            f"{1e3 * _UM * run.tracking.largest:.0f} nm at most",
        )  # fmt: skip
    axes.set_xlim(made.time[0], made.time[-1])
    axes.set_ylim(-1.1 * top, 1.6 * top)
    axes.set_xlabel("time [s]", color=INK)
    axes.set_ylabel("output less reference [µm]", color=INK)
    axes.legend(loc="upper left", fontsize=7.0, frameon=False, labelcolor=INK)
    entitle(axes, "error that the loop's width hides")


_NM = 1e9
#: Colour of each way, the same in every figure.
_COLOURS = {
    "open loop": CYCLE[1],
    "inverse": CYCLE[0],
    "feedback": CYCLE[2],
    "both": CYCLE[3],
    "learning": CYCLE[4],
}
#: Points of a curve, so that the page stays small.
_POINTS = 3000


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
            _UM * run.reference[at], _UM * run.output[at], color=_COLOURS[run.way], linewidth=0.9,
            label=f"{run.way}, loop {_length(run.tracking.loop_width)}",
        )  # fmt: skip
    axes.set_xlabel("reference [µm]", color=INK)
    axes.set_ylabel("output [µm]", color=INK)
    axes.legend(loc="upper left", fontsize=7.0, frameon=False, labelcolor=INK)
    entitle(axes, f"{step.axis}: {_UM * step.stroke:.3g} µm at {step.rate_hz:g} Hz")


def _errors(axes: "Axes", step: "VerifiedStep") -> None:
    dress(axes)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    shown = [run for run in step.runs if run.way != "open loop"] or list(step.runs)
    top = 0.0
    for run in shown:
        at = _thin(run.time.size)
        error = _NM * (run.output - run.reference)[at]
        top = max(top, float(np.abs(error).max()))
        axes.plot(
            run.time[at] - run.time[0], error, color=_COLOURS[run.way], linewidth=0.7,
            label=f"{run.way}: {_length(run.tracking.rms)} rms, "
            f"{_length(run.tracking.largest)} at most",
        )  # fmt: skip
    axes.set_ylim(-1.1 * top, (1.25 + 0.15 * len(shown)) * top)
    axes.set_xlim(0.0, max(float(np.ptp(run.time)) for run in shown))
    axes.set_xlabel("time [s]", color=INK)
    axes.set_ylabel("reading less reference [nm]", color=INK)
    axes.legend(loc="upper left", fontsize=7.0, frameon=False, labelcolor=INK)
    entitle(axes, "error, which the width of a loop hides in part")


def _trials(axes: "Axes", run: "FollowedRun") -> None:
    from matplotlib.ticker import MaxNLocator, ScalarFormatter

    dress(axes)
    errors = _NM * np.asarray(run.errors)
    axes.plot(np.arange(errors.size), errors, "o-", color=_COLOURS["learning"], markersize=4)
    axes.set_yscale("log")
    for axis in ("set_major_formatter", "set_minor_formatter"):
        getattr(axes.yaxis, axis)(ScalarFormatter())
    axes.tick_params(axis="y", which="minor", labelsize=7)
    axes.set_xlabel("trial", color=INK)
    axes.set_ylabel("error [nm rms]", color=INK)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    entitle(axes, "learning")


def draw_drive_fit(step: "IdentifiedStep") -> "Figure":
    """Draw a record and the model identified from it, over voltage, and its rest over time."""
    figure = new_figure(10.6, 3.2)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    at = _thin(step.time.size)
    dress(left)
    left.plot(
        step.voltage[at], _UM * step.measured[at], color=CYCLE[1], linewidth=1.8, label="reading"
    )
    left.plot(
        step.voltage[at], _UM * step.modelled[at], color=CYCLE[0], linewidth=0.8, label=step.kind,
        linestyle=(0, (4, 2)),
    )  # fmt: skip
    left.set_xlabel("voltage [V]", color=INK)
    left.set_ylabel(f"{step.axis} [µm]", color=INK)
    left.legend(loc="upper left", fontsize=7.5, frameon=False, labelcolor=INK)
    entitle(left, f"{step.name}: {step.kind} on axis {step.axis}")
    dress(right)
    right.axhline(0.0, color=MUTED, linewidth=0.6)
    right.plot(
        step.time[at], _NM * (step.measured - step.modelled)[at], color=CYCLE[0], linewidth=0.6
    )
    # what is drawn in grey still remembers what was before the record
    right.axvspan(step.time[0], step.settled, color=MUTED, alpha=0.18, linewidth=0.0)
    right.set_xlabel("time [s]", color=INK)
    right.set_ylabel("reading less model [nm]", color=INK)
    entitle(right, f"model error, {_length(step.deviation)} at most after the grey part")
    return figure


def _thin(size: int) -> NDArray[np.intp]:
    return np.arange(0, size, max(1, size // _POINTS))


def _length(value: float) -> str:
    if abs(value) < 0.995e-6:
        return f"{_NM * value:.3g} nm"
    return f"{_UM * value:.3g} µm"
