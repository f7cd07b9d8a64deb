"""Writing samples to disk while they are taken, so that a crash loses none that was written."""

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

# so much may wait for the disk at most, whatever the clock says [bytes]
_MOST_UNSYNCED = 8 * 2**20
# the number of the first sample, and samples of each channel
_Chunk = tuple[int, list[Array]]


class RunWriter:
    """A stream of samples on disk: appended chunk by chunk, kept whatever happens.

    Every chunk is framed with its length and a checksum, and handed to the operating system before
    `append` returns, so that the end of the program, by ``kill -9`` too, loses nothing that was
    appended. What a power failure may lose is what came after the last `sync`. On `close` the
    stream becomes an HDF5 file, and is removed once that was read back and is the same.

    As a context manager it closes the stream; where the block failed it leaves it for `recover`.

    The name of the stream ends in ``.stream``; it must not exist, and its folder must. `channels`
    are the name and SI unit of each. The metadata get a start and an identifier where they have
    none. `sync` is the longest time that samples wait until they are forced to the disk [s]: 0 for
    no time at all, None to leave it to the operating system. `opener` opens a new file for writing
    bytes, without a buffer.

    Validity
    --------
    For one thread. Between an append and the sync that follows, at most `sync` seconds and 8 MiB
    are exposed to a power failure; `synced` says how many samples are not.
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
        """Number of samples of each channel that were written."""
        return self._file.at.samples

    @property
    def synced(self) -> int:
        """Number of samples of each channel that a power failure does not lose."""
        return self._file.safe.samples

    @property
    def failed(self) -> bool:
        """Whether the stream could not be written on, so that samples are in `unsaved`."""
        return self._state == "failed"

    @property
    def irregularities(self) -> tuple[Irregularity, ...]:
        """Gaps and overlaps so far."""
        return tuple(self._irregular)

    @property
    def unsaved(self) -> tuple[tuple[int, dict[str, Array]], ...]:
        """Chunks that are not sure to be on disk: number of the first sample, and columns."""
        return tuple(
            (first, dict(zip(self._names, columns, strict=True)))
            for first, columns in self._unsaved
        )

    def append(self, first: int, columns: Mapping[str, ArrayLike]) -> Irregularity | None:
        """Write the samples of a chunk, in SI units by channel, behind those before.

        `first` is the number of the first of them, counted from the start of the run. Where it does
        not follow the chunk before, the gap or overlap is returned, and kept in the stream and in
        `irregularities`.

        Raises
        ------
        RecordError
            The columns are not those of the run, or the writer is closed; nothing is written.
            Or the disk is full, or fails: once. What was written stays readable, this chunk and
            those that follow are kept in `unsaved`.
        """
        if self._state == "closed":
            raise RecordError(f"'{self.path}' is closed: nothing can be added to it")
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
        """Force what was appended to the disk; where that fails, it is kept in `unsaved`."""
        if self._state == "open":
            try:
                self._sync()
            except OSError as error:
                self._fail(error, None)

    def close(self) -> Path:
        """End the stream, turn it into an HDF5 file beside it, and remove the stream.

        The stream is removed only when every sample was read back from the HDF5 file and is the
        same, bit by bit; it stays where samples were given twice, as the file holds them once, and
        where there are fewer than two samples or the file cannot be written: `recover` reads it.
        `flexstage.records.read_record` reads the file, which is returned.

        Validity
        --------
        The file is forced to the disk, but what is read back may come from the system's memory: a
        disk that keeps other bytes than it was given is found later, by the hash of the catalogue.
        """
        from flexstage.instruments.recording.archive import archived

        target = self.path.with_suffix(".h5")
        if self._state == "closed":
            if target.exists():
                return target
            raise RecordError(f"'{self.path}' was left as a stream: read it with recover")
        if self._state == "failed":
            self._retry()
        self._finish()
        if self._file.at.samples < 2:
            raise RecordError(
                f"the run has {self._file.at.samples} samples, and a record needs two: the stream "
                f"'{self.path}' stays"
            )
        archived(self.path, target)
        if not any(i.kind == "overlap" for i in self._irregular):
            self.path.unlink()
        return target

    def leave(self) -> None:
        """Close the stream as it is, without its end: what `recover` finds is all that there is."""
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
        """Note whether a chunk follows the ones before, and count it."""
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
        """Keep in memory what is not on disk, cut off the frame that is not whole, and tell."""
        self._state = "failed"
        self._file.cut()
        try:
            self._sync()
        except OSError:
            if self._sync_after is None:
                self._file.trust()  # nothing was kept that could be written again
        self._unsaved += self._unsynced
        self._unsynced = []
        if chunk is not None:
            self._unsaved.append(chunk)
        raise RecordError(
            f"'{self.path}' cannot be written on: {error.strerror or error}; its first "
            f"{self._file.safe.samples} samples are safe, those that follow are in memory only"
        ) from error

    def _retry(self) -> None:
        """Write once more, from the last sync on: there may be room by now."""
        try:
            self._file.back()
            for first, columns in self._unsaved:
                self._file.append(SAMPLES, first, columns)
            self._sync()
        except OSError as error:
            self._file.cut()
            safe = self._file.safe.samples
            raise RecordError(
                f"'{self.path}' still cannot be written on: {error.strerror or error}; its first "
                f"{safe} samples are safe, those that follow are in memory only (unsaved)"
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
    """Return a copy of the samples of each channel, in the order of the run, if they fit to it."""
    is_integer = isinstance(first, (int, np.integer)) and not isinstance(first, bool)
    # times are doubles, which count no further
    if not is_integer or not 0 <= first < 2**53:
        raise RecordError(f"the first sample must be a whole number from 0, got {first!r}")
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
                f"channel '{name}' must be a row of numbers, got {v.dtype} of shape {v.shape}"
            )
        # a copy, as a chunk may wait in memory while the caller fills the array anew
        values.append(np.array(v, dtype="<f8", order="C"))
    sizes = {v.size for v in values}
    if len(sizes) > 1:
        raise RecordError(
            "the channels of a chunk must have equally many samples, got "
            + ", ".join(f"{n}: {v.size}" for n, v in zip(names, values, strict=True))
        )
    return values
