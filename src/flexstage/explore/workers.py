"""Who computes the batches of a job: this process, or workers where the work is long enough."""

import multiprocessing
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexstage.errors import ModelError, WorkerError
from flexstage.explore.batches import FinishedBatch, Job, KeptBatches, joined
from flexstage.lazy import require_extra
from flexstage.progress import hand_over, update

if TYPE_CHECKING:
    from flexstage.explore.cluster import Cluster
    from flexstage.explore.pool import Pool

#: Work that takes this process longer than that, with what it has taken already, is shared [s]:
#: workers take some two seconds to start.
_WORTH_SHARING = 4.0

#: Time that this process works before it judges how long the rest takes: a first batch may compile
#: what the next ones find [s].
_TRIED = 1.0


class Workers:
    """Workers that are started when a job is long enough, and are there for the next ones.

    Parameters
    ----------
    count
        Number of processes; every core where it is None.
    scheduler
        Address of the scheduler of a Dask cluster, which then does all the work.
    """

    def __init__(self, count: int | None = None, scheduler: str | None = None) -> None:
        if count is not None and count < 1:
            raise ModelError(f"the number of workers must be 1 or more, got {count}")
        if count is not None and scheduler is not None:
            raise ModelError(
                "a cluster has the workers that joined it: give a number of workers or the "
                "address of a scheduler, not both"
            )
        if getattr(multiprocessing.current_process(), "_inheriting", False):
            raise WorkerError(
                'a program that shares work does so under `if __name__ == "__main__":`, as each '
                "worker process imports it"
            )
        if scheduler is not None:
            require_extra("explore", "distributed", "work on a cluster", WorkerError)
        self._count, self._scheduler = count, scheduler
        # a process that another program shares work with may start none
        self._alone = count == 1 or multiprocessing.current_process().daemon
        self._others: Cluster | Pool | None = None
        self._worked = 0.0  # what this process has computed itself [s]

    def run(self, job: Job, keep: Path | None = None) -> dict[str, np.ndarray]:
        """Return the arrays of a job, the rows of all batches in order.

        Each finished batch is kept in the folder `keep` at once; those that are there already, of
        the same job, are not computed again.

        Raises
        ------
        WorkerError
            Workers or scheduler were lost for good, or a batch ended every worker that tried it.
        RecordError
            The folder holds batches of another job.
        """
        kept = None if keep is None else KeptBatches(keep, job)
        parts: dict[int, dict[str, np.ndarray]] = {}
        for number in range(job.batches) if kept else ():
            found = kept.read(number) if kept else None
            if found is not None:
                parts[number] = found
                _hand_over(job, number, found)
        progress = _Progress(job, len(parts))
        try:
            for number, found in self._computed(job, parts, progress):
                if kept:
                    kept.keep(number, found)
                parts[number] = found
                _hand_over(job, number, found)
                progress.show(len(parts))
        except WorkerError as error:
            if not parts:
                raise
            raise WorkerError(f"{error}; {_what_is_kept(job, kept, len(parts))}") from error
        return joined(parts.pop(number) for number in range(job.batches))

    def close(self, *, at_once: bool = False) -> None:
        """End the workers that were started, or leave the cluster; `at_once` amid their work."""
        if self._others is not None:
            self._others.close(at_once=at_once)
            self._others = None

    def _computed(
        self, job: Job, done: dict[int, dict[str, np.ndarray]], progress: "_Progress"
    ) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """Yield the batches of a job that are not done, in the order in which they are finished."""
        left = [number for number in range(job.batches) if number not in done]
        progress.show(len(done))
        each = float("inf")
        while left and not self._worth_sharing(each, len(left)):
            began = time.perf_counter()
            found = job.compute(left[0])
            took = time.perf_counter() - began
            each, self._worked = min(each, took), self._worked + took
            yield left.pop(0), found
        if left:
            if self._others is None:
                joins = self._scheduler is not None
                progress.wait("joining the cluster" if joins else "starting workers")
            yield from self._shared(len(left)).finished(job, left, progress.wait)

    def _worth_sharing(self, each: float, left: int) -> bool:
        if self._alone or self._scheduler is not None or self._others is not None:
            return not self._alone
        return self._worked > _TRIED and left > 1 and self._worked + left * each > _WORTH_SHARING

    def _shared(self, batches: int) -> "Cluster | Pool":
        if self._scheduler is not None:
            from flexstage.explore.cluster import Cluster

            self._others = self._others or Cluster(self._scheduler)
        else:
            from flexstage.explore.pool import Pool

            self._others = pool = self._others if isinstance(self._others, Pool) else Pool()
            pool.start(self._count, batches)
        return self._others


def _hand_over(job: Job, number: int, found: dict[str, np.ndarray]) -> None:
    # a dictionary of its own: what is joined is taken out of the other
    hand_over(FinishedBatch(job=job.name, start=job.span(number)[0], arrays=dict(found)))


@contextmanager
def open_workers(count: int | None = None, scheduler: str | None = None) -> Iterator[Workers]:
    """Give workers for the jobs in this block; they end with it, at once where it fails.

    Examples
    --------
    >>> from flexstage.explore import Job
    >>> def squares(base, start, stop):
    ...     return {"square": (base + np.arange(start, stop)) ** 2}
    >>> with open_workers(1) as workers:
    ...     workers.run(Job(name="squares", work=squares, payload=2, count=5, batch=2))
    {'square': array([ 4,  9, 16, 25, 36])}
    """
    workers = Workers(count, scheduler)
    try:
        yield workers
    except BaseException:
        workers.close(at_once=True)
        raise
    workers.close()


class _Progress:
    """How many batches are finished, and how long the others will take."""

    def __init__(self, job: Job, done: int) -> None:
        self._job, self._before = job, done
        self._began = time.monotonic()
        self._done = done

    def show(self, done: int) -> None:
        self._done = done
        computed, left = done - self._before, self._job.batches - done
        after = ""
        if computed and left:
            taken = time.monotonic() - self._began
            after = f", {duration(taken / computed * left)} left"
        self._tell(after)

    def wait(self, reason: str) -> None:
        """Say why nothing goes on."""
        self._tell(f", {reason}")

    def _tell(self, after: str) -> None:
        job = self._job
        update(
            f"{job.name}, {self._done} of {job.batches} batches{after}", self._done / job.batches
        )


def duration(seconds: float) -> str:
    """Return a time in words, in its two largest units.

    Examples
    --------
    >>> duration(7.4), duration(70.0), duration(7500.0), duration(266400.0)
    ('7 s', '1 min 10 s', '2 h 5 min', '3 d 2 h')
    """
    left = round(seconds)
    if left < 60:
        return f"{left} s"
    units = (("d", 86400), ("h", 3600), ("min", 60), ("s", 1))
    at = next(i for i, (_, size) in enumerate(units) if left >= size)
    words = []
    for name, size in units[at : at + 2]:
        number, left = divmod(left, size)
        words.append(f"{number} {name}")
    return " ".join(words)


def _what_is_kept(job: Job, kept: KeptBatches | None, done: int) -> str:
    if kept is None:
        return "nothing was kept, as no folder for finished batches was given"
    return (
        f"{done} of {job.batches} batches are kept in {kept.folder}, and the same run goes on "
        "from them"
    )
