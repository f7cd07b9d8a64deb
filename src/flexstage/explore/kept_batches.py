"""The folder in which finished batches of a job are kept, so that a run can go on from them."""

import hashlib
import io
import json
import pickle
import platform
import shutil
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import flexstage
from flexstage.errors import ModelError, RecordError
from flexstage.explore.batches import Job, rows_of
from flexstage.files.write import write_whole

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
        "flexstage": flexstage.__version__,
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
