"""Pictures of an optimisation: its history, the stage before and after, its figures, its front."""

from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import FlexstageError
from flexstage.report.figures.drawing import draw_bodies
from flexstage.report.figures.shapes import BodyShape, body_shapes, extent
from flexstage.report.figures.style import (
    CYCLE,
    INK,
    MM,
    MUTED,
    PAPER,
    add_legend,
    add_shared_legend,
    new_figure,
    one_panel,
    panels,
    set_title,
    style_axes,
)
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.optimise.front import Front
from flexstage.studies.explore.optimise.optimum import Optimum

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawn

    from flexstage.stage import Stage

#: Mean width of a sliver below which it is rounding [mm].
_ROUNDING = 1e-3
#: Mean width of a change below which it is magnified, relative to the drawing [1].
_VISIBLE = 8e-3


def draw_history(optimum: Optimum) -> "Drawn":
    """Draw the goal and the violation of the requirements over the evaluations.

    Searches of the lumped and of the corrected model have different colours; crosses are the values
    of the finer model at the optimum of each iteration.
    """
    # a smaller violation is drawn as this
    smallest = 1e-8
    figure, (above, below) = panels(6.6, 5.0, 2, sharex=True, height_ratios=(1.4, 1.0))
    goals = optimum.problem.goals
    quantity = goals[0].figure.display if goals else None
    factor = quantity.factor if quantity else 1.0
    first_correction = optimum.iterations[0].evaluations if optimum.iterations else np.inf
    for search in dict.fromkeys(step.search for step in optimum.history):
        steps = [step for step in optimum.history if step.search == search]
        at = [step.evaluations for step in steps]
        corrected = at[0] > first_correction
        look: dict[str, Any] = {"color": CYCLE[int(corrected)], "marker": ".", "ms": 3, "lw": 1.2}
        label = "corrected model" if corrected else "lumped model, one line per start"
        above.plot(at, [factor * s.objective for s in steps], label=label, **look)
        below.semilogy(at, [max(s.violation, smallest) for s in steps], **look)
    for level in optimum.iterations if goals else ():
        value, label = factor * level.computed[0], f"by {level.model}"
        above.plot(level.evaluations, value, marker="x", color=INK, ms=6, ls="", label=label)
    above.set_ylabel(goals[0].figure.heading if goals else "distance from the start\n[bounds]")
    below.set(ylabel="violation\n[relative to limit]", xlabel="evaluations of the lumped model")
    below.set_ylim(0.5 * smallest, None)
    figure.align_ylabels([above, below])
    set_title(above, "History of the goal, and of the violation of the requirements")
    add_shared_legend(figure, size=8)
    return figure


def draw_before_after(optimum: Optimum) -> "Drawn":
    """Draw the best stage, and the edges of the initial one where they differ.

    Small changes are coloured as added and removed, also in a magnified detail.
    """
    shapes = body_shapes(optimum.stage)
    before = _before(optimum)
    x0, y0, x1, y1 = (v * MM for v in extent(shapes))
    added: list[Any] = []
    removed: list[Any] = []
    edges: Any = None
    if before is not None:
        b0, c0, b1, c1 = (v * MM for v in extent(body_shapes(before)))
        x0, y0, x1, y1 = min(x0, b0), min(y0, c0), max(x1, b1), max(y1, c1)
        area_before, area_after = (_area(each) for each in (body_shapes(before), shapes))
        added, removed = (
            _pieces(area_after.difference(area_before)),
            _pieces(area_before.difference(area_after)),
        )
        edges = area_before.boundary.difference(area_after.boundary.buffer(_ROUNDING))
    size = max(x1 - x0, y1 - y0)
    margin = 0.04 * size
    detail = _detail(optimum.stage, [*added, *removed], size)
    width, height = 6.0 * (x1 - x0) / size + 1.2, 6.0 * (y1 - y0) / size + 1.2
    figure = new_figure(width + (0.0 if detail is None else height - 1.6), height)
    axes = figure.add_subplot(1, 1 if detail is None else 2, 1)
    _draw_best(axes, optimum, shapes)
    axes.set(xlim=(x0 - margin, x1 + margin), ylim=(y0 - margin, y1 + margin))
    set_title(axes, f"{optimum.problem.family.template.source}: before and after")
    handles: list[Any] = []
    if detail is not None:
        detail_axes = figure.add_subplot(1, 2, 2)
        _draw_best(detail_axes, optimum, shapes)
        for place in (axes, detail_axes):
            handles = [
                _fill(place, added, CYCLE[2], "added"),
                _fill(place, removed, CYCLE[1], "removed"),
            ]
        x, y, half = detail
        detail_axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
        set_title(detail_axes, f"largest change, magnified {0.5 * size / half:.0f} times")
        axes.indicate_inset((x - half, y - half, 2.0 * half, 2.0 * half), edgecolor=INK, alpha=1.0)
    elif edges is not None:
        axes.add_patch(_outlines(edges, CYCLE[1]))
        handles = [axes.plot([], [], color=INK, lw=1.0, label="best")[0]]
        handles += axes.plot([], [], color=CYCLE[1], lw=1.2, label="start, where it differs")
    if handles:
        add_legend(figure, handles=handles, loc="outside lower center", ncols=2, size=8)
    return figure


