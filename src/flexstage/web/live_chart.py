"""A live chart of a history: its script requests new data when it can draw them."""

import asyncio
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

import numpy as np
from fastapi import FastAPI
from nicegui.element import Element
from nicegui.events import GenericEventArguments

from flexstage.base.errors import FlexstageError, ModelError
from flexstage.measure.spectra.averaging import spectral_density
from flexstage.web.live_history import POINTS, VOLTAGE, HistoryWindow, LiveChannel, LiveHistory
from flexstage.web.page import Page, Panel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from starlette.requests import Request
    from starlette.responses import Response

#: Kinds of live charts, and those that show samples only.
MODES = ("time", "loop", "polar", "spectrum")
_OF_SAMPLES = ("loop", "polar")

#: Address of the data of histories.
PATH = "/live/"

_MAX_TIME = 1e12  # largest valid time [s]
_FEWEST = 64  # smallest number of samples of a spectrum
_GAP = 10.0  # largest sample interval of a spectrum, relative to the mean


class SharedHistories(WeakValueDictionary[str, LiveHistory]):
    """The histories of open pages, by their keys."""


def add_live_data(app: "FastAPI", panel: "Panel") -> None:
    """Add a route for the data of live charts to the panel."""
    from starlette.responses import Response

    histories = panel.state(SharedHistories)

    async def answer(request: "Request") -> "Response":
        history = histories.get(request.path_params["key"])
        if history is None:
            return Response(status_code=204)
        query = request.query_params
        try:
            if query.get("mode") == "spectrum":
                body = await asyncio.to_thread(_window_or_message, history, query)
            else:
                body = encode_window(history, query)
        except (KeyError, ValueError):
            return Response(status_code=400)
        if isinstance(body, str):
            return Response(body, media_type="text/plain")
        return Response(body, media_type="application/octet-stream")

    app.add_route(PATH + "{key}", answer, methods=["GET"], include_in_schema=False)


def _window_or_message(history: LiveHistory, query: "Mapping[str, str]") -> bytes | str:
    """Return the requested data, or the message why there are none."""
    try:
        return encode_window(history, query)
    except FlexstageError as error:
        return str(error)


def encode_window(history: LiveHistory, query: "Mapping[str, str]") -> bytes:
    """Return the requested data in the binary format of the script.

    Nine numbers (generation, tier, length of a bin, newest time, begin, end, number of points,
    1 if points have maxima as well as minima, time of the first sample), the newest value of each
    channel and the times of the points, all in 8 bytes; then the minima and maxima in 4 bytes.

    `query` has the `mode` (`time`; `loop` and `polar` for samples only; `spectrum` with frequencies
    in place of times), the `length` [s] and, unless it follows the newest sample, the `end`; and
    `generation`, `tier` and `after` of the points that the page has already.

    Raises
    ------
    FlexstageError
        The samples have no spectrum.
    KeyError, ValueError
        The query is invalid.
    """
    span = history.span
    mode, length = query["mode"], _number(query["length"])
    end = _number(query["end"]) if "end" in query else span[1] if span else 0.0
    if length <= 0.0 or mode not in MODES:
        raise ValueError(query)
    generation = history.generation
    known: tuple[int, float] | None = None
    if query.get("generation") == str(generation):
        known = int(query["tier"]), _number(query["after"])
    if mode == "spectrum":
        window = spectrum(history, end - length, end)
    else:
        window = _window(history, end - length, end, mode in _OF_SAMPLES, known)
    has_maxima = window.high is not window.low
    origin, newest = span or (math.nan, math.nan)
    window_numbers = (end - length, end, window.times.size, has_maxima, origin)
    head = np.array([generation, window.tier, window.step, newest, *window_numbers], dtype="<f8")
    values = [window.low, window.high] if has_maxima else [window.low]
    parts = [
        head,
        history.newest.astype("<f8"),
        window.times.astype("<f8"),
        *(v.astype("<f4") for v in values),
    ]
    return b"".join(part.tobytes() for part in parts)


def _window(
    history: LiveHistory, begin: float, end: float, samples: bool, known: tuple[int, float] | None
) -> HistoryWindow:
    if not samples:
        return history.window(begin, end, POINTS, known=known)
    window = history.samples(begin, end, POINTS)
    if known is None or known[0] != window.tier:
        return window
    return history.samples(begin, end, POINTS, after=known[1])


