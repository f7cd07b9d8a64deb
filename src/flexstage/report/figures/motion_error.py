"""Measured motion: errors over the stroke, workspace, and positioning."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.base.arrays import Array
from flexstage.measure.motion.motion_curve import Line, MotionCurve, line_weights
from flexstage.measure.motion.positioning import Positioning
from flexstage.measure.motion.reach import Workspace
from flexstage.quantities.quantity import number, prefixed
from flexstage.report.figures.style import (
    CYCLE,
    INK,
    LONG_DASHED,
    MUTED,
    PAPER,
    add_legend,
    add_words,
    label_axes,
    one_panel,
    set_title,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.quantities.estimate import Estimate


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

    `line` is the straight line of the mean of both runs, which is subtracted; labels have no unit.
    """
    x = curve.grid()
    off = line_weights(x, line)
    mean = curve.rows(x, "mean")
    # an offset is no error of motion: without a line the mean is subtracted
    base = off @ mean if line != "none" else np.tile(mean.mean(axis=0), (x.size, 1))
    figure, axes = one_panel(6.4, 3.3)
    curves = []
    for name in ("forward", "backward"):
        rows = curve.rows(x, name) - base
        estimates = [curve.of_coefficients(r) for r in rows]
        values = np.array([e.value for e in estimates])
        curves.append((name, values, np.array([e.expanded for e in estimates])))
    reach = max(float(np.abs(v).max() + u.max()) for _, v, u in curves)
    factor, prefix = prefixed(reach)
    across, unit = prefixed(float(np.abs(x).max())) if curve.position_unit == "m" else (1.0, "")
    for colour, style, (name, values, band) in zip(CYCLE, ("-", (0, (5, 2))), curves, strict=False):
        axes.fill_between(
            across * x, factor * (values - band), factor * (values + band), color=colour,
            alpha=0.18, linewidth=0.0,
        )  # fmt: skip
        axes.plot(across * x, factor * values, color=colour, linewidth=1.4, linestyle=style,
                  label=name)  # fmt: skip
    axes.set_xlim(across * x[0], across * x[-1])
    of_position = f" [{unit}{curve.position_unit}]" if curve.position_unit else ""
    of_error = f" [{prefix}{curve.unit}]" if curve.unit else ""
    label_axes(axes, f"{position_label}{of_position}", f"{label}{of_error}")
    if legend:
        add_legend(
            axes,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.2),
            ncols=2,
            title="with 95 % band",
            title_fontproperties={"size": 7.5},
        ).get_title().set_color(MUTED)
    if title:
        set_title(axes, title)
    return figure


def draw_workspace(workspace: Workspace, *, title: str = "") -> "Figure":
    """Draw the measured workspace, with corners, sides and diagonals, in micrometres.

    The default title is the area.
    """
    figure, axes = one_panel(5.0, 4.7)
    corners = 1e6 * workspace.corners
    closed = np.vstack((corners, corners[:1]))
    axes.fill(closed[:, 0], closed[:, 1], color=CYCLE[0], alpha=0.12, linewidth=0.0)
    axes.plot(closed[:, 0], closed[:, 1], color=CYCLE[0], linewidth=1.3)
    for i, j in ((0, 2), (1, 3)):
        axes.plot(*corners[[i, j]].T, color=MUTED, linewidth=0.8, linestyle=LONG_DASHED)
    axes.plot(*corners.T, "o", color=CYCLE[1], markersize=4.0)
    middle = corners.mean(axis=0)
    _label(axes, 0.5 * (corners[0] + corners[1]), workspace.stroke_x[0], (0, -5), "center", "top")
    _label(axes, 0.5 * (corners[3] + corners[2]), workspace.stroke_x[1], (0, 5), "center", "bottom")
    _label(
        axes, 0.5 * (corners[0] + corners[3]), workspace.stroke_y[0], (-5, 0), "right", "center", 90
    )
    _label(
        axes, 0.5 * (corners[1] + corners[2]), workspace.stroke_y[1], (5, 0), "left", "center", 90
    )
    for i, (j, k) in enumerate(((0, 2), (1, 3))):
        # a quarter from the upper end, so that the two texts do not meet
        at = corners[j] + 0.74 * (corners[k] - corners[j])
        turn = float(np.degrees(np.arctan2(*(corners[k] - corners[j])[::-1])))
        turn = turn if i == 0 else turn - 180.0
        _label(axes, at, workspace.diagonals[i], (0, 0), "center", "center", turn, box=True)
    axes.set_aspect("equal")
    span = np.ptp(corners, axis=0)
    for bounds, centre, size in ((axes.set_xlim, middle[0], span[0]),
                                 (axes.set_ylim, middle[1], span[1])):  # fmt: skip
        bounds(centre - 0.64 * size, centre + 0.64 * size)
    label_axes(axes, "x [µm]", "y [µm]")
    area, angle = workspace.area.times(1e12), workspace.squareness.times(1e6)
    # the squareness of a straight workspace is small: in microradians
    set_title(
        axes,
        title
        or f"{number(area.value)} ± {_short(area.expanded)} µm², squareness error "
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
    add_words(
        axes,
        text,
        (float(at[0]), float(at[1])),
        offset,
        ha=horizontal,
        va=vertical,
        rotation=turn,
        rotation_mode="default",
        bbox=frame if box else None,
    )


def _short(value: float) -> str:
    """Return an uncertainty with two digits."""
    return f"{float(f'{value:.2g}'):g}"


_UP, _DOWN, _MEAN = CYCLE[0], CYCLE[1], CYCLE[2]
#: Distance of the first dimension from the last target, and between dimensions, over the range.
_GAP, _PITCH = 0.05, 0.085


def draw_positioning(positioning: Positioning, *, title: str = "") -> "Figure":
    """Draw deviations over the targets, with the figures of the axis as dimensions.

    Mean deviation upward, downward and of both, with two standard deviations about each of the
    former; A, E and M at the side, R and B at their targets. The default title is the accuracy.
    """
    figure, axes = one_panel(7.2, 4.0)
    (across, of_target), (factor, unit) = positioning.shown_units
    x = across * positioning.target
    up, down, mean = (
        factor * v
        for v in (
            positioning.mean_upward,
            positioning.mean_downward,
            positioning.mean_bidirectional,
        )
    )
    wide_up, wide_down = (
        2.0 * factor * positioning.spread_upward,
        2.0 * factor * positioning.spread_downward,
    )
    small = 3.5 if x.size <= 15 else 2.0
    for y, wide, colour, mark, name in (
        (up, wide_up, _UP, "^", "mean upward x̄↑"),
        (down, wide_down, _DOWN, "v", "mean downward x̄↓"),
    ):
        axes.fill_between(x, y - wide, y + wide, color=colour, alpha=0.15, linewidth=0.0)
        for edge in (y - wide, y + wide):
            axes.plot(x, edge, color=colour, linewidth=0.6, linestyle=(0, (2, 2)))
        axes.plot(x, y, color=colour, linewidth=1.3, marker=mark, markersize=small, label=name)
    axes.plot(x, mean, color=_MEAN, linewidth=1.0, linestyle=(0, (6, 2)), label="mean of both x̄")
    tops, feet = (np.stack((up + wide_up, down + wide_down)),
                  np.stack((up - wide_up, down - wide_down)))  # fmt: skip
    span = float(np.ptp(x))
    for k, (symbol, estimate, ends) in enumerate(
        (
            ("A", positioning.accuracy.value, (feet, tops)),
            ("E", positioning.systematic.value, (np.stack((up, down)),) * 2),
            ("M", positioning.mean_deviation.value, (mean[None],) * 2),
        )
    ):  # fmt: skip
        at = float(x[-1]) + span * (_GAP + _PITCH * (2 - k))
        _dimension(axes, at, _ends(x, *ends), f"{symbol} = {number(factor * estimate)} {unit}")
    _at_targets(axes, positioning, x, factor, unit, (tops, feet), (up, down))
    axes.margins(y=0.13)
    axes.set_xlim(x[0] - 0.09 * span, x[-1] + span * (_GAP + 2.6 * _PITCH))
    label_axes(axes, f"target [{of_target}]", f"deviation [{unit}]")
    add_legend(
        axes,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.14),
        ncols=3,
        title=f"bands of ±2 s, {positioning.runs} runs",
        title_fontproperties={"size": 7.5},
    ).get_title().set_color(MUTED)
    set_title(axes, title or f"A = {number(factor * positioning.accuracy.value)} {unit}")
    return figure


