"""Any record as it is: what a room shows of which no other drawing knows."""

from typing import TYPE_CHECKING

from flexstage.records import Channel, Record
from flexstage.report.figures.responses import shown_lines
from flexstage.report.figures.style import CYCLE, INK, dress, entitle, new_figure, scale

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
        axes.set_ylabel(f"{name}{shown}".strip(), color=INK, parse_math=False)
        if len(channels) > 1:
            legend = axes.legend(loc="upper right", fontsize=7.5, frameon=False, labelcolor=INK)
            for text in legend.get_texts():
                text.set_parse_math(False)
    panels[-1].set_xlabel(_OVER[record.over], color=INK)
    panels[-1].set_xlim(record.time[0], record.time[-1])
    if title:
        entitle(panels[0], title)
    return figure
