"""Files that survive: folders forced to disk, and a mark that a stream is being written."""

import contextlib
import os
import sys
from pathlib import Path
from typing import IO, Any

__all__ = ["in_use", "locked", "sync_folder"]


def sync_folder(folder: Path) -> None:
    """Force the names in a folder to the disk, where the system can.

    Parameters
    ----------
    folder : pathlib.Path
        The folder.
    """
    if sys.platform == "win32":
        return
    # some network file systems cannot; the files are there all the same
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def locked(file: IO[Any]) -> bool:
    """Mark an open file as being written, until it is closed or the program ends.

    Parameters
    ----------
    file : file
        An open file.

    Returns
    -------
    bool
        Whether it could be marked. Windows needs no mark, as it lets nobody remove an open file;
        some network file systems know none.
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
    """Say whether another program is writing a file, as far as the system tells.

    Parameters
    ----------
    path : pathlib.Path
        The file.

    Returns
    -------
    bool
        Whether it is marked by `locked`.

    Raises
    ------
    OSError
        The file cannot be read.
    """
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
