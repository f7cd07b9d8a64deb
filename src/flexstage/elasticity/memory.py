"""Whether the memory of this computer is enough for a mesh, asked before any of it is taken."""

import math
import os
from collections.abc import Sequence
from pathlib import Path

from flexstage.errors import ModelError

# Peak resident memory of `Continuum.factorise` and `Continuum.modes`, less that of the mesh,
# measured with sparse Cholesky:
#   triangles, orders 2 to 4, 34 000 to 535 000 unknowns: 1750 to 2010 bytes an unknown;
#   cubes of tetrahedra, orders 2 to 4, 5 000 to 97 000: 282 to 344 bytes n^(4/3), nearly alike for
#   all orders (nested dissection of a block, George 1973);
#   bars of 6 : 2 : 1, orders 3 and 4: 188 and 216 bytes n^(4/3), for which `_shape` says 205;
#   plates of one layer of prisms, order 3: 6570, order 4: 8470 and 9400 bytes an unknown.
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
    """Estimate the memory that factorisation and modes take.

    It is in bytes, for `unknowns` degrees of freedom. `box` are the sides of the box about a part
    in three dimensions, in any unit: slender parts need less than a cube, which is taken where it
    is None. `layered` is a plate of one layer of prisms.

    Notes
    -----
    Validity: within 25 % of what was measured for triangles, blocks, bars and plates of one layer;
    parts whose unknowns crowd in a few necks need down to half of it.

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
    """Return what a box needs over what a cube of as many unknowns needs.

    The widest separators, with an area of the two shorter sides, take the square of their unknowns
    each, and the longest side holds as many of them as it is longer than they are wide.
    """
    if box is None:
        return 1.0
    c, b, a = sorted(float(side) for side in box)
    section = b * c
    return (section / (a * section) ** (2.0 / 3.0)) ** 2 * a / math.sqrt(section)


def memory_available() -> float:
    """Return the memory that this process may still take [byte]; infinity where nothing tells.

    It is the least of what the computer has free and what the limits of its control group leave.
    """
    found = [_free_memory(), *_group_limits()]
    return min(found)


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
    """Return what each limit of the control groups that can be seen from inside leaves."""
    left = []
    for limit, used in (
        ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
        (
            "/sys/fs/cgroup/memory/memory.limit_in_bytes",
            "/sys/fs/cgroup/memory/memory.usage_in_bytes",
        ),
    ):
        most, taken = _read(limit).strip(), _read(used).strip()
        if most.isdigit() and taken.isdigit():
            left.append(float(most) - float(taken))
    return left


def _read(path: str) -> str:
    try:
        return Path(path).read_text("ascii")
    except (OSError, UnicodeError):
        return ""


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
