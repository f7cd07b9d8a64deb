"""Format of a stream, and its file.

A stream is a head, then frames, each with its own checksum::

    head:  mark (8)  version (4)  length (4)  JSON (length)  checksum (4)
    frame: mark (4)  number (4)  first (8)  rows (4)  checksum (4)  samples

All integers are unsigned, little-endian. Samples are doubles, one channel after the other. The
checksum is CRC-32 of all bytes before it, and of the samples. The checksum of a frame starts from
that of the head, so that a frame of another run is invalid. `number` counts frames, which reveals a
lost one; `first` counts samples. A last frame without samples ends the stream.
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

#: Suffix of the name of a stream.
STREAM_SUFFIX = ".stream"
#: First bytes of a stream; the first one is not a letter, so that programs do not take it for text.
HEAD = b"\x8eFXSTRM\n"
#: First bytes of a frame of samples, and of the last one.
SAMPLES, END = b"\xf5FX\x8e", b"\xf5FX\x9c"
#: Largest size of the description in a head, and of the samples in a frame [bytes].
LARGEST_HEAD, LARGEST_PAYLOAD = 2**22, 2**22

_FRAME = struct.Struct("<4sIQI")
_PREAMBLE = struct.Struct("<8sII")
_CHECKSUM = struct.Struct("<I")
#: Size of the header of a frame [bytes].
FRAME_SIZE = _FRAME.size + _CHECKSUM.size
_VERSION = 2
_HEAD_TEXT = replace(RUN_DESCRIPTION, noun="head of a stream")


class StreamFrame(NamedTuple):
    """Header of a frame."""

    mark: bytes
    """`SAMPLES` or `END`."""
    number: int
    """Number of the frame, from 0."""
    first: int
    """Number of its first sample."""
    rows: int
    """Number of samples of each channel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Irregularity:
    """Missing or duplicate samples of a stream."""

    kind: str
    """``damage`` for samples that were written but cannot be read, ``gap`` for samples that were
    never received, ``overlap`` for samples that were received twice.
    """
    first: int
    """Number of the first one."""
    count: int
    """Number of samples."""

    def __str__(self) -> str:
        last = self.first + self.count - 1
        which = f"sample {self.first}" if self.count == 1 else f"samples {self.first} to {last}"
        descriptions = {
            "damage": "lost by damage of the file",
            "gap": "not received from the instrument",
            "overlap": "received twice: the first ones are used",
        }
        return f"{which} {descriptions[self.kind]}"


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamHead:
    """Head of a stream."""

    channels: tuple[tuple[str, str], ...]
    """Name and SI unit of each channel."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""
    run: RunMetadata
    """Metadata of the run."""

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
                f"'{path}' is not a stream of a run: give a file whose name ends in "
                f"{STREAM_SUFFIX}, or read the HDF5 file of the same name"
            )
        complete = len(preamble) == _PREAMBLE.size
        version, length = _PREAMBLE.unpack(preamble)[1:] if complete else (0, 0)
        text = file.read(min(length, LARGEST_HEAD))
        if file.read(_CHECKSUM.size) != _CHECKSUM.pack(zlib.crc32(text, zlib.crc32(preamble))):
            raise RecordError(
                f"the head of the stream '{path}' is damaged, so its samples cannot be read"
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
    """Return names and units of channels; refuse invalid ones.

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
                f"the name of a channel must be one line without surrounding spaces, got {name!r}"
            )
        if not name.isprintable() or name.lower() == "time":
            raise RecordError(
                f"a channel cannot be called {name!r}: 'time' is reserved, and names must be "
                "printable"
            )
        _require_si(name, unit)
    again = sorted({n for n in names if names.count(n) > 1})
    if again:
        raise RecordError(f"two channels have the name '{again[0]}': use different names")
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
            f"by {factor:g} and give '{si}'"
        )


def head_bytes(head: StreamHead) -> bytes:
    """Return the bytes of a head."""
    text = json.dumps(head.plain(), allow_nan=False).encode("ascii")
    if len(text) > LARGEST_HEAD:
        raise RecordError(
            f"the metadata of a run may have at most {LARGEST_HEAD} characters, got {len(text)}: "
            "shorten its note or the settings"
        )
    covered = _PREAMBLE.pack(HEAD, _VERSION, len(text)) + text
    return covered + _CHECKSUM.pack(zlib.crc32(covered))


