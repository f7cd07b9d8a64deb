"""Results of a sweep: figures of a stage over the varied parameters, and Sobol' indices."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.quantities.quantity import Quantity
from flexstage.report.figures.style import (
    CYCLE,
    HATCH,
    INK,
    MUTED,
    PAPER,
    add_heading,
    add_legend,
    label_axes,
    panels,
    set_title,
)
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.sweep import Sweep
from flexstage.studies.explore.variables import Variable

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure as Drawing

_WIDTH = 9.6
#: Lines and labels on the colours of a map, which stay light on a dark page.
_ON_MAP = "#14181c"
_DESCRIBED = "stage as described"
_INFEASIBLE = "infeasible"


def draw_sweep(sweep: Sweep) -> "Drawing":
    """Draw the figures that vary over the varied parameters.

    One variable gives curves, two on a grid give contour maps, others a diagram for each figure and
    each variable.
    """
    if sweep.constant.all():
        raise ModelError("no figure of the sweep varies: there is nothing to draw")
    if len(sweep.variables) == 1:
        return _curves(sweep)
    if len(sweep.variables) == 2 and sweep.counts:
        return _maps(sweep)
    return _matrix(sweep)


def draw_indices(sweep: Sweep) -> "Drawing":
    """Draw Sobol' indices: bars of first and total order with intervals."""
    from matplotlib.patches import Patch

    most_bars = 16

    indices = sweep.indices
    if indices is None:
        raise ModelError("the sweep has no Sobol' indices: run it with indices")
    figures = [k for k in sweep.varying if np.isfinite(indices.total[k]).all()]
    if not figures:
        raise ModelError("no figure of the sweep varies: there is nothing to draw")
    strongest = list(sweep.strongest(most_bars))
    names = [sweep.variables[i].name for i in strongest]
    rows, columns = _rows_and_columns(len(figures))
    wide = 0.075 * max(map(len, names))
    wide += (3.9 if columns == 2 else 2.6) * columns
    high = rows * (0.34 * len(names) + 0.75) + 0.7
    figure, grid = panels(wide, high, len(figures), columns, sharex=True, sharey=True)
    colours = (CYCLE[0], CYCLE[5])
    at = np.arange(len(names))
    highest = max(np.max(part[figures]) for part in (indices.first_high, indices.total_high))
    furthest = min(max(1.05, highest + 0.03), 1.6)
    for axes, k in zip(grid, figures, strict=True):
        axes.grid(visible=False, axis="y")
        set_title(axes, sweep.figures[k].label, 8.5)
        for shift, colour, value, low, high in (
            (-0.19, colours[0], indices.first, indices.first_low, indices.first_high),
            (0.19, colours[1], indices.total, indices.total_low, indices.total_high),
        ):
            middle = value[k, strongest]
            axes.barh(at + shift, np.maximum(middle, 0.0), height=0.36, color=colour)
            axes.hlines(at + shift, low[k, strongest], high[k, strongest], color=INK, linewidth=0.9)
        axes.set(xlim=(-0.04, furthest), ylim=(len(names) - 0.45, -0.55))
        axes.axvline(0.0, color=MUTED, linewidth=0.6)
        axes.set_yticks(at, names, fontsize=7.5, parse_math=False)
    for axes in grid[-columns:]:
        axes.set_xlabel("share of the variance [1]", fontsize=8)
        axes.tick_params(axis="x", labelbottom=True)
    percent = f"{100.0 * indices.confidence:g} %"
    handles: list[Artist] = [
        Patch(color=colours[0], label="first order"),
        Patch(color=colours[1], label="total, with interactions"),
        _line(INK, "-", f"interval of {percent}"),
    ]
    _legend(figure, handles)
    _annotate_omitted(figure, len(strongest), sweep)
    return figure


