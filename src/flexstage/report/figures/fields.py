"""Finite elements: filled contours of fields in an outline, modes, mesh convergence."""

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
    label_axes,
    new_figure,
    on_paper,
    panels,
    set_title,
    style_axes,
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

    They include low to high; values beyond have the colour of the end. `count` is the largest
    number of bands, `clear` the transparent part of the scale at its low end [1].
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

    Points [m] have shape (n, 2), triangles (m, 3), values (n,); the loops bound them. Triangles
    outside the limits of the axes, which are set, are omitted.
    """
    from matplotlib.patches import PathPatch
    from matplotlib.tri import Triangulation

    mm = points * MM
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    x, y = mm[triangles, 0], mm[triangles, 1]
    visible = (
        (x.max(axis=1) > x0) & (x.min(axis=1) < x1) & (y.max(axis=1) > y0) & (y.min(axis=1) < y1)
    )
    corners, index = np.unique(triangles[visible], return_inverse=True)
    mesh = Triangulation(mm[corners, 0], mm[corners, 1], index.reshape(-1, 3))
    area = _area(axes, mm, loops)
    if area is None:
        return
    if bands.clear:
        axes.add_patch(PathPatch(area, facecolor=BODY, edgecolor="none", zorder=0.5))
    levels = bands.levels
    # a value on the lowest level would count as below it
    inside = np.clip(values[corners], levels[0] + 1e-9 * np.ptp(levels), levels[-1])
    contours = axes.tricontourf(
        mesh, inside, levels=levels, cmap=bands.map, norm=bands.norm, antialiased=False, zorder=1
    )
    contours.set_rasterized(True)
    contours.set_clip_path(area, axes.transData)


def trace(axes: "Axes", points: Array, loops: Loops, **look: Any) -> None:
    """Draw closed lines of corners [m], shape (n, 2), within the limits of the axes."""
    from matplotlib.collections import LineCollection

    style: dict[str, Any] = {"linewidths": 0.4, "colors": INK} | look
    axes.add_collection(LineCollection(_lines(axes, points * MM, loops), **style))


def _lines(axes: "Axes", mm: Array, loops: Loops) -> list[Array]:
    """Return lines with no more corners than a picture can show, cut to the visible area."""
    from shapely import LineString, box, get_parts

    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    sight = box(x0, y0, x1, y1)
    lines = []
    for loop in loops:
        line = LineString(_thinned(axes, mm[np.append(loop, loop[0])]))
        lines += [np.asarray(part.coords) for part in get_parts(line.intersection(sight))]
    return [line for line in lines if len(line) > 1]


def _area(axes: "Axes", mm: Array, loops: Loops) -> "Path | None":
    """Return the path around the visible material.

    Where exaggerated motion overlaps material, the path winds twice and the area is filled. Cutting
    it to a rectangle does not change the winding inside.
    """
    from matplotlib.path import Path
    from matplotlib.transforms import Bbox

    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    rings = [Path(_thinned(axes, mm[np.append(loop, loop[0])]), closed=True) for loop in loops]
    path = Path.make_compound_path(*rings).clip_to_bbox(Bbox([[x0, y0], [x1, y1]]))
    return path if np.size(path.vertices) else None


def _thinned(axes: "Axes", line: Array) -> Array:
    """Remove detail of a line that a picture cannot show."""
    from shapely import LineString

    # pixels of a picture: smaller detail is removed
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
    """Set the limits of axes: smallest x and y, largest x and y [m]; with ticks or without."""
    x0, y0, x1, y1 = (MM * v for v in sight)
    axes.set(xlim=(x0, x1), ylim=(y0, y1))
    axes.set_aspect("equal")
    if not ticks:
        axes.set_xticks([])
        axes.set_yticks([])
        for spine in axes.spines.values():
            spine.set_visible(False)


def place(figure: "Figure", left: float, top: float, width: float, height: float) -> "Axes":
    """Add axes at a position from the upper left corner [inch].

    An automatic layout does not keep pictures in proportion and in rows.
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
    axes.set_facecolor(BODY)  # below the first colour
    bar.outline.set_visible(False)


