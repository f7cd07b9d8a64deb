"""The bytes of a stream, and the file that they are written to.

A stream is a head, then frames, each with its own checksum::

    head:  mark (8)  version (4)  length (4)  JSON (length)  checksum (4)
    frame: mark (4)  number (4)  first (8)  rows (4)  checksum (4)  samples

All integers are unsigned, lowest byte first. Samples are doubles, one channel after the other. The
checksum is CRC-32 of all before it, and of the samples; that of a frame begins with that of the
head, so that no frame of another run fits. `number` counts frames, so that one that is lost shows;
`first` counts samples. A last frame without samples says that the stream was ended.
"""

import contextlib
import json
import math
import os
import struct
import sys
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError, UnitError
from flexstage.files.decoder import read_json
from flexstage.files.write import sync_folder
from flexstage.instruments.recording.metadata import RUN_DESCRIPTION, RunMetadata
from flexstage.records.columns import measured_unit

#: How the name of a stream ends.
STREAM_SUFFIX = ".stream"
#: First bytes of a stream; the first of them is no letter, so that it is taken for no text.
HEAD = b"\x8eFXSTRM\n"
#: First bytes of a frame of samples, and of the last one.
SAMPLES, END = b"\xf5FX\x8e", b"\xf5FX\x9c"
#: Largest size of the description in a head, and of the samples in a frame [bytes].
LARGEST_HEAD, LARGEST_PAYLOAD = 2**22, 2**22

_FRAME = struct.Struct("<4sIQI")
_PREAMBLE = struct.Struct("<8sII")
_CHECKSUM = struct.Struct("<I")
#: Size of what stands before the samples of a frame [bytes].
FRAME_SIZE = _FRAME.size + _CHECKSUM.size
_VERSION = 2
_HEAD_TEXT = replace(RUN_DESCRIPTION, noun="head of a stream")


class StreamFrame(NamedTuple):
    """What stands before the samples of a frame."""

    mark: bytes
    """`SAMPLES` or `END`."""
    number: int
    """Number of the frame, from 0."""
    first: int
    """Number of its first sample."""
    rows: int
    """Samples of each channel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Irregularity:
    """Samples that a stream does not hold, or holds twice."""

    kind: str
    """``damage`` where they were written and cannot be read, ``gap`` where they were never given,
    ``overlap`` where they were given twice.
    """
    first: int
    """Number of the first of them."""
    count: int
    """How many."""

    def __str__(self) -> str:
        last = self.first + self.count - 1
        which = f"sample {self.first}" if self.count == 1 else f"samples {self.first} to {last}"
        descriptions = {
            "damage": "lost to damage of the file",
            "gap": "never given by the instrument",
            "overlap": "given twice: the first ones count",
        }
        return f"{which} {descriptions[self.kind]}"


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamHead:
    """What stands at the beginning of a stream."""

    channels: tuple[tuple[str, str], ...]
    """Name and SI unit of each channel."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""
    run: RunMetadata
    """What is known of the run."""

    def __post_init__(self) -> None:
        checked_channels(self.channels)
        rate = self.sample_rate_hz
        if not (isinstance(rate, (int, float)) and 0.0 < rate < math.inf):
            raise RecordError(f"the sample rate must be positive and finite, got {rate!r} Hz")

    @property
    def row_size(self) -> int:
        """Size of one sample of every channel [bytes]."""
        return 8 * len(self.channels)

    @classmethod
    def read(cls, file: BinaryIO, path: Path) -> "StreamHead":
        """Read the head of a stream; its frames follow. `path` is the file, for messages."""
        preamble = file.read(_PREAMBLE.size)
        if not preamble.startswith(HEAD):
            raise RecordError(
                f"'{path}' is no stream of a run: give a file whose name ends in {STREAM_SUFFIX}, "
                "or read the HDF5 file beside it"
            )
        complete = len(preamble) == _PREAMBLE.size
        version, length = _PREAMBLE.unpack(preamble)[1:] if complete else (0, 0)
        text = file.read(min(length, LARGEST_HEAD))
        if file.read(_CHECKSUM.size) != _CHECKSUM.pack(zlib.crc32(text, zlib.crc32(preamble))):
            raise RecordError(
                f"the head of the stream '{path}' is damaged, so its numbers cannot be read"
            )
        if version != _VERSION:
            later = ", or a later one" if version > _VERSION else ""
            raise RecordError(
                f"the stream '{path}' is of version {version}, and this flexstage reads version "
                f"{_VERSION}: read it with the version that wrote it{later}"
            )
        return read_json(cls, text, f"the head of the stream {path}", _HEAD_TEXT)

    def plain(self) -> dict[str, Any]:
        """Return everything as plain data for JSON."""
        return {
            "channels": [list(c) for c in self.channels],
            "sample_rate_hz": float(self.sample_rate_hz),
            "run": self.run.plain(),
        }


