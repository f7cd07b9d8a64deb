"""Records as they are, and their loops beside a model: that identified from them, or another."""

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
    dress,
    entitle,
    label_axes,
    new_figure,
    panels,
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
    figure, plots = panels(9.6, 0.5 + 3.2 * shown, 2 * shown, 2, width_ratios=(1.0, 1.25))
    for i, (left, right) in enumerate(zip(plots[::2], plots[1::2], strict=True)):
        within = _shown(found, i)
        section = found.measurement.sections[i]
        measured = found.measurement.sign * section.y
        loops = (section.u[within], measured[within], found.predicted[i][within])
        _loop(left, found.model, loops, f"model, {found.kind}", 2.2, 1.0)
        entitle(left, f"{_short(called[i])}\n{_extent(found, i, within)}", 8.0)
        _residual(right, found, i, within)
    held = (
        "" if found.heldout_rms_percent is None else f", held out {found.heldout_rms_percent:.2f}"
    )
    more = len(sections) - shown
    beyond = f"; {more} more record{'s' if more > 1 else ''} not drawn" if more else ""
    every = f" over {len(sections)} records" if len(sections) > 1 else ""
    add_heading(
        figure,
        f"{found.kind}{every}: {found.rms_percent:.2f} % rms of the stroke{held}; largest "
        f"{found.max_percent:.2f}; noise {found.noise_percent:.2f} (dashed){beyond}",
        9.5,
    )
    return figure


def _short(name: str) -> str:
    # letters of a name, or of a title, that a plot has room for
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
    """Draw input, measured and modelled output as a loop; dots and lines of so many points."""
    driven, measured, modelled = loops
    unit, factor = scale(model.output_unit)
    axes.plot(driven, factor * measured, ".", color=CYCLE[1], markersize=dot, label="measured")
    axes.plot(driven, factor * modelled, color=CYCLE[0], linewidth=line, label=label)
    axes.set(xlabel=f"input{scale(model.input_unit)[0]}", ylabel=f"output{unit}")
    add_legend(axes, loc="upper left", markerscale=5.0 / dot)


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
    axes.axvspan(*shaded, color=MUTED, alpha=0.12, linewidth=0.0)
    at = counted[shown_lines(own)]
    axes.plot(s.begin + at * s.dt, left[at], color=CYCLE[0], linewidth=0.5)
    for level in (-found.noise_percent, found.noise_percent):
        axes.axhline(level, color=INK, linewidth=0.8, linestyle=LONG_DASHED)
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


def draw_prediction(found: Prediction, model: DriveModel, band: float | None = None) -> "Figure":
    """Draw the measured and the predicted loop, and the error as predicted over time.

    `band` is half the width of the model's band of confidence, over the stroke [%].
    """
    figure, (left, right) = panels(9.6, 3.6, 2, 2, width_ratios=(1.0, 1.25))
    at = thinned(found.warm_up, found.time.size, 6000)
    loops = (found.command[at], found.measured[at], found.predicted[at])
    _loop(left, model, loops, f"predicted, {model.hysteresis.kind}", 1.6, 0.6)
    entitle(left, Path(found.source).name or "loop")
    _error(right, found, at, band)
    return figure


def _error(axes: "Axes", found: Prediction, at: np.ndarray, band: float | None) -> None:
    percent = 100.0 / found.stroke
    error = (found.measured - found.predicted)[at] * percent
    if band is not None:
        axes.axhspan(-band, band, color=CYCLE[0], alpha=0.12, linewidth=0.0, label="95 % band")
    axes.plot(found.time[at], error, color=CYCLE[0], linewidth=0.5)
    mean = found.constant_percent
    axes.axhline(mean, color=INK, linewidth=0.8, linestyle=LONG_DASHED, label="mean")
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


_OVER = {"time": "time [s]", "frequency": "frequency [Hz]", "point": "point"}


def draw_record(record: Record, *, title: str = "") -> "Figure":
    """Draw all channels over what they follow one another by, those of one unit together."""
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
        entitle(grid[0], title)
    return figure


def _over_time(axes: "Axes", record: Record, channel: Channel, colour: int) -> None:
    """Draw a channel in a colour of the cycle."""
    factor, at = scale(channel.unit)[1], shown_lines(channel.values)
    look = {"color": CYCLE[colour % len(CYCLE)], "linewidth": 0.9, "label": channel.name}
    axes.plot(record.time[at], factor * channel.values[at], **look)


def draw_drive_record(record: Record, driven: str | int, follows: str | int) -> "Figure":
    """Draw what drives and what follows over time, and one over the other."""
    figure = new_figure(9.6, 3.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.6, 1.0))
    above = figure.add_subplot(grid[0, 0])
    both = record.channel(driven), record.channel(follows)
    for k, channel in enumerate(both):
        axes = above if k == 0 else figure.add_subplot(grid[1, 0], sharex=above)
        dress(axes)
        _over_time(axes, record, channel, k)
        axes.set_ylabel(f"{channel.name}{scale(channel.unit)[0]}", parse_math=False)
        axes.set_xlim(record.time[0], record.time[-1])
        if k == 0:
            axes.tick_params(labelbottom=False)
        else:
            axes.set_xlabel(_OVER[record.over])
    loop = figure.add_subplot(grid[:, 1])
    dress(loop)
    at = np.unique(np.concatenate([shown_lines(channel.values) for channel in both]))
    (x, across), (y, up) = ((c.values[at], scale(c.unit)) for c in both)
    loop.plot(across[1] * x, up[1] * y, color=CYCLE[1], linewidth=0.5)
    label_axes(loop, f"{both[0].name}{across[0]}", f"{both[1].name}{up[0]}", 10)
    return figure
