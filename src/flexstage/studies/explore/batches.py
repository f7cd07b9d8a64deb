"""Jobs: computations for many samples, divided into batches.

Batches do not depend on the workers. A folder stores finished ones, so that a run can be resumed.
"""

import hashlib
import io
import json
import pickle
import platform
import shutil
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexstage.base.errors import ModelError, RecordError, WorkerError
from flexstage.base.version import __version__
from flexstage.files.write import write_whole

#: Computing time of a batch: long compared with its transfer, short enough to repeat [s].
_SECONDS = 1.0

#: Least number of batches, if there are as many samples, so that many workers can share them.
_FEWEST = 32

#: One thread for each library, as workers run in parallel already.
ONE_THREAD = {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NGS", "NUMBA")
}

Arrays = Mapping[str, np.ndarray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A computation for samples 0 to `count`, in batches.

    The results of a batch depend on payload and range alone. The job defines its batches, so that
    the result is the same to the last bit for any number of workers.
    """

    name: str
    """Name in messages and progress displays, such as "tolerance"."""
    work: Callable[[Any, int, int], Arrays]
    """Function of the payload and a range of samples, start and stop. It returns arrays with a row
    for each sample. Workers import it from its module."""
    payload: Any
    """Input of the function; it can be pickled."""
    count: int
    """Number of samples."""
    batch: int
    """Number of samples of a batch; the last one may have fewer."""

    def __post_init__(self) -> None:
        if self.count < 1 or self.batch < 1:
            raise ModelError(
                f"{self.name} needs at least one sample and batches of at least one, got "
                f"{self.count} in batches of {self.batch}"
            )

    @property
    def batches(self) -> int:
        """Number of batches."""
        return -(-self.count // self.batch)

    def span(self, number: int) -> tuple[int, int]:
        """Return the samples of a batch, start and stop.

        Examples
        --------
        >>> Job(name="squares", work=max, payload=None, count=10, batch=4).span(2)
        (8, 10)
        """
        start = number * self.batch
        return start, min(start + self.batch, self.count)

    def compute(self, number: int) -> dict[str, np.ndarray]:
        """Return the arrays of a batch."""
        return rows_of(self, number, self.work(self.payload, *self.span(number)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FinishedBatch:
    """A finished batch of a running job, for a progress listener."""

    job: str
    """Name of the job."""
    start: int
    """The first of its samples."""
    arrays: Arrays
    """Results of the samples."""


def rows_of(job: Job, number: int, results: Arrays) -> dict[str, np.ndarray]:
    """Return the results of a batch as arrays; reject those without a row for each sample."""
    start, stop = job.span(number)
    arrays = {name: np.asarray(values) for name, values in results.items()}
    for name, values in arrays.items():
        if values.shape[:1] != (stop - start,) or values.dtype.hasobject:
            raise ModelError(
                f"the function of {job.name} must return numbers or texts with a row for each of "
                f"the {stop - start} samples of a batch, got '{name}' of shape {values.shape}, "
                f"{values.dtype}"
            )
    return arrays


def joined(parts: Iterable[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Return the arrays of all batches, joined in their order."""
    batches = list(parts)
    names = list(batches[0])
    # arrays are removed from the batches one by one, to save memory
    return {name: np.concatenate([batch.pop(name) for batch in batches]) for name in names}


def batch_size(count: int, each: float) -> int:
    """Return the number of samples of a batch for about a second and enough batches.

    `each` is the typical computing time of a sample [s]. It is a constant and not measured, so that
    batches are the same on every machine.

    Examples
    --------
    >>> batch_size(100_000, 50e-6), batch_size(100, 0.03), batch_size(10, 40.0)
    (3125, 4, 1)
    """
    return max(1, min(round(_SECONDS / each), -(-count // _FEWEST)))


def crash_error(job: Job, number: int, times: int) -> WorkerError:
    """Return the error for a batch that ends the process of its worker every time."""
    start, stop = job.span(number)
    return WorkerError(
        f"batch {number} of {job.name} (samples {start} to {stop - 1}) ended the process of its "
        f"worker {times} times: there is too little memory, or a library crashes on a sample; "
        "compute with one worker to find out"
    )


_HEAD = "job.json"

#: Fields of the head, and the message for a different value.
_DIFFERENCES = {
    "name": "another kind of job",
    "samples": "another number of samples",
    "batch": "batches of another size",
    "versions": "another version of flexstage, Python, NumPy or SciPy",
    "payload": "another stage or other settings",
}


def versions() -> dict[str, str]:
    """Return the versions of all software that affects the last bit of results."""
    import scipy

    return {
        "flexstage": __version__,
        "python": ".".join(platform.python_version_tuple()[:2]),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }


class StoredBatches:
    """Stored batches of a job: a folder with a file for each, and a head with the job."""

    def __init__(self, folder: Path, job: Job) -> None:
        self.folder = folder
        self._job = job
        head = _head_of(job)
        if not self._is_of(head):
            folder.mkdir(parents=True, exist_ok=True)
            write_whole(folder / _HEAD, json.dumps(head, indent=2) + "\n")

    def read(self, number: int) -> dict[str, np.ndarray] | None:
        """Return the arrays of a batch; None if its file is missing or damaged."""
        try:
            content = io.BytesIO(self._file(number).read_bytes())
            with np.load(content, allow_pickle=False) as file:
                return rows_of(self._job, number, dict(file))
        except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile, zlib.error):
            return None

    def store(self, number: int, arrays: dict[str, np.ndarray]) -> None:
        """Store a finished batch in a complete file."""
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **arrays)
        write_whole(self._file(number), content.getvalue())

    def _file(self, number: int) -> Path:
        return self.folder / f"batch-{number:06d}.npz"

    def _is_of(self, head: dict[str, Any]) -> bool:
        """Return whether the folder has the head of this job; reject another head."""
        path = self.folder / _HEAD
        advice = "name another folder, or remove this one to start again"
        try:
            stored = json.loads(path.read_text("utf-8"))
        except FileNotFoundError:
            if any(self.folder.glob("batch-*.npz")):
                raise RecordError(
                    f"{self.folder} has batches, but no {_HEAD} that identifies their job: {advice}"
                ) from None
            return False
        except ValueError:
            stored = {}
        if not isinstance(stored, dict) or not _DIFFERENCES.keys() <= stored.keys():
            raise RecordError(f"{path} does not identify the job of its batches: {advice}")
        differences = [text for key, text in _DIFFERENCES.items() if stored[key] != head[key]]
        if differences:
            raise RecordError(
                f"{self.folder} has batches of another run than this {self._job.name} "
                f"({', '.join(differences)}): {advice}"
            )
        return True


@contextmanager
def finished_batches(folder: Path | None) -> Iterator[Path | None]:
    """Yield the subfolder for finished batches, and remove it at the end of the block.

    It remains after an interruption, so that the run can be resumed. It is removed after an error
    of the run, which would occur again, unless it existed before.
    """
    keep = None if folder is None else folder / "unfinished"
    before = keep is not None and keep.exists()
    try:
        yield keep
    except ModelError:
        if not before:
            _remove(keep)
        raise
    _remove(keep)


def _remove(keep: Path | None) -> None:
    if keep is not None and keep.exists():
        shutil.rmtree(keep)


def _head_of(job: Job) -> dict[str, Any]:
    work = f"{job.work.__module__}.{job.work.__qualname__}"
    return {
        "name": job.name,
        "samples": job.count,
        "batch": job.batch,
        "versions": versions(),
        "payload": hashlib.sha256(work.encode() + _bytes_of(job.payload)).hexdigest(),
    }


def _bytes_of(payload: Any) -> bytes:
    """Return bytes that are equal for equal payloads: without references to repeated objects."""
    file = io.BytesIO()
    pickler = pickle.Pickler(file, protocol=4)
    pickler.fast = True
    try:
        pickler.dump(payload)
    except (pickle.PicklingError, AttributeError, TypeError, ValueError) as error:
        raise ModelError(f"the payload of a job must be picklable: {error}") from error
    return file.getvalue()
