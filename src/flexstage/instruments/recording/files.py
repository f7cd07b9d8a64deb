"""A mark on a file that it is being written."""

import sys
from pathlib import Path
from typing import IO, Any


def locked(file: IO[Any]) -> bool:
    """Mark an open file as being written, until it is closed or the program ends; say if it could.

    Windows needs no mark, as it lets nobody remove an open file; some network file systems know
    none.
    """
    if sys.platform == "win32":
        return False
    import fcntl

    try:
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def in_use(path: Path) -> bool:
    """Say whether a file is marked by `locked`, as far as the system tells."""
    if sys.platform == "win32":
        return False
    import fcntl

    with path.open("rb") as file:
        try:
            fcntl.flock(file.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:
            return False
    return False
