"""Charts of samples: curves, maps, scatter plots and parallel coordinates."""

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
from flexstage.web.explore.samples_table import DOMINATED, ON_FRONT, SamplesColumn, SamplesTable
from flexstage.web.explore.state import ExploreRun
from flexstage.web.figures import chart
from flexstage.web.page import choice
from flexstage.web.pictures import chart_figure
from flexstage.web.sessions import Preferences

Chart = tuple[list[dict[str, Any]], dict[str, Any]]

CURVE, MAP, SCATTER, LINES = "curve", "map", "scatter", "parallel coordinates"
# largest number of lines of parallel coordinates, and of points: more makes the page slow
_MAX_LINES, _MAX_POINTS = 400, 2500
# largest number of axes of parallel coordinates, with room for their headings
_MAX_AXES = 9
_NOMINAL = {"symbol": "diamond", "size": 11, "color": CYCLE[1], "line": {"width": 1}}
_SELECTED = {"symbol": "circle-open", "size": 17, "color": CYCLE[3], "line": {"width": 3}}
_FRONT = {DOMINATED: CYCLE[5], ON_FRONT: CYCLE[0], "selected": CYCLE[1]}


def kinds(table: SamplesTable) -> tuple[str, ...]:
    """Return the suitable kinds of charts, the best first."""
    count = len(table.varied)
    if table.labels:
        return (SCATTER, LINES)
    if count == 1:
        return (CURVE,)
    if count == 2 and table.counts:
        return (MAP, SCATTER, LINES)
    return (LINES, SCATTER)


def draw(
    table: SamplesTable,
    kind: str,
    x_column: SamplesColumn,
    y_column: SamplesColumn,
    selected: int | None,
) -> Chart:
    """Return a chart of a kind; a map has the figure `y_column` over both variables."""
    match kind:
        case "curve":
            data, layout = _curve(table, x_column, y_column)
        case "map":
            data, layout = _map(table, y_column)
        case "scatter":
            data, layout = _scatter(table, x_column, y_column)
        case _:
            data, layout = _parallel(table, y_column, selected)
    if selected is not None and kind != LINES:
        horizontal, vertical = table.varied[:2] if kind == MAP else (x_column, y_column)
        data.append(
            _dot(horizontal.values[selected], vertical.values[selected], "selected", _SELECTED)
        )
    # a zoom of one diagram does not apply to another
    return data, layout | {"uirevision": f"{kind} {x_column.name} {y_column.name}"}


def _dot(x: float, y: float, label: str, marker: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "scatter", "mode": "markers", "x": [x], "y": [y], "name": label,
        "marker": marker, "hoverinfo": "skip", "cliponaxis": False,
    }  # fmt: skip


def _hover(table: SamplesTable, rows: Sequence[int], *columns: SamplesColumn) -> list[str]:
    """Return the hover texts of points."""
    return [
        "<br>".join((f"point {i + 1}", *(f"{c.heading}: {c.values[i]:.5g}" for c in columns)))
        for i in rows
    ]


def _axis(column: SamplesColumn, values: Any = None) -> dict[str, Any]:
    axis: dict[str, Any] = {"title": {"text": column.heading}}
    if values is not None:
        axis["range"] = [float(np.min(values)), float(np.max(values))]
    return axis


def _curve(table: SamplesTable, x: SamplesColumn, y: SamplesColumn) -> Chart:
    order = np.argsort(x.values, kind="stable")
    rows = [int(i) for i in order]
    data = [
        {
            "type": "scatter", "mode": "lines+markers", "name": y.heading,
            "x": x.values[order].tolist(), "y": _numbers(y.values[order]),
            "customdata": rows, "text": _hover(table, rows, x, y), "hoverinfo": "text",
            "showlegend": False,
        }
    ]  # fmt: skip
    return _with_nominal(data, x, y), {
        "xaxis": _axis(x, x.values),
        "yaxis": _axis(y),
    }


def _with_nominal(data: list[dict[str, Any]], x: SamplesColumn, y: SamplesColumn) -> list[Any]:
    if np.isfinite([x.described, y.described]).all():
        data.append(_dot(x.described, y.described, "nominal", _NOMINAL))
    return data


def _map(table: SamplesTable, figure: SamplesColumn) -> Chart:
    x_column, y_column = table.varied
    shape = table.counts
    x, y = (column.values.reshape(shape) for column in (x_column, y_column))
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
            "type": "scatter", "mode": "markers", "x": x_column.values[rows].tolist(),
            "y": y_column.values[rows].tolist(), "customdata": rows, "hoverinfo": "text",
            "text": _hover(table, rows, x_column, y_column, figure), "showlegend": False,
            "marker": {"size": 5, "color": "rgba(20, 30, 40, 0.35)"},
        },
    ]  # fmt: skip
    if np.isfinite([x_column.described, y_column.described]).all():
        data.append(_dot(x_column.described, y_column.described, "nominal", _NOMINAL))
    return data, {
        "xaxis": _axis(x_column, x_column.values),
        "yaxis": _axis(y_column, y_column.values),
    }


