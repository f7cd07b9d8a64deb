"""A stage that follows its reference, with and without the inverse of its hysteresis."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from flexstage.hysteresis.virtual_experiment import AxisExperiment
from flexstage.report.figures.style import CYCLE, INK, MUTED, dress, entitle, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_compensation"]

_UM = 1e6


def draw_compensation(experiments: Mapping[str, AxisExperiment]) -> "Figure":
    """Draw the experiment of identification and compensation, a row for each axis.

    Parameters
    ----------
    experiments : Mapping
        Experiment by axis.

    Returns
    -------
    matplotlib.figure.Figure
        Measured and modelled loop; the loop over the reference without and with the inverse; and
        the difference from the reference over time.
    """
    figure = new_figure(10.6, 3.3 * len(experiments))
    grid = figure.subplots(len(experiments), 3, squeeze=False, width_ratios=(1.0, 1.0, 1.15))
    for row, (name, made) in zip(grid, experiments.items(), strict=True):
        _loop(row[0], name, made)
        _over_reference(row[1], made)
        _difference(row[2], made)
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
    axes.set_xlabel("voltage [V]", color=INK)
    axes.set_ylabel(f"{name} [µm]", color=INK)
    axes.legend(loc="upper left", fontsize=7.5, frameon=False, labelcolor=INK)
    entitle(
        axes,
        f"{name}: loop {_UM * made.width:.2f} µm wide, model within {_UM * made.deviation:.2f}",
    )


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
    entitle(axes, "open loop and with the inverse")


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
            f"{1e3 * _UM * run.tracking.largest:.0f} at most",
        )  # fmt: skip
    axes.set_xlim(made.time[0], made.time[-1])
    axes.set_ylim(-1.1 * top, 1.6 * top)
    axes.set_xlabel("time [s]", color=INK)
    axes.set_ylabel("output less reference [µm]", color=INK)
    axes.legend(loc="upper left", fontsize=7.0, frameon=False, labelcolor=INK)
    entitle(axes, "error that the loop's width hides")