def _curves(sweep: Sweep) -> "Drawing":
    """Draw every figure over the variable."""
    variable = sweep.variables[0]
    order = np.argsort(sweep.points[:, 0], kind="stable")
    x = sweep.points[order, 0] * variable.factor
    figures = sweep.varying
    figure, grid = _small_multiples(len(figures), 2.4)
    gaps = _spans(x, ~sweep.possible[order])
    for axes, k in zip(grid, figures, strict=True):
        quantity = sweep.display(k)
        y = sweep.values[order, k] * quantity.factor
        for low, high in gaps:
            axes.axvspan(low, high, facecolor="none", edgecolor=HATCH, hatch="////", linewidth=0.0)
        marks: dict[str, Any] = {"marker": "o", "markersize": 2.6} if len(x) <= 60 else {}
        axes.plot(x, y, color=CYCLE[0], linewidth=1.3, **marks)
        usual = variable.usual * variable.factor
        if _includes_nominal(variable):
            axes.axvline(usual, color=CYCLE[1], linewidth=0.9, linestyle=(0, (4, 2)))
            axes.plot(
                [usual], [sweep.described[k] * quantity.factor], marker="D", markersize=4.5,
                color=CYCLE[1], linestyle="none", clip_on=False,
            )  # fmt: skip
        axes.set_xlim(variable.low * variable.factor, variable.high * variable.factor)
        axes.set_xlabel(variable.heading, fontsize=8, parse_math=False)
        set_title(axes, sweep.figures[k].heading_in(quantity), 8.5)
    handles = [_described_mark(dashed=True)] if _includes_nominal(variable) else []
    if gaps:
        handles.append(_hatched())
    _legend(figure, handles)
    return figure


def _maps(sweep: Sweep) -> "Drawing":
    """Draw every figure as a map over two variables."""
    across, up = sweep.variables
    grid_shape = sweep.counts
    x = sweep.points[:, 0].reshape(grid_shape) * across.factor
    y = sweep.points[:, 1].reshape(grid_shape) * up.factor
    figures = sweep.varying
    figure, grid = _small_multiples(len(figures), 2.9, lines=False)
    colours = _map_colours()
    has_infeasible = not sweep.possible.all()
    usual = across.usual * across.factor, up.usual * up.factor
    inside = _includes_nominal(across) and _includes_nominal(up)
    for axes, k in zip(grid, figures, strict=True):
        scaled = sweep.display(k)
        values = np.ma.masked_invalid(sweep.on_grid(k) * scaled.factor)
        if has_infeasible:
            axes.axvspan(
                x.min(), x.max(), facecolor="none", edgecolor=HATCH, hatch="////", linewidth=0.0,
                zorder=0,
            )  # fmt: skip
        levels = _levels(values)
        axes.contourf(x, y, values, levels=levels, cmap=colours, extend="both")
        lines = axes.contour(x, y, values, levels=levels, colors=_ON_MAP, linewidths=0.6)
        places = _middles(lines.allsegs, (np.ptp(x), np.ptp(y)), usual if inside else None)
        axes.clabel(lines, fmt="%.10g", fontsize=6.5, inline_spacing=2, manual=places)
        if inside:
            axes.plot(
                *usual, marker="D", markersize=5.5, color=CYCLE[1], markeredgecolor=PAPER,
                linestyle="none", zorder=5, clip_on=False,
            )  # fmt: skip
        axes.set(xlim=(x.min(), x.max()), ylim=(y.min(), y.max()))
        label_axes(axes, across.heading, up.heading, 8)
        set_title(axes, sweep.figures[k].heading_in(scaled), 8.5)
    handles: list[Artist] = [_described_mark()] if inside else []
    if has_infeasible:
        handles.append(_hatched())
    _legend(figure, handles)
    return figure


