"""Compilation of loops over samples."""

import contextlib
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])

#: Rooms with functions that are compiled.
_ROOMS = tuple(
    Path(__file__).parents[1] / name for name in ("hysteresis", "instruments", "virtual")
)


def forget_outdated(rooms: tuple[Path, ...] = _ROOMS) -> None:
    """Remove compiled functions of other sources than the present ones.

    Numba checks the file of a function, but not those of the functions that it calls: after an
    update of a checkout an unchanged caller would use the former code. Files elsewhere by
    ``NUMBA_CACHE_DIR`` are not removed.
    """
    # a folder without write access was written by an installer, completely
    with contextlib.suppress(OSError):
        now = hashlib.sha256()
        for path in sorted(path for room in rooms for path in room.rglob("*.py")):
            facts = path.stat()
            now.update(f"{path} {facts.st_mtime_ns} {facts.st_size}\n".encode())
        stamp = rooms[0] / "__pycache__" / "compiled.stamp"
        if stamp.exists() and stamp.read_text("ascii") == now.hexdigest():
            return
        for room in rooms:
            for index in room.rglob("*.nbi"):
                index.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(now.hexdigest(), "ascii")


forget_outdated()


def compiled(function: F) -> F:
    """Compile a function with Numba, and cache it next to its file.

    Floating-point arithmetic stays as it is written: results must not depend on the machine.
    """
    return cast("F", numba.njit(cache=True, nogil=True, error_model="numpy")(function))
