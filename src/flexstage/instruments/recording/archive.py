"""Files of a run, also after a kill: what is in a stream, and records that are kept and read."""

import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.files.write import draft_of
from flexstage.instruments.recording.metadata import (
    ENDING,
    LOST,
    RUN,
    RunMetadata,
    read_description,
    run_attributes,
)
from flexstage.instruments.recording.stream import (
    END,
    FRAME_SIZE,
    SAMPLES,
    Irregularity,
    StreamFrame,
    StreamHead,
    checksum_before,
    in_use,
    read_frame,
)
from flexstage.records import Channel, Record
from flexstage.records.write import file_keys, file_label

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


def _notes(recovery: StreamRecovery) -> Iterator[str]:
    damaged, tail = recovery.damaged_bytes, recovery.tail_bytes
    if not recovery.ended:
        yield f"the stream was not ended by its writer: {recovery.samples} samples are safe"
        if tail:
            yield (
                f"at its end are {tail} bytes that are no whole chunk: samples that were being "
                "written, or were damaged, are lost there"
            )
    if damaged > tail or (tail and recovery.ended):
        inside = damaged if recovery.ended else damaged - tail
        yield f"{inside} bytes inside the stream belong to no whole chunk"
    yield from (str(part) for part in recovery.lost)


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
        for mark in _MARK.finditer(block):
            if frame_at(start + mark.start()) is not None:
                return start + mark.start()
        # a mark may lie across the end of the block
        start += max(len(block) - len(END) + 1, 1)
    return size


def chunks(path: Path, recovery: StreamRecovery) -> Iterator[tuple[int, Array]]:
    """Give the samples of a stream, each once: number of the first, shape (channels, n).

    Where samples were given twice, the ones that were written first count. Chunks that follow one
    another are given together, up to about 4 MiB, as files take few large pieces sooner than many
    small ones.
    """
    gathered: list[Array] = []
    start = following = size = 0
    with path.open("rb") as file:
        for chunk in recovery.chunks:
            file.seek(chunk.position)
            data = file.read(chunk.rows * recovery.head.row_size)
            if len(data) != chunk.rows * recovery.head.row_size:
                raise RecordError(f"'{path}' became shorter while it was read")
            if gathered and (chunk.first != following or size + len(data) > _BLOCK):
                yield start, np.concatenate(gathered, axis=1)
                gathered, size = [], 0
            if not gathered:
                start = chunk.first
            part = np.frombuffer(data, dtype="<f8").reshape(len(recovery.head.channels), -1)
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


#: What an HDF5 file holds beside its samples [bytes].
_OVERHEAD = 64 * 1024


def archived(stream: Path, target: Path) -> Path:
    """Write what is whole in a stream as a new HDF5 file, and read it back; the stream stays.

    A dataset for each channel, with its ``unit`` and ``name``; the sample rate, or times where
    samples are missing; what is known of the run. The file appears under its name when all of it is
    on disk and was compared with the stream, bit by bit.
    """
    if target.exists():
        raise RecordError(f"'{target}' exists: no run is written over")
    try:
        recovery = examine(stream)
        _require_room(stream, target.parent, recovery)
        with draft_of(target) as draft:
            _write(draft, stream, recovery)
            _verify(draft, stream, recovery)
    except RecordError:
        raise
    except (OSError, RuntimeError) as error:  # h5py tells some failures of a disk as the latter
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0][:160]
        raise RecordError(
            f"'{target}' cannot be written ({reason}): the stream '{stream}' stays"
        ) from error
    return target


def rescued(stream: Path, target: Path | None = None, *, remove: bool = False) -> Path:
    """Write what a crash has left of a stream as an HDF5 file, beside it where none is named.

    Refused while another program writes the stream. It may be removed afterwards; one that a disk
    has damaged stays in any case.
    """
    if in_use(stream):
        raise RecordError(
            f"'{stream}' is being written by another program: wait until it ends, or look at it "
            "with --look"
        )
    record = archived(stream, target or stream.with_suffix(".h5"))
    if remove and not examine(stream).damaged_inside:
        stream.unlink()
    return record


def _is_whole(recovery: StreamRecovery) -> bool:
    """Return whether the samples are evenly spaced, so that the record has no times."""
    return not any(part.kind != "overlap" for part in recovery.lost)