def spectrum(history: LiveHistory, begin: float, end: float) -> HistoryWindow:
    """Return root spectral densities [unit/√Hz], with frequencies [Hz] in place of times.

    The samples are resampled uniformly: each multiple of their mean interval gets the nearest one.

    Validity
    --------
    A timing jitter of rms s removes (2 pi f s)^2 of the power of a line at f and spreads it; the
    level of white noise does not change.

    Raises
    ------
    ModelError
        There are too few samples, or there is a gap.
    """
    window = history.samples(begin, end)
    if window.times.size < _FEWEST:
        raise ModelError(f"a spectrum needs {_FEWEST} samples, got {window.times.size}")
    steps = np.diff(window.times)
    mean_step = float(steps.mean())
    if steps.max() > _GAP * mean_step:
        raise ModelError(
            f"a spectrum needs uniform samples: the last {end - begin:g} s have a gap of "
            f"{steps.max():.3g} s"
        )
    uniform_times = window.times[0] + mean_step * np.arange(window.times.size)
    nearest = np.searchsorted(0.5 * (window.times[1:] + window.times[:-1]), uniform_times)
    spectra = [spectral_density(values, 1.0 / mean_step) for values in window.low[nearest].T]
    roots = np.sqrt([each.density[1:] for each in spectra]).T
    lines = spectra[0].frequency_hz[1:]
    return HistoryWindow(tier=0, step=0.0, times=lines, low=roots, high=roots)


def _number(text: str) -> float:
    value = float(text)
    if not abs(value) < _MAX_TIME:
        raise ValueError(text)
    return value


_STATIC = Path(__file__).parent / "static"

#: Selectable lengths of the window [s].
WINDOWS = (10.0, 60.0, 600.0, 3600.0)


class ChartViews(dict[tuple[str, ...], dict[str, Any]]):
    """Settings of the live charts of a browser: window, loop, hidden channels.

    The keys are the description of the chart and the names of its channels.
    """


class LiveChart(
    Element, component=_STATIC / "live_chart.js", dependencies=[_STATIC / "live_drawing.js"]
):
    """A chart of a history: over time or an angle, one channel over another, or spectra.

    Parameters
    ----------
    page
        The page; its preferences choose the units.
    history
        The history.
    alt_text
        Description for screen readers, different for each chart of a view.
    loop
        Initial loop, by the names of its channels x and y. By default the chart begins over time;
        its loop is that of the first voltage and the first other channel.
    angle
        Channel of an angle [rad]: the chart begins as a polar plot of the other channels over it.
    """

    def __init__(
        self,
        page: Page,
        history: LiveHistory,
        *,
        alt_text: str = "Live chart",
        loop: tuple[str, str] | None = None,
        angle: str | None = None,
    ) -> None:
        super().__init__()
        # the route serves a history as long as it is referenced
        self._history = history
        self._views = page.session.state(ChartViews)
        self._key = (alt_text, *(channel.name for channel in history.channels))
        self.classes("live-chart")
        self.props["address"] = PATH + history.key
        page.panel.state(SharedHistories)[history.key] = history
        self.props["channels"] = [_channel_data(page, channel) for channel in history.channels]
        self.props["rate"], self.props["seconds"] = history.rate_hz, history.seconds
        self.props["windows"], self.props["caption"] = list(WINDOWS), alt_text
        self.props["begins"] = "polar" if angle else "loop" if loop else "time"
        names = [channel.name for channel in history.channels]
        self.props["angle"] = names.index(angle) if angle else -1
        self.props["pair"] = _pair(history, loop)
        self.props["view"] = self._views.get(self._key, {})
        self.on("view", self._keep)

    def _keep(self, event: GenericEventArguments) -> None:
        self._views[self._key] = event.args


def _pair(history: LiveHistory, loop: tuple[str, str] | None) -> list[int]:
    """Return the indices of the channels of a loop."""
    names = [channel.name for channel in history.channels]
    if loop is None:
        # the first driven channel, and the first other one
        driven = [channel.quantity == VOLTAGE for channel in history.channels]
        is_mixed = len({*driven}) > 1
        return [driven.index(True), driven.index(False)] if is_mixed else [0, len(names) - 1]
    for name in loop:
        if name not in names:
            raise ModelError(f"there is no channel '{name}'; the channels are {', '.join(names)}")
    return [names.index(name) for name in loop]


def _channel_data(page: Page, channel: LiveChannel) -> dict[str, Any]:
    """Return a channel in the format of the script, in the units of the page."""
    quantity = page.preferences.displayed(channel.quantity)
    return {
        "name": channel.name,
        "quantity": quantity.name,
        "label": quantity.label,
        "unit": quantity.shown_unit,
        "factor": quantity.factor,
    }
