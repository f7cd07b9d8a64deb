"""How pages ask for what a history holds: each for what it lacks, when it is ready to draw it."""

import math
from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

import numpy as np

from flexstage.web.live.history import POINTS, HistoryWindow, LiveHistory

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fastapi import FastAPI
    from starlette.requests import Request
    from starlette.responses import Response

    from flexstage.web.page import Panel

#: Where the data of a history are asked for.
PATH = "/live/"


class SharedHistories:
    """The histories that pages show now, by their keys."""

    def __init__(self) -> None:
        self._known: WeakValueDictionary[str, LiveHistory] = WeakValueDictionary()

    def add(self, history: LiveHistory) -> str:
        """Let pages ask for a history as long as someone holds it; return the address."""
        self._known[history.key] = history
        return PATH + history.key

    def get(self, key: str) -> LiveHistory | None:
        """Return a history that is still held."""
        return self._known.get(key)


def add_live_data(app: "FastAPI", panel: "Panel") -> None:
    """Let pages of a panel ask for what its histories hold."""
    from starlette.responses import Response

    histories = panel.state(SharedHistories)

    async def answer(request: "Request") -> "Response":
        history = histories.get(request.path_params["key"])
        if history is None:
            return Response(status_code=204)
        try:
            body = packed(history, request.query_params)
        except (KeyError, ValueError):
            return Response(status_code=400)
        return Response(body, media_type="application/octet-stream")

    app.add_route(PATH + "{key}", answer, methods=["GET"], include_in_schema=False)


def packed(history: LiveHistory, asked: "Mapping[str, str]") -> bytes:
    """Return what a page asked for, as it reads it.

    Nine numbers (generation, tier, length of a bin, newest time, begin, end, count of points,
    whether they have a greatest value beside the least, time of the first sample that ever came),
    times of points, all in 8 bytes, then the least and the greatest values in 4.

    `asked` has `length` [s] and, where it does not follow, `end`; `loop` for samples alone;
    `generation`, `tier` and `after` of what the page has already.

    Raises
    ------
    KeyError, ValueError
        It is nothing that a page asks.
    """
    span = history.span
    length = _number(asked["length"])
    end = _number(asked["end"]) if "end" in asked else span[1] if span else 0.0
    if length <= 0.0:
        raise ValueError(length)
    generation = history.generation
    known: tuple[int, float] | None = None
    if asked.get("generation") == str(generation):
        known = int(asked["tier"]), _number(asked["after"])
    found = _found(history, end - length, end, "loop" in asked, known)
    both = found.high is not found.low
    origin, newest = span or (math.nan, math.nan)
    of_window = (end - length, end, found.times.size, both, origin)
    head = np.array([generation, found.tier, found.step, newest, *of_window], dtype="<f8")
    values = [found.low, found.high] if both else [found.low]
    parts = [head, found.times.astype("<f8"), *(v.astype("<f4") for v in values)]
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


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value
