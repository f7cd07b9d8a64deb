"""Recovery of streams, and their conversion to HDF5 files of records."""

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
    """Readable samples of a stream."""

    position: int
    """Position of the samples of the frame in the file [bytes]."""
    rows: int
    """Number of samples of each channel in the frame."""
    again: int
    """Number of duplicates of earlier samples among them."""
    first: int
    """Number of the first sample after the duplicates."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamRecovery:
    """Readable content of a stream."""

    head: StreamHead
    """Channels, rate, and metadata of the run."""
    chunks: tuple[Chunk, ...]
    """Chunks of samples, without duplicates."""
    ended: bool
    """Whether the writer ended the stream."""
    lost: tuple[Irregularity, ...]
    """Missing and duplicate ranges."""
    damaged_bytes: int
    """Number of bytes outside complete chunks, including an incomplete chunk at the end."""
    tail_bytes: int
    """Number of such bytes at the end."""

    @property
    def samples(self) -> int:
        """Number of readable samples of each channel."""
        return sum(chunk.rows - chunk.again for chunk in self.chunks)

    @property
    def complete(self) -> bool:
        """Whether the stream was ended and every written sample is readable."""
        return self.ended and not any(part.kind == "damage" for part in self.lost)

    @property
    def damaged_inside(self) -> bool:
        """Whether bytes before the end are damaged, by the disk and not by a crash."""
        return self.damaged_bytes > self.tail_bytes

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the state of the stream."""
        return tuple(_notes(self))


def _notes(recovery: StreamRecovery) -> Iterator[str]:
    damaged, tail = recovery.damaged_bytes, recovery.tail_bytes
    if not recovery.ended:
        yield f"the writer did not end the stream: {recovery.samples} samples are readable"
        if tail:
            yield (
                f"the last {tail} bytes are an incomplete chunk: samples that were being written, "
                "or were damaged, are lost there"
            )
    if damaged > tail or (tail and recovery.ended):
        inside = damaged if recovery.ended else damaged - tail
        yield f"{inside} bytes inside the stream are damaged"
    yield from (str(part) for part in recovery.lost)


def examine(path: str | Path) -> StreamRecovery:
    """Return the readable content of a stream.

    Every frame is checked by its checksum; after a damaged one, the next is searched byte by byte.
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
        # frames are in ascending order
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
            # the last frame counts the written samples
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
    """Return the position of the next complete frame, or the end of the file."""
    while start < size:
        file.seek(start)
        block = file.read(_BLOCK)
        for mark in _MARK.finditer(block):
            if frame_at(start + mark.start()) is not None:
                return start + mark.start()
        # a mark may cross the end of the block
        start += max(len(block) - len(END) + 1, 1)
    return size


def chunks(path: Path, recovery: StreamRecovery) -> Iterator[tuple[int, Array]]:
    """Yield the samples of a stream without duplicates: number of the first, shape (channels, n).

    Of duplicate samples, those that were written first are used. Consecutive chunks are joined, up
    to about 4 MiB, since files are written faster in few large pieces.
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
    """Return all readable samples of a stream, and a report on lost ones.

    The stream is not changed. Missing samples are a gap in the times of the record.

    Validity
    --------
    A chunk is valid only if its checksum (CRC-32) is correct: one damaged chunk in 4e9 would not be
    detected. A damaged chunk is lost completely.
    """
    file = Path(path)
    recovery = examine(file)
    if recovery.samples < 2:
        raise RecordError(
            f"'{file}' contains {recovery.samples} complete samples, and a record needs two: "
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


#: Size of an HDF5 file without its samples [bytes].
_OVERHEAD = 64 * 1024


def archived(stream: Path, target: Path) -> Path:
    """Write the readable samples of a stream to a new HDF5 file, and verify it; keep the stream.

    A dataset for each channel, with its ``unit`` and ``name``; the sample rate, or times where
    samples are missing; the metadata of the run. The file appears under its name once it is
    completely on disk and identical with the stream, bit by bit.
    """
    if target.exists():
        raise RecordError(f"'{target}' exists: runs are never overwritten")
    try:
        recovery = examine(stream)
        _require_room(stream, target.parent, recovery)
        with draft_of(target) as draft:
            _write(draft, stream, recovery)
            _verify(draft, stream, recovery)
    except RecordError:
        raise
    except (OSError, RuntimeError) as error:  # h5py reports some disk failures as the latter
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0][:160]
        raise RecordError(
            f"'{target}' cannot be written ({reason}): the stream '{stream}' is kept"
        ) from error
    return target


def rescued(stream: Path, target: Path | None = None, *, remove: bool = False) -> Path:
    """Write the stream of a crashed run as an HDF5 file, by default with the same name.

    Refused while another program writes the stream. With `remove` the stream is removed afterwards,
    except if the disk has damaged it.
    """
    if in_use(stream):
        raise RecordError(
            f"'{stream}' is being written by another program: wait until it ends, or inspect it "
            "with --look"
        )
    record = archived(stream, target or stream.with_suffix(".h5"))
    if remove and not examine(stream).damaged_inside:
        stream.unlink()
    return record


def _is_uniform(recovery: StreamRecovery) -> bool:
    """Return whether the samples are uniform, so that the record has no times."""
    return not any(part.kind != "overlap" for part in recovery.lost)


def _require_room(stream: Path, folder: Path, recovery: StreamRecovery) -> None:
    """Refuse a disk that is too full, on which h5py would print its own tracebacks."""
    columns = len(recovery.head.channels) + (not _is_uniform(recovery))
    needed = _OVERHEAD + 8 * recovery.samples * columns
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise RecordError(
            f"'{folder}' has {free / 1e6:.1f} MB of free space, and the record needs "
            f"{needed / 1e6:.1f} MB: all {recovery.samples} samples are safe in '{stream}'; free "
            f"some space, then run 'flexstage runs recover {stream}'"
        )


def _keys(head: StreamHead) -> list[str]:
    return file_keys((name for name, _ in head.channels), (RUN, "time"))


def _write(draft: Path, stream: Path, recovery: StreamRecovery) -> None:
    import h5py

    head = recovery.head
    total = recovery.samples
    uniform = _is_uniform(recovery)
    if total < 2:
        raise RecordError(
            f"'{stream}' contains {total} complete samples, and a record needs two: the stream is "
            "kept"
        )
    with h5py.File(draft, "w", track_order=True) as file:
        _describe(file, recovery)
        if uniform:
            file.attrs["sample_rate_hz"] = head.sample_rate_hz
            times = None
        else:
            # readers must not take this for the rate of uniform samples
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
            # too long for an attribute; of fixed length, which Octave can read
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
                # as bytes, so that NaN equals itself
                if np.asarray(dataset[rows]).tobytes() != values.tobytes():
                    raise RecordError(
                        f"the file of '{stream}' differs from the stream: the disk may be damaged; "
                        "the stream is kept"
                    )
            at = rows.stop


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFile:
    """Summary of an HDF5 file of a run."""

    metadata: RunMetadata
    """Metadata of the run."""
    channels: tuple[tuple[str, str], ...]
    """Name and unit of each channel."""
    samples: int
    """Number of samples of each channel."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""
    complete: bool
    """Whether the writer ended the stream, and no sample was lost."""
    lost: str
    """Notes on lost and duplicate samples; empty where there are none."""


def file_summary(path: str | Path) -> RunFile:
    """Return a summary of an HDF5 file of a run, without reading its samples."""
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
            f"'{path}' is not a complete HDF5 file of a run of flexstage ({reason})"
        ) from error
