"""Finite elements: filled contours of fields within an outline, modes, convergence of a mesh."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base.arrays import Array, Integers
from flexstage.quantities.characteristic import WHOLE_STAGE
from flexstage.quantities.quantity import display, number
from flexstage.report.figures.style import (
    BODY,
    CYCLE,
    DASHED,
    INK,
    MM,
    MUTED,
    PAPER,
    add_shared_legend,
    add_words,
    dress,
    entitle,
    label_axes,
    new_figure,
    on_paper,
    panels,
)
from flexstage.system import Analysis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.path import Path

    from flexstage.fem import Refinement, StageModel
    from flexstage.fem.sampling import Sample


Loops = Sequence[Integers]


class Bands:
    """Colours of a field, in bands of equal, round width.

    From low to high at least; what lies beyond has the colour of its end. `count` is the largest
    number of bands, `clear` the part of the scale at its low end over which colour sets in [1].
    """

    def __init__(
        self, low: float, high: float, colours: str, *, count: int = 14, clear: float = 0.0
    ) -> None:
        from matplotlib import colormaps
        from matplotlib.colors import BoundaryNorm, ListedColormap
        from matplotlib.ticker import MaxNLocator

        end = high if high > low else low + 1.0
        self.levels = np.asarray(
            MaxNLocator(count, steps=(1, 2, 2.5, 5, 10)).tick_values(low, end), dtype=float
        )
        middle = np.linspace(0.0, 1.0, self.levels.size - 1)
        colour = colormaps[colours](middle)
        if clear > 0.0:
            colour[:, 3] = np.clip(middle / clear, 0.0, 1.0)
        self.clear = clear > 0.0
        self.map = ListedColormap(colour)
        self.norm = BoundaryNorm(self.levels, self.map.N)


def fill(
    axes: "Axes", points: Array, triangles: Integers, values: Array, loops: Loops, bands: Bands
) -> None:
    """Fill triangles with the bands of a field, as a picture of pixels.

    Points [m] have shape (n, 2), triangles (m, 3), values (n,); the loops bound them. What lies
    outside the limits of the axes, which are set, is left out.
    """
    from matplotlib.patches import PathPatch
    from matplotlib.tri import Triangulation

    mm = points * MM
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    x, y = mm[triangles, 0], mm[triangles, 1]
    seen = (x.max(axis=1) > x0) & (x.min(axis=1) < x1) & (y.max(axis=1) > y0) & (y.min(axis=1) < y1)
    kept, index = np.unique(triangles[seen], return_inverse=True)
    mesh = Triangulation(mm[kept, 0], mm[kept, 1], index.reshape(-1, 3))
    area = _area(axes, mm, loops)
    if area is None:
        return
    if bands.clear:
        axes.add_patch(PathPatch(area, facecolor=BODY, edgecolor="none", zorder=0.5))
    levels = bands.levels
    # a value on the lowest level would count as below it
    inside = np.clip(values[kept], levels[0] + 1e-9 * np.ptp(levels), levels[-1])
    drawn = axes.tricontourf(
        mesh, inside, levels=levels, cmap=bands.map, norm=bands.norm, antialiased=False, zorder=1
    )
    drawn.set_rasterized(True)
    drawn.set_clip_path(area, axes.transData)


def trace(axes: "Axes", points: Array, loops: Loops, **look: Any) -> None:
    """Draw closed lines of corners [m], shape (n, 2), within the limits of the axes."""
    from matplotlib.collections import LineCollection

    lines = _lines(axes, points * MM, loops)
    axes.add_collection(LineCollection(lines, **({"linewidths": 0.4, "colors": INK} | look)))


def _lines(axes: "Axes", mm: Array, loops: Loops) -> list[Array]:
    """Lines with no more corners than a picture can show, cut to what is seen of them."""
    from shapely import LineString, box, get_parts

    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    sight = box(x0, y0, x1, y1)
    found = []
    for loop in loops:
        line = LineString(_thinned(axes, mm[np.append(loop, loop[0])]))
        found += [np.asarray(part.coords) for part in get_parts(line.intersection(sight))]
    return [line for line in found if len(line) > 1]


def _area(axes: "Axes", mm: Array, loops: Loops) -> "Path | None":
    """Path about what is seen of the material.

    Exaggerated motion can lay material over material; the path winds twice about it, so that it is
    filled, and cutting it to a rectangle changes no winding inside.
    """
    from matplotlib.path import Path
    from matplotlib.transforms import Bbox

    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    rings = [Path(_thinned(axes, mm[np.append(loop, loop[0])]), closed=True) for loop in loops]
    path = Path.make_compound_path(*rings).clip_to_bbox(Bbox([[x0, y0], [x1, y1]]))
    return path if np.size(path.vertices) else None


def _thinned(axes: "Axes", line: Array) -> Array:
    """Leave out what a picture cannot show of a line."""
    from shapely import LineString

    # detail smaller than this part of a picture is left out of its lines
    resolution = 2000.0

    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    finest = max(x1 - x0, y1 - y0) / resolution
    return np.asarray(LineString(line).simplify(finest).coords)


def window(points: Array, margin: float) -> tuple[float, float, float, float]:
    """Return smallest x and y, largest x and y of points, with room about them.

    The room is a part of the larger side [1].
    """
    low, high = points.min(axis=0), points.max(axis=0)
    room = margin * float((high - low).max())
    return (*map(float, low - room), *map(float, high + room))  # type: ignore[return-value]


def frame(axes: "Axes", sight: tuple[float, float, float, float], *, ticks: bool) -> None:
    """Set what axes show: smallest x and y, largest x and y [m]; with ticks or without."""
    x0, y0, x1, y1 = (MM * v for v in sight)
    axes.set(xlim=(x0, x1), ylim=(y0, y1))
    axes.set_aspect("equal")
    if not ticks:
        axes.set_xticks([])
        axes.set_yticks([])
        for spine in axes.spines.values():
            spine.set_visible(False)


def place(figure: "Figure", left: float, top: float, width: float, height: float) -> "Axes":
    """Add axes at a place that is measured from the upper left corner [inch].

    Pictures keep their proportions and stand in rows, which an automatic layout does not settle.
    """
    wide, high = figure.get_size_inches()
    return figure.add_axes((left / wide, 1.0 - (top + height) / high, width / wide, height / high))


def add_bar(axes: "Axes", bands: Bands, label: str) -> None:
    """Draw a colour bar."""
    from matplotlib.cm import ScalarMappable

    scale = ScalarMappable(norm=bands.norm, cmap=bands.map)
    bar = axes.figure.colorbar(scale, cax=axes, spacing="proportional")
    bar.set_label(label, color=INK, fontsize=8)
    bar.set_ticks(bands.levels[:: 1 if bands.levels.size < 9 else 2].tolist())
    bar.minorticks_off()
    axes.tick_params(color=MUTED, labelcolor=INK, labelsize=8)
    axes.set_facecolor(BODY)  # where the colours set in
    bar.outline.set_visible(False)  # type: ignore[operator]


_SIZE, _LIFT = "displacement / largest [1]", "displacement out of plane / largest [1]"
_IN_PLANE, _OUT_OF_PLANE = "viridis", "RdBu_r"


def out_of_plane(model: "StageModel", q: Array) -> bool:
    """Tell whether more than half of a mode's kinetic energy is motion out of the plane.

    `q` are the coordinates of the model, shape (r,).
    """
    # the coordinates of the two problems do not mix, and have unit mass
    energy = [float((q[problem.basis.any(axis=0)] ** 2).sum()) for problem in model.problems]
    out = sum(e for e, problem in zip(energy, model.problems, strict=True) if problem.out_of_plane)
    return out > 0.5 * sum(energy)


def draw_fe_modes(
    model: "StageModel",
    analysis: Analysis,
    *,
    most: int = 6,
) -> "Figure":
    """Draw the lowest modes of a finite-element model.

    On the deformed shape the magnitude of the displacement as a part of the largest; of a mode out
    of the plane the displacement out of it, with its sign, on the middle plane, which such a mode
    leaves as it is. A thin line shows the stage at rest.
    """
    from flexstage.fem.sampling import Sampler

    margin = 0.05

    found = analysis.modes["removed"]
    count = min(most, found.frequency_hz.size)
    sampler = Sampler(model=model, divisions=4)
    bands = Bands(0.0, 1.0, _IN_PLANE, count=20)
    signed = Bands(-1.0, 1.0, _OUT_OF_PLANE, count=20)
    shapes = [found.shapes[:, k] for k in range(count)]
    lifted = [out_of_plane(model, shape) for shape in shapes]

    at_rest = sampler.read(shapes[0], stress=False).points[:, :2]
    x0, y0, x1, y1 = window(at_rest, margin)
    scales = [(bands, _SIZE)] if not all(lifted) else []
    scales += [(signed, _LIFT)] if any(lifted) else []
    figure, grid, bars = _arranged((y1 - y0) / (x1 - x0), count, len(scales))
    for k, axes in enumerate(grid):
        sample = sampler.read(shapes[k], stress=False)
        points, values = _drawn(sample, lifted=lifted[k])
        dress(axes, grid=False)
        frame(axes, (x0, y0, x1, y1), ticks=False)
        shown = signed if lifted[k] else bands
        fill(axes, points, sample.cells, values, sampler.outline, shown)
        if not lifted[k]:
            trace(axes, at_rest, sampler.outline, linewidths=0.3, colors=MUTED)
        trace(axes, points, sampler.outline, linewidths=0.35)
        where = " · out of plane" if lifted[k] else ""
        frequency = number(float(found.frequency_hz[k]))
        entitle(axes, f"mode {k + 1} · {frequency} Hz · drives removed{where}", 8.0)
    for axes, (colours, label) in zip(bars, scales, strict=True):
        add_bar(axes, colours, label)
    return figure


def _arranged(aspect: float, count: int, bars: int) -> "tuple[Figure, list[Axes], list[Axes]]":
    """Lay out pictures of this height to width, and colour bars beside them."""
    widest = 3.3  # of a picture [inch]
    most_columns = 3
    title, gap, beside = 0.32, 0.15, 0.85
    columns, rows = min(most_columns, count), math.ceil(count / most_columns)
    width = min(widest, 1.3 * widest / aspect)
    height = width * aspect
    cell = max(width, 2.4) + gap  # as wide as its title at least
    high = rows * (height + title) + 0.1
    across = columns * cell
    figure = new_figure(across + bars * beside + 0.05, max(high, 1.6))
    figure.set_layout_engine("none")
    grid = [
        place(
            figure,
            0.05 + (k % columns) * cell,
            title + (k // columns) * (height + title),
            width,
            height,
        )
        for k in range(count)
    ]
    tall = min(0.8 * max(high, 1.6), 4.5)
    top = 0.5 * (max(high, 1.6) - tall)
    scales = [place(figure, across + 0.1 + i * beside, top, 0.14, tall) for i in range(bars)]
    return figure, grid, scales


def _drawn(sample: "Sample", *, lifted: bool) -> tuple[Array, Array]:
    """Return the corners of a mode as they are drawn, and what colours them."""
    # the largest motion of a mode is drawn as this part of the size of the stage
    shown = 0.03
    points, motion = sample.points[:, :2], sample.displacement
    size = float((points.max(axis=0) - points.min(axis=0)).max())
    if lifted:
        values = motion[:, 2] / (np.abs(motion[:, 2]).max() or 1.0)
        # which way a mode starts says nothing: upwards where it moves furthest
        return points, values * np.sign(values[np.argmax(np.abs(values))])
    largest = float(sample.magnitude.max()) or 1.0
    return points + shown * size / largest * motion[:, :2], sample.magnitude / largest


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
    quantities = [
        q for q in dict.fromkeys((*_SHOWN, refinement.quantity)) if _axes_of(refinement, q)
    ]
    count = max(len(quantities), 1)
    figure, grid = panels(3.4 * count + 0.4, 3.4, count, count, sharex=True, sharey=True)
    for k, axes in enumerate(grid):
        axes.set(xscale="log", yscale="log")
        label_axes(axes, "unknowns of the mesh", "" if k else "difference to the last mesh [1]", 8)
        axes.tick_params(axis="x", labelsize=7)
    seen: list[float] = [refinement.accuracy]
    for axes, quantity in zip(grid, quantities, strict=False):
        entitle(axes, display(quantity).label)
        for i, axis in enumerate(_axes_of(refinement, quantity)):
            seen += _line(axes, refinement, quantity, axis, i)
        _asked(axes, refinement, own=quantity == refinement.quantity)
    _meshes(grid[0], refinement)
    positive = [v for v in seen if v > 0.0]
    grid[0].set_ylim(min(positive) / 2.0, max(positive) * 3.0)
    add_shared_legend(figure)
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


def _axes_of(refinement: "Refinement", quantity: str) -> list[str]:
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
    axes.axhline(refinement.accuracy, color=INK, linewidth=1.0, linestyle=DASHED)
    add_words(
        axes,
        f"asked for: {100.0 * refinement.accuracy:.3g} %",
        (0.0, refinement.accuracy),
        (4, 3),
        7,
        xycoords=("axes fraction", "data"),
        bbox=on_paper(0.6),
    )