def _ends(x: Array, low: Array, high: Array) -> tuple[tuple[float, float], ...]:
    """Return the positions of the minimum of curves, and of the maximum of others."""
    i, j = np.unravel_index(int(np.argmin(low)), low.shape)
    k, m = np.unravel_index(int(np.argmax(high)), high.shape)
    return (float(x[j]), float(low[i, j])), (float(x[m]), float(high[k, m]))


def _dimension(axes: "Axes", at: float, ends: tuple[tuple[float, float], ...], text: str) -> None:
    """Draw a dimension between two heights, with extension lines."""
    (x_low, low), (x_high, high) = ends
    for x, y in ((x_low, low), (x_high, high)):
        axes.plot((x, at), (y, y), color=MUTED, linewidth=0.5)
    _arrow(axes, at, low, high, INK)
    add_words(axes, text, (at, 0.5 * (low + high)), (3, 0), ha="left", va="center", rotation=90)


def _at_targets(
    axes: "Axes",
    positioning: Positioning,
    x: Array,
    factor: float,
    unit: str,
    bands: tuple[Array, Array],
    means: tuple[Array, Array],
) -> None:
    """Draw R and B at the targets where they are largest."""
    tops, feet = bands
    up, down = means
    i = int(np.argmax(positioning.repeatability_at_targets))
    high, low = float(tops[:, i].max()), float(feet[:, i].min())
    _arrow(axes, float(x[i]), low, high, INK)
    _text(
        axes, float(x[i]), high, f"R = {number(factor * positioning.repeatability.value)} {unit}", 1
    )
    j = int(np.argmax(np.abs(positioning.reversal_at_targets)))
    aside = 0.012 * float(np.ptp(x)) if i == j else 0.0
    _arrow(axes, float(x[j]) + aside, float(up[j]), float(down[j]), CYCLE[3])
    # below, where R is above
    _text(
        axes, float(x[j]), float(feet[:, j].min()),
        f"B = {number(factor * positioning.reversal.value)} {unit}", -1,
    )  # fmt: skip


def _arrow(axes: "Axes", x: float, low: float, high: float, colour: str) -> None:
    axes.annotate(
        "", (x, high), (x, low),
        arrowprops={"arrowstyle": "<->", "color": colour, "linewidth": 0.9, "shrinkA": 0.0,
                    "shrinkB": 0.0, "mutation_scale": 7.0},
    )  # fmt: skip


def _text(axes: "Axes", x: float, y: float, text: str, side: int) -> None:
    add_words(
        axes,
        text,
        (x, y),
        (0, 4 * side),
        ha="center",
        va="bottom" if side > 0 else "top",
        bbox={"boxstyle": "round,pad=0.1", "facecolor": PAPER, "edgecolor": "none", "alpha": 0.8},
    )
