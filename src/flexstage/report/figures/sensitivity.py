"""Which parameter moves which figure: a map of numbers, and the necks on the drawing."""

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
    entitle,
    one_panel,
    panels,
)
from flexstage.report.sensitivity import (
    change_text,
    moving,
    parameter_label,
    short_label,
    shown_changes,
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


def draw_sensitivities(found: Sensitivities) -> "Figure":
    """Draw the change of each figure in per cent of it, by the parameters that move one most.

    Colour goes with the root of the change, so that small ones are seen beside large ones.
    """
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.patches import Rectangle

    # parameters that are drawn at most; the others move less
    rows = 40

    shown = shown_changes(found)
    order, _ = moving(found)
    kept = [i for i in range(len(found.figures)) if not found.vanishing[i]]
    order = [k for k in order if shown[kept][:, k].any()]
    drawn = order[:rows]
    cells = np.nan_to_num(shown[np.ix_(kept, drawn)].T)
    names = [parameter_label(found, k) for k in drawn]
    wide = _LETTER * max((len(name) for name in names), default=0)
    if not drawn:
        return _empty(found)
    figure, axes = one_panel(
        wide + _COLUMN * max(len(kept), 4) + 0.3, _ROW * max(len(drawn), 3) + 1.0, grid=False
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
    axes.set_xlim(-0.5, len(kept) - 0.5)
    axes.set_ylim(len(drawn) - 0.5, -0.5)
    axes.set_yticks(range(len(drawn)), names, fontsize=7.5, parse_math=False)
    heads = []
    for i in kept:
        axis = found.figures[i].axis
        label = short_label(found.figures[i])
        heads.append(f"{label}\n{'' if axis == WHOLE_STAGE else axis}")
    axes.set_xticks(range(len(kept)), heads, fontsize=7.5, parse_math=False)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    entitle(axes, f"{found.stage}, {found.model}")
    told = f"change of each figure [%] for {step_words(found)}"
    if more := len(order) - len(drawn):
        told += f"\n{more} more parameters move a figure, and less than these"
    axes.set_xlabel(told, fontsize=7.5, color=MUTED, loc="left", parse_math=False)
    return figure


def _empty(found: Sensitivities) -> "Figure":
    figure, axes = one_panel(4.2, 1.0, grid=False)
    axes.set_axis_off()
    told = f"{found.stage}, {found.model}: none of these parameters moves these figures"
    axes.text(0.5, 0.5, told, ha="center", va="center", fontsize=8, color=INK, parse_math=False)
    return figure


# figures that are drawn at most, so many beside each other; longer side of a stage [inch]
_MOST, _COLUMNS, _SIDE = 6, 3, 2.9
# diameter of the disc of the neck that moves a figure most, and of the least that is drawn [point]
_LARGEST, _SMALLEST = 17.0, 1.2


def draw_moving_necks(stage: Stage, found: Sensitivities) -> "Figure":
    """Draw a disc at each neck, its area by how much the neck moves a figure; one stage a figure.

    `found` is of a `HingeFamily`; the figures are those that necks move most, at most six.

    Raises
    ------
    ModelError
        No neck was varied, or none moves a figure.
    """
    # a figure is drawn if a neck moves it by this of what one moves another
    share = 0.05
    necks = [k for k, v in enumerate(found.variables) if v.name.endswith(".neck")]
    changes = shown_changes(found, LENGTH)[:, necks]
    largest = np.abs(changes).max(axis=1, initial=0.0)
    largest[found.vanishing] = 0.0
    least = share * float(largest.max(initial=0.0))
    kept = [i for i in range(len(found.figures)) if largest[i] > least]
    kept = sorted(sorted(kept, key=lambda i: -largest[i])[:_MOST])
    if not kept:
        raise ModelError("no neck moves a figure that is looked at, so there is nothing to draw")
    x0, y0, x1, y1 = (v * MM for v in extent(body_shapes(stage)))
    per_inch = max(x1 - x0, y1 - y0) / _SIDE
    columns = 2 if len(kept) == 4 else min(len(kept), _COLUMNS)
    rows = -(-len(kept) // columns)
    wide, high = ((x1 - x0) / per_inch + 0.25), ((y1 - y0) / per_inch + 0.5)
    figure, grid = panels(columns * wide, rows * high + 0.3, len(kept), columns, grid=False)
    for axes, i in zip(grid, kept, strict=True):
        by_hinge = {
            name.removesuffix(".neck"): float(changes[i, j])
            for j, k in enumerate(necks)
            for name in found.equivalent[k]
        }
        _panel(axes, stage, by_hinge)
        entitle(axes, found.figures[i].label)
    figure.supxlabel(
        f"change of the figure [%] for +{value_text(LENGTH, 'length')} of one neck; orange more, "
        "blue less",
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
    # the number stands at one of those that move it most: the last that is drawn, on top
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
