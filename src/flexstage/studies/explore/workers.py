"""Who computes the batches of a job: this process, or worker processes at the end of pipes.

Workers compute where the work is long enough: processes of this machine, or those of a cluster.
"""

import multiprocessing
import os
import pickle
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base.errors import FlexstageError, ModelError, WorkerError
from flexstage.base.lazy import require_extra
from flexstage.base.progress import hand_over, update
from flexstage.elasticity.resources import cores
from flexstage.studies.explore.batches import (
    ONE_THREAD,
    FinishedBatch,
    Job,
    KeptBatches,
    deadly,
    joined,
)

if TYPE_CHECKING:
    from flexstage.studies.explore.cluster import Cluster


#: Time in which worker processes must start [s].
_STARTS = 60.0

#: Processes that a batch may end before it is to blame.
_TRIES = 3


class _Worker:
    """A process that computes one batch at a time."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs,), daemon=True)
        self.process.start()
        theirs.close()
        self.number: int | None = None

    def end(self, *, at_once: bool = True) -> None:
        """End it, amid its work if it has some."""
        self.connection.close()
        if at_once:
            self.process.kill()
        self.process.join()


def _serve(connection: Connection) -> None:
    """Compute what is asked for until the other end is closed, be it that its process was lost."""
    job: Job | None = None
    with suppress(EOFError, OSError):
        connection.send((True, None))
        while True:
            told = connection.recv()
            if isinstance(told, bytes):
                job = pickle.loads(told)
                continue
            assert job is not None
            try:
                answer: tuple[bool, Any] = (True, job.compute(told))
            except Exception as error:  # noqa: BLE001 - it goes on in the process that asked
                if not isinstance(error, FlexstageError):
                    error.add_note(traceback.format_exc())
                answer = (False, error)
            connection.send(answer)


class Pool:
    """Worker processes of this machine, which are there for one job after another."""

    def __init__(self) -> None:
        self._workers: list[_Worker] = []

    def start(self, count: int | None, batches: int) -> None:
        """Start processes where there are fewer than a number (every core), or than batches.

        Those that are still at the work of a job that failed or was left are ended first, as their
        answers would be taken for those of the next job.
        """
        for worker in [w for w in self._workers if w.number is not None]:
            worker.end()
            self._workers.remove(worker)
        missing = min(count or cores(), batches) - len(self._workers)
        self._workers += self._started(max(0, missing))

    def finished(
        self, job: Job, numbers: Sequence[int], wait_for: Callable[[str], None]
    ) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """Yield batches of a job as they are finished; `wait_for` is told why nothing goes on."""
        packed = pickle.dumps(job)
        left = list(reversed(numbers))
        ended: Counter[int] = Counter()  # processes, by the batch that each had
        for worker in self._workers:
            self._give(worker, left, packed)
        while busy := {w.connection: w for w in self._workers if w.number is not None}:
            for connection in wait(list(busy)):
                worker = busy[connection]  # type: ignore[index]
                number, worker.number = worker.number, None
                assert number is not None
                try:
                    came, found = worker.connection.recv()
                except (EOFError, OSError):
                    ended[number] += 1
                    if ended[number] == _TRIES:
                        raise deadly(job, number, _TRIES) from None
                    left.append(number)
                    wait_for("a worker ended, starting another one")
                    worker.end()
                    self._workers.remove(worker)
                    self._workers += self._started(1)
                    self._give(self._workers[-1], left, packed)
                    continue
                if not came:
                    raise found
                # it works on while this process keeps what it found
                self._give(worker, left)
                yield number, found

    def close(self, *, at_once: bool = False) -> None:
        """End the processes; `at_once` amid their work."""
        for worker in self._workers:
            worker.end(at_once=at_once)
        self._workers = []

    def _give(self, worker: _Worker, left: list[int], packed: bytes | None = None) -> None:
        """Give a worker the next batch, if there is one, of a job that it may not know yet."""
        if left:
            worker.number = left.pop()
            with suppress(OSError):  # it has ended, which is found where its answer is awaited
                if packed is not None:
                    worker.connection.send(packed)
                worker.connection.send(worker.number)

    def _started(self, count: int) -> list[_Worker]:
        with _for_workers():
            made = [_Worker() for _ in range(count)]
        deadline = time.monotonic() + _STARTS
        try:
            for worker in made:
                if not worker.connection.poll(max(0.0, deadline - time.monotonic())):
                    raise EOFError
                worker.connection.recv()
        except (EOFError, OSError):
            for worker in made:
                worker.end()
            raise WorkerError(
                "the worker processes do not start: compute with one worker, and put what a "
                'program does under `if __name__ == "__main__":`, as each of them imports it'
            ) from None
        return made


@contextmanager
def _for_workers() -> Iterator[None]:
    """Have processes that are started in this block use one thread each, and ignore Ctrl-C.

    A terminal sends it to all processes, and only this one knows what is to be kept.
    """
    before = dict(os.environ)
    os.environ.update(ONE_THREAD)
    masks = sys.platform != "win32"
    heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if masks else set()
    try:
        yield
    finally:
        if masks:
            signal.pthread_sigmask(signal.SIG_SETMASK, heard)
        for name in ONE_THREAD:
            del os.environ[name]
        os.environ.update({k: v for k, v in before.items() if k in ONE_THREAD})


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
            from flexstage.studies.explore.cluster import Cluster

            self._others = self._others or Cluster(self._scheduler)
        else:
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
    >>> from flexstage.studies.explore import Job
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
