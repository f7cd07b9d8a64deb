"""Any record as it is: what a room shows of which no other drawing knows."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.records import Channel, Record
from flexstage.report.figures.responses import shown_lines
from flexstage.report.figures.style import CYCLE, INK, add_legend, dress, entitle, new_figure, scale

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OVER = {"time": "time [s]", "frequency": "frequency [Hz]", "point": "point"}


def draw_record(record: Record, *, title: str = "") -> "Figure":
    """Draw all channels over what they follow one another by, those of one unit together."""
    groups: dict[str, list[Channel]] = {}
    for channel in record.channels:
        groups.setdefault(channel.unit, []).append(channel)
    figure = new_figure(8.6, 0.8 + 1.9 * max(len(groups), 1))
    panels = figure.subplots(max(len(groups), 1), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (unit, channels) in zip(panels, groups.items(), strict=False):
        dress(axes)
        shown, factor = scale(unit)
        for k, channel in enumerate(channels):
            at = shown_lines(channel.values)
            look = {"color": CYCLE[k % len(CYCLE)], "linewidth": 0.9, "label": channel.name}
            axes.plot(record.time[at], factor * channel.values[at], **look)
        name = channels[0].name if len(channels) == 1 else ""
        axes.set_ylabel(f"{name}{shown}".strip(), parse_math=False)
        if len(channels) > 1:
            add_legend(axes, loc="upper right")
    panels[-1].set_xlabel(_OVER[record.over])
    panels[-1].set_xlim(record.time[0], record.time[-1])
    if title:
        entitle(panels[0], title)
    return figure


def draw_drive_record(record: Record, driven: str | int, follows: str | int) -> "Figure":
    """Draw what drives and what follows over time, and one over the other."""
    figure = new_figure(9.6, 3.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.6, 1.0))
    above = figure.add_subplot(grid[0, 0])
    both = record.channel(driven), record.channel(follows)
    for k, channel in enumerate(both):
        axes = above if k == 0 else figure.add_subplot(grid[1, 0], sharex=above)
        dress(axes)
        shown, factor = scale(channel.unit)
        at = shown_lines(channel.values)
        axes.plot(record.time[at], factor * channel.values[at], color=CYCLE[k], linewidth=0.9)
        axes.set_ylabel(f"{channel.name}{shown}", parse_math=False)
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
    for channel, (unit, _), say in zip(
        both, (across, up), (loop.set_xlabel, loop.set_ylabel), strict=True
    ):
        say(f"{channel.name}{unit}", color=INK, parse_math=False)
    return figure
