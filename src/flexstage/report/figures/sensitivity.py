"""Sensitivities of the figures of a stage: a colour map, and the necks on the drawing."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.quantities.characteristic import WHOLE_STAGE
from flexstage.report.figures.shapes import add_body, body_shapes, extent
from flexstage.report.figures.style import (
    BODY,
    CYCLE,
    FIXED,
    HATCH,
    INK,
    MM,
    MUTED,
    PAPER,
    add_words,
    one_panel,
    panels,
    set_title,
)
from flexstage.report.sensitivity import (
    change_text,
    displayed_changes,
    influential_parameters,
    parameter_label,
    short_label,
    step_words,
)
from flexstage.report.tables import value_text
from flexstage.stage import Stage
from flexstage.studies.explore.sensitivity import LENGTH, Sensitivities

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# width of a column, height of a row and of a letter [inch]
_COLUMN, _ROW, _LETTER = 0.62, 0.19, 0.075


def draw_sensitivities(sensitivities: Sensitivities) -> "Figure":
    """Draw the change of each figure in per cent, by the most influential parameters.

    Colours follow the square root of the change, so that small changes are visible.
    """
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.patches import Rectangle

    # most parameters; the others have smaller effects
    rows = 40

    changes = displayed_changes(sensitivities)
    order, _ = influential_parameters(sensitivities)
    figure_indices = [
        i for i in range(len(sensitivities.figures)) if not sensitivities.vanishing[i]
    ]
    order = [k for k in order if changes[figure_indices][:, k].any()]
    drawn_parameters = order[:rows]
    cells = np.nan_to_num(changes[np.ix_(figure_indices, drawn_parameters)].T)
    names = [parameter_label(sensitivities, k) for k in drawn_parameters]
    wide = _LETTER * max((len(name) for name in names), default=0)
    if not drawn_parameters:
        return _empty(sensitivities)
    figure, axes = one_panel(
        wide + _COLUMN * max(len(figure_indices), 4) + 0.3,
        _ROW * max(len(drawn_parameters), 3) + 1.0,
        grid=False,
    )
    for spine in axes.spines.values():
        spine.set_visible(False)
    largest = float(np.abs(cells).max(initial=0.0)) or 1.0
    colour = LinearSegmentedColormap.from_list("change", (CYCLE[0], PAPER, CYCLE[1]))
    part = np.sign(cells) * np.sqrt(np.abs(cells) / largest)
    for (row, column), value in np.ndenumerate(cells):
        if value == 0.0:
            axes.text(column, row, "·", ha="center", va="center", fontsize=7, color=MUTED)
            continue
        strength = float(part[row, column])
        face = colour(0.5 + 0.42 * strength)
        cell = Rectangle((column - 0.47, row - 0.45), 0.94, 0.9, facecolor=face, linewidth=0.0)
        axes.add_patch(cell)
        text = change_text(float(value)).replace("-", "−")
        axes.text(
            column, row, text, ha="center", va="center", fontsize=7,
            color=PAPER if abs(strength) > 0.8 else INK,
        )  # fmt: skip
    axes.set_xlim(-0.5, len(figure_indices) - 0.5)
    axes.set_ylim(len(drawn_parameters) - 0.5, -0.5)
    axes.set_yticks(range(len(drawn_parameters)), names, fontsize=7.5, parse_math=False)
    heads = []
    for i in figure_indices:
        axis = sensitivities.figures[i].axis
        label = short_label(sensitivities.figures[i])
        heads.append(f"{label}\n{'' if axis == WHOLE_STAGE else axis}")
    axes.set_xticks(range(len(figure_indices)), heads, fontsize=7.5, parse_math=False)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    set_title(axes, f"{sensitivities.stage}, {sensitivities.model}")
    label_below = f"change of each figure [%] for {step_words(sensitivities)}"
    if omitted := len(order) - len(drawn_parameters):
        label_below += f"\n{omitted} more parameters have smaller effects"
    axes.set_xlabel(label_below, fontsize=7.5, color=MUTED, loc="left", parse_math=False)
    return figure


def _empty(sensitivities: Sensitivities) -> "Figure":
    figure, axes = one_panel(4.2, 1.0, grid=False)
    axes.set_axis_off()
    text = (
        f"{sensitivities.stage}, {sensitivities.model}: no parameter has an effect on these figures"
    )
    axes.text(0.5, 0.5, text, ha="center", va="center", fontsize=8, color=INK, parse_math=False)
    return figure


# most figures, most columns, and longer side of a stage [inch]
_MOST, _COLUMNS, _SIDE = 6, 3, 2.9
# diameter of the disc of the most influential neck, and of the smallest disc [point]
_LARGEST, _SMALLEST = 17.0, 1.2


def draw_moving_necks(stage: Stage, sensitivities: Sensitivities) -> "Figure":
    """Draw a disc at each neck with the area of its influence on a figure; one stage per figure.

    The sensitivities are of a `HingeFamily`; at most six figures are drawn.

    Raises
    ------
    ModelError
        No neck was varied, or none affects a figure.
    """
    # smallest influence on a figure that is drawn, relative to the largest influence
    share = 0.05
    necks = [k for k, v in enumerate(sensitivities.variables) if v.name.endswith(".neck")]
    changes = displayed_changes(sensitivities, LENGTH)[:, necks]
    largest = np.abs(changes).max(axis=1, initial=0.0)
    largest[sensitivities.vanishing] = 0.0
    least = share * float(largest.max(initial=0.0))
    figure_indices = [i for i in range(len(sensitivities.figures)) if largest[i] > least]
    figure_indices = sorted(sorted(figure_indices, key=lambda i: -largest[i])[:_MOST])
    if not figure_indices:
        raise ModelError("no neck affects a figure: there is nothing to draw")
    x0, y0, x1, y1 = (v * MM for v in extent(body_shapes(stage)))
    per_inch = max(x1 - x0, y1 - y0) / _SIDE
    columns = 2 if len(figure_indices) == 4 else min(len(figure_indices), _COLUMNS)
    rows = -(-len(figure_indices) // columns)
    wide, high = ((x1 - x0) / per_inch + 0.25), ((y1 - y0) / per_inch + 0.5)
    figure, grid = panels(
        columns * wide, rows * high + 0.3, len(figure_indices), columns, grid=False
    )
    for axes, i in zip(grid, figure_indices, strict=True):
        by_hinge = {
            name.removesuffix(".neck"): float(changes[i, j])
            for j, k in enumerate(necks)
            for name in sensitivities.equivalent[k]
        }
        _panel(axes, stage, by_hinge)
        set_title(axes, sensitivities.figures[i].label)
    figure.supxlabel(
        f"change of the figure [%] for +{value_text(LENGTH, 'length')} of one neck; orange: "
        "increase, blue: decrease",
        fontsize=7.5, color=MUTED, x=0.02, ha="left",
    )  # fmt: skip
    return figure


def _panel(axes: "Axes", stage: Stage, changes: dict[str, float]) -> None:
    axes.set_axis_off()
    axes.set_aspect("equal")
    for shape in body_shapes(stage):
        add_body(axes, shape, FIXED if shape.body.fixed else BODY, HATCH, 0.4)
    axes.margins(0.01)
    axes.autoscale_view()
    largest = max(map(abs, changes.values()))
    for hinge in stage.hinges:
        change = changes.get(hinge.name, 0.0)
        size = _LARGEST * np.sqrt(abs(change) / largest)
        if size < _SMALLEST:
            continue
        x, y = hinge.at[0] * MM, hinge.at[1] * MM
        colour = CYCLE[1] if change > 0.0 else CYCLE[0]
        axes.plot(x, y, "o", color=colour, markersize=size, markeredgewidth=0.0, alpha=0.85)
    # the most influential neck has the number
    top = max(stage.hinges, key=lambda hinge: abs(changes.get(hinge.name, 0.0)))
    add_words(
        axes,
        change_text(changes[top.name]),
        (top.at[0] * MM, top.at[1] * MM),
        (12, 12),
        7,
        ha="left",
        va="center",
        bbox={"boxstyle": "round,pad=0.15", "facecolor": PAPER, "edgecolor": "none"},
        arrowprops={"arrowstyle": "-", "color": INK, "linewidth": 0.5, "shrinkB": 0.0},
    )
