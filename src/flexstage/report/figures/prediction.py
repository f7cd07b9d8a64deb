"""A model beside a record that it was not made from."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexstage.hysteresis import DriveModel, Prediction
from flexstage.report.figures.identification import scale
from flexstage.report.figures.style import CYCLE, INK, dress, entitle, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Points that a curve is drawn with, at most.
_POINTS = 6000


def draw_prediction(found: Prediction, model: DriveModel, band: float | None = None) -> "Figure":
    """Draw the measured and the predicted loop, and the error as predicted over time.

    `band` is half the width of the model's band of confidence, over the stroke [%].
    """
    figure = new_figure(9.6, 3.6)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
    at = _thin(np.arange(found.warm_up, found.time.size))
    unit, factor = scale(model.output_unit)
    dress(left)
    left.plot(
        found.command[at], factor * found.measured[at], ".", color=CYCLE[1], markersize=1.6,
        label="measured",
    )  # fmt: skip
    left.plot(
        found.command[at], factor * found.predicted[at], color=CYCLE[0], linewidth=0.6,
        label=f"predicted, {model.hysteresis.kind}",
    )  # fmt: skip
    left.set_xlabel(f"input{scale(model.input_unit)[0]}", color=INK)
    left.set_ylabel(f"output{unit}", color=INK)
    left.legend(loc="upper left", fontsize=7.5, frameon=False, labelcolor=INK, markerscale=3.0)
    entitle(left, Path(found.source).name or "loop")
    _error(right, found, at, band)
    return figure


def _error(axes: "Axes", found: Prediction, at: np.ndarray, band: float | None) -> None:
    percent = 100.0 / found.stroke
    error = (found.measured - found.predicted)[at] * percent
    dress(axes)
    if band is not None:
        axes.axhspan(-band, band, color=CYCLE[0], alpha=0.12, linewidth=0.0, label="95 % band")
    axes.plot(found.time[at], error, color=CYCLE[0], linewidth=0.5)
    axes.axhline(
        found.constant_percent, color=INK, linewidth=0.8, linestyle=(0, (5, 3)), label="mean"
    )
    axes.set_xlim(float(found.time[at[0]]), float(found.time[at[-1]]))
    top = 1.2 * max(float(np.abs(error).max()), band or 0.0)
    axes.set_ylim(-top, top)
    axes.set_xlabel("time [s]", color=INK)
    axes.set_ylabel("measured less predicted [% of stroke]", color=INK)
    axes.legend(loc="lower right", fontsize=7.5, frameon=False, labelcolor=INK, ncols=2)
    entitle(
        axes,
        f"as predicted {found.as_predicted_rms_percent:.2f} % rms, with a free constant "
        f"{found.free_constant_rms_percent:.2f}; largest {found.largest_percent:.2f}",
    )


def _thin(at: np.ndarray) -> np.ndarray:
    return at[:: max(1, at.size // _POINTS)]
