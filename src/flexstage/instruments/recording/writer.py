"""Writer of samples to disk during a measurement, so that a crash loses no written sample."""

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.instruments.recording.stream import (
    END,
    LARGEST_PAYLOAD,
    SAMPLES,
    STREAM_SUFFIX,
    Irregularity,
    StreamFile,
    StreamHead,
)

# largest amount of data before a sync, in addition to the time limit [bytes]
_MOST_UNSYNCED = 8 * 2**20
# the number of the first sample, and samples of each channel
_Chunk = tuple[int, list[Array]]


class RunWriter:
    """A stream of samples on disk, appended chunk by chunk and safe against crashes.

    Every chunk is framed with its length and a checksum, and written to the operating system before
    `append` returns. So the end of the program, even by ``kill -9``, loses no appended sample. A
    power failure may lose samples after the last `sync`. `close` converts the stream to an HDF5
    file, reads it back, compares it, and then removes the stream.

    As a context manager it closes the stream; if the block failed, the stream remains for
    `recover`.

    The name of the stream ends in ``.stream``; it must not exist, and its folder must. `channels`
    are the name and SI unit of each. Missing start time and identifier are added to the metadata.
    `sync` is the longest time until samples are forced to the disk [s]: 0 for immediately, None for
    the default of the operating system. `opener` opens a new file for writing bytes, without a
    buffer.

    Validity
    --------
    For one thread. Between an append and the following sync, samples of at most `sync` seconds and
    8 MiB are exposed to a power failure; `synced` is the number of samples that are not.
    """

    def __init__(
        self,
        path: str | Path,
        channels: Sequence[tuple[str, str]],
        sample_rate_hz: float,
        metadata: RunMetadata,
        *,
        sync: float | None = 0.5,
        clock: Callable[[], float] = time.monotonic,
        opener: Callable[[Path], Any] | None = None,
    ) -> None:
        self.path = Path(path)
        if self.path.suffix != STREAM_SUFFIX:
            raise RecordError(
                f"the name of a stream must end in {STREAM_SUFFIX}, got '{self.path.name}'"
            )
        if sync is not None and not sync >= 0.0:
            raise RecordError(f"the time between syncs must not be negative, got {sync!r} s")
        self.head = StreamHead(
            channels=tuple((n, u) for n, u in channels),
            sample_rate_hz=sample_rate_hz,
            run=metadata.begun(),
        )
        self._names = [name for name, _ in self.head.channels]
        self._sync_after, self._clock = sync, clock
        self._state = "open"
        self._next = 0
        self._unsynced: list[_Chunk] = []
        self._unsaved: list[_Chunk] = []
        self._irregular: list[Irregularity] = []
        self._file = StreamFile(self.path, self.head, opener)
        self._synced_at = clock()

    @property
    def samples(self) -> int:
        """Number of written samples of each channel."""
        return self._file.at.samples

    @property
    def synced(self) -> int:
        """Number of samples of each channel that a power failure does not lose."""
        return self._file.safe.samples

    @property
    def failed(self) -> bool:
        """Whether writing to the stream failed, so that samples are in `unsaved`."""
        return self._state == "failed"

    @property
    def irregularities(self) -> tuple[Irregularity, ...]:
        """Gaps and overlaps so far."""
        return tuple(self._irregular)

    @property
    def unsaved(self) -> tuple[tuple[int, dict[str, Array]], ...]:
        """Chunks that may not be on disk: number of the first sample, and columns."""
        return tuple(
            (first, dict(zip(self._names, columns, strict=True)))
            for first, columns in self._unsaved
        )

    def append(self, first: int, columns: Mapping[str, ArrayLike]) -> Irregularity | None:
        """Write the samples of a chunk, in SI units by channel, after the previous ones.

        `first` is the number of the first sample, counted from the start of the run. If it does not
        follow the previous chunk, the gap or overlap is returned, and noted in the stream and in
        `irregularities`.

        Raises
        ------
        RecordError
            The columns are not those of the run, or the writer is closed; nothing is written.
            Or, once, the disk is full or fails. Written samples remain readable; this chunk and the
            following ones are kept in `unsaved`.
        """
        if self._state == "closed":
            raise RecordError(f"'{self.path}' is closed: no samples can be added")
        values = _checked(self._names, first, columns)
        if values[0].size == 0:
            return None
        irregularity = self._compared(first, values[0].size)
        if self._state == "failed":
            self._unsaved.append((first, values))
            return irregularity
        step = max(LARGEST_PAYLOAD // self.head.row_size, 1)
        for start in range(0, values[0].size, step):
            try:
                self._write_chunk(first + start, [v[start : start + step] for v in values])
            except OSError as error:
                self._fail(error, (first + start, [v[start:] for v in values]))
        self._sync_in_time()
        return irregularity

    def sync(self) -> None:
        """Force appended samples to the disk; if this fails, they are kept in `unsaved`."""
        if self._state == "open":
            try:
                self._sync()
            except OSError as error:
                self._fail(error, None)

    def close(self) -> Path:
        """End the stream, convert it to an HDF5 file of the same name, and remove the stream.

        The stream is removed only if every sample was read back from the HDF5 file and is identical
        bit by bit. It remains if samples were received twice, since the file contains them once,
        and if there are fewer than two samples or the file cannot be written: `recover` reads it.
        The file is returned; `flexstage.records.read_record` reads it.

        Validity
        --------
        The file is forced to the disk, but the comparison may read from the system's memory. The
        hash in the catalogue detects a disk that stores wrong bytes.
        """
        from flexstage.instruments.recording.archive import archived

        target = self.path.with_suffix(".h5")
        if self._state == "closed":
            if target.exists():
                return target
            raise RecordError(f"'{self.path}' is still a stream: read it with recover")
        if self._state == "failed":
            self._retry()
        self._finish()
        if self._file.at.samples < 2:
            raise RecordError(
                f"the run has {self._file.at.samples} samples, and a record needs two: the stream "
                f"'{self.path}' is kept"
            )
        archived(self.path, target)
        if not any(i.kind == "overlap" for i in self._irregular):
            self.path.unlink()
        return target

    def leave(self) -> None:
        """Close the stream without an end frame; `recover` reads its samples."""
        if self._state != "closed":
            if self._state == "open":
                with contextlib.suppress(OSError):
                    self._file.sync()
            self._state = "closed"
            with contextlib.suppress(OSError):
                self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            self.leave()
        elif self._state != "closed":
            try:
                self.close()
            finally:
                self.leave()

    def _compared(self, first: int, count: int) -> Irregularity | None:
        """Return and note a gap or overlap with the previous chunks, and count the samples."""
        irregularity = None
        if first > self._next:
            irregularity = Irregularity(kind="gap", first=self._next, count=first - self._next)
        elif first < self._next:
            again = min(count, self._next - first)
            irregularity = Irregularity(kind="overlap", first=int(first), count=int(again))
        if irregularity is not None:
            self._irregular.append(irregularity)
        self._next = max(self._next, int(first) + count)
        return irregularity

    def _write_chunk(self, first: int, columns: list[Array]) -> None:
        self._file.append(SAMPLES, first, columns)
        if self._sync_after is not None:
            self._unsynced.append((first, columns))

    def _sync_in_time(self) -> None:
        if self._sync_after is None:
            return
        waiting = self._file.at.size - self._file.safe.size
        if self._clock() - self._synced_at >= self._sync_after or waiting >= _MOST_UNSYNCED:
            self.sync()

    def _sync(self) -> None:
        self._file.sync()
        self._unsynced.clear()
        self._synced_at = self._clock()

    def _fail(self, error: OSError, chunk: _Chunk | None) -> None:
        """Keep unsaved samples in memory, cut off the incomplete frame, and raise the error."""
        self._state = "failed"
        self._file.cut()
        try:
            self._sync()
        except OSError:
            if self._sync_after is None:
                self._file.trust()  # no samples were kept that could be written again
        self._unsaved += self._unsynced
        self._unsynced = []
        if chunk is not None:
            self._unsaved.append(chunk)
        raise RecordError(
            f"writing to '{self.path}' failed: {error.strerror or error}; its first "
            f"{self._file.safe.samples} samples are safe, the following ones are only in memory"
        ) from error

    def _retry(self) -> None:
        """Write again from the last sync: the disk may have space by now."""
        try:
            self._file.back()
            for first, columns in self._unsaved:
                self._file.append(SAMPLES, first, columns)
            self._sync()
        except OSError as error:
            self._file.cut()
            safe = self._file.safe.samples
            raise RecordError(
                f"writing to '{self.path}' still fails: {error.strerror or error}; its first "
                f"{safe} samples are safe, the following ones are only in memory (unsaved)"
            ) from error
        self._unsaved.clear()
        self._state = "open"

    def _finish(self) -> None:
        try:
            self._file.append(END, self._next, [])
            self._sync()
        except OSError as error:
            self._fail(error, None)
        self._state = "closed"
        self._file.close()


def _checked(names: Sequence[str], first: int, columns: Mapping[str, ArrayLike]) -> list[Array]:
    """Return a copy of the samples of each channel, in the order of the run; refuse others."""
    is_integer = isinstance(first, (int, np.integer)) and not isinstance(first, bool)
    # times are doubles, whose integers are exact up to this
    if not is_integer or not 0 <= first < 2**53:
        raise RecordError(
            f"the number of the first sample must be an integer from 0, got {first!r}"
        )
    if set(columns) != set(names) or len(columns) != len(names):
        raise RecordError(
            f"a chunk must have the channels {', '.join(names)}, got "
            f"{', '.join(map(str, columns)) or 'none'}"
        )
    values: list[Array] = []
    for name in names:
        v = np.asarray(columns[name])
        if v.dtype.kind not in "buif" or v.ndim != 1:
            raise RecordError(
                f"channel '{name}' must be an array of numbers, got {v.dtype} of shape {v.shape}"
            )
        # a copy, since a chunk may stay in memory while the caller reuses the array
        values.append(np.array(v, dtype="<f8", order="C"))
    sizes = {v.size for v in values}
    if len(sizes) > 1:
        raise RecordError(
            "the channels of a chunk must have the same number of samples, got "
            + ", ".join(f"{n}: {v.size}" for n, v in zip(names, values, strict=True))
        )
    return values
