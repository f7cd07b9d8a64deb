"""A chart that follows a history on a page, which asks for what it lacks when it can draw it."""

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

#: What a live chart shows.
MODES = ("time", "loop", "spectrum")

#: Where the data of a history are asked for.
PATH = "/live/"

_LONGEST = 1e12  # time that is one [s]
_FEWEST = 64  # samples of a spectrum
_GAP = 10.0  # mean distances of samples that one of them may be


class SharedHistories(WeakValueDictionary[str, LiveHistory]):
    """The histories that pages show now, by their keys, as long as someone holds them."""


def add_live_data(app: "FastAPI", panel: "Panel") -> None:
    """Let pages of a panel have live charts, and ask for what their histories hold."""
    from starlette.responses import Response

    histories = panel.state(SharedHistories)

    async def answer(request: "Request") -> "Response":
        history = histories.get(request.path_params["key"])
        if history is None:
            return Response(status_code=204)
        asked = request.query_params
        try:
            if asked.get("mode") == "spectrum":
                body = await asyncio.to_thread(_packed_or_why, history, asked)
            else:
                body = packed(history, asked)
        except (KeyError, ValueError):
            return Response(status_code=400)
        if isinstance(body, str):
            return Response(body, media_type="text/plain")
        return Response(body, media_type="application/octet-stream")

    app.add_route(PATH + "{key}", answer, methods=["GET"], include_in_schema=False)


def _packed_or_why(history: LiveHistory, asked: "Mapping[str, str]") -> bytes | str:
    """Return what a page asked for, or the sentence why there is none."""
    try:
        return packed(history, asked)
    except FlexstageError as error:
        return str(error)


def packed(history: LiveHistory, asked: "Mapping[str, str]") -> bytes:
    """Return what a page asked for, as it reads it.

    Nine numbers (generation, tier, length of a bin, newest time, begin, end, count of points,
    whether they have a greatest value beside the least, time of the first sample that ever came),
    the newest value of each channel, times of points, all in 8 bytes, then the least and the
    greatest values in 4.

    `asked` has the `mode` (`time`; `loop` for samples alone; `spectrum`, whose points have
    frequencies for times), the `length` [s] and, where it does not follow, the `end`; `generation`,
    `tier` and `after` of what the page has already.

    Raises
    ------
    FlexstageError
        There is no spectrum of what was measured, and why.
    KeyError, ValueError
        It is nothing that a page asks.
    """
    span = history.span
    mode, length = asked["mode"], _number(asked["length"])
    end = _number(asked["end"]) if "end" in asked else span[1] if span else 0.0
    if length <= 0.0 or mode not in MODES:
        raise ValueError(asked)
    generation = history.generation
    known: tuple[int, float] | None = None
    if asked.get("generation") == str(generation):
        known = int(asked["tier"]), _number(asked["after"])
    if mode == "spectrum":
        found = spectrum(history, end - length, end)
    else:
        found = _found(history, end - length, end, mode == "loop", known)
    both = found.high is not found.low
    origin, newest = span or (math.nan, math.nan)
    of_window = (end - length, end, found.times.size, both, origin)
    head = np.array([generation, found.tier, found.step, newest, *of_window], dtype="<f8")
    values = [found.low, found.high] if both else [found.low]
    parts = [
        head,
        history.newest.astype("<f8"),
        found.times.astype("<f8"),
        *(v.astype("<f4") for v in values),
    ]
    return b"".join(part.tobytes() for part in parts)


def _found(
    history: LiveHistory, begin: float, end: float, loop: bool, known: tuple[int, float] | None
) -> HistoryWindow:
    if not loop:
        return history.window(begin, end, POINTS, known=known)
    whole = history.samples(begin, end, POINTS)
    if known is None or known[0] != whole.tier:
        return whole
    return history.samples(begin, end, POINTS, after=known[1])


