"""A command that makes a drive follow a reference, and what its model expects of it."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.hysteresis import DriveModel, Feedforward
from flexstage.report.figures.responses import shown_lines
from flexstage.report.figures.style import CYCLE, INK, MUTED, dress, entitle, new_figure, scale
from flexstage.units import readable, readable_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_feedforward(
    made: Feedforward, model: DriveModel, band_percent: float | None = None
) -> "Figure":
    """Draw the command over time and over the reference, and what its prediction leaves.

    The band is half the width of that which holds 95 % of the held-out errors of the model, over
    its stroke [%]: so far a measured drive is away from its model.
    """
    figure = new_figure(10.2, 4.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1.0))
    above = figure.add_subplot(grid[0, 0])
    _command(above, made, model)
    _residual(figure.add_subplot(grid[1, 0], sharex=above), made, model, band_percent)
    _loop(figure.add_subplot(grid[:, 1]), made, model)
    return figure


def _command(axes: "Axes", made: Feedforward, model: DriveModel) -> None:
    dress(axes)
    at = shown_lines(made.command)
    axes.plot(made.time[at], made.command[at], color=CYCLE[0], linewidth=1.0, label="command")
    axes.set_ylabel(f"command{scale(model.input_unit)[0]}", color=INK)
    axes.tick_params(labelbottom=False)
    axes.set_xlim(made.time[0], made.time[-1])
    low, high = float(made.command.min()), float(made.command.max())
    entitle(
        axes,
        f"{made.time.size} samples, {readable(model.input_unit, low, high, digits=4)}",
    )


def _residual(
    axes: "Axes", made: Feedforward, model: DriveModel, band_percent: float | None
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
    axes.legend(loc="upper right", fontsize=7.5, frameon=False, labelcolor=INK, ncols=2)
    axes.set_xlabel("time [s]", color=INK)
    shown = f" [{unit.replace('um', 'µm')}]" if unit else ""
    axes.set_ylabel(f"predicted less wanted{shown}", color=INK)
    axes.set_xlim(made.time[0], made.time[-1])


def _loop(axes: "Axes", made: Feedforward, model: DriveModel) -> None:
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
    axes.set_xlabel(f"wanted{unit}", color=INK)
    axes.set_ylabel(f"command{scale(model.input_unit)[0]}", color=INK)
    axes.legend(loc="upper left", fontsize=7.5, frameon=False, labelcolor=INK)
    entitle(axes, "the loop that undoes the drive's")
