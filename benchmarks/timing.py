"""Timing: the least of several warm runs here, or one run with a limit in a process of its own."""

import math
import multiprocessing
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

__all__ = ["Timed", "in_turns", "limited", "warm"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Timed:
    """Seconds that something took; at least so many where it did not end within its limit."""

    seconds: float
    finished: bool = True

    def __str__(self) -> str:
        mark = "" if self.finished else "> "
        if self.seconds < 1.0:
            return f"{mark}{1e3 * self.seconds:.3g} ms"
        return f"{mark}{self.seconds:.3g} s"


def warm(work: Callable[[], Any], *, runs: int = 5) -> Timed:
    """Run once to warm up, then return the least time of some runs."""
    work()
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return Timed(seconds=min(times))


def in_turns(works: Sequence[Callable[[], Any]], *, runs: int = 5) -> list[Timed]:
    """Return the least processor time of each, after a warm-up; all take their turn in every run.

    Time of the processor counts what this process did, so that other programs disturb it little;
    it is that of the clock where a single thread works.
    """
    least = [math.inf] * len(works)
    for turn in range(runs + 1):
        for i, work in enumerate(works):
            start = time.process_time()
            work()
            if turn:
                least[i] = min(least[i], time.process_time() - start)
    return [Timed(seconds=seconds) for seconds in least]


def _child(connection: Any, work: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    start = time.perf_counter()
    work(*arguments)
    connection.send(time.perf_counter() - start)


def limited(work: Callable[..., Any], *arguments: Any, limit: float) -> Timed:
    """Run a function of a module once in a process of its own, and end it at the limit [s]."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_child, args=(theirs, work, arguments))
    process.start()
    theirs.close()
    try:
        # the process also has to start and import, which is not counted
        if ours.poll(limit + 10.0):
            return Timed(seconds=ours.recv())
        return Timed(seconds=limit, finished=False)
    except EOFError as error:
        raise RuntimeError(f"{work.__name__} failed in its process") from error
    finally:
        process.terminate()
        process.join()
