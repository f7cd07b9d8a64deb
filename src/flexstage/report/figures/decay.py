"""A free decay beside the damped sines that were fitted to it."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.experiment.modal.ring_down import RingDown
from flexstage.records import Record
from flexstage.report.figures.identification import scale
from flexstage.report.figures.measured_response import shown_lines
from flexstage.report.figures.style import CYCLE, INK, dress, entitle, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Channels that are drawn, at most.
_CHANNELS = 4


def draw_ring_down(fit: RingDown, record: Record) -> "Figure":
    """Draw a free decay, the damped sines that were fitted to it, and what they leave.

    Of the first four channels; the record gives their units.
    """
    names = fit.channels[:_CHANNELS]
    figure = new_figure(8.6, 1.2 + 2.6 * len(names))
    panels = figure.subplots(2 * len(names), 1, sharex=True, height_ratios=(2.2, 1.0) * len(names))
    for axes in panels:
        dress(axes)
    for k, name in enumerate(names):
        unit, factor = scale(record.channel(name).unit)
        measured, fitted = factor * fit.measured[:, k], factor * fit.fitted[:, k]
        upper, lower = panels[2 * k], panels[2 * k + 1]
        colour = CYCLE[k % len(CYCLE)]
        at = shown_lines(measured)
        upper.plot(fit.time[at], measured[at], color=colour, linewidth=0.9, label="measured")
        upper.plot(
            fit.time[at], fitted[at], color=INK, linewidth=0.8, linestyle=(0, (4, 2)), label="fit"
        )
        upper.set_ylabel(f"{name}{unit}", color=INK)
        rest = measured - fitted
        at = shown_lines(rest)
        lower.plot(fit.time[at], rest[at], color=colour, linewidth=0.7)
        lower.set_ylabel("measured\nless fit", color=INK)
        if k == 0:
            upper.legend(loc="upper right", ncols=2, fontsize=7.5, frameon=False, labelcolor=INK)
    panels[-1].set_xlabel("time [s]", color=INK)
    panels[-1].set_xlim(float(fit.time[0]), float(np.max(fit.time)))
    figure.align_ylabels(panels)
    found = ", ".join(f"{mode.frequency_hz.value:.2f} Hz" for mode in fit.modes[:5])
    entitle(panels[0], f"free decay: {found}" if found else "free decay: no mode stands out")
    return figure
