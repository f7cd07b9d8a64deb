"""Working line of a stack: force over stroke, with the line of its stage."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.report.figures.style import (
    CYCLE,
    DASHED,
    INK,
    LONG_DASHED,
    MUTED,
    UM,
    add_legend,
    label_axes,
    one_panel,
    set_title,
)
from flexstage.system.working_line import WorkingLine

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_working_line(line: WorkingLine) -> "Figure":
    """Draw the line of a stack at full voltage, the load of the stage, and where they meet."""
    drive = line.drive
    figure, axes = one_panel(5.4, 3.6)
    top = max(line.drive.blocked_force, drive.stiffness * drive.free_stroke)
    axes.plot(
        [0.0, UM * drive.free_stroke], [drive.stiffness * drive.free_stroke, 0.0],
        color=CYCLE[0], linewidth=1.6, label="stack, full voltage",
    )  # fmt: skip
    axes.plot([0.0], [line.drive.blocked_force], "s", color=CYCLE[0], markersize=4.5,
              label="blocking force", clip_on=False)  # fmt: skip
    # twice the force at work, as far as the diagram shows
    force = np.linspace(0.0, min(2.0 * line.force, top), 81)
    load = line.force / line.stroke
    loads = "stage and spring" if line.preload_stiffness else "stage"
    way = np.array([f / load + line.seat_approach(float(f)) for f in force])
    label = f"{loads}, with seats" if drive.seats else loads
    axes.plot(UM * way, force, color=CYCLE[1], linewidth=1.6, label=label)
    if drive.seats:
        axes.plot(UM * force / load, force, color=CYCLE[1], linewidth=1.0, linestyle=DASHED,
                  label=loads)  # fmt: skip
    if line.preload_stiffness:
        axes.plot(UM * way, line.preload_stiffness * force / load, color=CYCLE[2], linewidth=1.0,
                  linestyle=LONG_DASHED, label="preload spring")  # fmt: skip
    at = UM * (line.stroke + line.seat_approach(line.force))
    axes.plot([at, at], [0.0, line.force], color=MUTED, linewidth=0.8, linestyle=DASHED)
    axes.plot([at], [line.force], "o", color=INK, markersize=5.0, zorder=4)
    axes.set_xlim(0.0, 1.05 * UM * drive.free_stroke)
    axes.set_ylim(0.0, 1.1 * top)
    label_axes(axes, "elongation of the stack [µm]", "force [N]")
    add_legend(axes, loc="upper right")
    set_title(
        axes,
        f"Working line of {drive.name}: {UM * line.stroke:.3g} µm of "
        f"{UM * drive.free_stroke:.3g} µm left,\n"
        f"at {line.force:.3g} N, {100.0 * line.force_share:.3g} % of the blocking force",
    )
    return figure
