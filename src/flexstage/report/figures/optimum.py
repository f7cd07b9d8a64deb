"""Pictures of an optimisation: its way, the stage before and after, its figures, its front."""

from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import FlexstageError
from flexstage.explore.figures import Figure
from flexstage.explore.optimise.front import Front
from flexstage.explore.optimise.optimum import Optimum
from flexstage.report.figures.drawing import draw_bodies
from flexstage.report.figures.shapes import body_shapes, extent
from flexstage.report.figures.style import CYCLE, INK, MUTED, dress, entitle, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawn

    from flexstage.stage import Stage

_MM = 1e3
# violation that is drawn as none
_NONE = 1e-8


def draw_history(found: Optimum) -> "Drawn":
    """Draw the goal and the violation of the requirements over the evaluations.

    Each search is a line; crosses are what the finer model says of the optimum of each turn.
    """
    figure = new_figure(6.6, 5.0)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.4, 1.0))
    goals = found.problem.goals
    shown = goals[0].figure.shown if goals else None
    factor = shown.factor if shown else 1.0
    turned = found.rungs[0].evaluations if found.rungs else np.inf
    for search in dict.fromkeys(step.search for step in found.trace):
        steps = [step for step in found.trace if step.search == search]
        at = [step.evaluations for step in steps]
        look: dict[str, Any] = {"color": CYCLE[search % len(CYCLE)], "marker": ".", "ms": 3}
        label = f"{'corrected' if at[0] > turned else 'search'} {search + 1}"
        above.plot(at, [factor * s.objective for s in steps], lw=1.2, **look)
        off = [max(s.violation, _NONE) for s in steps]
        below.semilogy(at, off, lw=1.2, label=label, **look)
    for k, rung in enumerate(found.rungs):
        if goals:
            above.plot(
                rung.evaluations,
                factor * rung.found[0],
                marker="x",
                color=INK,
                ms=6,
                ls="",
                label=f"by {rung.model}" if k == 0 else None,
            )
    for axes in (above, below):
        dress(axes)
    above.set_ylabel(goals[0].figure.heading if goals else "distance from the start [bounds]")
    below.set(ylabel="requirements missed by\n(sum, parts of the limits)", xlabel="evaluations")
    below.set_ylim(0.5 * _NONE, None)
    entitle(above, "Way to the optimum: lumped model, corrected after every turn")
    if goals and found.rungs:
        above.legend(frameon=False, fontsize=8)
    handles, labels = below.get_legend_handles_labels()
    place = "outside lower center"
    figure.legend(handles, labels, frameon=False, fontsize=7, ncols=5, loc=place)
    return figure


def draw_before_after(found: Optimum) -> "Drawn":
    """Draw the outlines of the stage as it is described or began, and of the best one."""
    from matplotlib.patches import PathPatch

    shapes = body_shapes(found.stage)
    before = _before(found)
    x0, y0, x1, y1 = (v * _MM for v in extent(shapes))
    if before is not None:
        b0, c0, b1, c1 = (v * _MM for v in extent(body_shapes(before)))
        x0, y0, x1, y1 = min(x0, b0), min(y0, c0), max(x1, b1), max(y1, c1)
    margin = 0.04 * max(x1 - x0, y1 - y0)
    per_inch = max(x1 - x0, y1 - y0) / 6.0
    figure = new_figure((x1 - x0) / per_inch + 1.2, (y1 - y0) / per_inch + 1.1)
    axes = figure.subplots()
    dress(axes, grid=False)
    draw_bodies(axes, found.stage, shapes)
    for shape in () if before is None else body_shapes(before):
        line = {"facecolor": "none", "edgecolor": CYCLE[1], "linewidth": 0.7, "zorder": 3}
        axes.add_patch(PathPatch(shape.path(_MM), **line))
    axes.set(
        xlim=(x0 - margin, x1 + margin),
        ylim=(y0 - margin, y1 + margin),
        xlabel="x [mm]",
        ylabel="y [mm]",
        aspect="equal",
    )
    handles = [axes.plot([], [], color=INK, label="best")[0]]
    if before is not None:
        handles.append(axes.plot([], [], color=CYCLE[1], label="start")[0])
    figure.legend(handles=handles, frameon=False, fontsize=8, ncols=2, loc="outside lower right")
    entitle(axes, f"{found.problem.family.template.source}: before and after")
    return figure