def _scatter(table: SamplesTable, x: SamplesColumn, y: SamplesColumn) -> Chart:
    labels = list(table.labels) or ["points"] * len(table.points)
    computed = set(table.computed_rows.tolist())
    data = []
    for label in sorted({labels[i] for i in table.computed_rows}, key=lambda one: one != DOMINATED):
        rows = _thinned(
            [i for i, row_label in enumerate(labels) if row_label == label and i in computed]
        )
        is_selected = label.startswith("selected")
        marker = {
            "size": 13 if is_selected else 4 if label == DOMINATED else 7,
            "symbol": "star" if is_selected else "circle",
            "color": CYCLE[2]
            if label in ("selected, refined", "best")
            else _FRONT.get(label, CYCLE[0]),
            "opacity": 0.5 if label == DOMINATED else 1.0,
        }
        data.append(
            {
                "type": "scatter", "mode": "markers", "name": label, "marker": marker,
                "x": x.values[rows].tolist(), "y": y.values[rows].tolist(),
                "customdata": rows, "text": _hover(table, rows, x, y),
                "hoverinfo": "text", "showlegend": bool(table.labels),
            }
        )  # fmt: skip
    return _with_nominal(data, x, y), {"xaxis": _axis(x), "yaxis": _axis(y)}


def _thinned(rows: list[int], limit: int = _MAX_POINTS) -> list[int]:
    """Return at most `limit` rows, evenly selected."""
    if len(rows) <= limit:
        return rows
    return [rows[k] for k in np.linspace(0, len(rows) - 1, limit).astype(int)]


def _parallel(table: SamplesTable, colour: SamplesColumn, selected: int | None) -> Chart:
    """Draw parallel coordinates: a line for each sample, an axis for each column.

    Each axis reaches from the smallest to the largest value. All lines share one trace for speed.
    """
    columns = [c for c in table.columns if c.varies][:_MAX_AXES]
    rows = np.array(_thinned(table.computed_rows.tolist(), _MAX_LINES), dtype=int)
    low = [float(np.nanmin(c.values)) for c in columns]
    high = [float(np.nanmax(c.values)) for c in columns]
    positions = [*range(len(columns)), None]

    def line(of: Sequence[int], width: float, tint: str, name: str) -> dict[str, Any]:
        heights = [
            [(float(c.values[i]) - a) / (b - a) for c, a, b in zip(columns, low, high, strict=True)]
            for i in of
        ]
        hover = [[f"point {i + 1}<br>{c.heading}: {c.values[i]:.5g}" for c in columns] for i in of]
        return {
            "type": "scatter", "mode": "lines+markers", "name": name, "connectgaps": False,
            "x": positions * len(of), "y": [v for ys in heights for v in (*_numbers(ys), None)],
            "customdata": [int(i) for i in of for _ in positions],
            "text": [t for lines in hover for t in (*lines, "")], "hoverinfo": "text",
            "line": {"width": width, "color": tint}, "marker": {"size": 3 + width, "color": tint},
            "showlegend": False,
        }  # fmt: skip

    thirds = _thirds(colour, rows)
    data = [
        line(part, 0.7, tint, name)
        for part, tint, name in zip(thirds, (CYCLE[5], CYCLE[0], CYCLE[2]), _THIRDS, strict=True)
        if len(part)
    ]
    for trace in data:
        trace["showlegend"] = True
    if selected is not None:
        data.append(line([selected], 3.0, CYCLE[3], "selected"))
    ticks = [
        f"{_broken(c.short)}<br>{a:.4g}<br>to {b:.4g}"
        for c, a, b in zip(columns, low, high, strict=True)
    ]
    layout = {
        "xaxis": {
            "title": {"text": "Varied parameters and figures, from smallest to largest"},
            "tickvals": positions[:-1],
            "ticktext": ticks, "showgrid": True, "tickangle": 0,
            "tickfont": {"size": 9 if len(columns) > 9 else 10},
        },
        "yaxis": {
            "title": {"text": "Smallest to largest", "standoff": 4}, "tickvals": [0, 1],
            "ticktext": ["smallest", "largest"], "range": [-0.05, 1.05], "automargin": True,
        },
        "margin": {"l": 80, "r": 30, "t": 24, "b": 130},
    }  # fmt: skip
    return data, layout


_THIRDS = ("lowest third", "middle third", "highest third")


def _thirds(column: SamplesColumn, rows: np.ndarray) -> list[list[int]]:
    order = rows[np.argsort(column.values[rows], kind="stable")]
    return [[int(i) for i in part] for part in np.array_split(order, 3)]


