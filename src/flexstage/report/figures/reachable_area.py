"""What all drives of a stage reach together: the workspace as its Jacobian has it."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.arrays import Array
from flexstage.quantities import number
from flexstage.report.figures.style import CYCLE, INK, MUTED, PAPER, dress, entitle, new_figure
from flexstage.system.reachable_area import ReachableArea

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UM = 1e6


def draw_reachable_area(found: ReachableArea) -> "Figure":
    """Draw the positions that all drives reach together, in micrometres.

    With a rotation: those at its middle, filled, and those at any. Arrows are what the stroke of
    each drive does by itself, from where all are at the lower end of theirs.
    """
    figure = new_figure(5.2, 4.9)
    axes = figure.subplots()
    dress(axes)
    section = _UM * found.section()
    whole = _UM * found.projection
    turns = len(found.axes) > 2
    if turns:
        _closed(
            axes, whole, color=MUTED, linewidth=1.0, linestyle=(0, (5, 3)), label="any rotation"
        )
    label = None
    if turns:
        angle = number(_UM * float(found.middle[2]))
        label = f"{found.axes[2]} = {angle} µrad"
    axes.fill(*section.T, color=CYCLE[0], alpha=0.14, linewidth=0.0)
    _closed(axes, section, color=CYCLE[0], linewidth=1.4, label=label)
    ends = _arrows(axes, found)
    points = np.vstack((whole, ends))
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.09 * float((high - low).max())
    axes.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))
    axes.set_aspect("equal")
    axes.set_xlabel(f"{found.axes[0]} [µm]", fontsize=8.5, parse_math=False)
    axes.set_ylabel(f"{found.axes[1]} [µm]", fontsize=8.5, parse_math=False)
    title = f"{number(found.area * _UM**2)} µm²"
    if turns:
        title += f" at the middle rotation, {number(found.projected_area * _UM**2)} µm² at any"
        axes.legend(loc="best", fontsize=7.5, frameon=False, labelcolor=INK)
    entitle(axes, title)
    return figure


def _closed(axes: "Axes", corners: Array, **line: object) -> None:
    around = np.vstack((corners, corners[:1]))
    axes.plot(*around.T, **line)  # type: ignore[arg-type]


def _arrows(axes: "Axes", found: ReachableArea) -> Array:
    """Draw the stroke of each drive; return the ends of all arrows."""
    origin = _UM * found.lowest[:2]
    ends = origin + _UM * found.generators[:2].T
    axes.plot(*origin, "o", color=CYCLE[1], markersize=3.5)
    for name, end in zip(found.drives, ends, strict=True):
        arrow = {"arrowstyle": "-|>", "color": CYCLE[1], "linewidth": 1.2, "mutation_scale": 9}
        axes.annotate("", xy=tuple(end), xytext=tuple(origin), arrowprops=arrow)
        axes.annotate(
            name, 0.55 * end + 0.45 * origin, ha="center", va="center", fontsize=8, color=CYCLE[1],
            fontweight="bold", parse_math=False,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": PAPER, "edgecolor": "none"},
        )  # fmt: skip
    return np.vstack((ends, origin))
