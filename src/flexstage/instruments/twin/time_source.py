"""Where the time comes from: the computer, or whoever tests what depends on it."""

import math
import threading
import time
from collections.abc import Callable
from typing import Protocol

from flexstage.errors import ModelError


class Clock(Protocol):
    """Tells the time, and waits."""

    def now(self) -> float:
        """Return the time from some moment on [s]."""
        ...

    def wait(self, seconds: float, ended: threading.Event) -> bool:
        """Wait some time, or until an event is set."""
        ...


class RealClock(Clock):
    """The clock of the computer, which is never set back."""

    def now(self) -> float:
        return time.monotonic()

    def wait(self, seconds: float, ended: threading.Event) -> bool:
        return ended.wait(seconds)


class StepClock(Clock):
    """A clock that stands until it is told to go on.

    `on_wait` is called with the seconds of each wait, before the clock goes on by them.

    Examples
    --------
    >>> clock = StepClock()
    >>> clock.advance(0.25)
    >>> clock.now()
    0.25
    """

    def __init__(self, on_wait: Callable[[float], None] | None = None) -> None:
        self._now = 0.0
        self._on_wait = on_wait

    def now(self) -> float:
        return self._now

    def advance(self, seconds: float) -> None:
        """Go on."""
        self._now += duration(seconds)

    def wait(self, seconds: float, ended: threading.Event) -> bool:
        """Go on at once by the time that is waited for."""
        if self._on_wait is not None:
            self._on_wait(seconds)
        self.advance(seconds)
        return ended.is_set()


def duration(seconds: float) -> float:
    """Return a time [s]; refuse what is none that can pass."""
    if not 0.0 <= seconds < math.inf:
        raise ModelError(f"time passes by 0 s or more, got {seconds!r}")
    return seconds
