"""Measured errors of motion over the stroke, and the workspace that was reached."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.arrays import Array
from flexstage.experiment.motion.curve_extremes import Line, line_weights
from flexstage.experiment.motion.motion_curve import MotionCurve
from flexstage.experiment.motion.workspace import Workspace
from flexstage.quantities import number, prefixed
from flexstage.report.figures.style import CYCLE, INK, MUTED, dress, entitle, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.estimate import Estimate


def draw_motion_error(
    curve: MotionCurve,
    *,
    title: str = "",
    position_label: str = "position",
    label: str = "error",
    line: Line = "least_squares",
    legend: bool = True,
) -> "Figure":
    """Draw a measured error over the stroke, forward and backward, with its 95 % band.

    `line` is the straight line of the mean of both runs that is taken off; labels are without unit.
    """
    x = curve.grid()
    off = line_weights(x, line)
    mean = curve.rows(x, "mean")
    # an offset is no error of motion: without a line the mean level is taken off
    base = off @ mean if line != "none" else np.tile(mean.mean(axis=0), (x.size, 1))
    figure = new_figure(6.4, 3.3)
    axes = figure.subplots()
    dress(axes)
    drawn = []
    for name in ("forward", "backward"):
        rows = curve.rows(x, name) - base
        found = [curve.of_coefficients(r) for r in rows]
        values = np.array([e.value for e in found])
        drawn.append((name, values, np.array([e.expanded for e in found])))
    reach = max(float(np.abs(v).max() + u.max()) for _, v, u in drawn)
    factor, prefix = prefixed(reach)
    across, unit = prefixed(float(np.abs(x).max())) if curve.position_unit == "m" else (1.0, "")
    for colour, style, (name, values, band) in zip(CYCLE, ("-", (0, (5, 2))), drawn, strict=False):
        axes.fill_between(
            across * x, factor * (values - band), factor * (values + band), color=colour,
            alpha=0.18, linewidth=0.0,
        )  # fmt: skip
        axes.plot(across * x, factor * values, color=colour, linewidth=1.4, linestyle=style,
                  label=name)  # fmt: skip
    axes.set_xlim(across * x[0], across * x[-1])
    of_position = f" [{unit}{curve.position_unit}]" if curve.position_unit else ""
    axes.set_xlabel(f"{position_label}{of_position}", fontsize=8.5, parse_math=False)
    of_error = f" [{prefix}{curve.unit}]" if curve.unit else ""
    axes.set_ylabel(f"{label}{of_error}", fontsize=8.5, parse_math=False)
    if legend:
        axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, fontsize=7.5, frameon=False,
            labelcolor=INK, title="with 95 % band", title_fontproperties={"size": 7.5},
        ).get_title().set_color(MUTED)  # fmt: skip
    if title:
        entitle(axes, title)
    return figure


def draw_workspace(found: Workspace, *, title: str = "") -> "Figure":
    """Draw the area that a stage reached, with corners, sides and diagonals, in micrometres.

    The title is the area where not given.
    """
    figure = new_figure(5.0, 4.7)
    axes = figure.subplots()
    dress(axes)
    outline, corners = 1e6 * found.outline, 1e6 * found.corners
    closed = np.vstack((outline, outline[:1]))
    axes.fill(closed[:, 0], closed[:, 1], color=CYCLE[0], alpha=0.12, linewidth=0.0)
    axes.plot(closed[:, 0], closed[:, 1], color=CYCLE[0], linewidth=1.3)
    for i, j in ((0, 2), (1, 3)):
        axes.plot(*corners[[i, j]].T, color=MUTED, linewidth=0.8, linestyle=(0, (5, 3)))
    axes.plot(*corners.T, "o", color=CYCLE[1], markersize=4.0)
    middle = corners.mean(axis=0)
    _label(axes, 0.5 * (corners[0] + corners[1]), found.stroke_x[0], (0, -5), "center", "top")
    _label(axes, 0.5 * (corners[3] + corners[2]), found.stroke_x[1], (0, 5), "center", "bottom")
    _label(axes, 0.5 * (corners[0] + corners[3]), found.stroke_y[0], (-5, 0), "right", "center", 90)
    _label(axes, 0.5 * (corners[1] + corners[2]), found.stroke_y[1], (5, 0), "left", "center", 90)
    for i, (j, k) in enumerate(((0, 2), (1, 3))):
        # a quarter from the upper end, so that the two texts do not meet
        at = corners[j] + 0.74 * (corners[k] - corners[j])
        turn = float(np.degrees(np.arctan2(*(corners[k] - corners[j])[::-1])))
        turn = turn if i == 0 else turn - 180.0
        _label(axes, at, found.diagonals[i], (0, 0), "center", "center", turn, box=True)
    axes.set_aspect("equal")
    span = np.ptp(outline, axis=0)
    for bounds, centre, size in ((axes.set_xlim, middle[0], span[0]),
                                 (axes.set_ylim, middle[1], span[1])):  # fmt: skip
        bounds(centre - 0.64 * size, centre + 0.64 * size)
    axes.set_xlabel("x [µm]", fontsize=8.5)
    axes.set_ylabel("y [µm]", fontsize=8.5)
    area, angle = found.area.times(1e12), found.squareness.times(1e6)
    # the squareness of a straight workspace is small: in microradians
    entitle(
        axes,
        title
        or f"{number(area.value)} ± {_short(area.expanded)} µm², off square by "
        f"{number(angle.value)} ± {_short(angle.expanded)} µrad (statistical)",
    )
    return figure


def _label(
    axes: "Axes",
    at: Array,
    length: "Estimate",
    offset: tuple[float, float],
    horizontal: str,
    vertical: str,
    turn: float = 0.0,
    *,
    box: bool = False,
) -> None:
    text = f"{number(1e6 * length.value)} µm"
    frame = {"boxstyle": "round,pad=0.15", "facecolor": axes.get_facecolor(), "edgecolor": "none"}
    axes.annotate(
        text, (float(at[0]), float(at[1])), xytext=offset, textcoords="offset points",
        ha=horizontal, va=vertical, rotation=turn, rotation_mode="default", fontsize=7.5, color=INK,
        bbox=frame if box else None,
    )  # fmt: skip


def _short(value: float) -> str:
    """Write an uncertainty with two digits."""
    return f"{float(f'{value:.2g}'):g}"