def frame_bytes(mark: bytes, number: int, first: int, columns: Sequence[Array], seed: int) -> bytes:
    """Return the bytes of a frame of contiguous columns; `seed` is the checksum of the head."""
    header = _FRAME.pack(mark, number, first, columns[0].size if columns else 0)
    checksum = zlib.crc32(header, seed)
    for column in columns:
        checksum = zlib.crc32(column.data, checksum)
    return b"".join([header, _CHECKSUM.pack(checksum), *(column.data for column in columns)])


def checksum_before(file: BinaryIO, position: int) -> int:
    """Return the checksum of the head of a stream, whose frames start at a position."""
    file.seek(position - _CHECKSUM.size)
    checksum: int
    (checksum,) = _CHECKSUM.unpack(file.read(_CHECKSUM.size))
    return checksum


def read_frame(
    file: BinaryIO, position: int, size: int, row_size: int, seed: int
) -> StreamFrame | None:
    """Return the frame at a position of a file of a given size; None without a complete frame.

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
    """Length of a stream."""

    size: int
    """Its size [bytes]."""
    frames: int = 0
    """Number of frames."""
    samples: int = 0
    """Number of samples of each channel."""


class StreamFile:
    """A new file with the head of a stream, to which frames are added.

    `opener` opens a file for writing bytes, without a buffer. Later failures are an `OSError`.
    """

    def __init__(
        self, path: Path, head: StreamHead, opener: Callable[[Path], Any] | None = None
    ) -> None:
        first = head_bytes(head)
        self._file = _opened(path, opener or _new_file, first)
        (self._seed,) = _CHECKSUM.unpack(first[-_CHECKSUM.size :])
        self.at = self.safe = StreamPosition(size=len(first))

    def append(self, mark: bytes, first: int, columns: list[Array]) -> None:
        """Write a frame; if this fails, `cut` removes its incomplete bytes."""
        at = self.at
        data = frame_bytes(mark, at.frames, first, columns, self._seed)
        _write_all(self._file, data)
        rows = columns[0].size if columns else 0
        self.at = StreamPosition(at.size + len(data), at.frames + 1, at.samples + rows)

    def sync(self) -> None:
        """Force the written bytes to the disk."""
        os.fsync(self._file.fileno())
        self.trust()

    def trust(self) -> None:
        """Consider all written bytes as safe."""
        self.safe = self.at

    def cut(self) -> None:
        """Remove the bytes of an incomplete frame."""
        # a reader skips an incomplete frame, so nothing is lost if this fails too
        with contextlib.suppress(OSError):
            self._file.truncate(self.at.size)
            self._file.seek(self.at.size)

    def back(self) -> None:
        """Remove all bytes that may not be safe, to write them again."""
        self.at = self.safe
        self._file.truncate(self.at.size)
        self._file.seek(self.at.size)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _mark_in_use(file: BinaryIO) -> None:
    """Mark an open file as being written, until it is closed or the program ends.

    Windows needs no mark, since it does not permit removal of an open file; some network file
    systems do not support marks.
    """
    if sys.platform != "win32":
        import fcntl

        with contextlib.suppress(OSError):
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)


def in_use(path: Path) -> bool:
    """Return whether a stream is being written, as far as the system reports it."""
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
        raise RecordError(f"'{path.with_suffix('.h5')}' exists: runs are never overwritten")
    try:
        file = cast(BinaryIO, opener(path))
    except FileExistsError as error:
        raise RecordError(f"'{path}' exists: runs are never overwritten") from error
    except OSError as error:
        raise RecordError(
            f"the stream '{path}' cannot be created: {error.strerror or error}"
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
            f"the stream '{path}' cannot be started: {error.strerror or error}; nothing was "
            "recorded"
        ) from error
    return file


def _new_file(path: Path) -> BinaryIO:
    return cast(BinaryIO, path.open("xb", buffering=0))


def _write_all(file: BinaryIO, data: bytes) -> None:
    """Write all bytes: one call may write only a part of them."""
    view = memoryview(data)
    while view:
        view = view[file.write(view) :]
