"""How the figures of a finite-element model settle as its mesh is refined."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from flexstage.arrays import Array
from flexstage.characteristic import WHOLE_STAGE
from flexstage.quantities import display
from flexstage.report.figures.style import (
    CYCLE,
    INK,
    MUTED,
    PAPER,
    add_legend,
    dress,
    entitle,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.fem import Refinement

_SHOWN = ("natural_frequency_hz", "transmission_ratio", "max_stress")
_DASHES = ("-", (0, (5, 2)), (0, (2, 1.5)), (0, (6, 2, 1, 2)))
_MARKS = "osD^vP"


def changes(refinement: "Refinement", quantity: str, axis: str) -> tuple[Array, Array]:
    """Return unknowns of each mesh but the last, and how far from the last a quantity was [1].

    The difference is a relative magnitude.
    """
    key = (quantity, axis)
    last = refinement.steps[-1].values[key]
    steps = [s for s in refinement.steps[:-1] if key in s.values]
    return (
        np.array([float(s.unknowns) for s in steps]),
        np.array([abs(s.values[key] / last - 1.0) for s in steps]),
    )


def draw_convergence(refinement: "Refinement") -> "Figure":
    """Draw how frequencies, ratios and stress settled.

    A diagram for each quantity, a line for each axis: the relative difference to the last mesh
    against unknowns. An open mark over the last mesh is the estimate of what its value lacks; the
    level line is the accuracy that was asked for.
    """
    quantities = [q for q in dict.fromkeys((*_SHOWN, refinement.quantity)) if _axes(refinement, q)]
    figure = new_figure(3.4 * max(len(quantities), 1) + 0.4, 3.4)
    grid = figure.subplots(1, max(len(quantities), 1), sharex=True, sharey=True, squeeze=False)[0]
    for axes in grid:
        dress(axes)
        axes.set(xscale="log", yscale="log")
        axes.set_xlabel("unknowns of the mesh", fontsize=8)
        axes.tick_params(axis="x", labelsize=7)
    grid[0].set_ylabel("difference to the last mesh [1]", fontsize=8)
    seen: list[float] = [refinement.accuracy]
    for axes, quantity in zip(grid, quantities, strict=False):
        entitle(axes, display(quantity).label)
        for i, axis in enumerate(_axes(refinement, quantity)):
            seen += _line(axes, refinement, quantity, axis, i)
        _asked(axes, refinement, own=quantity == refinement.quantity)
    _meshes(grid[0], refinement)
    positive = [v for v in seen if v > 0.0]
    grid[0].set_ylim(min(positive) / 2.0, max(positive) * 3.0)
    handles, labels = _named(grid)
    add_legend(figure, handles, labels, loc="outside lower center", ncols=min(len(labels), 4) or 1)
    return figure


def _meshes(axes: "Axes", refinement: "Refinement") -> None:
    """Mark each mesh on the level axis."""
    from matplotlib.ticker import NullLocator

    steps = refinement.steps
    low, high = steps[0].unknowns, steps[-1].unknowns
    axes.set_xlim(low / 1.4, high * 1.4)
    ticks: list[float] = []
    labels = []
    for step in reversed(steps):
        if ticks and step.unknowns > 0.8 * ticks[-1]:
            continue  # no room
        ticks.append(step.unknowns)
        size = f"{step.unknowns / 1e3:.3g} k" if step.unknowns >= 1000 else f"{step.unknowns}"
        labels.append(f"{size}\norder {step.settings.order}")
    axes.set_xticks(ticks, labels)
    axes.xaxis.set_minor_locator(NullLocator())


def _axes(refinement: "Refinement", quantity: str) -> list[str]:
    values = refinement.steps[-1].values
    return [axis for name, axis in values if name == quantity and axis != WHOLE_STAGE]


def _line(
    axes: "Axes", refinement: "Refinement", quantity: str, axis: str, index: int
) -> list[float]:
    """Draw one axis; return what was drawn."""
    unknowns, difference = changes(refinement, quantity, axis)
    colour = CYCLE[index % len(CYCLE)]
    # axes that are alike lie over one another, and show through each other's gaps
    look = {"color": colour, "linestyle": _DASHES[index % len(_DASHES)], "linewidth": 1.2}
    mark = {"marker": _MARKS[index % len(_MARKS)], "markersize": 4.5 - 0.5 * min(index, 3)}
    drawn = difference > 0.0  # a logarithm has no nothing
    axes.plot(unknowns[drawn], difference[drawn], label=f"axis {axis}", **look, **mark)
    rows = refinement.analysis.characteristics
    row = next((r for r in rows if (r.quantity, r.axis) == (quantity, axis)), None)
    left = 0.0
    if row is not None and row.uncertainty and row.value:
        left = abs(row.uncertainty / row.value)
        axes.plot(
            [refinement.steps[-1].unknowns], [left], linestyle="none", color=colour,
            markerfacecolor=PAPER, label=f"axis {axis}, estimate for the last mesh", **mark,
        )  # fmt: skip
    return [*difference.tolist(), left]


def _asked(axes: "Axes", refinement: "Refinement", *, own: bool) -> None:
    """Draw the accuracy that was asked for; of other quantities only as what it was for one."""
    if not own:
        axes.axhline(refinement.accuracy, color=MUTED, linewidth=0.6, linestyle=(0, (1, 3)))
        return
    axes.axhline(refinement.accuracy, color=INK, linewidth=1.0, linestyle=(0, (4, 2)))
    axes.annotate(
        f"asked for: {100.0 * refinement.accuracy:.3g} %", (0.0, refinement.accuracy),
        xycoords=("axes fraction", "data"), xytext=(4, 3), textcoords="offset points",
        fontsize=7, color=INK, bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 0.6},
    )  # fmt: skip


def _named(grid: "Iterable[Axes]") -> tuple[list["Artist"], list[str]]:
    """Each label once."""
    found: dict[str, Artist] = {}
    for axes in grid:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values()), list(found)
