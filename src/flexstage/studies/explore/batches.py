"""A job: work on many samples, cut into batches that do not depend on who computes them.

Finished batches are kept in a folder, so that a run can go on from them.
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

#: A batch that lasts this long hides what it costs to send it, and little is lost with it [s].
_LASTS = 1.0

#: So many batches at least, where there are as many samples, so that many workers share them.
_FEWEST = 32

#: Workers are the parallelism, and threads of a library in each would only wait for one another.
ONE_THREAD = {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NGS", "NUMBA")
}

Arrays = Mapping[str, np.ndarray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """Work on samples 0 to `count`, in batches.

    The numbers of a batch depend on payload and range alone. As the batches are fixed by the job,
    its result is the same to the last bit however many workers there are.
    """

    name: str
    """What is done, for messages and progress, such as "tolerance"."""
    work: Callable[[Any, int, int], Arrays]
    """Called with the payload and a range of samples, start and stop; returns arrays whose first
    axis has a row for each. A function of a module, which workers import."""
    payload: Any
    """What the work needs to know; it can be pickled."""
    count: int
    """Number of samples."""
    batch: int
    """Samples of a batch; the last one may have fewer."""

    def __post_init__(self) -> None:
        if self.count < 1 or self.batch < 1:
            raise ModelError(
                f"{self.name} needs at least one sample, in batches of one or more, got "
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
    """A batch of a job that has not ended, as it is handed over to who watches."""

    job: str
    """Name of the job."""
    start: int
    """The first of its samples."""
    arrays: Arrays
    """What was found of them."""


def rows_of(job: Job, number: int, found: Arrays) -> dict[str, np.ndarray]:
    """Return what was found of a batch as arrays, refusing what has not a row for each sample."""
    start, stop = job.span(number)
    arrays = {name: np.asarray(values) for name, values in found.items()}
    for name, values in arrays.items():
        if values.shape[:1] != (stop - start,) or values.dtype.hasobject:
            raise ModelError(
                f"the work of {job.name} must return a row for each of the {stop - start} samples "
                f"of a batch, numbers or texts, got '{name}' of shape {values.shape}, "
                f"{values.dtype}"
            )
    return arrays


def joined(parts: Iterable[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Return the arrays of all batches, joined in their order."""
    taken = list(parts)
    names = list(taken[0])
    # each part goes as soon as it is joined: all of them may fill much of the memory
    return {name: np.concatenate([part.pop(name) for part in taken]) for name in names}


def batch_size(count: int, each: float) -> int:
    """Return a number of samples that makes batches of about a second, and enough of them.

    `each` is what a sample usually costs [s]: a constant of the kind of work, not measured, so that
    the batches are the same on every machine.

    Examples
    --------
    >>> batch_size(100_000, 50e-6), batch_size(100, 0.03), batch_size(10, 40.0)
    (3125, 4, 1)
    """
    return max(1, min(round(_LASTS / each), -(-count // _FEWEST)))


def deadly(job: Job, number: int, times: int) -> WorkerError:
    """Return what is said of a batch that ends the process of its worker each time."""
    start, stop = job.span(number)
    return WorkerError(
        f"batch {number} of {job.name} (samples {start} to {stop - 1}) ended the process of its "
        f"worker {times} times: it needs more memory than there is, or a library fails on a "
        "sample; compute it with one worker to see"
    )


_HEAD = "job.json"

#: What the head says of a job, and what to call it where it differs.
_WORDS = {
    "name": "another kind of job",
    "samples": "another number of samples",
    "batch": "batches of another size",
    "versions": "another version of flexstage, Python, NumPy or SciPy",
    "payload": "another stage or other settings",
}


def versions() -> dict[str, str]:
    """Return the versions on which the last bit of a number depends."""
    import scipy

    return {
        "flexstage": __version__,
        "python": ".".join(platform.python_version_tuple()[:2]),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }


class KeptBatches:
    """Finished batches of a job in a folder, a file each, and a head that says of which job."""

    def __init__(self, folder: Path, job: Job) -> None:
        self.folder = folder
        self._job = job
        head = _head_of(job)
        if not self._is_of(head):
            folder.mkdir(parents=True, exist_ok=True)
            write_whole(folder / _HEAD, json.dumps(head, indent=2) + "\n")

    def read(self, number: int) -> dict[str, np.ndarray] | None:
        """Return the arrays of a batch, or None where its file is not there or is damaged."""
        try:
            content = io.BytesIO(self._file(number).read_bytes())
            with np.load(content, allow_pickle=False) as file:
                return rows_of(self._job, number, dict(file))
        except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile, zlib.error):
            return None

    def keep(self, number: int, arrays: dict[str, np.ndarray]) -> None:
        """Keep a finished batch: its file is there whole, or not at all."""
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **arrays)
        write_whole(self._file(number), content.getvalue())

    def _file(self, number: int) -> Path:
        return self.folder / f"batch-{number:06d}.npz"

    def _is_of(self, head: dict[str, Any]) -> bool:
        """Return whether the folder has the head of this job; another one is refused."""
        path = self.folder / _HEAD
        mend = "name another folder, or remove this one to begin anew"
        try:
            found = json.loads(path.read_text("utf-8"))
        except FileNotFoundError:
            if any(self.folder.glob("batch-*.npz")):
                raise RecordError(
                    f"{self.folder} holds batches, and no {_HEAD} that says of which job: {mend}"
                ) from None
            return False
        except ValueError:
            found = {}
        differs = [key for key in _WORDS if not isinstance(found, dict) or key not in found]
        if differs:
            raise RecordError(f"{path} does not say which job its batches are of: {mend}")
        differs = [words for key, words in _WORDS.items() if found[key] != head[key]]
        if differs:
            raise RecordError(
                f"{self.folder} holds batches of another run than this {self._job.name} "
                f"({', '.join(differs)}): {mend}"
            )
        return True


@contextmanager
def finished_batches(folder: Path | None) -> Iterator[Path | None]:
    """Give where finished batches are kept until this block ends, beside what is written there.

    They stay where it is interrupted, so that the same run goes on from them. Those of a run that
    fails by itself do not, as it would again; but those that were there before it do.
    """
    keep = None if folder is None else folder / "unfinished"
    before = keep is not None and keep.exists()
    try:
        yield keep
    except ModelError:
        if not before:
            _forget(keep)
        raise
    _forget(keep)


def _forget(keep: Path | None) -> None:
    if keep is not None and keep.exists():
        shutil.rmtree(keep)


def _head_of(job: Job) -> dict[str, Any]:
    work = f"{job.work.__module__}.{job.work.__qualname__}"
    return {
        "name": job.name,
        "samples": job.count,
        "batch": job.batch,
        "versions": versions(),
        "payload": hashlib.sha256(work.encode() + _spelled(job.payload)).hexdigest(),
    }


def _spelled(payload: Any) -> bytes:
    """Return a payload as bytes that are equal for equal payloads: nothing is called as before."""
    file = io.BytesIO()
    pickler = pickle.Pickler(file, protocol=4)
    pickler.fast = True
    try:
        pickler.dump(payload)
    except (pickle.PicklingError, AttributeError, TypeError, ValueError) as error:
        raise ModelError(f"what a job needs to know must be picklable: {error}") from error
    return file.getvalue()
