"""Records, and measured loops with those of an identified or another model."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexstage.hysteresis import DriveModel, Prediction
from flexstage.hysteresis.identification.result import Identification
from flexstage.records import Channel, Record
from flexstage.report.figures.responses import shown_lines, thinned
from flexstage.report.figures.style import (
    CYCLE,
    INK,
    LONG_DASHED,
    MUTED,
    add_heading,
    add_legend,
    label_axes,
    new_figure,
    panels,
    scale,
    set_title,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_identification(result: Identification) -> "Figure":
    """Draw measured and modelled loop of each record, and the residual over time.

    At most four records are drawn. The cycles of the loop are shaded over time; dashed lines are
    the noise of the output.
    """
    # most records
    records = 4
    sections = result.measurement.sections
    names = [Path(name).name or f"record {i}" for i, name in enumerate(result.records, start=1)]
    count = min(len(sections), records)
    figure, plots = panels(9.6, 0.5 + 3.2 * count, 2 * count, 2, width_ratios=(1.0, 1.25))
    for i, (left, right) in enumerate(zip(plots[::2], plots[1::2], strict=True)):
        within = _last_cycles(result, i)
        section = result.measurement.sections[i]
        measured = result.measurement.sign * section.y
        loops = (section.u[within], measured[within], result.predicted[i][within])
        _loop(left, result.model, loops, f"model, {result.kind}", 2.2, 1.0)
        set_title(left, f"{_short(names[i])}\n{_extent(result, i, within)}", 8.0)
        _residual(right, result, i, within)
    heldout = (
        "" if result.heldout_rms_percent is None else f", held out {result.heldout_rms_percent:.2f}"
    )
    omitted = len(sections) - count
    beyond = f"; {omitted} more record{'s' if omitted > 1 else ''} not drawn" if omitted else ""
    every = f" over {len(sections)} records" if len(sections) > 1 else ""
    add_heading(
        figure,
        f"{result.kind}{every}: {result.rms_percent:.2f} % rms of the stroke{heldout}; largest "
        f"{result.max_percent:.2f}; noise {result.noise_percent:.2f} (dashed){beyond}",
        9.5,
    )
    return figure


def _short(name: str) -> str:
    # most letters of a name
    letters = 44
    return name if len(name) <= letters else f"{name[: letters // 2]}...{name[-letters // 2 + 3 :]}"


def _loop(
    axes: "Axes",
    model: DriveModel,
    loops: "tuple[np.ndarray, np.ndarray, np.ndarray]",
    label: str,
    dot: float,
    line: float,
) -> None:
    """Draw input, measured and modelled output as a loop; size of dots and width of lines [pt]."""
    driven, measured, modelled = loops
    unit, factor = scale(model.output_unit)
    axes.plot(driven, factor * measured, ".", color=CYCLE[1], markersize=dot, label="measured")
    axes.plot(driven, factor * modelled, color=CYCLE[0], linewidth=line, label=label)
    axes.set(xlabel=f"input{scale(model.input_unit)[0]}", ylabel=f"output{unit}")
    add_legend(axes, loc="upper left", markerscale=5.0 / dot)


def _extent(result: Identification, section: int, within: np.ndarray) -> str:
    """Return the drawn cycles of a record, and their times."""
    s = result.measurement.sections[section]
    first, last = (int(np.searchsorted(s.cycles.bounds, within[i])) for i in (0, -1))
    count = s.cycles.swing.size
    cycle_range = f"cycle {last}" if last == first + 1 else f"cycles {first + 1} to {last}"
    cycles = f"all {count} cycles" if last - first == count > 1 else f"{cycle_range} of {count}"
    begin, end = s.begin + within[[0, -1]] * s.dt
    return f"{cycles}, {begin:.4g} to {end:.4g} s"


def _residual(axes: "Axes", result: Identification, section: int, within: np.ndarray) -> None:
    s = result.measurement.sections[section]
    errors = (result.measurement.sign * s.y - result.predicted[section]) * (100.0 / result.stroke)
    counted = s.warm_up + np.flatnonzero(np.isfinite(errors[s.warm_up :]))
    counted_errors = errors[counted]
    begin, end = s.begin + counted[[0, -1]] * s.dt
    shaded = s.begin + within[[0, -1]] * s.dt
    axes.axvspan(*shaded, color=MUTED, alpha=0.12, linewidth=0.0)
    at = counted[shown_lines(counted_errors)]
    axes.plot(s.begin + at * s.dt, errors[at], color=CYCLE[0], linewidth=0.5)
    for level in (-result.noise_percent, result.noise_percent):
        axes.axhline(level, color=INK, linewidth=0.8, linestyle=LONG_DASHED)
    axes.set_xlim(begin, end)
    top = 1.15 * max(float(np.abs(counted_errors).max()), result.noise_percent)
    axes.set_ylim(-top, top)
    axes.set(xlabel="time [s]", ylabel="measured − model [% of stroke]")
    set_title(
        axes,
        f"{begin:.4g} to {end:.4g} s: {np.sqrt(np.mean(counted_errors**2)):.2f} % rms, largest "
        f"{np.abs(counted_errors).max():.2f}\nshaded: cycles in the left diagram",
        8.0,
    )


def _last_cycles(result: Identification, section: int) -> np.ndarray:
    """Return the samples of the last cycles, few enough to distinguish their curves."""
    # most cycles of a loop
    cycles = 7
    s = result.measurement.sections[section]
    bounds = s.cycles.bounds
    minor = np.flatnonzero(s.cycles.swing < 0.9)
    # from the last major loop before the last minor ones, or the last few cycles
    last = int(minor[-1]) if minor.size else s.cycles.swing.size - 1
    first = max(last - cycles, int(np.searchsorted(bounds, s.warm_up)))
    stop = min(last + 2, bounds.size - 1)
    return np.arange(bounds[min(first, stop - 1)], bounds[stop] + 1)


def draw_prediction(
    prediction: Prediction, model: DriveModel, band: float | None = None
) -> "Figure":
    """Draw the measured and the predicted loop, and the error as predicted over time.

    `band` is half the width of the 95 % band of the model, relative to the stroke [%].
    """
    figure, (left, right) = panels(9.6, 3.6, 2, 2, width_ratios=(1.0, 1.25))
    at = thinned(prediction.warm_up, prediction.time.size, 6000)
    loops = (prediction.command[at], prediction.measured[at], prediction.predicted[at])
    _loop(left, model, loops, f"predicted, {model.hysteresis.kind}", 1.6, 0.6)
    set_title(left, Path(prediction.source).name or "loop")
    _error(right, prediction, at, band)
    return figure


def _error(axes: "Axes", prediction: Prediction, at: np.ndarray, band: float | None) -> None:
    percent = 100.0 / prediction.stroke
    error = (prediction.measured - prediction.predicted)[at] * percent
    if band is not None:
        axes.axhspan(-band, band, color=CYCLE[0], alpha=0.12, linewidth=0.0, label="95 % band")
    axes.plot(prediction.time[at], error, color=CYCLE[0], linewidth=0.5)
    mean = prediction.constant_percent
    axes.axhline(mean, color=INK, linewidth=0.8, linestyle=LONG_DASHED, label="mean")
    axes.set_xlim(float(prediction.time[at[0]]), float(prediction.time[at[-1]]))
    top = 1.2 * max(float(np.abs(error).max()), band or 0.0)
    axes.set_ylim(-top, top)
    axes.set(xlabel="time [s]", ylabel="measured − predicted [% of stroke]")
    add_legend(axes, loc="lower right", ncols=2)
    set_title(
        axes,
        f"as predicted {prediction.as_predicted_rms_percent:.2f} % rms, with a free constant "
        f"{prediction.free_constant_rms_percent:.2f}; largest {prediction.largest_percent:.2f}",
    )


_OVER = {"time": "time [s]", "frequency": "frequency [Hz]", "point": "point"}


def draw_record(record: Record, *, title: str = "") -> "Figure":
    """Draw all channels over time, frequency or index, those of one unit together."""
    groups: dict[str, list[Channel]] = {}
    for channel in record.channels:
        groups.setdefault(channel.unit, []).append(channel)
    count = max(len(groups), 1)
    figure, grid = panels(8.6, 0.8 + 1.9 * count, count, sharex=True)
    for axes, channels in zip(grid, groups.values(), strict=False):
        for k, channel in enumerate(channels):
            _over_time(axes, record, channel, k)
        name, unit = channels[0].name if len(channels) == 1 else "", scale(channels[0].unit)[0]
        axes.set_ylabel(f"{name}{unit}".strip(), parse_math=False)
        if len(channels) > 1:
            add_legend(axes, loc="upper right")
    grid[-1].set_xlabel(_OVER[record.over])
    grid[-1].set_xlim(record.time[0], record.time[-1])
    if title:
        set_title(grid[0], title)
    return figure


def _over_time(axes: "Axes", record: Record, channel: Channel, colour: int) -> None:
    """Draw a channel in a colour of the cycle."""
    factor, at = scale(channel.unit)[1], shown_lines(channel.values)
    look = {"color": CYCLE[colour % len(CYCLE)], "linewidth": 0.9, "label": channel.name}
    axes.plot(record.time[at], factor * channel.values[at], **look)


def draw_drive_record(record: Record, driven: str | int, follows: str | int) -> "Figure":
    """Draw input and output over time, and the output over the input."""
    figure = new_figure(9.6, 3.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.6, 1.0))
    above = figure.add_subplot(grid[0, 0])
    both = record.channel(driven), record.channel(follows)
    for k, channel in enumerate(both):
        axes = above if k == 0 else figure.add_subplot(grid[1, 0], sharex=above)
        style_axes(axes)
        _over_time(axes, record, channel, k)
        axes.set_ylabel(f"{channel.name}{scale(channel.unit)[0]}", parse_math=False)
        axes.set_xlim(record.time[0], record.time[-1])
        if k == 0:
            axes.tick_params(labelbottom=False)
        else:
            axes.set_xlabel(_OVER[record.over])
    loop = figure.add_subplot(grid[:, 1])
    style_axes(loop)
    at = np.unique(np.concatenate([shown_lines(channel.values) for channel in both]))
    (x, across), (y, up) = ((c.values[at], scale(c.unit)) for c in both)
    loop.plot(across[1] * x, up[1] * y, color=CYCLE[1], linewidth=0.5)
    label_axes(loop, f"{both[0].name}{across[0]}", f"{both[1].name}{up[0]}", 10)
    return figure
