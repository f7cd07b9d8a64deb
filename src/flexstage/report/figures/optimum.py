"""Pictures of an optimisation: its way, the stage before and after, its figures, its front."""

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
    dress,
    entitle,
    new_figure,
    one_panel,
    panels,
)
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.optimise.front import Front
from flexstage.studies.explore.optimise.optimum import Optimum

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawn

    from flexstage.stage import Stage

# mean width of a sliver that is rounding [mm]; and of what is seen, in parts of the drawing
_NOISE, _SEEN = 1e-3, 8e-3


def draw_history(found: Optimum) -> "Drawn":
    """Draw the goal and the violation of the requirements over the evaluations.

    Searches of the lumped model have one colour, those of the corrected one another; crosses are
    what the finer model says of the optimum of each turn.
    """
    # violation that is drawn as none
    none = 1e-8
    figure, (above, below) = panels(6.6, 5.0, 2, sharex=True, height_ratios=(1.4, 1.0))
    goals = found.problem.goals
    shown = goals[0].figure.display if goals else None
    factor = shown.factor if shown else 1.0
    turned = found.iterations[0].evaluations if found.iterations else np.inf
    for search in dict.fromkeys(step.search for step in found.history):
        steps = [step for step in found.history if step.search == search]
        at = [step.evaluations for step in steps]
        corrected = at[0] > turned
        look: dict[str, Any] = {"color": CYCLE[int(corrected)], "marker": ".", "ms": 3, "lw": 1.2}
        label = "corrected model" if corrected else "lumped model, each start a line"
        above.plot(at, [factor * s.objective for s in steps], label=label, **look)
        below.semilogy(at, [max(s.violation, none) for s in steps], **look)
    for rung in found.iterations if goals else ():
        value, label = factor * rung.computed[0], f"by {rung.model}"
        above.plot(rung.evaluations, value, marker="x", color=INK, ms=6, ls="", label=label)
    above.set_ylabel(goals[0].figure.heading if goals else "distance from the start\n[bounds]")
    below.set(ylabel="missed by\n[parts of limits]", xlabel="evaluations of the lumped model")
    below.set_ylim(0.5 * none, None)
    figure.align_ylabels([above, below])
    entitle(above, "Way to the optimum, and what the requirements are missed by on it")
    add_shared_legend(figure, size=8)
    return figure


def draw_before_after(found: Optimum) -> "Drawn":
    """Draw the best stage, and the edges of the one that it began with where they differ.

    Where they hardly do, colours say what was added and taken away, also in a detail.
    """
    shapes = body_shapes(found.stage)
    before = _before(found)
    x0, y0, x1, y1 = (v * MM for v in extent(shapes))
    added: list[Any] = []
    removed: list[Any] = []
    edges: Any = None
    if before is not None:
        b0, c0, b1, c1 = (v * MM for v in extent(body_shapes(before)))
        x0, y0, x1, y1 = min(x0, b0), min(y0, c0), max(x1, b1), max(y1, c1)
        was, now = (_area(each) for each in (body_shapes(before), shapes))
        added, removed = _pieces(now.difference(was)), _pieces(was.difference(now))
        edges = was.boundary.difference(now.boundary.buffer(_NOISE))
    size = max(x1 - x0, y1 - y0)
    margin = 0.04 * size
    detail = _detail(found.stage, [*added, *removed], size)
    width, height = 6.0 * (x1 - x0) / size + 1.2, 6.0 * (y1 - y0) / size + 1.2
    figure = new_figure(width + (0.0 if detail is None else height - 1.6), height)
    axes = figure.add_subplot(1, 1 if detail is None else 2, 1)
    _draw_best(axes, found, shapes)
    axes.set(xlim=(x0 - margin, x1 + margin), ylim=(y0 - margin, y1 + margin))
    entitle(axes, f"{found.problem.family.template.source}: before and after")
    handles: list[Any] = []
    if detail is not None:
        beside = figure.add_subplot(1, 2, 2)
        _draw_best(beside, found, shapes)
        for place in (axes, beside):
            handles = [
                _fill(place, added, CYCLE[2], "added"),
                _fill(place, removed, CYCLE[1], "taken away"),
            ]
        x, y, half = detail
        beside.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
        entitle(beside, f"the largest change, {0.5 * size / half:.0f} times larger")
        axes.indicate_inset((x - half, y - half, 2.0 * half, 2.0 * half), edgecolor=INK, alpha=1.0)
    elif edges is not None:
        axes.add_patch(_outlines(edges, CYCLE[1]))
        handles = [axes.plot([], [], color=INK, lw=1.0, label="best")[0]]
        handles += axes.plot([], [], color=CYCLE[1], lw=1.2, label="start, where it differs")
    if handles:
        add_legend(figure, handles=handles, loc="outside lower center", ncols=2, size=8)
    return figure


def _draw_best(axes: "Axes", found: Optimum, shapes: tuple[BodyShape, ...]) -> None:
    dress(axes, grid=False)
    draw_bodies(axes, found.stage, shapes)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")