def _draw_best(axes: "Axes", optimum: Optimum, shapes: tuple[BodyShape, ...]) -> None:
    style_axes(axes, grid=False)
    draw_bodies(axes, optimum.stage, shapes)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")


def _fill(axes: "Axes", pieces: list[Any], colour: str, label: str) -> Any:
    """Fill areas, with an edge to show narrow ones; return the entry of the legend."""
    from matplotlib.patches import Patch, PathPatch
    from matplotlib.path import Path

    for piece in pieces:
        rings = [
            Path(np.asarray(r.coords), closed=True) for r in (piece.exterior, *piece.interiors)
        ]
        look = {"facecolor": colour, "edgecolor": colour, "linewidth": 1.0, "zorder": 3}
        axes.add_patch(PathPatch(Path.make_compound_path(*rings), alpha=0.8, **look))
    return Patch(color=colour, alpha=0.8, label=label)


def _outlines(lines: Any, colour: str) -> Any:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path
    from shapely import get_parts

    paths = [Path(np.asarray(line.coords)) for line in get_parts(lines) if not line.is_empty]
    path = Path.make_compound_path(*paths) if paths else Path(np.zeros((0, 2)))
    return PathPatch(path, facecolor="none", edgecolor=colour, linewidth=1.0, zorder=3)


def _area(shapes: tuple[BodyShape, ...]) -> Any:
    """Return the material of a stage as one area [mm]."""
    from shapely import Polygon, unary_union

    # a clockwise loop is a hole
    bodies = []
    for shape in shapes:
        parts = [Polygon(loop * MM) for loop in shape.loops]
        solid = unary_union([p.buffer(0.0) for p in parts if p.exterior.is_ccw])
        cut = unary_union([p.buffer(0.0) for p in parts if not p.exterior.is_ccw])
        bodies.append(solid.difference(cut))
    return unary_union(bodies)


def _pieces(area: Any) -> list[Any]:
    """Return the polygons of a difference above rounding."""
    from shapely import get_parts

    parts = [part for part in get_parts(area) if part.geom_type == "Polygon"]
    return [part for part in parts if 2.0 * part.area > _ROUNDING * part.length]


def _detail(stage: "Stage", pieces: list[Any], size: float) -> tuple[float, float, float] | None:
    """Return centre and half width of the magnified detail; None if the changes are visible."""
    from shapely import Point

    depths = [2.0 * piece.area / piece.length for piece in pieces]
    if not depths or max(depths) > _VISIBLE * size:
        return None
    most = pieces[int(np.argmax(depths))]
    low_x, low_y, high_x, high_y = most.bounds
    necks = [(most.distance(Point(h.at[0] * MM, h.at[1] * MM)), h) for h in stage.hinges]
    distance, neck = min(necks, key=lambda one: one[0], default=(np.inf, None))
    if neck is not None and distance < neck.profile.length * MM:
        return neck.at[0] * MM, neck.at[1] * MM, 1.2 * neck.profile.length * MM
    half = min(max(0.6 * max(high_x - low_x, high_y - low_y), 0.008 * size), 0.05 * size)
    return *most.representative_point().coords[0], half


def _before(optimum: Optimum) -> "Stage | None":
    try:
        return optimum.problem.family.stage(optimum.start)
    except FlexstageError:
        return None


