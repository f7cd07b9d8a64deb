"""A job: work on many samples, cut into batches that do not depend on who computes them."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexstage.errors import ModelError, WorkerError

#: A batch that lasts this long hides what it costs to send it, and little is lost with it [s].
_LASTS = 1.0

#: So many batches at least, where there are as many samples, so that many workers share them.
_FEWEST = 32

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
