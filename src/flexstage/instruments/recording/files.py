"""Files that survive: streams, and a mark that a stream is being written."""

import contextlib
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, BinaryIO, cast

from flexstage.arrays import Array
from flexstage.errors import RecordError
from flexstage.files.write import sync_folder
from flexstage.instruments.recording.frames import StreamHead, frame_bytes, head_bytes


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


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamPosition:
    """How far a stream is written."""

    size: int
    """Its size [bytes]."""
    number: int = 0
    """Number of the next frame."""
    checksum: int = 0
    """Checksum of the last frame."""
    samples: int = 0
    """Samples of each channel."""


class StreamFile:
    """A new file with the head of a stream, to which frames are added.

    `opener` opens a file for writing bytes, without a buffer. What fails later is an `OSError`.
    """

    def __init__(
        self, path: Path, head: StreamHead, opener: Callable[[Path], Any] | None = None
    ) -> None:
        first, self._salt = head_bytes(head)
        self._file = _opened(path, opener or _new_file, first)
        self.at = self.safe = StreamPosition(size=len(first))

    def append(self, mark: bytes, first: int, columns: list[Array]) -> None:
        """Write a frame of a kind; where that fails, `cut` removes what there is of it."""
        at = self.at
        data, checksum = frame_bytes(mark, at.number, first, columns, at.checksum, self._salt)
        _write_all(self._file, data)
        self.at = StreamPosition(
            size=at.size + len(data),
            number=at.number + 1,
            checksum=checksum,
            samples=at.samples + (columns[0].size if columns else 0),
        )

    def sync(self) -> None:
        """Force what was written to the disk."""
        os.fsync(self._file.fileno())
        self.trust()

    def trust(self) -> None:
        """Take all that was written for safe."""
        self.safe = self.at

    def cut(self) -> None:
        """Remove what there is of a frame that could not be written whole."""
        # a reader passes over half a frame, so nothing is lost where this fails too
        with contextlib.suppress(OSError):
            self._file.truncate(self.at.size)
            self._file.seek(self.at.size)

    def back(self) -> None:
        """Remove what is not known to be safe, to write it again."""
        self.at = self.safe
        self._file.truncate(self.at.size)
        self._file.seek(self.at.size)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _opened(path: Path, opener: Callable[[Path], Any], first: bytes) -> BinaryIO:
    if path.with_suffix(".h5").exists():
        raise RecordError(f"'{path.with_suffix('.h5')}' exists: no run is written over")
    try:
        file = cast(BinaryIO, opener(path))
    except FileExistsError as error:
        raise RecordError(f"'{path}' exists: no run is written over") from error
    except OSError as error:
        raise RecordError(
            f"the stream '{path}' cannot be made: {error.strerror or error}"
        ) from error
    try:
        locked(file)
        _write_all(file, first)
        os.fsync(file.fileno())
        sync_folder(path.parent)
    except OSError as error:
        file.close()
        path.unlink(missing_ok=True)
        raise RecordError(
            f"the stream '{path}' cannot be begun: {error.strerror or error}; nothing was recorded"
        ) from error
    return file


def _new_file(path: Path) -> BinaryIO:
    return cast(BinaryIO, path.open("xb", buffering=0))


def _write_all(file: BinaryIO, data: bytes) -> None:
    """Write all bytes: one call may take only some of them."""
    view = memoryview(data)
    while view:
        view = view[file.write(view) :]
