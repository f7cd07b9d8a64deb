"""Finding what is whole in a stream that may be cut, damaged, or still be written."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import RecordError
from flexstage.instruments.recording.frames import (
    END,
    FRAME,
    HEAD,
    LARGEST_HEAD,
    LARGEST_PAYLOAD,
    MARKS,
    FrameHead,
    StreamHead,
    columns_of,
)

_BLOCK = 2**22


@dataclass(frozen=True, slots=True, kw_only=True)
class Chunk:
    """A frame of samples that is whole."""

    position: int
    """Where its samples are in the file [bytes]."""
    number: int
    """Number of the frame in the stream."""
    first: int
    """Number of its first sample."""
    rows: int
    """Samples of each channel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scan:
    """What a stream holds."""

    head: StreamHead
    """How it begins."""
    chunks: tuple[Chunk, ...]
    """Its whole frames of samples, in the order in which they were written."""
    damaged: tuple[tuple[int, int], ...]
    """Where bytes belong to no whole frame: position and size [bytes]."""
    expected: int | None
    """The number of the last frame, which says that the stream was ended; None where there is no
    such frame.
    """
    end: int
    """The sample after the last one, as the last frame says it."""
    ordered: bool
    """Whether the frames stood in the file in the order in which they were written, each once."""
    joined: bool
    """Whether each frame stands behind the one that it was written behind."""
    size: int
    """Size of the file [bytes]."""


def scan(path: Path) -> Scan:
    """Find the head and the whole frames of a stream.

    Every frame is checked by its checksum; where one fails, the next is looked for byte by byte.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        head, salt, begin = _head(file, path)
        damaged: list[tuple[int, int]] = []
        found: list[tuple[FrameHead, int]] = []
        position = begin
        while position < size:
            frame = _frame_at(file, position, size, head, salt)
            if frame is None:
                after = _next_frame(file, position + 1, size, head, salt)
                damaged.append((position, after - position))
                position = after
                continue
            found.append((frame, position + FRAME.size))
            position += FRAME.size + frame.rows * head.row_size
    return _summary(head, found, tuple(damaged), size)


def _head(file: BinaryIO, path: Path) -> tuple[StreamHead, int, int]:
    """Return the head, its checksum, and where the frames begin."""
    file.seek(0)
    data = file.read(2 * LARGEST_HEAD + 64)
    at = 0
    while at >= 0:
        read = StreamHead.read(data[at:], path)
        if read is not None:
            head, salt, size = read
            # the copy of the head, where it is whole too
            both = StreamHead.read(data[at + size :], path) is not None
            return head, salt, at + (2 * size if both else size)
        at = data.find(HEAD, at + 1)
    if not data.startswith(HEAD[:1]) and HEAD[1:] not in data:
        raise RecordError(
            f"'{path}' is no stream of a run: give a file whose name ends in .stream, or read the "
            "HDF5 file beside it"
        )
    raise RecordError(
        f"the head of the stream '{path}' is damaged in both of its copies, so its numbers cannot "
        "be read"
    )


def _frame_at(
    file: BinaryIO, position: int, size: int, head: StreamHead, salt: int
) -> FrameHead | None:
    file.seek(position)
    frame = FrameHead.read(file.read(FRAME.size))
    if frame is None:
        return None
    length = frame.rows * head.row_size
    if length > LARGEST_PAYLOAD + head.row_size or position + FRAME.size + length > size:
        return None
    return frame if frame.proves(file.read(length), salt) else None


def _next_frame(file: BinaryIO, start: int, size: int, head: StreamHead, salt: int) -> int:
    """Return where the next whole frame begins, or the end of the file."""
    overlap = len(MARKS[0]) - 1
    while start < size:
        file.seek(start)
        block = file.read(_BLOCK + overlap)
        at = _first_mark(block, 0)
        while at >= 0:
            if _frame_at(file, start + at, size, head, salt) is not None:
                return start + at
            at = _first_mark(block, at + 1)
        start += _BLOCK
    return size


def _first_mark(block: bytes, start: int) -> int:
    places = [at for mark in MARKS if (at := block.find(mark, start)) >= 0]
    return min(places, default=-1)


def _summary(
    head: StreamHead,
    found: list[tuple[FrameHead, int]],
    damaged: tuple[tuple[int, int], ...],
    size: int,
) -> Scan:
    chunks: dict[int, Chunk] = {}
    expected, end, before = None, 0, 0
    ordered = joined = True
    last = -1
    for frame, position in found:
        ordered = ordered and frame.number > last
        joined = joined and frame.previous == before
        last = frame.number
        if frame.mark == END:
            expected, end = frame.number, frame.first
        elif frame.number not in chunks:
            chunks[frame.number] = Chunk(
                position=position,
                number=frame.number,
                first=frame.first,
                rows=frame.rows,
            )
        before = frame.checksum
    return Scan(
        head=head,
        chunks=tuple(chunks[number] for number in sorted(chunks)),
        damaged=damaged,
        expected=expected,
        end=end,
        ordered=ordered,
        joined=joined,
        size=size,
    )


def chunks(path: Path, found: Scan, *, most: int = _BLOCK) -> Iterator[tuple[int, Array]]:
    """Give the samples of a stream, each once: number of the first, shape (channels, n).

    Where samples were given twice, the ones that were written first count. Chunks that follow one
    another are given together, up to about `most` bytes, as files take few large pieces sooner than
    many small ones.
    """
    gathered: list[Array] = []
    start = following = 0
    for first, part in _single_chunks(path, found):
        size = sum(p.nbytes for p in gathered)
        if gathered and (first != following or size + part.nbytes > most):
            yield start, np.concatenate(gathered, axis=1)
            gathered = []
        if not gathered:
            start = first
        gathered.append(part)
        following = first + part.shape[1]
    if gathered:
        yield start, np.concatenate(gathered, axis=1)


def _single_chunks(path: Path, found: Scan) -> Iterator[tuple[int, Array]]:
    width = len(found.head.channels)
    following = 0
    with path.open("rb") as file:
        for chunk in found.chunks:
            again = max(following - chunk.first, 0)
            if again >= chunk.rows:
                continue
            file.seek(chunk.position)
            data = file.read(chunk.rows * found.head.row_size)
            if len(data) != chunk.rows * found.head.row_size:
                raise RecordError(f"'{path}' became shorter while it was read")
            yield chunk.first + again, columns_of(data, width)[:, again:]
            following = chunk.first + chunk.rows
