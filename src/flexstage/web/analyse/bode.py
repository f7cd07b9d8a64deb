"""The Bode diagram of a drive and a probe, by all models, with two cursors that read it."""

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
from flexstage.web.analyse.state import AnalyseState
from flexstage.web.analyse.work import ModelResult
from flexstage.web.figures import chart, show_table
from flexstage.web.page import Page, choice, div, remark
from flexstage.web.pictures import chart_figure

_NAMES = "AB"
_NOTHING = 1e-300
_CONDITIONS = ["in place", "removed"]
_DASHES = ("solid", "dash", "dot", "dashdot", "longdash")


def reading(response: FrequencyResponse, frequency_hz: float) -> tuple[float, float]:
    """Return magnitude, in the unit of the diagram, and phase [deg] of a response at a frequency.

    Between its points as a straight line of the diagram.
    """
    _, size, phase = bode_curves(response)
    at, x = np.log(response.frequency_hz), math.log(frequency_hz)
    # a drive that does not move the probe at all has no logarithm
    read = np.exp(np.interp(x, at, np.log(np.maximum(size, _NOTHING))))
    return float(read) if read > 2.0 * _NOTHING else 0.0, float(np.interp(x, at, phase))


def readings_table(shown: Sequence[tuple[str, FrequencyResponse]], cursors: list[float]) -> Table:
    """Return what two cursors read of the responses of models, and the difference."""
    a, b = cursors
    rows = [["frequency [Hz]", number(a, 5), number(b, 5), f"{number(b - a)} (× {number(b / a)})"]]
    for name, response in shown:
        unit = bode_curves(response)[0]
        (size_a, phase_a), (size_b, phase_b) = (reading(response, f) for f in cursors)
        step = "–"
        if size_a and size_b:
            ratio = size_b / size_a
            step = f"× {number(ratio)} ({20.0 * math.log10(ratio):.1f} dB)"
        rows.append([f"{name}: magnitude [{unit}]", number(size_a), number(size_b), step])
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
        self._shown = page.session.state(AnalyseState).shown
        self._found: dict[str, ModelResult] = {}
        self._chart: ui.plotly | None = None
        self._place = div("bode")

    def show(self, found: dict[str, ModelResult]) -> None:
        """Show the responses of what was found, by model."""
        if found == self._found and self._chart is not None:
            return
        self._found = found
        self._place.clear()
        self._chart = None
        pairs = list(dict.fromkeys((r.drive, r.probe) for o in found.values() for r in o.responses))
        with self._place:
            if not pairs:
                words = "No response: the stage needs a drive and a probe."
                ui.label(words if found else NOTHING_YET).classes("muted")
                return
            self._build(pairs)

    def _build(self, pairs: list[tuple[str, str]]) -> None:
        shown = self._shown
        if shown.pair not in pairs:
            axes = next(iter(self._found.values())).analysis.axes
            first = [(d, axis.probe) for axis in axes for d in axis.drives]
            shown.pair = next((pair for pair in first if pair in pairs), pairs[0])
        drives = list(dict.fromkeys(d for d, _ in pairs))
        probes = list(dict.fromkeys(p for _, p in pairs))
        with ui.row().classes("items-center choices"):
            choose = self._choose
            choice(drives, shown.pair[0], "Drive", lambda e: choose(drive=e.value))
            choice(probes, shown.pair[1], "Probe", lambda e: choose(probe=e.value))
            choice(_CONDITIONS, shown.bode_drives, "Drives", lambda e: choose(condition=e.value))
            self._fields = [self._cursor_field(k) for k in range(2)]
        self._require_cursors()
        self._chart = chart(*self._figure(), self._says())
        self._chart.update_figure(self._movable())
        # its cursors can be reached, which is more than a picture has
        self._chart.props["role"] = "figure"
        self._chart.classes("tall").on("plotly_relayout", self._dragged)
        self._readings = div("full-width")
        one = next(iter(self._found.values()))
        remark(
            f"Drag a cursor, or type its frequency. Damping of the modes: {_damping_words(one)}."
        )
        self._read()

    def _cursor_field(self, k: int) -> ui.number:
        field = ui.number(f"Cursor {_NAMES[k]} [Hz]", min=0, format="%.5g")
        field.props("dense outlined debounce=400").classes("cursor")
        field.on_value_change(lambda event: self._typed(k, event.value))
        return field

    def _responses(self) -> list[tuple[str, FrequencyResponse]]:
        return [
            (title_of(model), response)
            for model, one in self._found.items()
            for response in one.responses
            if (response.drive, response.probe) == self._shown.pair
            and response.drives == self._shown.bode_drives
        ]

    def _require_cursors(self) -> None:
        """Put cursors that are not on the diagram to its two lowest natural frequencies."""
        response = self._responses()[0][1]
        low, high = float(response.frequency_hz[0]), float(response.frequency_hz[-1])
        if len(self._shown.cursors) != 2 or not all(low <= f <= high for f in self._shown.cursors):
            own = next(iter(self._found.values())).analysis.modes[self._shown.bode_drives]
            inside = [float(f) for f in own.frequency_hz if low < f < high]
            self._shown.cursors = [*inside, low, high][:2]
        for field, frequency in zip(self._fields, self._shown.cursors, strict=True):
            field.value = float(f"{frequency:.5g}")

    def _says(self) -> str:
        drive, probe = self._shown.pair or ("", "")
        return f"Bode diagram: probe {probe} by drive {drive}, drives {self._shown.bode_drives}"

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
                for k, f in enumerate(self._shown.cursors)
            ],
        }  # fmt: skip
        return data, layout

    def _movable(self) -> dict[str, Any]:
        """Return the diagram with cursors that can be dragged."""
        figure = chart_figure(*self._figure())
        figure["config"]["edits"] = {"shapePosition": True}
        return figure

    def _line(self, k: int) -> dict[str, Any]:
        at = self._shown.cursors[k]
        line = {"color": CYCLE[2 + k], "width": 2}
        return {"type": "line", "x0": at, "x1": at, "yref": "paper", "y0": 0, "y1": 1, "line": line}

    def _read(self) -> None:
        self._readings.clear()
        with self._readings:
            show_table(readings_table(self._responses(), self._shown.cursors))

    def _redraw(self) -> None:
        if self._chart is None:
            return
        self._chart.update_figure(self._movable())
        self._chart.props["aria-label"] = self._says()
        self._read()

    def _typed(self, k: int, value: float | None) -> None:
        if value and value > 0.0 and abs(value - self._shown.cursors[k]) > 1e-5 * value:
            self._shown.cursors[k] = float(value)
            self._redraw()

    def _dragged(self, event: events.GenericEventArguments) -> None:
        moved = {k: event.args[name] for k in range(2) if (name := f"shapes[{k}].x0") in event.args}
        for k, at in moved.items():
            if at > 0.0:
                self._shown.cursors[k] = float(at)
                self._fields[k].value = float(f"{at:.5g}")
        if moved:
            self._redraw()

    def _choose(self, *, drive: str = "", probe: str = "", condition: Any = None) -> None:
        before = self._shown.pair or ("", "")
        self._shown.pair = (drive or before[0], probe or before[1])
        if condition:
            self._shown.bode_drives = condition
            self._require_cursors()
        self._redraw()


def _damping_words(one: ModelResult) -> str:
    ratios = one.analysis.modes["removed"].damping_ratio
    return f"{number(100.0 * float(ratios.min()), 2)} % of critical" if ratios.size else "none"