def _matrix(sweep: Sweep) -> "Drawing":
    """Draw a diagram for each figure and variable: all points, and their median by slices."""
    from matplotlib.patches import Patch

    # most columns of a matrix of diagrams
    most_columns = 5

    figures, possible = sweep.varying, sweep.possible
    strongest = sweep.strongest(most_columns)
    correlations = sweep.correlations
    columns, high = len(strongest), 1.4 * len(figures) + 0.9
    figure, grid = panels(_WIDTH, high, len(figures) * columns, columns, sharex="col", sharey="row")
    rows = [grid[i : i + columns] for i in range(0, len(grid), columns)]
    for row, k in zip(rows, figures, strict=True):
        scaled = sweep.display(k)
        y = sweep.values[possible, k] * scaled.factor
        for axes, i in zip(row, strongest, strict=True):
            variable = sweep.variables[i]
            x = sweep.points[:, i] * variable.factor
            # as vectors the points would make the file too large
            axes.plot(
                x[possible], y, linestyle="none", marker=".", markersize=2.0, color=CYCLE[5],
                alpha=0.6, rasterized=True,
            )  # fmt: skip
            middle, low, half, high = _by_slices(x[possible], y)
            axes.fill_between(middle, low, high, color=CYCLE[0], alpha=0.18, linewidth=0.0)
            axes.plot(middle, half, color=CYCLE[0], linewidth=1.4)
            if _includes_nominal(variable):
                usual = variable.usual * variable.factor
                axes.axvline(usual, color=CYCLE[1], linewidth=0.8, linestyle=(0, (4, 2)))
            if not possible.all():
                bottom = {"transform": axes.get_xaxis_transform(), "clip_on": True}
                axes.vlines(
                    x[~possible], 0.0, 0.05, color=CYCLE[3], linewidth=0.4, rasterized=True,
                    **bottom,
                )  # fmt: skip
            axes.set_title(
                f"r = {_signed(correlations[k, i])}", loc="right", fontsize=6.5, color=MUTED, pad=2
            )
            axes.ticklabel_format(useOffset=False)
            axes.set_xlim(variable.low * variable.factor, variable.high * variable.factor)
            axes.margins(y=0.12)
        row[0].set_ylabel(_in_two_lines(sweep.figures[k], scaled), fontsize=7.5)
    for axes, i in zip(rows[-1], strongest, strict=True):
        axes.set_xlabel(sweep.variables[i].heading, fontsize=7.5, parse_math=False)
    handles: list[Artist] = [
        _line(CYCLE[0], "-", "median"),
        Patch(color=CYCLE[0], alpha=0.18, label="80 % range"),
        _line(MUTED, "none", "r: rank correlation"),
    ]
    if any(_includes_nominal(sweep.variables[i]) for i in strongest):
        handles.insert(2, _line(CYCLE[1], (0, (4, 2)), _DESCRIBED))
    if not possible.all():
        handles.append(_line(CYCLE[3], "-", f"ticks at the bottom: {_INFEASIBLE}"))
    _legend(figure, handles)
    _annotate_omitted(figure, len(strongest), sweep)
    return figure


def _signed(value: float) -> str:
    """Return a correlation with its sign; 0.00 has none."""
    return "0.00" if abs(value) < 0.005 else f"{value:+.2f}".replace("-", "−")


def _includes_nominal(variable: Variable) -> bool:
    """Return whether the described stage is between the bounds."""
    return variable.low <= variable.usual <= variable.high


