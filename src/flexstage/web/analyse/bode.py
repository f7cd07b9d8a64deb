"""The Bode diagram of a drive and a probe by all models, with two cursors."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from nicegui import events, ui

from flexstage.quantities.comparison import title_of
from flexstage.quantities.quantity import number
from flexstage.quantities.table import Table, table
from flexstage.report.figures.responses import bode_curves
from flexstage.report.figures.style import CYCLE
from flexstage.system import FrequencyResponse
from flexstage.web.analyse.shapes import NOTHING_YET
from flexstage.web.analyse.work import AnalyseState, ModelResult
from flexstage.web.figures import chart, show_table
from flexstage.web.page import Page, choice, div, remark
from flexstage.web.pictures import chart_figure

_NAMES = "AB"
_SMALLEST = 1e-300
_CONDITIONS = ["in place", "removed"]
_DASHES = ("solid", "dash", "dot", "dashdot", "longdash")


def reading(response: FrequencyResponse, frequency_hz: float) -> tuple[float, float]:
    """Return magnitude, in the unit of the diagram, and phase [deg] of a response at a frequency.

    The interpolation is linear in the diagram.
    """
    _, size, phase = bode_curves(response)
    log_frequencies, x = np.log(response.frequency_hz), math.log(frequency_hz)
    # a zero response has no logarithm
    magnitude = np.exp(np.interp(x, log_frequencies, np.log(np.maximum(size, _SMALLEST))))
    return float(magnitude) if magnitude > 2.0 * _SMALLEST else 0.0, float(
        np.interp(x, log_frequencies, phase)
    )


def readings_table(
    responses: Sequence[tuple[str, FrequencyResponse]], cursors: list[float]
) -> Table:
    """Return the responses of models at two cursors, and their difference."""
    a, b = cursors
    rows = [["frequency [Hz]", number(a, 5), number(b, 5), f"{number(b - a)} (× {number(b / a)})"]]
    for name, response in responses:
        unit = bode_curves(response)[0]
        (size_a, phase_a), (size_b, phase_b) = (reading(response, f) for f in cursors)
        change = "–"
        if size_a and size_b:
            ratio = size_b / size_a
            change = f"× {number(ratio)} ({20.0 * math.log10(ratio):.1f} dB)"
        rows.append([f"{name}: magnitude [{unit}]", number(size_a), number(size_b), change])
        cells = (f"{p:.1f}".replace("-0.0", "0.0") for p in (phase_a, phase_b, phase_b - phase_a))
        rows.append([f"{name}: phase [°]", *cells])
    return table("", ("", "cursor A", "cursor B", "B to A"), rows)


class Bode:
    """The diagram.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._display = page.session.state(AnalyseState).display
        self._results: dict[str, ModelResult] = {}
        self._chart: ui.plotly | None = None
        self._place = div("bode")

    def show(self, results: dict[str, ModelResult]) -> None:
        """Show the responses in the results, by model."""
        if results == self._results and self._chart is not None:
            return
        self._results = results
        self._place.clear()
        self._chart = None
        pairs = list(
            dict.fromkeys((r.drive, r.probe) for o in results.values() for r in o.responses)
        )
        with self._place:
            if not pairs:
                text = "No response: the stage needs a drive and a probe."
                ui.label(text if results else NOTHING_YET).classes("muted")
                return
            self._build(pairs)

    def _build(self, pairs: list[tuple[str, str]]) -> None:
        display = self._display
        if display.pair not in pairs:
            axes = next(iter(self._results.values())).analysis.axes
            axis_pairs = [(d, axis.probe) for axis in axes for d in axis.drives]
            display.pair = next((pair for pair in axis_pairs if pair in pairs), pairs[0])
        drives = list(dict.fromkeys(d for d, _ in pairs))
        probes = list(dict.fromkeys(p for _, p in pairs))
        with ui.row().classes("items-center choices"):
            choose = self._choose
            choice(drives, display.pair[0], "Drive", lambda e: choose(drive=e.value))
            choice(probes, display.pair[1], "Probe", lambda e: choose(probe=e.value))
            choice(_CONDITIONS, display.bode_drives, "Drives", lambda e: choose(condition=e.value))
            self._fields = [self._cursor_field(k) for k in range(2)]
        self._require_cursors()
        self._chart = chart(*self._figure(), self._alt_text())
        self._chart.update_figure(self._movable())
        # an interactive figure, as its cursors have the focus
        self._chart.props["role"] = "figure"
        self._chart.classes("tall").on("plotly_relayout", self._move_cursors)
        self._readings = div("full-width")
        result = next(iter(self._results.values()))
        remark(
            f"Drag a cursor, or type its frequency. Damping of the modes: {_damping_text(result)}."
        )
        self._read()

    def _cursor_field(self, k: int) -> ui.number:
        field = ui.number(f"Cursor {_NAMES[k]} [Hz]", min=0, format="%.5g")
        field.props("dense outlined debounce=400").classes("cursor")
        field.on_value_change(lambda event: self._set_cursor(k, event.value))
        return field

    def _responses(self) -> list[tuple[str, FrequencyResponse]]:
        return [
            (title_of(model), response)
            for model, one in self._results.items()
            for response in one.responses
            if (response.drive, response.probe) == self._display.pair
            and response.drives == self._display.bode_drives
        ]

    def _require_cursors(self) -> None:
        """Move cursors outside the diagram to the two lowest natural frequencies."""
        response = self._responses()[0][1]
        low, high = float(response.frequency_hz[0]), float(response.frequency_hz[-1])
        if len(self._display.cursors) != 2 or not all(
            low <= f <= high for f in self._display.cursors
        ):
            modes = next(iter(self._results.values())).analysis.modes[self._display.bode_drives]
            inside = [float(f) for f in modes.frequency_hz if low < f < high]
            self._display.cursors = [*inside, low, high][:2]
        for field, frequency in zip(self._fields, self._display.cursors, strict=True):
            field.value = float(f"{frequency:.5g}")

    def _alt_text(self) -> str:
        drive, probe = self._display.pair or ("", "")
        return f"Bode diagram: probe {probe} by drive {drive}, drives {self._display.bode_drives}"

    def _figure(self) -> tuple[list[dict[str, Any]], dict[str, Any]]:
        data: list[dict[str, Any]] = []
        unit = ""
        for k, (name, response) in enumerate(self._responses()):
            unit, size, phase = bode_curves(response)
            line = {"color": CYCLE[k % len(CYCLE)], "dash": _DASHES[k % len(_DASHES)], "width": 1.8}
            common = {"x": response.frequency_hz.tolist(), "line": line, "legendgroup": name}
            data.append(common | {"y": size.tolist(), "name": name})
            data.append(
                common | {"y": phase.tolist(), "yaxis": "y2", "name": name, "showlegend": False}
            )
        sizes = [value for trace in data if "yaxis" not in trace for value in trace["y"] if value]
        decades = math.log10(max(sizes, default=1.0) / min(sizes, default=1.0))
        phases = [value for trace in data if "yaxis" in trace for value in trace["y"]]
        span = max(phases) - min(phases)
        step = next((s for s in (45, 90, 180, 360) if span <= 4 * s), 720)
        layout = {
            "xaxis": {
                "type": "log", "title": {"text": "frequency [Hz]"}, "anchor": "y2", "dtick": "D2"
            },
            "yaxis": {
                "type": "log", "domain": [0.4, 1.0], "exponentformat": "power",
                "title": {"text": f"magnitude [{unit}]"}, "dtick": 1 if decades > 2.0 else "D2",
            },
            "yaxis2": {"domain": [0.0, 0.34], "dtick": step, "title": {"text": "phase [°]"}},
            "margin": {"l": 78, "r": 16, "t": 24, "b": 48},
            "font": {"family": "inherit", "size": 12},
            "shapes": [self._line(k) for k in range(2)],
            "annotations": [
                {"x": math.log10(f), "y": 1.0, "yref": "paper", "yanchor": "top", "xanchor": "left",
                 "text": _NAMES[k], "showarrow": False, "font": {"color": CYCLE[2 + k]}}
                for k, f in enumerate(self._display.cursors)
            ],
        }  # fmt: skip
        return data, layout

    def _movable(self) -> dict[str, Any]:
        """Return the diagram with movable cursors."""
        figure = chart_figure(*self._figure())
        figure["config"]["edits"] = {"shapePosition": True}
        return figure

    def _line(self, k: int) -> dict[str, Any]:
        frequency = self._display.cursors[k]
        line = {"color": CYCLE[2 + k], "width": 2}
        return {
            "type": "line",
            "x0": frequency,
            "x1": frequency,
            "yref": "paper",
            "y0": 0,
            "y1": 1,
            "line": line,
        }

    def _read(self) -> None:
        self._readings.clear()
        with self._readings:
            show_table(readings_table(self._responses(), self._display.cursors))

    def _redraw(self) -> None:
        if self._chart is None:
            return
        self._chart.update_figure(self._movable())
        self._chart.props["aria-label"] = self._alt_text()
        self._read()

    def _set_cursor(self, k: int, value: float | None) -> None:
        if value and value > 0.0 and abs(value - self._display.cursors[k]) > 1e-5 * value:
            self._display.cursors[k] = float(value)
            self._redraw()

    def _move_cursors(self, event: events.GenericEventArguments) -> None:
        positions = {
            k: event.args[name] for k in range(2) if (name := f"shapes[{k}].x0") in event.args
        }
        for k, frequency in positions.items():
            if frequency > 0.0:
                self._display.cursors[k] = float(frequency)
                self._fields[k].value = float(f"{frequency:.5g}")
        if positions:
            self._redraw()

    def _choose(self, *, drive: str = "", probe: str = "", condition: Any = None) -> None:
        previous = self._display.pair or ("", "")
        self._display.pair = (drive or previous[0], probe or previous[1])
        if condition:
            self._display.bode_drives = condition
            self._require_cursors()
        self._redraw()


def _damping_text(result: ModelResult) -> str:
    ratios = result.analysis.modes["removed"].damping_ratio
    return f"{number(100.0 * float(ratios.min()), 2)} % of critical" if ratios.size else "none"
