"""Reading a stream that a crash, a full disk or a damaged disk has left behind."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import RecordError
from flexstage.instruments.recording.metadata import run_attributes
from flexstage.instruments.recording.stream import (
    END,
    FRAME_SIZE,
    SAMPLES,
    Irregularity,
    StreamFrame,
    StreamHead,
    checksum_before,
    read_frame,
)
from flexstage.records import Channel, Record

_BLOCK = 2**22
_MARK = re.compile(b"|".join(map(re.escape, (SAMPLES, END))))


class Chunk(NamedTuple):
    """Samples of a stream that can be read."""

    position: int
    """Where the samples of their frame are in the file [bytes]."""
    rows: int
    """Samples of each channel in the frame."""
    again: int
    """How many of them came before."""
    first: int
    """Number of the first one after those."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamRecovery:
    """What a stream still holds."""

    head: StreamHead
    """Channels, rate, and what is known of the run."""
    chunks: tuple[Chunk, ...]
    """Where its samples are, each once."""
    ended: bool
    """Whether the stream was ended by its writer: nothing came after."""
    lost: tuple[Irregularity, ...]
    """Ranges that are missing, or came twice."""
    damaged_bytes: int
    """Bytes that belong to no whole chunk: half a chunk at the end, as a crash leaves it, among
    them.
    """
    tail_bytes: int
    """How many of those are at the end."""

    @property
    def samples(self) -> int:
        """Samples of each channel that are safe."""
        return sum(chunk.rows - chunk.again for chunk in self.chunks)

    @property
    def complete(self) -> bool:
        """Whether the stream was ended and every sample that was written can be read."""
        return self.ended and not any(part.kind == "damage" for part in self.lost)

    @property
    def damaged_inside(self) -> bool:
        """Whether bytes before the end belong to no whole chunk: a damaged disk, and no crash."""
        return self.damaged_bytes > self.tail_bytes

    @property
    def notes(self) -> tuple[str, ...]:
        """All of it in words."""
        return tuple(_notes(self))


def _notes(found: StreamRecovery) -> Iterator[str]:
    damaged, tail = found.damaged_bytes, found.tail_bytes
    if not found.ended:
        yield f"the stream was not ended by its writer: {found.samples} samples are safe"
        if tail:
            yield (
                f"at its end are {tail} bytes that are no whole chunk: samples that were being "
                "written, or were damaged, are lost there"
            )
    if damaged > tail or (tail and found.ended):
        inside = damaged if found.ended else damaged - tail
        yield f"{inside} bytes inside the stream belong to no whole chunk"
    yield from (str(part) for part in found.lost)


def examine(path: str | Path) -> StreamRecovery:
    """Say what a stream still holds.

    Every frame is checked by its checksum; where one fails, the next is looked for byte by byte.
    """
    try:
        with Path(path).open("rb") as file:
            return _examined(file, Path(path))
    except OSError as error:
        raise RecordError(f"'{path}' cannot be read: {error.strerror or error}") from error


def _examined(file: BinaryIO, path: Path) -> StreamRecovery:
    size = file.seek(0, 2)
    file.seek(0)
    head = StreamHead.read(file, path)
    position = file.tell()
    seed = checksum_before(file, position)
    chunks: list[Chunk] = []
    lost: list[Irregularity] = []
    ended = False
    frames = following = damaged = tail = 0

    def frame_at(place: int) -> StreamFrame | None:
        frame = read_frame(file, place, size, head.row_size, seed)
        # no writer puts a frame behind a later one
        return frame if frame is not None and frame.number >= frames else None

    while position < size:
        frame = frame_at(position)
        if frame is None:
            after = _next_frame(file, position + 1, size, frame_at)
            damaged, tail = damaged + after - position, tail + after - position
            position = after
            continue
        _, number, first, rows = frame
        if first > following:
            # a last frame counts the samples that were written
            kind = "damage" if number > frames or frame.mark == END else "gap"
            lost.append(Irregularity(kind=kind, first=following, count=first - following))
        if frame.mark == END:
            ended = True
        else:
            again = min(max(following - first, 0), rows)
            if again:
                lost.append(Irregularity(kind="overlap", first=first, count=again))
            if again < rows:
                chunks.append(Chunk(position + FRAME_SIZE, rows, again, first + again))
            following = max(following, first + rows)
        position += FRAME_SIZE + rows * head.row_size
        frames, tail = number + 1, 0
    return StreamRecovery(
        head=head,
        chunks=tuple(chunks),
        ended=ended,
        lost=tuple(lost),
        damaged_bytes=damaged,
        tail_bytes=tail,
    )


def _next_frame(
    file: BinaryIO, start: int, size: int, frame_at: Callable[[int], StreamFrame | None]
) -> int:
    """Return where the next whole frame begins, or the end of the file."""
    while start < size:
        file.seek(start)
        block = file.read(_BLOCK)
        for found in _MARK.finditer(block):
            if frame_at(start + found.start()) is not None:
                return start + found.start()
        # a mark may lie across the end of the block
        start += max(len(block) - len(END) + 1, 1)
    return size


def chunks(path: Path, found: StreamRecovery) -> Iterator[tuple[int, Array]]:
    """Give the samples of a stream, each once: number of the first, shape (channels, n).

    Where samples were given twice, the ones that were written first count. Chunks that follow one
    another are given together, up to about 4 MiB, as files take few large pieces sooner than many
    small ones.
    """
    gathered: list[Array] = []
    start = following = size = 0
    with path.open("rb") as file:
        for chunk in found.chunks:
            file.seek(chunk.position)
            data = file.read(chunk.rows * found.head.row_size)
            if len(data) != chunk.rows * found.head.row_size:
                raise RecordError(f"'{path}' became shorter while it was read")
            if gathered and (chunk.first != following or size + len(data) > _BLOCK):
                yield start, np.concatenate(gathered, axis=1)
                gathered, size = [], 0
            if not gathered:
                start = chunk.first
            part = np.frombuffer(data, dtype="<f8").reshape(len(found.head.channels), -1)
            gathered.append(part[:, chunk.again :])
            size += len(data)
            following = chunk.first + chunk.rows - chunk.again
    if gathered:
        yield start, np.concatenate(gathered, axis=1)


def recover(path: str | Path) -> tuple[Record, StreamRecovery]:
    """Read all that is whole in a stream, and say what is safe, and what was lost.

    The stream is not changed. Where samples are missing the times of the record have a gap.

    Validity
    --------
    A chunk counts only if its checksum (CRC-32) is right: of
    damaged chunks one in 4e9 would pass. A chunk is lost whole.
    """
    file = Path(path)
    recovery = examine(file)
    if recovery.samples < 2:
        raise RecordError(
            f"'{file}' holds {recovery.samples} whole samples, and a record needs two: "
            + "; ".join(recovery.notes)
        )
    values = np.empty((len(recovery.head.channels), recovery.samples))
    numbers = np.empty(recovery.samples)
    at = 0
    try:
        for first, part in chunks(file, recovery):
            count = part.shape[1]
            values[:, at : at + count] = part
            numbers[at : at + count] = np.arange(first, first + count)
            at += count
    except OSError as error:
        raise RecordError(f"'{file}' cannot be read: {error.strerror or error}") from error
    record = Record(
        channels=tuple(
            Channel(name=name, values=v, unit=unit)
            for (name, unit), v in zip(recovery.head.channels, values, strict=True)
        ),
        time=numbers / recovery.head.sample_rate_hz,
        source=str(path),
        notes=recovery.notes,
        attributes=run_attributes(recovery.head.run, recovery.complete, recovery.notes),
    )
    return record, recovery
