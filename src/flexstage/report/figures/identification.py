"""Measured loops beside a model: that identified from them, or one that was not made from them."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexstage.hysteresis import DriveModel, Prediction
from flexstage.hysteresis.identification.result import Identification
from flexstage.report.figures.style import (
    CYCLE,
    INK,
    MUTED,
    add_legend,
    dress,
    entitle,
    new_figure,
    scale,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_identification(found: Identification) -> "Figure":
    """Draw measured and modelled loop of each record, and what the model leaves over time.

    The first four records. Cycles that are drawn in the loop are shaded over time; the noise of the
    output is a band.
    """
    # records that are drawn below one another
    records = 4
    sections = found.measurement.sections
    called = [Path(name).name or f"record {i}" for i, name in enumerate(found.records, start=1)]
    shown = min(len(sections), records)
    figure = new_figure(9.6, 0.5 + 3.2 * shown)
    plots = figure.subplots(shown, 2, width_ratios=(1.0, 1.25), squeeze=False)
    for i, (left, right) in enumerate(plots):
        within = _shown(found, i)
        _loop(left, found, i, within, _short(called[i]))
        _residual(right, found, i, within)
    held = (
        "" if found.heldout_rms_percent is None else f", held out {found.heldout_rms_percent:.2f}"
    )
    more = len(sections) - shown
    beyond = f"; {more} more record{'s' if more > 1 else ''} not drawn" if more else ""
    every = f" over {len(sections)} records" if len(sections) > 1 else ""
    figure.suptitle(
        f"{found.kind}{every}: {found.rms_percent:.2f} % rms of the stroke{held}; largest "
        f"{found.max_percent:.2f}; noise {found.noise_percent:.2f} (dashed){beyond}",
        x=0.01, ha="left", fontsize=9.5, color=INK,
    )  # fmt: skip
    return figure


def _short(name: str) -> str:
    # letters of a name, or of a title, that a plot has room for
    letters = 44
    return name if len(name) <= letters else f"{name[: letters // 2]}...{name[-letters // 2 + 3 :]}"


def _loop(axes: "Axes", found: Identification, section: int, within: np.ndarray, name: str) -> None:
    s = found.measurement.sections[section]
    sign = found.measurement.sign
    unit, factor = scale(found.model.output_unit)
    dress(axes)
    axes.plot(
        s.u[within], factor * sign * s.y[within], ".", color=CYCLE[1], markersize=2.2,
        label="measured",
    )  # fmt: skip
    axes.plot(
        s.u[within], factor * found.predicted[section][within], color=CYCLE[0], linewidth=1.0,
        label=f"model, {found.kind}",
    )  # fmt: skip
    axes.set(xlabel=f"input{scale(found.model.input_unit)[0]}", ylabel=f"output{unit}")
    add_legend(axes, loc="upper left", markerscale=2.5)
    entitle(axes, f"{name}\n{_extent(found, section, within)}", 8.0)


def _extent(found: Identification, section: int, within: np.ndarray) -> str:
    """Say which cycles of a record are drawn, and when they are."""
    s = found.measurement.sections[section]
    first, last = (int(np.searchsorted(s.cycles.bounds, within[i])) for i in (0, -1))
    count = s.cycles.swing.size
    which = f"cycle {last}" if last == first + 1 else f"cycles {first + 1} to {last}"
    cycles = f"all {count} cycles" if last - first == count > 1 else f"{which} of {count}"
    begin, end = s.begin + within[[0, -1]] * s.dt
    return f"{cycles}, {begin:.4g} to {end:.4g} s"


def _residual(axes: "Axes", found: Identification, section: int, within: np.ndarray) -> None:
    s = found.measurement.sections[section]
    left = (found.measurement.sign * s.y - found.predicted[section]) * (100.0 / found.stroke)
    counted = s.warm_up + np.flatnonzero(np.isfinite(left[s.warm_up :]))
    own = left[counted]
    begin, end = s.begin + counted[[0, -1]] * s.dt
    shaded = s.begin + within[[0, -1]] * s.dt
    dress(axes)
    axes.axvspan(*shaded, color=MUTED, alpha=0.12, linewidth=0.0)
    at = counted[_extremes(own)]
    axes.plot(s.begin + at * s.dt, left[at], color=CYCLE[0], linewidth=0.5)
    for level in (-found.noise_percent, found.noise_percent):
        axes.axhline(level, color=INK, linewidth=0.8, linestyle=(0, (5, 3)))
    axes.set_xlim(begin, end)
    top = 1.15 * max(float(np.abs(own).max()), found.noise_percent)
    axes.set_ylim(-top, top)
    axes.set(xlabel="time [s]", ylabel="output less model [% of stroke]")
    entitle(
        axes,
        f"{begin:.4g} to {end:.4g} s: {np.sqrt(np.mean(own**2)):.2f} % rms, largest "
        f"{np.abs(own).max():.2f}\nshaded: the cycles at the left",
        8.0,
    )


def _shown(found: Identification, section: int) -> np.ndarray:
    """Samples of the last cycles, so many that one can tell their curves apart."""
    # cycles of which the loop is drawn
    cycles = 7
    s = found.measurement.sections[section]
    bounds = s.cycles.bounds
    minor = np.flatnonzero(s.cycles.swing < 0.9)
    # from the last major loop before the last minor ones, or a few cycles of the end
    last = int(minor[-1]) if minor.size else s.cycles.swing.size - 1
    first = max(last - cycles, int(np.searchsorted(bounds, s.warm_up)))
    stop = min(last + 2, bounds.size - 1)
    return np.arange(bounds[min(first, stop - 1)], bounds[stop] + 1)


def _extremes(values: np.ndarray) -> np.ndarray:
    """Return where a curve of so many samples is lowest and highest, bin by bin."""
    # points that a curve over time is drawn with, at most
    points = 4000
    if values.size <= points:
        return np.arange(values.size)
    bins = np.array_split(values, points // 2)
    starts = np.concatenate(([0], np.cumsum([b.size for b in bins])[:-1]))
    ends = [sorted((int(b.argmin()), int(b.argmax()))) for b in bins]
    return (starts[:, None] + np.array(ends)).ravel()


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
    left.set(xlabel=f"input{scale(model.input_unit)[0]}", ylabel=f"output{unit}")
    add_legend(left, loc="upper left", markerscale=3.0)
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
    axes.set(xlabel="time [s]", ylabel="measured less predicted [% of stroke]")
    add_legend(axes, loc="lower right", ncols=2)
    entitle(
        axes,
        f"as predicted {found.as_predicted_rms_percent:.2f} % rms, with a free constant "
        f"{found.free_constant_rms_percent:.2f}; largest {found.largest_percent:.2f}",
    )


def _thin(at: np.ndarray) -> np.ndarray:
    # points that a curve is drawn with, at most
    predicted_points = 6000
    return at[:: max(1, at.size // predicted_points)]