def _fill(axes: "Axes", pieces: list[Any], colour: str, label: str) -> Any:
    """Fill areas, each edged so that the narrowest can be seen; return the entry of a legend."""
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
    """Return all material of a stage as one area [mm]."""
    from shapely import Polygon, unary_union

    # a loop to the right is a hole
    bodies = []
    for shape in shapes:
        parts = [Polygon(loop * MM) for loop in shape.loops]
        solid = unary_union([p.buffer(0.0) for p in parts if p.exterior.is_ccw])
        cut = unary_union([p.buffer(0.0) for p in parts if not p.exterior.is_ccw])
        bodies.append(solid.difference(cut))
    return unary_union(bodies)


def _pieces(area: Any) -> list[Any]:
    """Return the polygons of a difference that are more than rounding."""
    from shapely import get_parts

    parts = [part for part in get_parts(area) if part.geom_type == "Polygon"]
    return [part for part in parts if 2.0 * part.area > _NOISE * part.length]


def _detail(stage: "Stage", pieces: list[Any], size: float) -> tuple[float, float, float] | None:
    """Return middle and half width of what is drawn larger; None where changes can be seen."""
    from shapely import Point

    depths = [2.0 * piece.area / piece.length for piece in pieces]
    if not depths or max(depths) > _SEEN * size:
        return None
    most = pieces[int(np.argmax(depths))]
    low_x, low_y, high_x, high_y = most.bounds
    necks = [(most.distance(Point(h.at[0] * MM, h.at[1] * MM)), h) for h in stage.hinges]
    distance, neck = min(necks, key=lambda one: one[0], default=(np.inf, None))
    if neck is not None and distance < neck.profile.length * MM:
        return neck.at[0] * MM, neck.at[1] * MM, 1.2 * neck.profile.length * MM
    half = min(max(0.6 * max(high_x - low_x, high_y - low_y), 0.008 * size), 0.05 * size)
    return *most.representative_point().coords[0], half


def _before(found: Optimum) -> "Stage | None":
    try:
        return found.problem.family.stage(found.start)
    except FlexstageError:
        return None


def draw_figures(found: Optimum) -> "Drawn":
    """Draw start and best stage by every model, each figure in parts of what is required of it."""
    # figures are drawn to so many times their limit
    farthest = 3.0
    rows = _compared(found)
    figure, axes = one_panel(6.6, 0.9 + 0.5 * len(rows))
    at = np.arange(len(rows))[::-1]
    last = found.levels[-1]
    bars = [("start, " + last.model, last.start, MUTED)]
    bars += [
        (f"best, {level.model}", level.best, CYCLE[k % len(CYCLE)])
        for k, level in enumerate(found.levels)
    ]
    height = 0.8 / len(bars)
    for k, (label, values, colour) in enumerate(bars):
        shares = np.array([values[i] / reference for i, _, reference in rows])
        offset = 0.4 - (k + 0.5) * height
        axes.barh(at + offset, shares, height=0.9 * height, color=colour, label=label)
        for y, share in zip(at + offset, shares, strict=True):
            if share > farthest:  # its length is written where its end is not seen
                look = {"ha": "right", "va": "center", "fontsize": 7, "color": PAPER}
                axes.text(0.99 * farthest, y, f"{share:.3g}", **look)
    if axes.get_xlim()[1] > farthest:
        axes.set_xlim(right=farthest)
    axes.axvline(1.0, color=INK, lw=0.8)
    axes.set_yticks(at, [name for _, name, _ in rows])
    axes.set_xlabel("figure ÷ its limit; of a goal: figure ÷ its value at the start")
    axes.set_ylim(-0.6, len(rows) - 0.4)
    add_shared_legend(figure, most=len(bars), size=8)
    entitle(axes, "Figures relative to what is required (line: at the limit)")
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
    wide = 6.4 if len(others) == 1 else 4.2 * len(others)
    figure, grid = panels(wide, 4.4, len(others), len(others))
    for axes, other in zip(grid, others, strict=True):
        _pair(axes, found, other, goals[0])
    # both fronts have one name where both are by the lumped model
    entries = grid[0].get_legend_handles_labels()
    add_legend(figure, *entries, loc="outside lower center", ncols=4, size=8)
    return figure


def _pair(axes: "Axes", found: Front, across: Figure, up: Figure) -> None:
    at = [found.figures.index(figure) for figure in (across, up)]
    factors = np.array([across.display.factor, up.display.factor])

    def drawn(values: Array) -> Array:
        return (values[..., at] * factors).T

    axes.plot(*drawn(found.searched), "o", ms=2, color=MUTED, alpha=0.35, label="searched")
    axes.plot(*drawn(found.values), "o", ms=4, color=CYCLE[0], label="front, lumped")
    axes.plot(
        *drawn(found.recomputed_values), "o", ms=5, color=CYCLE[1], label=f"front, {found.model}"
    )
    best = found.optimum
    own = [best.figures.index(figure) for figure in (across, up)]
    axes.plot(
        *(best.levels[-1].best[own] * factors), "*", ms=12, color=CYCLE[2], label="chosen, improved"
    )
    axes.set(xlabel=across.heading, ylabel=up.heading)
    spread = drawn(np.concatenate([found.values, found.recomputed_values]))
    for values, limit in zip(spread, (axes.set_xlim, axes.set_ylim), strict=True):
        room = 0.25 * max(float(np.ptp(values)), 1e-3 * abs(float(values.max())))
        limit(float(values.min()) - room, float(values.max()) + room)
