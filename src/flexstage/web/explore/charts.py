"""Charts of points that one can pick: curves, maps, scatter and parallel coordinates."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from nicegui import ui

from flexstage.base.arrays import Array
from flexstage.report.figures.style import CYCLE
from flexstage.studies.explore.batches import FinishedBatch
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.optimise.optimum import HistoryEntry
from flexstage.studies.explore.tolerance import MonteCarloSamples
from flexstage.web.explore.points import ON_FRONT, SEARCHED, PointColumn, PointTable
from flexstage.web.explore.state import Run
from flexstage.web.figures import chart
from flexstage.web.page import choice
from flexstage.web.pictures import chart_figure
from flexstage.web.preferences import Preferences

Chart = tuple[list[dict[str, Any]], dict[str, Any]]

CURVE, MAP, SCATTER, LINES = "curve", "map", "scatter", "parallel coordinates"
# lines of parallel coordinates, and points, beyond which nobody sees more, and a page becomes slow
_LINES, _POINTS = 400, 2500
# axes of parallel coordinates, whose headings stand side by side
_AXES = 9
_MARK = {"symbol": "diamond", "size": 11, "color": CYCLE[1], "line": {"width": 1}}
_PICKED = {"symbol": "circle-open", "size": 17, "color": CYCLE[3], "line": {"width": 3}}
_FRONT = {SEARCHED: CYCLE[5], ON_FRONT: CYCLE[0], "chosen": CYCLE[1]}


def kinds(table: PointTable) -> tuple[str, ...]:
    """Return the kinds of charts that suit points, the best first."""
    count = len(table.varied)
    if table.labels:
        return (SCATTER, LINES)
    if count == 1:
        return (CURVE,)
    if count == 2 and table.counts:
        return (MAP, SCATTER, LINES)
    return (LINES, SCATTER)


def draw(
    table: PointTable, kind: str, across: PointColumn, up: PointColumn, picked: int | None
) -> Chart:
    """Return a chart of a kind; a map has the figure `up` over both variables."""
    match kind:
        case "curve":
            data, layout = _curve(table, across, up)
        case "map":
            data, layout = _map(table, up)
        case "scatter":
            data, layout = _scatter(table, across, up)
        case _:
            data, layout = _parallel(table, up, picked)
    if picked is not None and kind != LINES:
        x, y = table.varied[:2] if kind == MAP else (across, up)
        data.append(_dot(x.values[picked], y.values[picked], "picked", _PICKED))
    # what one looks at closer in one diagram is no place in another
    return data, layout | {"uirevision": f"{kind} {across.name} {up.name}"}


def _dot(x: float, y: float, name: str, marker: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "scatter", "mode": "markers", "x": [x], "y": [y], "name": name,
        "marker": marker, "hoverinfo": "skip", "cliponaxis": False,
    }  # fmt: skip


def _hover(table: PointTable, rows: Sequence[int], *columns: PointColumn) -> list[str]:
    """Return what is said of each point where a pointer is over it."""
    return [
        "<br>".join((f"point {i + 1}", *(f"{c.heading}: {c.values[i]:.5g}" for c in columns)))
        for i in rows
    ]


def _axis(column: PointColumn, values: Any = None) -> dict[str, Any]:
    axis: dict[str, Any] = {"title": {"text": column.heading}}
    if values is not None:
        axis["range"] = [float(np.min(values)), float(np.max(values))]
    return axis


def _curve(table: PointTable, across: PointColumn, up: PointColumn) -> Chart:
    order = np.argsort(across.values, kind="stable")
    rows = [int(i) for i in order]
    data = [
        {
            "type": "scatter", "mode": "lines+markers", "name": up.heading,
            "x": across.values[order].tolist(), "y": _numbers(up.values[order]),
            "customdata": rows, "text": _hover(table, rows, across, up), "hoverinfo": "text",
            "showlegend": False,
        }
    ]  # fmt: skip
    return _with_described(data, across, up), {
        "xaxis": _axis(across, across.values),
        "yaxis": _axis(up),
    }


def _with_described(data: list[dict[str, Any]], x: PointColumn, y: PointColumn) -> list[Any]:
    if np.isfinite([x.described, y.described]).all():
        data.append(_dot(x.described, y.described, "as described", _MARK))
    return data


def _map(table: PointTable, figure: PointColumn) -> Chart:
    across, up = table.varied
    shape = table.counts
    x, y = (column.values.reshape(shape) for column in (across, up))
    colours = {
        "colorscale": "YlGnBu", "reversescale": True,
        "colorbar": {"title": {"text": figure.heading, "side": "right"}, "thickness": 14},
    }  # fmt: skip
    rows = _thinned(list(range(len(table.points))))
    data: list[dict[str, Any]] = [
        {
            "type": "contour", "x": x[:, 0].tolist(), "y": y[0].tolist(),
            "z": [_numbers(line) for line in figure.values.reshape(shape).T],
            "hoverinfo": "skip", "name": figure.heading, **colours,
        },
        {
            "type": "scatter", "mode": "markers", "x": across.values[rows].tolist(),
            "y": up.values[rows].tolist(), "customdata": rows, "hoverinfo": "text",
            "text": _hover(table, rows, across, up, figure), "showlegend": False,
            "marker": {"size": 5, "color": "rgba(20, 30, 40, 0.35)"},
        },
    ]  # fmt: skip
    if np.isfinite([across.described, up.described]).all():
        data.append(_dot(across.described, up.described, "as described", _MARK))
    return data, {"xaxis": _axis(across, across.values), "yaxis": _axis(up, up.values)}


def _scatter(table: PointTable, across: PointColumn, up: PointColumn) -> Chart:
    labels = list(table.labels) or ["points"] * len(table.points)
    shown = set(table.shown.tolist())
    data = []
    for label in sorted({labels[i] for i in table.shown}, key=lambda one: one != SEARCHED):
        rows = _thinned([i for i, own in enumerate(labels) if own == label and i in shown])
        star = label.startswith("chosen")
        marker = {
            "size": 13 if star else 4 if label == SEARCHED else 7,
            "symbol": "star" if star else "circle",
            "color": CYCLE[2]
            if label in ("chosen, improved", "best")
            else _FRONT.get(label, CYCLE[0]),
            "opacity": 0.5 if label == SEARCHED else 1.0,
        }
        data.append(
            {
                "type": "scatter", "mode": "markers", "name": label, "marker": marker,
                "x": across.values[rows].tolist(), "y": up.values[rows].tolist(),
                "customdata": rows, "text": _hover(table, rows, across, up),
                "hoverinfo": "text", "showlegend": bool(table.labels),
            }
        )  # fmt: skip
    return _with_described(data, across, up), {"xaxis": _axis(across), "yaxis": _axis(up)}


def _thinned(rows: list[int], most: int = _POINTS) -> list[int]:
    """Return as many rows as can be seen, evenly."""
    if len(rows) <= most:
        return rows
    return [rows[k] for k in np.linspace(0, len(rows) - 1, most).astype(int)]


def _parallel(table: PointTable, colour: PointColumn, picked: int | None) -> Chart:
    """Draw a line for each point through an axis for each column, from its least to its greatest.

    One trace has all lines, so that a page of many stays quick; a click on a point of a line picks.
    """
    columns = [c for c in table.columns if c.varies][:_AXES]
    rows = np.array(_thinned(table.shown.tolist(), _LINES), dtype=int)
    low = [float(np.nanmin(c.values)) for c in columns]
    high = [float(np.nanmax(c.values)) for c in columns]
    places = [*range(len(columns)), None]

    def line(of: Sequence[int], width: float, tint: str, name: str) -> dict[str, Any]:
        heights = [
            [(float(c.values[i]) - a) / (b - a) for c, a, b in zip(columns, low, high, strict=True)]
            for i in of
        ]
        told = [[f"point {i + 1}<br>{c.heading}: {c.values[i]:.5g}" for c in columns] for i in of]
        return {
            "type": "scatter", "mode": "lines+markers", "name": name, "connectgaps": False,
            "x": places * len(of), "y": [v for ys in heights for v in (*_numbers(ys), None)],
            "customdata": [int(i) for i in of for _ in places],
            "text": [t for texts in told for t in (*texts, "")], "hoverinfo": "text",
            "line": {"width": width, "color": tint}, "marker": {"size": 3 + width, "color": tint},
            "showlegend": False,
        }  # fmt: skip

    best = _thirds(colour, rows)
    data = [
        line(part, 0.7, tint, name)
        for part, tint, name in zip(best, (CYCLE[5], CYCLE[0], CYCLE[2]), _THIRDS, strict=True)
        if len(part)
    ]
    for trace in data:
        trace["showlegend"] = True
    if picked is not None:
        data.append(line([picked], 3.0, CYCLE[3], "picked"))
    ticks = [
        f"{_broken(c.short)}<br>{a:.4g}<br>to {b:.4g}"
        for c, a, b in zip(columns, low, high, strict=True)
    ]
    layout = {
        "xaxis": {
            "title": {"text": "What was varied, and the figures: from least to greatest"},
            "tickvals": places[:-1],
            "ticktext": ticks, "showgrid": True, "tickangle": 0,
            "tickfont": {"size": 9 if len(columns) > 9 else 10},
        },
        "yaxis": {
            "title": {"text": "From least to greatest", "standoff": 4}, "tickvals": [0, 1],
            "ticktext": ["least", "greatest"], "range": [-0.05, 1.05], "automargin": True,
        },
        "margin": {"l": 80, "r": 30, "t": 24, "b": 130},
    }  # fmt: skip
    return data, layout


_THIRDS = ("lowest third", "middle third", "highest third")


def _thirds(column: PointColumn, rows: np.ndarray) -> list[list[int]]:
    order = rows[np.argsort(column.values[rows], kind="stable")]
    return [[int(i) for i in part] for part in np.array_split(order, 3)]


def _broken(heading: str) -> str:
    """Break a heading into lines of few letters, also behind dots, as axes stand close."""
    lines = [""]
    for word in re.findall(r"[^ .]+\.*", heading):
        between = "" if lines[-1].endswith(".") or not lines[-1] else " "
        if lines[-1] and len(lines[-1] + between + word) > 10:
            lines.append(word)
        else:
            lines[-1] += between + word
    return "<br>".join(lines)


def _numbers(values: Any) -> list[float | None]:
    """Return numbers as JSON has them: none where there is none."""
    return [float(v) if np.isfinite(v) else None for v in values]


def draw_way(columns: Sequence[PointColumn], trace: Sequence[HistoryEntry]) -> Chart:
    """Draw the goal of a search over the evaluations, a line for each of its starts.

    Points that miss a requirement are hollow.
    """
    at, goal, missed = columns[:3]
    searches = [step.search for step in trace]
    data = []
    for search in dict.fromkeys(searches):
        rows = [i for i, own in enumerate(searches) if own == search]
        off = missed.values[rows] > 0.2
        data.append(
            {
                "type": "scatter", "mode": "lines+markers", "name": f"search {search + 1}",
                "x": at.values[rows].tolist(), "y": _numbers(goal.values[rows]),
                "customdata": rows, "hoverinfo": "text",
                "text": [f"step {i + 1}<br>{goal.heading}: {goal.values[i]:.5g}"
                         f"<br>{missed.heading}: {missed.values[i]:.2g}" for i in rows],
                "line": {"color": CYCLE[search % 6]},
                "marker": {
                    "color": CYCLE[search % 6], "size": 7,
                    "symbol": ["circle-open" if one else "circle" for one in off],
                },
            }
        )  # fmt: skip
    return data, {"xaxis": _axis(at), "yaxis": _axis(goal)}


_BINS = 40


class LotChart:
    """A histogram that fills, and a field for its figure.

    Parameters
    ----------
    run, preferences
        The run, and units.
    """

    def __init__(self, run: Run, preferences: Preferences) -> None:
        self._run, self._preferences = run, preferences
        self._box = ui.column().classes("full-width")
        self._plot: ui.plotly | None = None
        self._count: ui.label | None = None
        self.show()

    def show(self) -> None:
        """Show what was drawn so far."""
        found = self._run.job.found
        lot = next((each for each in found if isinstance(each, MonteCarloSamples)), None)
        batches = [each for each in found if isinstance(each, FinishedBatch)]
        if lot is None or not batches:
            return
        values = lot.corrected(np.concatenate([each.arrays["values"] for each in batches]))
        if self._plot is None:
            self._begin(lot.figures)
        names = [figure.name for figure in lot.figures]
        at = names.index(self._run.up)
        assert self._plot is not None
        assert self._count is not None
        self._count.text = f"{len(values)} stages"
        figure = lot.figures[at]
        self._plot.update_figure(chart_figure(*histogram(figure, values[:, at], self._preferences)))

    def _begin(self, figures: tuple[Figure, ...]) -> None:
        run, names = self._run, {f.name: f.label for f in figures}
        if run.up not in names:
            frequencies = (name for name in names if name.startswith("natural_frequency"))
            run.up = next(frequencies, next(iter(names)))

        def choose(event: Any) -> None:
            run.up = event.value
            self.show()

        with self._box:
            with ui.row().classes("items-center controls"):
                choice(names, run.up, "Figure", choose)
                self._count = ui.label().classes("muted small")
            empty = histogram(figures[0], np.zeros(0), self._preferences)
            self._plot = chart(*empty, "Distribution of a figure among the stages").classes("tall")


def histogram(figure: Figure, values: Array, preferences: Preferences) -> Chart:
    """Return how values of a figure are distributed; those of what is no stage are left out."""
    shown = preferences.shown(figure.display)
    known = values[np.isfinite(values)] * shown.factor
    counts, edges = np.histogram(known, bins=_BINS) if known.size else (np.zeros(1), np.zeros(2))
    bars = {
        "type": "bar", "x": (0.5 * (edges[1:] + edges[:-1])).tolist(),
        "y": (100.0 * counts / max(len(values), 1)).tolist(),
        "marker": {"color": CYCLE[0]}, "hoverinfo": "x+y", "showlegend": False,
    }  # fmt: skip
    return [bars], {
        "xaxis": {"title": {"text": figure.heading_in(shown)}},
        "yaxis": {"title": {"text": "Stages in a bin [%]"}},
        "bargap": 0.05,
    }
