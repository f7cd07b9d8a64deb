"""How far long work has come and what it found so far, for whoever wants to be told."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple

_LONG = 2.0  # a phase that lasts so long is named [s]
_EVERY = 10.0  # time between lines within a phase [s]
_LOOK = 0.5  # time between looks at the clock [s]


class _Span(NamedTuple):
    listener: Callable[[str, float], None]
    low: float
    high: float
    taker: Callable[[Any], None] | None = None


_span: ContextVar[_Span | None] = ContextVar("progress", default=None)


@contextmanager
def listen(
    listener: Callable[[str, float], None], taker: Callable[[Any], None] | None = None
) -> Iterator[None]:
    """Tell a function what the work in this block does, and which share of it is done, 0 to 1.

    `taker` is called with whatever the work hands over on its way.
    """
    token = _span.set(_Span(listener, 0.0, 1.0, taker))
    try:
        yield
    finally:
        _span.reset(token)


@contextmanager
def subtask(low: float, high: float) -> Iterator[None]:
    """Let the work in this block be the part from `low` to `high`, 0 to 1, of the work around."""
    span = _span.get()
    if span is None:
        yield
        return
    length = span.high - span.low
    token = _span.set(span._replace(low=span.low + low * length, high=span.low + high * length))
    try:
        yield
    finally:
        _span.reset(token)


def update(what: str, done: float = 0.0) -> None:
    """Say what is being done, and how much of the innermost `subtask`, 0 to 1.

    Without a listener it costs nothing.

    Examples
    --------
    >>> with listen(lambda what, done: print(what, done)), subtask(0.5, 1.0):
    ...     update("modes", 0.5)
    modes 0.75
    """
    span = _span.get()
    if span is not None:
        span.listener(what, span.low + min(max(done, 0.0), 1.0) * (span.high - span.low))


def hand_over(found: Any) -> None:
    """Hand over what was found so far, such as a finished batch, before the work has ended.

    Nobody need take it: it stands in the result again.

    Examples
    --------
    >>> with listen(lambda what, done: None, taker=print):
    ...     hand_over([1, 4, 9])
    [1, 4, 9]
    """
    span = _span.get()
    if span is not None and span.taker is not None:
        span.taker(found)


class ProgressLines:
    """What long work says of itself in lines: where a long phase began, and every ten seconds.

    Work that is shorter than `silent` [s] says nothing; `began` [s] is by the clock of `line`.

    Examples
    --------
    >>> lines = ProgressLines("identify", 0.0)
    >>> lines.update("mesh", 0.1)
    >>> [lines.line(t) for t in (1.0, 4.0, 6.0)]
    [None, None, 'identify: mesh, 10 %, 6 s so far']
    """

    def __init__(self, name: str, began: float, silent: float = 5.0) -> None:
        self._name, self._began, self._silent = name, began, silent
        self._now = self._shown = ""
        self._done = 0.0
        self._seen = self._last = began

    def update(self, what: str, done: float) -> None:
        """Take what is being done, and which share of the whole is done, as a listener does."""
        self._now, self._done = what, done

    def line(self, now: float) -> str | None:
        """Return the line that is due at a time [s], if any; to be asked every second or so."""
        what = self._now
        if what != self._shown:  # a phase that the last call did not see has just begun
            self._shown, self._seen = what, now
        due = self._last < self._seen <= now - _LONG or now - self._last >= _EVERY
        if now - self._began < self._silent or not due:
            return None
        self._last = now
        doing = f"{what}, " if what else ""
        return f"{self._name}: {doing}{100.0 * self._done:.0f} %, {now - self._began:.0f} s so far"


@contextmanager
def in_lines(write: Callable[[str], None], name: str, silent: float = 5.0) -> Iterator[None]:
    """Write lines while the work in this block goes on, also where it says nothing for long.

    Another thread calls `write`. Work that is shorter than `silent` [s] says nothing.
    """
    lines = ProgressLines(name, time.monotonic(), silent)
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(_LOOK):
            line = lines.line(time.monotonic())
            if line is not None:
                write(line)

    watching = threading.Thread(target=watch, name="progress", daemon=True)
    watching.start()
    try:
        with listen(lines.update):
            yield
    finally:
        ended.set()
        watching.join()