def _broken(heading: str) -> str:
    """Break a heading into short lines, also after dots, as the axes are close."""
    lines = [""]
    for word in re.findall(r"[^ .]+\.*", heading):
        between = "" if lines[-1].endswith(".") or not lines[-1] else " "
        if lines[-1] and len(lines[-1] + between + word) > 10:
            lines.append(word)
        else:
            lines[-1] += between + word
    return "<br>".join(lines)


def _numbers(values: Any) -> list[float | None]:
    """Return numbers for JSON, with None for NaN."""
    return [float(v) if np.isfinite(v) else None for v in values]


def draw_history(columns: Sequence[SamplesColumn], trace: Sequence[HistoryEntry]) -> Chart:
    """Draw the goal of a search over the evaluations, a line for each of its starts.

    Hollow points violate a constraint.
    """
    evaluations, goal, violation = columns[:3]
    searches = [step.search for step in trace]
    data = []
    for search in dict.fromkeys(searches):
        rows = [i for i, step_search in enumerate(searches) if step_search == search]
        is_violated = violation.values[rows] > 0.2
        data.append(
            {
                "type": "scatter", "mode": "lines+markers", "name": f"search {search + 1}",
                "x": evaluations.values[rows].tolist(), "y": _numbers(goal.values[rows]),
                "customdata": rows, "hoverinfo": "text",
                "text": [f"step {i + 1}<br>{goal.heading}: {goal.values[i]:.5g}"
                         f"<br>{violation.heading}: {violation.values[i]:.2g}" for i in rows],
                "line": {"color": CYCLE[search % 6]},
                "marker": {
                    "color": CYCLE[search % 6], "size": 7,
                    "symbol": ["circle-open" if one else "circle" for one in is_violated],
                },
            }
        )  # fmt: skip
    return data, {"xaxis": _axis(evaluations), "yaxis": _axis(goal)}


_BINS = 40


class ToleranceChart:
    """A histogram of a running tolerance analysis, and the choice of its figure.

    Parameters
    ----------
    run, preferences
        The run, and the units.
    """

    def __init__(self, run: ExploreRun, preferences: Preferences) -> None:
        self._run, self._preferences = run, preferences
        self._box = ui.column().classes("full-width")
        self._plot: ui.plotly | None = None
        self._count: ui.label | None = None
        self.show()

    def show(self) -> None:
        """Show the samples so far."""
        partial_results = self._run.job.partial_results
        lot = next((each for each in partial_results if isinstance(each, MonteCarloSamples)), None)
        batches = [each for each in partial_results if isinstance(each, FinishedBatch)]
        if lot is None or not batches:
            return
        values = lot.corrected(np.concatenate([each.arrays["values"] for each in batches]))
        if self._plot is None:
            self._begin(lot.figures)
        names = [figure.name for figure in lot.figures]
        column = names.index(self._run.y_column)
        assert self._plot is not None
        assert self._count is not None
        self._count.text = f"{len(values)} simulated stages"
        figure = lot.figures[column]
        data, layout = histogram(figure, values[:, column], self._preferences)
        self._plot.update_figure(chart_figure(data, layout))

    def _begin(self, figures: tuple[Figure, ...]) -> None:
        run, labels = self._run, {f.name: f.label for f in figures}
        if run.y_column not in labels:
            frequencies = (name for name in labels if name.startswith("natural_frequency"))
            run.y_column = next(frequencies, next(iter(labels)))

        def choose(event: Any) -> None:
            run.y_column = event.value
            self.show()

        with self._box:
            with ui.row().classes("items-center controls"):
                choice(labels, run.y_column, "Figure", choose)
                self._count = ui.label().classes("muted small")
            empty = histogram(figures[0], np.zeros(0), self._preferences)
            self._plot = chart(
                *empty, "Distribution of a figure among the simulated stages"
            ).classes("tall")


def histogram(figure: Figure, values: Array, preferences: Preferences) -> Chart:
    """Return the histogram of a figure; infeasible samples are excluded."""
    quantity = preferences.displayed(figure.display)
    finite = values[np.isfinite(values)] * quantity.factor
    counts, edges = np.histogram(finite, bins=_BINS) if finite.size else (np.zeros(1), np.zeros(2))
    bars = {
        "type": "bar", "x": (0.5 * (edges[1:] + edges[:-1])).tolist(),
        "y": (100.0 * counts / max(len(values), 1)).tolist(),
        "marker": {"color": CYCLE[0]}, "hoverinfo": "x+y", "showlegend": False,
    }  # fmt: skip
    return [bars], {
        "xaxis": {"title": {"text": figure.heading_in(quantity)}},
        "yaxis": {"title": {"text": "Stages per bin [%]"}},
        "bargap": 0.05,
    }