def spectrum(history: LiveHistory, begin: float, end: float) -> HistoryWindow:
    """Return root spectral densities [unit/√Hz], with frequencies [Hz] for times.

    The samples are taken as evenly spaced: at each multiple of their mean distance stands the one
    that is nearest.

    Validity
    --------
    Times that stray from even ones by an rms of s take (2 pi f s)^2 of the power of a line at f,
    and spread it; the level of white noise stays.

    Raises
    ------
    ModelError
        There are few samples, or none for a while.
    """
    found = history.samples(begin, end)
    if found.times.size < _FEWEST:
        raise ModelError(f"a spectrum needs {_FEWEST} samples, there are {found.times.size}")
    steps = np.diff(found.times)
    mean = float(steps.mean())
    if steps.max() > _GAP * mean:
        raise ModelError(
            f"a spectrum needs evenly spaced samples: for {steps.max():.3g} s of the last "
            f"{end - begin:g} s there was none"
        )
    even = found.times[0] + mean * np.arange(found.times.size)
    nearest = np.searchsorted(0.5 * (found.times[1:] + found.times[:-1]), even)
    made = [spectral_density(values, 1.0 / mean) for values in found.low[nearest].T]
    roots = np.sqrt([one.density[1:] for one in made]).T
    lines = made[0].frequency_hz[1:]
    return HistoryWindow(tier=0, step=0.0, times=lines, low=roots, high=roots)


def _number(text: str) -> float:
    value = float(text)
    if not abs(value) < _LONGEST:
        raise ValueError(text)
    return value


_STATIC = Path(__file__).parent / "static"

#: How long the windows are that one chooses from [s].
WINDOWS = (10.0, 60.0, 600.0, 3600.0)


class ChartViews(dict[tuple[str, ...], dict[str, Any]]):
    """What a browser shows in each live chart: window, loop, hidden channels.

    By what the charts say that they show, and the names of their channels.
    """


class LiveChart(
    Element, component=_STATIC / "live_chart.js", dependencies=[_STATIC / "live_drawing.js"]
):
    """A chart of a history that pages share: over time, one channel over another, or spectra.

    Parameters
    ----------
    page
        The page; its preferences choose the units.
    history
        What is shown.
    says
        What it shows, for those who do not see it; different for each chart of a view.
    loop
        The loop that it begins with: the names of its channels, x and y. Over time where none is
        given; a loop is then that of the first voltage and the first channel that is none.
    """

    def __init__(
        self,
        page: Page,
        history: LiveHistory,
        *,
        says: str = "Live chart",
        loop: tuple[str, str] | None = None,
    ) -> None:
        super().__init__()
        # pages are answered as long as somebody holds it
        self._history = history
        self._views = page.session.state(ChartViews)
        self._key = (says, *(channel.name for channel in history.channels))
        self.classes("live-chart")
        self.props["address"] = PATH + history.key
        page.panel.state(SharedHistories)[history.key] = history
        self.props["channels"] = [_described(page, channel) for channel in history.channels]
        self.props["rate"], self.props["seconds"] = history.rate_hz, history.seconds
        self.props["windows"], self.props["says"] = list(WINDOWS), says
        self.props["begins"] = "loop" if loop else "time"
        self.props["pair"] = _pair(history, loop)
        self.props["view"] = self._views.get(self._key, {})
        self.on("view", self._keep)

    def _keep(self, event: GenericEventArguments) -> None:
        self._views[self._key] = event.args


def _pair(history: LiveHistory, loop: tuple[str, str] | None) -> list[int]:
    """Return the places of the channels of a loop."""
    names = [channel.name for channel in history.channels]
    if loop is None:
        # what is driven, and the first that follows it
        driven = [channel.quantity == VOLTAGE for channel in history.channels]
        mixed = len({*driven}) > 1
        return [driven.index(True), driven.index(False)] if mixed else [0, len(names) - 1]
    for name in loop:
        if name not in names:
            raise ModelError(f"there is no channel '{name}' to show: there are {', '.join(names)}")
    return [names.index(name) for name in loop]


def _described(page: Page, channel: LiveChannel) -> dict[str, Any]:
    """Return a channel as the script of the chart takes it, in the units of the page."""
    shown = page.preferences.shown(channel.quantity)
    return {
        "name": channel.name,
        "quantity": shown.name,
        "label": shown.label,
        "unit": shown.shown_unit,
        "factor": shown.factor,
    }
