"""How far long work has come, for whoever wants to be told."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

__all__ = ["now_and_then", "reporting", "share", "tell"]


class _Span(NamedTuple):
    told: Callable[[str, float], None]
    low: float
    high: float


_span: ContextVar[_Span | None] = ContextVar("progress", default=None)


@contextmanager
def reporting(told: Callable[[str, float], None]) -> Iterator[None]:
    """Tell a function how far the work in this block has come.

    Parameters
    ----------
    told : callable
        Is given what is being done, and the share of the whole that is done, 0 to 1.

    Yields
    ------
    None
    """
    token = _span.set(_Span(told, 0.0, 1.0))
    try:
        yield
    finally:
        _span.reset(token)


@contextmanager
def share(low: float, high: float) -> Iterator[None]:
    """Let the work in this block be a part of what is told.

    Parameters
    ----------
    low, high : float
        Where the part begins and ends in the work around it, 0 to 1.

    Yields
    ------
    None
    """
    span = _span.get()
    if span is None:
        yield
        return
    length = span.high - span.low
    token = _span.set(_Span(span.told, span.low + low * length, span.low + high * length))
    try:
        yield
    finally:
        _span.reset(token)


def tell(what: str, done: float = 0.0) -> None:
    """Say what is being done; without a listener it costs nothing.

    Parameters
    ----------
    what : str
        What is being done, such as ``mesh`` or ``modes``.
    done : float
        How much of the work in the innermost `share` is done, 0 to 1.

    Examples
    --------
    >>> with reporting(lambda what, done: print(what, done)), share(0.5, 1.0):
    ...     tell("modes", 0.5)
    modes 0.75
    """
    span = _span.get()
    if span is not None:
        span.told(what, span.low + min(max(done, 0.0), 1.0) * (span.high - span.low))


def now_and_then(
    write: Callable[[str], None], silent: float, clock: Callable[[], float] = time.monotonic
) -> Callable[[str, float], None]:
    """Return a listener for `reporting` that writes a line where a while has passed since the last.

    Parameters
    ----------
    write : callable
        Is given each line.
    silent : float
        Time from the beginning to the first line, and between two lines, at least [s].
    clock : callable
        Gives the time [s].

    Returns
    -------
    callable
        The listener.

    Examples
    --------
    >>> times = iter([0.0, 3.0, 12.0])
    >>> listener = now_and_then(print, 10.0, lambda: next(times))
    >>> with reporting(listener):
    ...     tell("mesh", 0.1)
    ...     tell("modes", 0.7)
    70 % after 12 s: modes
    """
    began = last = clock()

    def told(what: str, done: float) -> None:
        nonlocal last
        now = clock()
        if now - last >= silent:
            last = now
            write(f"{100.0 * done:.0f} % after {now - began:.0f} s: {what}")

    return told