def checked_channels(channels: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    """Return names and units of channels, if a record can have them.

    Examples
    --------
    >>> checked_channels([("x", "m"), ("drive", "V")])
    (('x', 'm'), ('drive', 'V'))
    """
    if not channels:
        raise RecordError("a recording needs at least one channel, got none")
    names = [name for name, _ in channels]
    for name, unit in channels:
        if not isinstance(name, str) or not name.strip() or name != " ".join(name.split()):
            raise RecordError(
                f"the name of a channel must be one line without spaces around it, got {name!r}"
            )
        if not name.isprintable() or name.lower() == "time":
            raise RecordError(
                f"a channel cannot be called {name!r}: 'time' is what its samples are counted by, "
                "and other names must be printable"
            )
        _require_si(name, unit)
    again = sorted({n for n in names if names.count(n) > 1})
    if again:
        raise RecordError(f"two channels have the name '{again[0]}': give each its own")
    return tuple((str(n), str(u)) for n, u in channels)


def _require_si(name: str, unit: str) -> None:
    if unit == "":
        return
    try:
        factor, si = measured_unit(unit)
    except UnitError as error:
        raise RecordError(f"channel '{name}': {error}") from error
    if factor != 1.0 or si != unit:
        raise RecordError(
            f"channel '{name}' must be recorded in an SI unit, got '{unit}': multiply its values "
            f"by {factor:g} and say '{si}'"
        )


def head_bytes(head: StreamHead) -> bytes:
    """Return the bytes of a head."""
    text = json.dumps(head.plain(), allow_nan=False).encode("ascii")
    if len(text) > LARGEST_HEAD:
        raise RecordError(
            f"what is said about a run may have {LARGEST_HEAD} letters at most, got {len(text)}: "
            "shorten its note or the settings"
        )
    covered = _PREAMBLE.pack(HEAD, _VERSION, len(text)) + text
    return covered + _CHECKSUM.pack(zlib.crc32(covered))


def frame_bytes(mark: bytes, number: int, first: int, columns: Sequence[Array], seed: int) -> bytes:
    """Return the bytes of a frame of columns of contiguous doubles, of the head of a checksum."""
    header = _FRAME.pack(mark, number, first, columns[0].size if columns else 0)
    checksum = zlib.crc32(header, seed)
    for column in columns:
        checksum = zlib.crc32(column.data, checksum)
    return b"".join([header, _CHECKSUM.pack(checksum), *(column.data for column in columns)])


def checksum_before(file: BinaryIO, position: int) -> int:
    """Return the checksum of the head of a stream, whose frames begin at a position."""
    file.seek(position - _CHECKSUM.size)
    checksum: int
    (checksum,) = _CHECKSUM.unpack(file.read(_CHECKSUM.size))
    return checksum


def read_frame(
    file: BinaryIO, position: int, size: int, row_size: int, seed: int
) -> StreamFrame | None:
    """Return the frame at a position of a file of some size, None where there is no whole one.

    `seed` is the checksum of the head.
    """
    file.seek(position)
    header = file.read(FRAME_SIZE)
    if len(header) < FRAME_SIZE or not header.startswith((SAMPLES, END)):
        return None
    frame = StreamFrame._make(_FRAME.unpack_from(header))
    length = frame.rows * row_size
    if length > LARGEST_PAYLOAD + row_size or position + FRAME_SIZE + length > size:
        return None
    checksum = zlib.crc32(file.read(length), zlib.crc32(header[: _FRAME.size], seed))
    return frame if header[_FRAME.size :] == _CHECKSUM.pack(checksum) else None


class StreamPosition(NamedTuple):
    """How far a stream is written."""

    size: int
    """Its size [bytes]."""
    frames: int = 0
    """Its frames."""
    samples: int = 0
    """Samples of each channel."""


class StreamFile:
    """A new file with the head of a stream, to which frames are added.

    `opener` opens a file for writing bytes, without a buffer. What fails later is an `OSError`.
    """

    def __init__(
        self, path: Path, head: StreamHead, opener: Callable[[Path], Any] | None = None
    ) -> None:
        first = head_bytes(head)
        self._file = _opened(path, opener or _new_file, first)
        (self._seed,) = _CHECKSUM.unpack(first[-_CHECKSUM.size :])
        self.at = self.safe = StreamPosition(size=len(first))

    def append(self, mark: bytes, first: int, columns: list[Array]) -> None:
        """Write a frame of a kind; where that fails, `cut` removes what there is of it."""
        at = self.at
        data = frame_bytes(mark, at.frames, first, columns, self._seed)
        _write_all(self._file, data)
        rows = columns[0].size if columns else 0
        self.at = StreamPosition(at.size + len(data), at.frames + 1, at.samples + rows)

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


def _mark_in_use(file: BinaryIO) -> None:
    """Mark an open file as being written, until it is closed or the program ends.

    Windows needs no mark, as it lets nobody remove an open file; some network file systems know
    none.
    """
    if sys.platform != "win32":
        import fcntl

        with contextlib.suppress(OSError):
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)


def in_use(path: Path) -> bool:
    """Say whether a stream is being written, as far as the system tells."""
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
        _mark_in_use(file)
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