def draw_figures(optimum: Optimum) -> "Drawn":
    """Draw start and best stage by every model, each figure relative to its limit."""
    # bars are cut at this multiple of the limit
    farthest = 3.0
    rows = _compared(optimum)
    figure, axes = one_panel(6.6, 0.9 + 0.5 * len(rows))
    at = np.arange(len(rows))[::-1]
    last = optimum.levels[-1]
    bars = [("start, " + last.model, last.start, MUTED)]
    bars += [
        (f"best, {level.model}", level.best, CYCLE[k % len(CYCLE)])
        for k, level in enumerate(optimum.levels)
    ]
    height = 0.8 / len(bars)
    for k, (label, values, colour) in enumerate(bars):
        shares = np.array([values[i] / reference for i, _, reference in rows])
        offset = 0.4 - (k + 0.5) * height
        axes.barh(at + offset, shares, height=0.9 * height, color=colour, label=label)
        for y, share in zip(at + offset, shares, strict=True):
            if share > farthest:  # the value of a cut bar is printed
                look = {"ha": "right", "va": "center", "fontsize": 7, "color": PAPER}
                axes.text(0.99 * farthest, y, f"{share:.3g}", **look)
    if axes.get_xlim()[1] > farthest:
        axes.set_xlim(right=farthest)
    axes.axvline(1.0, color=INK, lw=0.8)
    axes.set_yticks(at, [name for _, name, _ in rows])
    axes.set_xlabel("figure / limit; goals: figure / value at the start")
    axes.set_ylim(-0.6, len(rows) - 0.4)
    add_shared_legend(figure, most=len(bars), size=8)
    set_title(axes, "Figures relative to their limits (line: at the limit)")
    return figure


def _compared(optimum: Optimum) -> list[tuple[int, str, float]]:
    """Return index, name and reference of each figure: its limit, or its value at the start."""
    rows = []
    limits = {}
    for requirement in optimum.problem.all_requirements:
        limit = requirement.low if requirement.low is not None else requirement.high
        limits.setdefault(requirement.figure, (limit, requirement))
    for i, figure in enumerate(optimum.figures):
        limit, requirement = limits.get(figure, (None, None))
        reference = limit if limit else optimum.levels[-1].start[i]
        if not np.isfinite(reference) or reference == 0.0:
            continue
        sign = "" if requirement is None else _sign(requirement.low, requirement.high)
        rows.append((i, f"{figure.label}{sign}", float(reference)))
    return rows


def _sign(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return "  ="
    return "  ≥" if low is not None else "  ≤"


def draw_front(front: Front) -> "Drawn":
    """Draw a front of two goals, or of more in pairs with the first."""
    goals = [goal.figure for goal in front.problem.goals]
    others = goals[1:]
    wide = 6.4 if len(others) == 1 else 4.2 * len(others)
    figure, grid = panels(wide, 4.4, len(others), len(others))
    for axes, other in zip(grid, others, strict=True):
        _pair(axes, front, other, goals[0])
    # both fronts share a label if both are by the lumped model
    entries = grid[0].get_legend_handles_labels()
    add_legend(figure, *entries, loc="outside lower center", ncols=4, size=8)
    return figure


def _pair(axes: "Axes", front: Front, across: Figure, up: Figure) -> None:
    at = [front.figures.index(figure) for figure in (across, up)]
    factors = np.array([across.display.factor, up.display.factor])

    def scaled(values: Array) -> Array:
        return (values[..., at] * factors).T

    axes.plot(*scaled(front.searched), "o", ms=2, color=MUTED, alpha=0.35, label="evaluated")
    axes.plot(*scaled(front.values), "o", ms=4, color=CYCLE[0], label="front, lumped")
    axes.plot(
        *scaled(front.recomputed_values), "o", ms=5, color=CYCLE[1], label=f"front, {front.model}"
    )
    best = front.optimum
    columns = [best.figures.index(figure) for figure in (across, up)]
    axes.plot(
        *(best.levels[-1].best[columns] * factors),
        "*",
        ms=12,
        color=CYCLE[2],
        label="selected, improved",
    )
    axes.set(xlabel=across.heading, ylabel=up.heading)
    spread = scaled(np.concatenate([front.values, front.recomputed_values]))
    for values, limit in zip(spread, (axes.set_xlim, axes.set_ylim), strict=True):
        room = 0.25 * max(float(np.ptp(values)), 1e-3 * abs(float(values.max())))
        limit(float(values.min()) - room, float(values.max()) + room)