def _in_two_lines(figure: Figure, quantity: Quantity) -> str:
    """Return the heading of a figure with its drawn unit, in two lines."""
    words = figure.heading_in(quantity).split(" ")
    unit = f" {words.pop()}" if quantity.shown_unit else ""
    half = -(-len(words) // 2)
    return f"{' '.join(words[:half])}\n{' '.join(words[half:])}{unit}"


def _small_multiples(
    count: int, height: float, *, lines: bool = True
) -> "tuple[Drawing, list[Axes]]":
    rows, columns = _rows_and_columns(count)
    wide = _WIDTH if columns > 1 else 4.8
    figure, grid = panels(wide, height * rows + 0.5, count, columns, grid=lines)
    for axes in grid:
        axes.ticklabel_format(useOffset=False)
    return figure, grid


def _rows_and_columns(count: int) -> tuple[int, int]:
    # most diagrams of a row
    most_columns = 3
    columns = 2 if count == 4 else min(most_columns, count)
    return -(-count // columns), columns


def _spans(x: Array, bad: np.ndarray) -> list[tuple[float, float]]:
    """Return the intervals of x nearer to a bad point than to a good one."""
    edges = np.concatenate((x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]))
    spans: list[tuple[float, float]] = []
    for low, high in ((edges[i], edges[i + 1]) for i in np.flatnonzero(bad)):
        if spans and spans[-1][1] == low:
            spans[-1] = (spans[-1][0], float(high))
        else:
            spans.append((float(low), float(high)))
    return spans


def _levels(values: "np.ma.MaskedArray") -> Array:
    """Return round levels within the values of a map."""
    from matplotlib.ticker import MaxNLocator

    levels = 9

    low, high = float(values.min()), float(values.max())
    ticks = np.array(MaxNLocator(levels, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high))
    inside = ticks[(ticks > low) & (ticks < high)]
    return inside if len(inside) else np.array([0.5 * (low + high)])


def _middles(
    lines: "Sequence[Sequence[Array]]", size: tuple[float, float], mark: tuple[float, float] | None
) -> list[tuple[float, float]]:
    """Return the place of the label of each contour: the middle of its longest piece."""
    # distance of a label from a mark, and shortest line with a label, relative to the map
    clear = 0.12
    places = []
    for stretches in lines:
        longest, length = None, clear
        for stretch in stretches:
            steps = np.hypot(*(np.diff(stretch, axis=0) / size).T)
            if steps.sum() > length:
                longest, length = stretch, float(steps.sum())
        if longest is None:
            continue
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*(np.diff(longest, axis=0) / size).T))))
        for share in (0.5, 0.3, 0.7):
            at = longest[int(np.argmin(np.abs(along - share * along[-1])))]
            if mark is None or np.hypot(*((at - mark) / size)) > clear:
                break
        places.append((float(at[0]), float(at[1])))
    return places


def _by_slices(x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Return the centres of slices of x with equal numbers of points, and quantiles of y there."""
    # most slices of a variable
    slices = 12
    values = np.unique(x)
    if len(values) <= slices:  # a grid
        parts = [x == value for value in values]
    else:
        edges = np.quantile(x, np.linspace(0.0, 1.0, min(slices, max(len(x) // 8, 2)) + 1))
        at = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
        parts = [at == i for i in range(len(edges) - 1)]
    parts = [part for part in parts if part.any()]
    middle = np.array([x[part].mean() for part in parts])
    low, half, high = np.array([np.quantile(y[part], (0.1, 0.5, 0.9)) for part in parts]).T
    return middle, low, half, high


def _map_colours() -> "Colormap":
    """Return light colours, on which lines and labels in ink can be read."""
    import matplotlib as mpl
    from matplotlib.colors import ListedColormap

    return ListedColormap(mpl.colormaps["YlGnBu"](np.linspace(0.02, 0.62, 256)), name="flexstage")


def _described_mark(*, dashed: bool = False) -> "Artist":
    from matplotlib.lines import Line2D

    return Line2D(
        [], [], color=CYCLE[1], marker="D", markersize=4.5, label=_DESCRIBED,
        linestyle=(0, (4, 2)) if dashed else "none", linewidth=0.9,
    )  # fmt: skip


def _line(colour: str, style: Any, label: str) -> "Artist":
    from matplotlib.lines import Line2D

    return Line2D([], [], color=colour, linestyle=style, linewidth=1.2, label=label)


def _hatched() -> "Artist":
    from matplotlib.patches import Patch

    return Patch(facecolor="none", edgecolor=HATCH, hatch="////", linewidth=0.0, label=_INFEASIBLE)


def _annotate_omitted(figure: "Drawing", count: int, sweep: Sweep) -> None:
    """Add a heading if some of the variables are omitted."""
    if count < len(sweep.variables):
        text = f"the {count} most influential of {len(sweep.variables)} variables"
        add_heading(figure, text, 8, MUTED)


def _legend(figure: "Drawing", handles: "list[Artist]") -> None:
    if handles:
        add_legend(figure, handles=handles, loc="outside lower right", ncols=len(handles))
