"""Which neck moves a figure most, on the drawing of the stage."""

from typing import TYPE_CHECKING

import numpy as np

from flexstage.errors import ModelError
from flexstage.explore.sensitivity import LENGTH, Sensitivities
from flexstage.report.figures.shapes import body_shapes, extent
from flexstage.report.figures.style import (
    BODY,
    CYCLE,
    FIXED,
    HATCH,
    INK,
    MUTED,
    PAPER,
    dress,
    entitle,
    new_figure,
)
from flexstage.report.sensitivity import change_text, shown_changes
from flexstage.report.tables import value_text
from flexstage.stage import Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MM = 1e3
# figures that are drawn at most, so many beside each other; longer side of a stage [inch]
_MOST, _COLUMNS, _SIDE = 6, 3, 2.9
# a figure is drawn if a neck moves it by this of what one moves another
_SHARE = 0.05
# diameter of the disc of the neck that moves a figure most, and of the least that is drawn [point]
_LARGEST, _SMALLEST = 17.0, 1.2


def draw_moving_necks(stage: Stage, found: Sensitivities, length: float = LENGTH) -> "Figure":
    """Draw a disc at each neck, its area by how much the neck moves a figure; one stage a figure.

    `found` is of a `HingeFamily`; the figures are those that necks move most, at most six.

    Raises
    ------
    ModelError
        No neck was varied, or none moves a figure.
    """
    necks = [k for k, v in enumerate(found.variables) if v.name.endswith(".neck")]
    changes = shown_changes(found, length)[:, necks]
    largest = np.abs(changes).max(axis=1, initial=0.0)
    largest[found.vanishing] = 0.0
    least = _SHARE * float(largest.max(initial=0.0))
    kept = [i for i in range(len(found.figures)) if largest[i] > least]
    kept = sorted(sorted(kept, key=lambda i: -largest[i])[:_MOST])
    if not kept:
        raise ModelError("no neck moves a figure that is looked at, so there is nothing to draw")
    x0, y0, x1, y1 = (v * _MM for v in extent(body_shapes(stage)))
    per_inch = max(x1 - x0, y1 - y0) / _SIDE
    columns = 2 if len(kept) == 4 else min(len(kept), _COLUMNS)
    rows = -(-len(kept) // columns)
    figure = new_figure(
        columns * ((x1 - x0) / per_inch + 0.25), rows * ((y1 - y0) / per_inch + 0.5) + 0.3
    )
    panels = np.ravel(figure.subplots(rows, columns, squeeze=False))
    for axes in panels:
        axes.set_axis_off()
    for axes, i in zip(panels, kept, strict=False):
        by_hinge = {
            name.removesuffix(".neck"): float(changes[i, j])
            for j, k in enumerate(necks)
            for name in found.alike[k]
        }
        _panel(axes, stage, by_hinge)
        entitle(axes, found.figures[i].label)
    figure.supxlabel(
        f"change of the figure [%] for +{value_text(length, 'length')} of one neck; orange more, "
        "blue less",
        fontsize=7.5, color=MUTED, x=0.02, ha="left",
    )  # fmt: skip
    return figure


def _panel(axes: "Axes", stage: Stage, changes: dict[str, float]) -> None:
    from matplotlib.patches import PathPatch

    dress(axes, grid=False)
    axes.set_axis_off()
    axes.set_aspect("equal")
    for shape in body_shapes(stage):
        fill = FIXED if shape.body.fixed else BODY
        patch = PathPatch(shape.path(_MM), facecolor=fill, edgecolor=HATCH, linewidth=0.4)
        axes.add_patch(patch)
    axes.margins(0.01)
    axes.autoscale_view()
    largest = max(map(abs, changes.values()))
    for hinge in stage.hinges:
        change = changes.get(hinge.name, 0.0)
        size = _LARGEST * np.sqrt(abs(change) / largest)
        if size < _SMALLEST:
            continue
        x, y = hinge.at[0] * _MM, hinge.at[1] * _MM
        colour = CYCLE[1] if change > 0.0 else CYCLE[0]
        axes.plot(x, y, "o", color=colour, markersize=size, markeredgewidth=0.0, alpha=0.85)
    # the number stands at one of those that move it most: the last that is drawn, on top
    top = max(stage.hinges, key=lambda hinge: abs(changes.get(hinge.name, 0.0)))
    axes.annotate(
        change_text(changes[top.name]), (top.at[0] * _MM, top.at[1] * _MM), xytext=(12, 12),
        textcoords="offset points", fontsize=7, color=INK, ha="left", va="center",
        bbox={"boxstyle": "round,pad=0.15", "facecolor": PAPER, "edgecolor": "none"},
        arrowprops={"arrowstyle": "-", "color": INK, "linewidth": 0.5, "shrinkB": 0.0},
    )  # fmt: skip