_SIZE, _LIFT = "displacement / largest [1]", "displacement out of plane / largest [1]"
_IN_PLANE, _OUT_OF_PLANE = "viridis", "RdBu_r"


def out_of_plane(model: "StageModel", q: Array) -> bool:
    """Return whether more than half of a mode's kinetic energy is motion out of the plane.

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

    In-plane modes: the magnitude of the displacement, relative to the largest, on the deformed
    shape. Out-of-plane modes: the signed displacement on the middle plane, which stays undeformed.
    A thin line shows the stage at rest.
    """
    from flexstage.fem.sampling import Sampler

    margin = 0.05

    modes = analysis.modes["removed"]
    count = min(most, modes.frequency_hz.size)
    sampler = Sampler(model=model, divisions=4)
    bands = Bands(0.0, 1.0, _IN_PLANE, count=20)
    signed = Bands(-1.0, 1.0, _OUT_OF_PLANE, count=20)
    shapes = [modes.shapes[:, k] for k in range(count)]
    lifted = [out_of_plane(model, shape) for shape in shapes]

    at_rest = sampler.read(shapes[0], stress=False).points[:, :2]
    x0, y0, x1, y1 = window(at_rest, margin)
    scales = [(bands, _SIZE)] if not all(lifted) else []
    scales += [(signed, _LIFT)] if any(lifted) else []
    figure, grid, bars = _lay_out((y1 - y0) / (x1 - x0), count, len(scales))
    for k, axes in enumerate(grid):
        sample = sampler.read(shapes[k], stress=False)
        points, values = _mode_corners(sample, lifted=lifted[k])
        style_axes(axes, grid=False)
        frame(axes, (x0, y0, x1, y1), ticks=False)
        mode_bands = signed if lifted[k] else bands
        fill(axes, points, sample.cells, values, sampler.outline, mode_bands)
        if not lifted[k]:
            trace(axes, at_rest, sampler.outline, linewidths=0.3, colors=MUTED)
        trace(axes, points, sampler.outline, linewidths=0.35)
        where = " · out of plane" if lifted[k] else ""
        frequency = number(float(modes.frequency_hz[k]))
        set_title(axes, f"mode {k + 1} · {frequency} Hz · drives removed{where}", 8.0)
    for axes, (colours, label) in zip(bars, scales, strict=True):
        add_bar(axes, colours, label)
    return figure


def _lay_out(aspect: float, count: int, bars: int) -> "tuple[Figure, list[Axes], list[Axes]]":
    """Lay out pictures of an aspect ratio, height to width, with colour bars."""
    widest = 3.3  # of a picture [inch]
    most_columns = 3
    title, gap, bar_width = 0.32, 0.15, 0.85
    columns, rows = min(most_columns, count), math.ceil(count / most_columns)
    width = min(widest, 1.3 * widest / aspect)
    height = width * aspect
    cell = max(width, 2.4) + gap  # as wide as its title at least
    high = rows * (height + title) + 0.1
    across = columns * cell
    figure = new_figure(across + bars * bar_width + 0.05, max(high, 1.6))
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
    bar_height = min(0.8 * max(high, 1.6), 4.5)
    top = 0.5 * (max(high, 1.6) - bar_height)
    scales = [
        place(figure, across + 0.1 + i * bar_width, top, 0.14, bar_height) for i in range(bars)
    ]
    return figure, grid, scales


def _mode_corners(sample: "Sample", *, lifted: bool) -> tuple[Array, Array]:
    """Return the displaced corners of a mode, and their values for the colours."""
    # largest motion of a mode in the drawing, relative to the size of the stage
    drawn_size = 0.03
    points, motion = sample.points[:, :2], sample.displacement
    size = float((points.max(axis=0) - points.min(axis=0)).max())
    if lifted:
        values = motion[:, 2] / (np.abs(motion[:, 2]).max() or 1.0)
        # the sign of a mode is arbitrary: positive at the largest displacement
        return points, values * np.sign(values[np.argmax(np.abs(values))])
    largest = float(sample.magnitude.max()) or 1.0
    return points + drawn_size * size / largest * motion[:, :2], sample.magnitude / largest


