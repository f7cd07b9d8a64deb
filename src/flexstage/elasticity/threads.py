"""As many threads as there are cores that nothing else uses."""

import math
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import ngsolve as ng

_WATCHED = 0.1  # shortest time over which the use of the cores is counted [s]
_KEPT = 1.0  # what was counted is asked for again after this time [s]
_OLD = 5.0  # what the cores did over a longer time than this does not tell what they do now [s]
_ROOM = 0.3  # part of a core that others may use while it still counts as free
_TICK = 1.0 / float(os.sysconf("SC_CLK_TCK")) if hasattr(os, "sysconf") else 0.01


def _now() -> tuple[float, float, float]:
    """Return the time, what this process and its children used of it, and what nobody used [s]."""
    return time.monotonic(), sum(os.times()[:4]), _idle()


def _cores() -> set[int]:
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def _idle() -> float:
    """Return for how long the cores of this process did nothing since the start [s]; else nan."""
    mine = {f"cpu{k}" for k in _cores()}
    rows = [line.split() for line in _read("/proc/stat").splitlines()]
    found = [float(row[4]) + float(row[5]) for row in rows if row and row[0] in mine]
    return _TICK * sum(found) if found else math.nan


def _quota() -> float:
    """Return how many cores the control group of this process may use."""
    words = _read("/sys/fs/cgroup/cpu.max").split()
    return int(words[0]) / int(words[1]) if len(words) == 2 and words[0] != "max" else math.inf


def _read(path: str) -> str:
    try:
        return Path(path).read_text("ascii")
    except (OSError, UnicodeError):
        return ""


class _Watch:
    """What was counted last, and whether threads are at work."""

    def __init__(self) -> None:
        self.before = _now()
        self.free = 0
        self.active = False


_watch = _Watch()


def free_cores() -> int:
    """Return how many cores are idle, or used by this process itself: at least one.

    All that the process may run on count where the system does not tell their use.

    Notes
    -----
    Validity: Linux. What others use is counted over the time since the last question, at least
    0.1 s; who begins to compute later is not seen before the next one.
    """
    passed = time.monotonic() - _watch.before[0]
    if _watch.free and passed < _KEPT:
        return _watch.free
    if not _WATCHED < passed < _OLD:
        _watch.before = _now()
        time.sleep(_WATCHED)
    now = _now()
    wall, own, idle = (b - a for a, b in zip(_watch.before, now, strict=True))
    most = min(float(len(_cores())), _quota())
    found = most if math.isnan(idle) else min(most, (own + idle) / wall)
    _watch.before, _watch.free = now, max(1, int(found + _ROOM))
    return _watch.free


@contextmanager
def parallel(most: int | None = None) -> Iterator[None]:
    """Let the finite elements in this block use the cores that are free.

    Threads of the finite elements wait by turning in circles. Where other programs want the cores
    too, such a wait lasts until a thread that was put aside has its turn again, and there are
    thousands of them: with eight others on two cores two threads took many times as long as one.

    Parameters
    ----------
    most : int, optional
        How many threads at most; where not given, what ``NGS_NUM_THREADS`` says in the environment.

    Yields
    ------
    None
    """
    if _watch.active:  # the threads are those of the block around this one
        yield
        return
    given = os.environ.get("NGS_NUM_THREADS", "")
    limit = most if most is not None else int(given) if given.isdigit() else None
    _watch.active = True
    try:
        ng.SetNumThreads(limit if limit == 1 else min(free_cores(), limit or len(_cores())))
        with ng.TaskManager():
            yield
    finally:
        _watch.active = False
