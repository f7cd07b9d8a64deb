"""How loops over samples are compiled."""

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
    """Remove what was compiled from other sources than those that are there.

    Numba looks at the file of a function, but not at those of the functions that it calls: after an
    update of a checkout a caller that did not change would go on with the code of before. What
    ``NUMBA_CACHE_DIR`` puts elsewhere is not looked at.
    """
    # a place that cannot be written to was written by an installer, as a whole
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
    """Compile a function with Numba, and keep what was compiled beside its file.

    Floating-point arithmetic stays as it is written: results must not depend on the machine.
    """
    return cast("F", numba.njit(cache=True, nogil=True, error_model="numpy")(function))