def _before(found: Optimum) -> "Stage | None":
    try:
        return found.problem.family.stage(found.start)
    except FlexstageError:
        return None


def draw_figures(found: Optimum) -> "Drawn":
    """Draw start and best stage by every model, each figure in parts of what is required of it."""
    rows = _compared(found)
    figure = new_figure(6.6, 0.9 + 0.5 * len(rows))
    axes = figure.subplots()
    dress(axes)
    at = np.arange(len(rows))[::-1]
    last = found.levels[-1]
    bars = [("start, " + last.model, last.start, MUTED)]
    bars += [
        (f"best, {level.model}", level.best, CYCLE[k % len(CYCLE)])
        for k, level in enumerate(found.levels)
    ]
    height = 0.8 / len(bars)
    for k, (label, values, colour) in enumerate(bars):
        shares = [values[i] / reference for i, _, reference in rows]
        offset = 0.4 - (k + 0.5) * height
        axes.barh(at + offset, shares, height=0.9 * height, color=colour, label=label)
    axes.axvline(1.0, color=INK, lw=0.8)
    axes.set_yticks(at, [name for _, name, _ in rows])
    axes.set_xlabel("parts of the limit; of the goal in parts of its start")
    axes.set_ylim(-0.6, len(rows) - 0.4)
    figure.legend(frameon=False, fontsize=8, loc="outside lower center", ncols=len(bars))
    entitle(axes, "Figures against what is required")
    return figure


def _compared(found: Optimum) -> list[tuple[int, str, float]]:
    """Place, name and reference of every figure that is drawn, its limit or what it began with."""
    rows = []
    limits = {}
    for asked in found.problem.all_requirements:
        limit = asked.low if asked.low is not None else asked.high
        limits.setdefault(asked.figure, (limit, asked))
    for i, figure in enumerate(found.figures):
        limit, asked = limits.get(figure, (None, None))
        reference = limit if limit else found.levels[-1].start[i]
        if not np.isfinite(reference) or reference == 0.0:
            continue
        sign = "" if asked is None else _sign(asked.low, asked.high)
        rows.append((i, f"{figure.label}{sign}", float(reference)))
    return rows


def _sign(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return "  ="
    return "  ≥" if low is not None else "  ≤"


def draw_front(found: Front) -> "Drawn":
    """Draw a front of two goals, or of more by pairs with the first."""
    goals = [goal.figure for goal in found.problem.goals]
    others = goals[1:]
    figure = new_figure(6.4 if len(others) == 1 else 4.2 * len(others), 4.4)
    for axes, other in zip(np.atleast_1d(figure.subplots(1, len(others))), others, strict=True):
        _pair(axes, found, other, goals[0])
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, fontsize=8, loc="outside lower center", ncols=4)
    return figure


def _pair(axes: "Axes", found: Front, across: Figure, up: Figure) -> None:
    at = [found.figures.index(figure) for figure in (across, up)]
    factors = np.array([across.shown.factor, up.shown.factor])

    def drawn(values: Array) -> Array:
        return (values[..., at] * factors).T

    dress(axes)
    axes.plot(*drawn(found.searched), "o", ms=2, color=MUTED, alpha=0.35, label="searched")
    axes.plot(*drawn(found.values), "o", ms=4, color=CYCLE[0], label="front, lumped")
    axes.plot(*drawn(found.found), "o", ms=5, color=CYCLE[1], label=f"front, {found.model}")
    best = found.optimum
    own = [best.figures.index(figure) for figure in (across, up)]
    axes.plot(
        *(best.levels[-1].best[own] * factors), "*", ms=12, color=CYCLE[2], label="chosen, improved"
    )
    axes.set(xlabel=across.heading, ylabel=up.heading)
    spread = drawn(np.concatenate([found.values, found.found]))
    for values, limit in zip(spread, (axes.set_xlim, axes.set_ylim), strict=True):
        room = 0.25 * max(float(np.ptp(values)), 1e-3 * abs(float(values.max())))
        limit(float(values.min()) - room, float(values.max()) + room)