def _require_room(stream: Path, folder: Path, recovery: StreamRecovery) -> None:
    """Refuse a disk that is too full; h5py writes tracebacks of its own when it finds that out."""
    columns = len(recovery.head.channels) + (not _is_whole(recovery))
    needed = _OVERHEAD + 8 * recovery.samples * columns
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise RecordError(
            f"'{folder}' has {free / 1e6:.1f} MB of room, and the record needs {needed / 1e6:.1f} "
            f"MB: all {recovery.samples} samples are safe in '{stream}'; make room, then "
            f"'flexstage runs recover {stream}'"
        )


def _keys(head: StreamHead) -> list[str]:
    return file_keys((name for name, _ in head.channels), (RUN, "time"))


def _write(draft: Path, stream: Path, recovery: StreamRecovery) -> None:
    import h5py

    head = recovery.head
    total = recovery.samples
    uniform = _is_whole(recovery)
    if total < 2:
        raise RecordError(
            f"'{stream}' holds {total} whole samples, and a record needs two: the stream stays"
        )
    with h5py.File(draft, "w", track_order=True) as file:
        _describe(file, recovery)
        if uniform:
            file.attrs["sample_rate_hz"] = head.sample_rate_hz
            times = None
        else:
            # a name that no reader takes for the rate of evenly spaced samples
            file.attrs["nominal_rate_hz"] = head.sample_rate_hz
            times = _dataset(file, "time", "time", "s", total)
        sets = [
            _dataset(file, key, file_label(name, unit), unit, total)
            for key, (name, unit) in zip(_keys(head), head.channels, strict=True)
        ]
        at = 0
        for first, part in chunks(stream, recovery):
            rows = slice(at, at + part.shape[1])
            for dataset, values in zip(sets, part, strict=True):
                dataset[rows] = values
            if times is not None:
                times[rows] = np.arange(first, first + part.shape[1]) / head.sample_rate_hz
            at = rows.stop


def _describe(file: Any, recovery: StreamRecovery) -> None:
    for key, value in run_attributes(recovery.head.run, recovery.complete, recovery.notes).items():
        if key == RUN:
            # of any length, and so no attribute; of a fixed one, which Octave reads as well
            file.create_dataset(key, data=np.bytes_(str(value).encode()))
        else:
            file.attrs[key] = value


def _dataset(file: Any, key: str, label: str, unit: str, size: int) -> Any:
    dataset = file.create_dataset(key, shape=(size,), dtype="<f8", track_times=False)
    dataset.attrs["name"] = label
    dataset.attrs["unit"] = unit
    return dataset


def _verify(draft: Path, stream: Path, recovery: StreamRecovery) -> None:
    """Compare every sample of the file with the stream."""
    import h5py

    with h5py.File(draft, "r") as opened:
        file: Any = opened
        sets = [file[key] for key in _keys(recovery.head)]
        at = 0
        for _, part in chunks(stream, recovery):
            rows = slice(at, at + part.shape[1])
            for dataset, values in zip(sets, part, strict=True):
                # as bytes, so that a value that is no number is equal to itself
                if np.asarray(dataset[rows]).tobytes() != values.tobytes():
                    raise RecordError(
                        f"what was read back of '{stream}' is not what was written: the disk may "
                        "be damaged, and the stream stays"
                    )
            at = rows.stop


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFile:
    """What an HDF5 file of a run says about itself."""

    metadata: RunMetadata
    """What is known of the run."""
    channels: tuple[tuple[str, str], ...]
    """Name and unit of each channel."""
    samples: int
    """Samples of each channel."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""
    complete: bool
    """Whether its stream was ended by its writer, and nothing of it was lost."""
    lost: str
    """What was lost, or came twice, in words; empty where nothing was."""


def file_summary(path: str | Path) -> RunFile:
    """Return what an HDF5 file of a run says about itself, without reading its samples."""
    import h5py

    try:
        with h5py.File(path, "r") as opened:
            file: Any = opened
            metadata = read_description(file[RUN][()], path)
            sets = [file[key] for key in file if key not in (RUN, "time")]
            rate = file.attrs.get("sample_rate_hz", file.attrs.get("nominal_rate_hz"))
            return RunFile(
                metadata=metadata,
                channels=tuple((str(d.attrs["name"]), str(d.attrs["unit"])) for d in sets),
                samples=int(sets[0].shape[0]),
                sample_rate_hz=float(rate),
                complete=file.attrs[ENDING] == "complete",
                lost=str(file.attrs.get(LOST, "")),
            )
    except RecordError:
        raise
    except (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError) as error:
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0][:120]
        raise RecordError(
            f"'{path}' is no whole HDF5 file of a run of flexstage ({reason})"
        ) from error
