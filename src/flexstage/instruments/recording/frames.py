"""The bytes of a stream: a head that is there twice, then frames that prove themselves.

A stream is a head, its copy, and frames::

    head:  mark (8)  version (4)  length (4)  JSON (length)  checksum (4)
    frame: mark (4)  number (4)  first (8)  rows (4)  previous (4)  checksum (4)  samples

All integers are unsigned, lowest byte first. Samples are doubles, one channel after the other. The
checksum is CRC-32 of the frame without it, begun with the checksum of the head, so that a frame of
another stream does not pass. `number` counts frames, and `previous` is the checksum of the frame
before: a frame that was lost, repeated or swapped shows. A last frame without samples says that the
stream was ended.
"""

import json
import math
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import RecordError, UnitError
from flexstage.files.decoder import read_json
from flexstage.instruments.recording.metadata import RUN_DESCRIPTION, RunMetadata
from flexstage.records.columns import measured_unit

#: First bytes of a stream; the first of them is no letter, so that it is taken for no text.
HEAD = b"\x8eFXSTRM\n"
#: First bytes of a frame of samples, and of the last one.
SAMPLES, END = b"\xf5FX\x8e", b"\xf5FX\x9c"
MARKS = (SAMPLES, END)
#: Largest size of the description in a head, and of the samples in a frame [bytes].
LARGEST_HEAD, LARGEST_PAYLOAD = 2**22, 2**22

FRAME = struct.Struct("<4sIQIII")
_BEFORE_CHECKSUM = struct.Struct("<4sIQII")
_PREAMBLE = struct.Struct("<8sII")
_CHECKSUM = struct.Struct("<I")
_VERSION = 1
_HEAD_TEXT = replace(RUN_DESCRIPTION, noun="head of a stream")


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameHead:
    """What stands before the samples of a frame."""

    mark: bytes
    """One of `MARKS`."""
    number: int
    """Number of the frame, from 0."""
    first: int
    """Number of its first sample."""
    rows: int
    """Samples of each channel."""
    previous: int
    """Checksum of the frame before."""
    checksum: int
    """Its own checksum."""

    @classmethod
    def read(cls, data: bytes) -> "FrameHead | None":
        """Return the head of a frame, not yet checked, or None where there cannot be one."""
        if len(data) < FRAME.size or not data.startswith(MARKS):
            return None
        mark, number, first, rows, previous, checksum = FRAME.unpack_from(data)
        return cls(
            mark=mark,
            number=number,
            first=first,
            rows=rows,
            previous=previous,
            checksum=checksum,
        )

    def proves(self, payload: bytes, salt: int) -> bool:
        """Say whether the checksum is that of this head and these samples.

        `salt` is the checksum of the stream's head, which it begins with.
        """
        begun = _BEFORE_CHECKSUM.pack(self.mark, self.number, self.first, self.rows, self.previous)
        return zlib.crc32(payload, zlib.crc32(begun, salt)) == self.checksum


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
    def read(cls, data: bytes, path: Path) -> "tuple[StreamHead, int, int] | None":
        """Return a head, its checksum and its size [bytes], or None where there is no whole one.

        `path` is the file, for messages.
        """
        if len(data) < _PREAMBLE.size or not data.startswith(HEAD):
            return None
        _, version, length = _PREAMBLE.unpack_from(data)
        size = _PREAMBLE.size + length + _CHECKSUM.size
        if length > LARGEST_HEAD or len(data) < size:
            return None
        covered = data[: size - _CHECKSUM.size]
        (checksum,) = _CHECKSUM.unpack_from(data, size - _CHECKSUM.size)
        if zlib.crc32(covered) != checksum:
            return None
        if version != _VERSION:
            raise RecordError(
                f"the stream '{path}' is of version {version}, and this flexstage reads version "
                f"{_VERSION}: read it with the version that wrote it, or a later one"
            )
        text, source = covered[_PREAMBLE.size :], f"the head of the stream {path}"
        return read_json(cls, text, source, _HEAD_TEXT), checksum, size

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


def head_bytes(head: StreamHead) -> tuple[bytes, int]:
    """Return a head with its copy, and the checksum that those of all frames begin with."""
    text = json.dumps(head.plain(), allow_nan=False).encode("ascii")
    if len(text) > LARGEST_HEAD:
        raise RecordError(
            f"what is said about a run may have {LARGEST_HEAD} letters at most, got {len(text)}: "
            "shorten its note or the settings"
        )
    covered = _PREAMBLE.pack(HEAD, _VERSION, len(text)) + text
    checksum = zlib.crc32(covered)
    whole = covered + _CHECKSUM.pack(checksum)
    return whole + whole, checksum


def frame_bytes(
    mark: bytes, number: int, first: int, columns: Sequence[Array], previous: int, salt: int
) -> tuple[bytes, int]:
    """Return a frame of columns of contiguous doubles, and its checksum.

    `previous` is the checksum of the frame before, `salt` that of the stream's head.
    """
    rows = columns[0].size if columns else 0
    begun = _BEFORE_CHECKSUM.pack(mark, number, first, rows, previous)
    checksum = zlib.crc32(begun, salt)
    for column in columns:
        checksum = zlib.crc32(column.data, checksum)
    parts = [begun, _CHECKSUM.pack(checksum), *(column.data for column in columns)]
    return b"".join(parts), checksum


def columns_of(payload: bytes, channels: int) -> Array:
    """Return the samples of a frame, shape (channels, n)."""
    return np.frombuffer(payload, dtype="<f8").reshape(channels, -1)