_QUANTITIES = ("natural_frequency_hz", "transmission_ratio", "max_stress")
_DASHES = ("-", (0, (5, 2)), (0, (2, 1.5)), (0, (6, 2, 1, 2)))
_MARKS = "osD^vP"


def changes(refinement: "Refinement", quantity: str, axis: str) -> tuple[Array, Array]:
    """Return unknowns of each mesh but the last, and the difference of a quantity from the last.

    The difference is a relative magnitude [1].
    """
    key = (quantity, axis)
    last = refinement.steps[-1].values[key]
    steps = [s for s in refinement.steps[:-1] if key in s.values]
    return (
        np.array([float(s.unknowns) for s in steps]),
        np.array([abs(s.values[key] / last - 1.0) for s in steps]),
    )


def draw_convergence(refinement: "Refinement") -> "Figure":
    """Draw the mesh convergence of frequencies, ratios and stress.

    A diagram for each quantity, a line for each axis: the relative difference from the last mesh
    over the unknowns. An open mark at the last mesh is the estimate of its error; the horizontal
    line is the requested accuracy.
    """
    quantities = [
        q for q in dict.fromkeys((*_QUANTITIES, refinement.quantity)) if _axes_of(refinement, q)
    ]
    count = max(len(quantities), 1)
    figure, grid = panels(3.4 * count + 0.4, 3.4, count, count, sharex=True, sharey=True)
    for k, axes in enumerate(grid):
        axes.set(xscale="log", yscale="log")
        label_axes(
            axes, "unknowns of the mesh", "" if k else "difference from the last mesh [1]", 8
        )
        axes.tick_params(axis="x", labelsize=7)
    values_drawn: list[float] = [refinement.accuracy]
    for axes, quantity in zip(grid, quantities, strict=False):
        set_title(axes, display(quantity).label)
        for i, axis in enumerate(_axes_of(refinement, quantity)):
            values_drawn += _line(axes, refinement, quantity, axis, i)
        _accuracy_line(axes, refinement, requested=quantity == refinement.quantity)
    _meshes(grid[0], refinement)
    positive = [v for v in values_drawn if v > 0.0]
    grid[0].set_ylim(min(positive) / 2.0, max(positive) * 3.0)
    add_shared_legend(figure)
    return figure


def _meshes(axes: "Axes", refinement: "Refinement") -> None:
    """Mark each mesh on the x axis."""
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
    """Draw the convergence of one axis; return the drawn values."""
    unknowns, difference = changes(refinement, quantity, axis)
    colour = CYCLE[index % len(CYCLE)]
    # lines of equal axes overlap, and show through each other's gaps
    look = {"color": colour, "linestyle": _DASHES[index % len(_DASHES)], "linewidth": 1.2}
    mark = {"marker": _MARKS[index % len(_MARKS)], "markersize": 4.5 - 0.5 * min(index, 3)}
    positive = difference > 0.0  # a logarithmic scale has no zero
    axes.plot(unknowns[positive], difference[positive], label=f"axis {axis}", **look, **mark)
    rows = refinement.analysis.characteristics
    row = next((r for r in rows if (r.quantity, r.axis) == (quantity, axis)), None)
    estimate = 0.0
    if row is not None and row.uncertainty and row.value:
        estimate = abs(row.uncertainty / row.value)
        axes.plot(
            [refinement.steps[-1].unknowns], [estimate], linestyle="none", color=colour,
            markerfacecolor=PAPER, label=f"axis {axis}, estimate for the last mesh", **mark,
        )  # fmt: skip
    return [*difference.tolist(), estimate]


def _accuracy_line(axes: "Axes", refinement: "Refinement", *, requested: bool) -> None:
    """Draw the requested accuracy; faint in diagrams of other quantities."""
    if not requested:
        axes.axhline(refinement.accuracy, color=MUTED, linewidth=0.6, linestyle=(0, (1, 3)))
        return
    axes.axhline(refinement.accuracy, color=INK, linewidth=1.0, linestyle=DASHED)
    add_words(
        axes,
        f"requested: {100.0 * refinement.accuracy:.3g} %",
        (0.0, refinement.accuracy),
        (4, 3),
        7,
        xycoords=("axes fraction", "data"),
        bbox=on_paper(0.6),
    )
