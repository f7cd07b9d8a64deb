"""Progress and partial results of long work, for a listener."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple

_LONG = 2.0  # duration from which a phase is reported [s]
_EVERY = 10.0  # time between two lines within a phase [s]
_POLL = 0.5  # time between two readings of the clock [s]


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
    """Call a function with the current phase of the work in this block and its progress, 0 to 1.

    `taker` is called with each partial result.
    """
    token = _span.set(_Span(listener, 0.0, 1.0, taker))
    try:
        yield
    finally:
        _span.reset(token)


@contextmanager
def subtask(low: float, high: float) -> Iterator[None]:
    """Map the progress of this block to the range `low` to `high`, 0 to 1, of the outer work."""
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
    """Report the current phase and the progress of the innermost `subtask`, 0 to 1.

    Without a listener it has no effect.

    Examples
    --------
    >>> with listen(lambda what, done: print(what, done)), subtask(0.5, 1.0):
    ...     update("modes", 0.5)
    modes 0.75
    """
    span = _span.get()
    if span is not None:
        span.listener(what, span.low + min(max(done, 0.0), 1.0) * (span.high - span.low))


def hand_over(partial: Any) -> None:
    """Pass a partial result, such as a finished batch, to the listener.

    A listener may ignore it: the final result contains it as well.

    Examples
    --------
    >>> with listen(lambda what, done: None, taker=print):
    ...     hand_over([1, 4, 9])
    [1, 4, 9]
    """
    span = _span.get()
    if span is not None and span.taker is not None:
        span.taker(partial)


class ProgressLines:
    """Lines on the progress of long work: at the start of a long phase, then every ten seconds.

    Work that is shorter than `silent` [s] has no lines; `began` [s] is by the clock of `line`.

    Examples
    --------
    >>> lines = ProgressLines("identify", 0.0)
    >>> lines.update("mesh", 0.1)
    >>> [lines.line(t) for t in (1.0, 4.0, 6.0)]
    [None, None, 'identify: mesh, 10 %, 6 s so far']
    """

    def __init__(self, name: str, began: float, silent: float = 5.0) -> None:
        self._name, self._began, self._silent = name, began, silent
        self._phase = self._last_phase = ""
        self._done = 0.0
        self._phase_start = self._last_line = began

    def update(self, what: str, done: float) -> None:
        """Record the current phase and the progress, as a listener does."""
        self._phase, self._done = what, done

    def line(self, now: float) -> str | None:
        """Return the line that is due at a time [s], if any; call it about every second."""
        phase, elapsed = self._phase, now - self._began
        if phase != self._last_phase:  # it has begun since the last call
            self._last_phase, self._phase_start = phase, now
        long_phase = self._last_line < self._phase_start <= now - _LONG
        due = long_phase or now - self._last_line >= _EVERY
        if elapsed < self._silent or not due:
            return None
        self._last_line = now
        words = f"{phase}, " if phase else ""
        return f"{self._name}: {words}{100.0 * self._done:.0f} %, {elapsed:.0f} s so far"


@contextmanager
def in_lines(write: Callable[[str], None], name: str, silent: float = 5.0) -> Iterator[None]:
    """Write lines on the progress of the work in this block, also between its reports.

    Another thread calls `write`. Work that is shorter than `silent` [s] writes none.
    """
    lines = ProgressLines(name, time.monotonic(), silent)
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(_POLL):
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
