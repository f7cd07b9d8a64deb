"""Free resources of this computer: idle cores for threads, and available memory."""

import math
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from flexstage.base.errors import ModelError

_WATCHED = 0.1  # shortest time over which the use of the cores is counted [s]
_VALID = 1.0  # counts are renewed after this time [s]
_OLD = 5.0  # what the cores did over a longer time than this does not tell what they do now [s]
_ROOM = 0.3  # part of a core that others may use while it still counts as free
_TICK = 1.0 / float(os.sysconf("SC_CLK_TCK")) if hasattr(os, "sysconf") else 0.01


def _now() -> tuple[float, float, float]:
    """Return wall time, computing time of this process and its children, and idle time [s]."""
    return time.monotonic(), sum(os.times()[:4]), _idle()


def _cores() -> set[int]:
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def _idle() -> float:
    """Return the idle time of the cores of this process since the start [s]; nan if unknown."""
    mine = {f"cpu{k}" for k in _cores()}
    rows = [line.split() for line in _read("/proc/stat").splitlines()]
    idle = [float(row[4]) + float(row[5]) for row in rows if row and row[0] in mine]
    return _TICK * sum(idle) if idle else math.nan


def _quota() -> float:
    """Return the number of cores that the control group of this process may use."""
    words = _read("/sys/fs/cgroup/cpu.max").split()
    return int(words[0]) / int(words[1]) if len(words) == 2 and words[0] != "max" else math.inf


def _read(path: str) -> str:
    try:
        return Path(path).read_text("ascii")
    except (OSError, UnicodeError):
        return ""


def cores() -> int:
    """Return the number of cores that this process may use."""
    return max(1, math.ceil(min(len(_cores()), _quota())))


class _Watch:
    """Last counts, and whether threads are active."""

    def __init__(self) -> None:
        self.before = _now()
        self.free = 0
        self.active = False


_watch = _Watch()


def free_cores() -> int:
    """Return the number of cores that are idle, or used by this process itself: at least one.

    All cores of the process count where the system does not report their use.

    Notes
    -----
    Validity: Linux. The use by others is counted over the time since the last call, at least 0.1 s;
    a program that starts later is not seen before the next call.
    """
    passed = time.monotonic() - _watch.before[0]
    if _watch.free and passed < _VALID:
        return _watch.free
    if not _WATCHED < passed < _OLD:
        _watch.before = _now()
        time.sleep(_WATCHED)
    now = _now()
    wall, used, idle = (b - a for a, b in zip(_watch.before, now, strict=True))
    most = min(float(len(_cores())), _quota())
    cores = most if math.isnan(idle) else min(most, (used + idle) / wall)
    _watch.before, _watch.free = now, max(1, int(cores + _ROOM))
    return _watch.free


@contextmanager
def parallel(most: int | None = None) -> Iterator[None]:
    """Let the finite elements in this block use the cores that are free.

    Threads of the finite elements wait actively. Where other programs use the cores too, such a
    wait lasts until a suspended thread runs again, and there are thousands of them: with eight
    others on two cores two threads took many times as long as one.

    Parameters
    ----------
    most : int, optional
        Largest number of threads; where not given, ``NGS_NUM_THREADS`` of the environment.

    Yields
    ------
    None
    """
    if _watch.active:  # the threads are those of the block around this one
        yield
        return
    import ngsolve as ng

    setting = os.environ.get("NGS_NUM_THREADS", "")
    limit = most if most is not None else int(setting) if setting.isdigit() else None
    _watch.active = True
    try:
        ng.SetNumThreads(limit if limit == 1 else min(free_cores(), limit or len(_cores())))
        with ng.TaskManager():
            yield
    finally:
        _watch.active = False


# Peak resident memory of `Continuum.factorise` and `Continuum.modes`, less that of the mesh,
# measured with sparse Cholesky:
#   triangles, orders 2 to 4, 34 000 to 535 000 unknowns: 1750 to 2010 bytes an unknown;
#   cubes of tetrahedra, orders 2 to 4, 5 000 to 97 000: 282 to 344 bytes n^(4/3), nearly the same
# for all orders (nested dissection of a block, George 1973); bars of 6 : 2 : 1, orders 3 and 4: 188
# and 216 bytes n^(4/3), for which `_shape` says 205; plates of one layer of prisms, order 3: 6570,
# order 4: 8470 and 9400 bytes an unknown.
_PLANE = 2.0e3
_BLOCK = 330.0
_LAYER = 2.35e3
_GIGA = 1e9


def memory_needed(
    unknowns: int,
    dimension: int,
    order: int,
    *,
    box: Sequence[float] | None = None,
    layered: bool = False,
) -> float:
    """Estimate the memory for factorisation and modes.

    It is in bytes, for `unknowns` degrees of freedom. `box` are the sides of the box about a part
    in three dimensions, in any unit: slender parts need less than a cube, which is taken where it
    is None. `layered` is a plate of one layer of prisms.

    Notes
    -----
    Validity: within 25 % of measurements for triangles, blocks, bars and plates of one layer;
    parts with most unknowns in a few necks need down to half of it.

    Examples
    --------
    >>> round(memory_needed(1_000_000, 3, 3) / 1e9, 1)
    33.0
    """
    n = float(unknowns)
    if dimension == 2:
        return _PLANE * n
    if layered:
        return min(_LAYER * order * n, _BLOCK * n ** (4.0 / 3.0))
    return _BLOCK * _shape(box) * n ** (4.0 / 3.0)


def _shape(box: Sequence[float] | None) -> float:
    """Return the memory of a box over that of a cube with as many unknowns.

    The widest separators, with an area of the two shorter sides, take the square of their unknowns
    each, and the longest side holds as many of them as it is longer than they are wide.
    """
    if box is None:
        return 1.0
    c, b, a = sorted(float(side) for side in box)
    section = b * c
    return (section / (a * section) ** (2.0 / 3.0)) ** 2 * a / math.sqrt(section)


def memory_available() -> float:
    """Return the memory that this process may still use [byte]; infinity if unknown.

    It is the lesser of the free memory of the computer and the remainder of the limits of its
    control group.
    """
    limits = [_free_memory(), *_group_limits()]
    return min(limits)


def _free_memory() -> float:
    text = _read("/proc/meminfo")
    for line in text.splitlines():
        if line.startswith("MemAvailable:"):
            return 1024.0 * float(line.split()[1])
    try:
        return float(os.sysconf("SC_AVPHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return math.inf


def _group_limits() -> list[float]:
    """Return the remainder of each limit of the visible control groups."""
    left = []
    for limit, used in (
        ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
        (
            "/sys/fs/cgroup/memory/memory.limit_in_bytes",
            "/sys/fs/cgroup/memory/memory.usage_in_bytes",
        ),
    ):
        most, used_memory = _read(limit).strip(), _read(used).strip()
        if most.isdigit() and used_memory.isdigit():
            left.append(float(most) - float(used_memory))
    return left


def require_memory(
    unknowns: int,
    dimension: int,
    order: int,
    *,
    box: Sequence[float] | None = None,
    layered: bool = False,
) -> None:
    """Refuse a mesh whose factorisation does not fit in memory.

    The arguments are those of `memory_needed`.
    """
    needed = memory_needed(unknowns, dimension, order, box=box, layered=layered)
    free = memory_available()
    if needed > free:
        raise ModelError(
            f"this mesh needs about {needed / _GIGA:.0f} GB for its factorisation, "
            f"{free / _GIGA:.0f} GB are free: it has {unknowns} unknowns of order {order}; take a "
            "lower order or larger elements"
        )
