"""How far long work has come, for whoever wants to be told."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

__all__ = ["reporting", "share", "tell"]


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
