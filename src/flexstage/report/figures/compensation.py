"""A stage that follows its reference, with and without the inverse of its hysteresis."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from flexstage.hysteresis.virtual_experiment import AxisExperiment
from flexstage.report.figures.style import CYCLE, INK, MUTED, dress, entitle, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UM = 1e6


def draw_compensation(experiments: Mapping[str, AxisExperiment]) -> "Figure":
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


def draw_loop(made: AxisExperiment) -> "Figure":
    """Draw the loop of one axis over its reference, without and with the inverse."""
    figure = new_figure(5.0, 2.8)
    axes = figure.subplots()
    _over_reference(axes, made)
    entitle(axes, f"{made.axis}: open loop and with the inverse, simulated")
    return figure


def _loop(axes: "Axes", name: str, made: AxisExperiment) -> None:
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


def _residual(axes: "Axes", made: AxisExperiment) -> None:
    dress(axes)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.plot(made.voltage, _UM * (made.measured - made.modelled), color=CYCLE[0], linewidth=0.8)
    axes.set_xlabel("voltage [V]", color=INK)
    axes.set_ylabel("residual [µm]", color=INK)


def _over_reference(axes: "Axes", made: AxisExperiment) -> None:
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


def _difference(axes: "Axes", made: AxisExperiment) -> None:
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
