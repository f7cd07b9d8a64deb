"""Reading a stream that a crash, a full disk or a damaged disk has left behind."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexstage.errors import RecordError
from flexstage.instruments.recording.attributes import run_attributes
from flexstage.instruments.recording.frames import StreamHead
from flexstage.instruments.recording.scan import Scan, chunks, scan
from flexstage.records import Channel, Record


@dataclass(frozen=True, slots=True, kw_only=True)
class Lost:
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
        said = {
            "damage": "lost to damage of the file",
            "gap": "never given by the instrument",
            "overlap": "given twice: the first ones count",
        }
        return f"{which} {said[self.kind]}"


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamRecovery:
    """What a stream still holds."""

    head: StreamHead
    """Channels, rate, and what is known of the run."""
    samples: int
    """Samples of each channel that are safe."""
    ended: bool
    """Whether the stream was ended by its writer: nothing came after."""
    lost: tuple[Lost, ...]
    """Ranges that are missing, or came twice."""
    damaged_bytes: int
    """Bytes that belong to no whole chunk: half a chunk at the end, as a crash leaves it, among
    them.
    """
    tail_bytes: int
    """How many of those are at the end."""
    notes: tuple[str, ...]
    """All of it in words."""

    @property
    def complete(self) -> bool:
        """Whether the stream was ended and every sample that was written can be read."""
        return self.ended and not any(part.kind == "damage" for part in self.lost)

    @property
    def damaged_inside(self) -> bool:
        """Whether bytes before the end belong to no whole chunk: a damaged disk, and no crash."""
        return self.damaged_bytes > self.tail_bytes


def examine(path: str | Path) -> StreamRecovery:
    """Say what a stream still holds."""
    return recovery_of(_scanned(Path(path)))


def recover(path: str | Path) -> tuple[Record, StreamRecovery]:
    """Read all that is whole in a stream, and say what is safe, and what was lost.

    The stream is not changed. Where samples are missing the times of the record have a gap.

    Validity
    --------
    A chunk counts only if its checksum (CRC-32, begun with that of the stream's head) is right: of
    damaged chunks one in 4e9 would pass. A chunk is lost whole.
    """
    file = Path(path)
    found = _scanned(file)
    recovery = recovery_of(found)
    if recovery.samples < 2:
        raise RecordError(
            f"'{file}' holds {recovery.samples} whole samples, and a record needs two: "
            + "; ".join(recovery.notes)
        )
    values = np.empty((len(found.head.channels), recovery.samples))
    numbers = np.empty(recovery.samples)
    at = 0
    try:
        for first, part in chunks(file, found):
            count = part.shape[1]
            values[:, at : at + count] = part
            numbers[at : at + count] = np.arange(first, first + count)
            at += count
    except OSError as error:
        raise RecordError(f"'{file}' cannot be read: {error.strerror or error}") from error
    record = Record(
        channels=tuple(
            Channel(name=name, values=v, unit=unit)
            for (name, unit), v in zip(found.head.channels, values, strict=True)
        ),
        time=numbers / found.head.sample_rate_hz,
        source=str(path),
        notes=recovery.notes,
        attributes=run_attributes(found.head, recovery.complete, recovery.notes),
    )
    return record, recovery


def _scanned(path: Path) -> Scan:
    try:
        return scan(path)
    except OSError as error:
        raise RecordError(f"'{path}' cannot be read: {error.strerror or error}") from error


def recovery_of(found: Scan) -> StreamRecovery:
    """Say what a stream still holds that was looked through."""
    lost = tuple(_lost(found))
    samples = _safe(found)
    damaged = sum(size for _, size in found.damaged)
    tail = next((s for at, s in found.damaged if at + s == found.size), 0)
    ended = found.expected is not None
    return StreamRecovery(
        head=found.head,
        samples=samples,
        ended=ended,
        lost=lost,
        damaged_bytes=damaged,
        tail_bytes=tail,
        notes=tuple(_notes(found, lost, samples, damaged, tail)),
    )


def _safe(found: Scan) -> int:
    following = total = 0
    for chunk in found.chunks:
        fresh = min(chunk.rows, max(chunk.first + chunk.rows - following, 0))
        total += fresh
        following = max(following, chunk.first + chunk.rows)
    return total


def _lost(found: Scan) -> Iterator[Lost]:
    """Give what is between each chunk and the next, and after the last one."""
    following, number = 0, 0
    for chunk in found.chunks:
        missing = chunk.number > number
        if chunk.first > following:
            kind = "damage" if missing else "gap"
            yield Lost(kind=kind, first=following, count=chunk.first - following)
        elif chunk.first < following:
            again = min(chunk.rows, following - chunk.first)
            yield Lost(kind="overlap", first=chunk.first, count=again)
        following = max(following, chunk.first + chunk.rows)
        number = chunk.number + 1
    if found.expected is not None and found.end > following:
        yield Lost(kind="damage", first=following, count=found.end - following)


def _notes(
    found: Scan, lost: Sequence[Lost], samples: int, damaged: int, tail: int
) -> Iterator[str]:
    if found.expected is None:
        yield f"the stream was not ended by its writer: {samples} samples are safe"
        if tail:
            yield (
                f"at its end are {tail} bytes that are no whole chunk: samples that were being "
                "written, or were damaged, are lost there"
            )
    if damaged > tail or (tail and found.expected is not None):
        inside = damaged if found.expected is not None else damaged - tail
        yield f"{inside} bytes inside the stream belong to no whole chunk"
    if not found.ordered or not found.joined:
        kind = "are not in the order" if not found.ordered else "do not join as"
        yield f"the chunks {kind} in which they were written"
    yield from (str(part) for part in lost)
