"""Workers for the batches of a job: this process, local processes, or a cluster.

Local processes and clusters are used for long computations only.
"""

import multiprocessing
import os
import pickle
import signal
import sys
import threading
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
    StoredBatches,
    crash_error,
    joined,
)

if TYPE_CHECKING:
    from flexstage.studies.explore.cluster import Cluster


#: Timeout for the start of worker processes [s].
_START_TIMEOUT = 60.0

#: Number of crashes after which a batch is not repeated.
_CRASHES = 3


class _Worker:
    """A worker process, which computes one batch at a time."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, remote = context.Pipe()
        self.process = context.Process(target=_serve, args=(remote,), daemon=True)
        self.process.start()
        remote.close()
        self.number: int | None = None

    def end(self, *, at_once: bool = True) -> None:
        """End the process, by default without waiting for its batch."""
        self.connection.close()
        if at_once:
            self.process.kill()
        self.process.join()


def _serve(connection: Connection) -> None:
    """Compute requested batches until the connection is closed."""
    job: Job | None = None
    with suppress(EOFError, OSError):
        connection.send((True, None))
        while True:
            message = connection.recv()
            if isinstance(message, bytes):
                job = pickle.loads(message)
                continue
            assert job is not None
            try:
                answer: tuple[bool, Any] = (True, job.compute(message))
            except Exception as error:  # noqa: BLE001 - raised again in the parent process
                if not isinstance(error, FlexstageError):
                    error.add_note(traceback.format_exc())
                answer = (False, error)
            connection.send(answer)


class Pool:
    """Worker processes of this machine, for several jobs."""

    def __init__(self) -> None:
        self._workers: list[_Worker] = []

    def start(self, count: int | None, batches: int) -> None:
        """Start processes up to a number (by default all cores), at most one for each batch.

        Processes that still compute batches of a former job are ended first, as their answers would
        be mistaken for those of the next job.
        """
        for worker in [w for w in self._workers if w.number is not None]:
            worker.end()
            self._workers.remove(worker)
        missing = min(count or cores(), batches) - len(self._workers)
        self._workers += self._new_workers(max(0, missing))

    def finished(
        self, job: Job, numbers: Sequence[int], wait_for: Callable[[str], None]
    ) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """Yield batches of a job when they are finished; `wait_for` gets the reason for a delay."""
        job_bytes = pickle.dumps(job)
        remaining = list(reversed(numbers))
        crashes: Counter[int] = Counter()  # by batch
        for worker in self._workers:
            self._assign(worker, remaining, job_bytes)
        while busy := {w.connection: w for w in self._workers if w.number is not None}:
            for connection in wait(list(busy)):
                worker = busy[connection]  # type: ignore[index]
                number, worker.number = worker.number, None
                assert number is not None
                try:
                    successful, answer = worker.connection.recv()
                except (EOFError, OSError):
                    crashes[number] += 1
                    if crashes[number] == _CRASHES:
                        raise crash_error(job, number, _CRASHES) from None
                    remaining.append(number)
                    wait_for("a worker ended, starting another one")
                    worker.end()
                    self._workers.remove(worker)
                    self._workers += self._new_workers(1)
                    self._assign(self._workers[-1], remaining, job_bytes)
                    continue
                if not successful:
                    raise answer
                # the worker continues while this process stores its batch
                self._assign(worker, remaining)
                yield number, answer

    def close(self, *, at_once: bool = False) -> None:
        """End the processes; `at_once` without waiting for their batches."""
        for worker in self._workers:
            worker.end(at_once=at_once)
        self._workers = []

    def _assign(
        self, worker: _Worker, remaining: list[int], job_bytes: bytes | None = None
    ) -> None:
        """Assign the next batch, if any, to a worker; with the job if that is new to it."""
        if remaining:
            worker.number = remaining.pop()
            with suppress(OSError):  # a worker that ended is noticed when its answer is read
                if job_bytes is not None:
                    worker.connection.send(job_bytes)
                worker.connection.send(worker.number)

    def _new_workers(self, count: int) -> list[_Worker]:
        with _environment_of_workers():
            workers = [_Worker() for _ in range(count)]
        deadline = time.monotonic() + _START_TIMEOUT
        try:
            for worker in workers:
                if not worker.connection.poll(max(0.0, deadline - time.monotonic())):
                    raise EOFError
                worker.connection.recv()
        except (EOFError, OSError):
            for worker in workers:
                worker.end()
            raise WorkerError(
                "the worker processes do not start: compute with one worker, and put the code "
                'of a program under `if __name__ == "__main__":`, as each process imports it'
            ) from None
        return workers


@contextmanager
def _environment_of_workers() -> Iterator[None]:
    """Let processes that start in this block use one thread each, and ignore Ctrl-C.

    A terminal sends Ctrl-C to all processes; this one alone handles it.
    """
    before = dict(os.environ)
    os.environ.update(ONE_THREAD)
    posix = sys.platform != "win32"
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if posix else set()
    handler = signal.getsignal(signal.SIGPIPE) if posix else None
    if handler is not None and threading.current_thread() is threading.main_thread():
        # a library such as Gmsh restores its default, by which a lost worker ends this process
        signal.signal(signal.SIGPIPE, handler)
    try:
        yield
    finally:
        if posix:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for name in ONE_THREAD:
            del os.environ[name]
        os.environ.update({k: v for k, v in before.items() if k in ONE_THREAD})


#: Total computing time from which work is shared [s]; workers need about two seconds to start.
_WORTH_SHARING = 4.0

#: Time before the remaining time is estimated: the first batch may compile code [s].
_FIRST_ESTIMATE = 1.0


class Workers:
    """Workers, started on the first long job, and used for later ones.

    Parameters
    ----------
    count
        Number of processes; by default one for each core.
    scheduler
        Address of the scheduler of a Dask cluster, which then computes all batches.
    """

    def __init__(self, count: int | None = None, scheduler: str | None = None) -> None:
        if count is not None and count < 1:
            raise ModelError(f"the number of workers must be 1 or more, got {count}")
        if count is not None and scheduler is not None:
            raise ModelError(
                "a cluster defines its number of workers: give a number of workers or the address "
                "of a scheduler, not both"
            )
        if getattr(multiprocessing.current_process(), "_inheriting", False):
            raise WorkerError(
                'a program must use workers under `if __name__ == "__main__":`, as each worker '
                "process imports it"
            )
        if scheduler is not None:
            require_extra("explore", "distributed", "work on a cluster", WorkerError)
        self._count, self._scheduler = count, scheduler
        # a worker process of another program cannot start workers
        self._alone = count == 1 or multiprocessing.current_process().daemon
        self._others: Cluster | Pool | None = None
        self._worked = 0.0  # computing time of this process [s]

    def run(self, job: Job, keep: Path | None = None) -> dict[str, np.ndarray]:
        """Return the arrays of a job, with the rows of all batches in order.

        Each finished batch is stored in the folder `keep`; stored batches of the same job are not
        computed again.

        Raises
        ------
        WorkerError
            Workers or scheduler were lost, or a batch crashed several workers.
        RecordError
            The folder has batches of another job.
        """
        store = None if keep is None else StoredBatches(keep, job)
        parts: dict[int, dict[str, np.ndarray]] = {}
        for number in range(job.batches) if store else ():
            arrays = store.read(number) if store else None
            if arrays is not None:
                parts[number] = arrays
                _hand_over(job, number, arrays)
        progress = _Progress(job, len(parts))
        try:
            for number, arrays in self._computed(job, parts, progress):
                if store:
                    store.store(number, arrays)
                parts[number] = arrays
                _hand_over(job, number, arrays)
                progress.report(len(parts))
        except WorkerError as error:
            if not parts:
                raise
            raise WorkerError(f"{error}; {_stored_note(job, store, len(parts))}") from error
        return joined(parts.pop(number) for number in range(job.batches))

    def close(self, *, at_once: bool = False) -> None:
        """End the workers or disconnect from the cluster; `at_once` without waiting for batches."""
        if self._others is not None:
            self._others.close(at_once=at_once)
            self._others = None

    def _computed(
        self, job: Job, finished: dict[int, dict[str, np.ndarray]], progress: "_Progress"
    ) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """Yield the remaining batches of a job, in the order in which they are finished."""
        remaining = [number for number in range(job.batches) if number not in finished]
        progress.report(len(finished))
        each = float("inf")
        while remaining and not self._worth_sharing(each, len(remaining)):
            began = time.perf_counter()
            arrays = job.compute(remaining[0])
            seconds = time.perf_counter() - began
            each, self._worked = min(each, seconds), self._worked + seconds
            yield remaining.pop(0), arrays
        if remaining:
            if self._others is None:
                cluster = self._scheduler is not None
                progress.wait("joining the cluster" if cluster else "starting workers")
            yield from self._shared(len(remaining)).finished(job, remaining, progress.wait)

    def _worth_sharing(self, each: float, batches: int) -> bool:
        if self._alone or self._scheduler is not None or self._others is not None:
            return not self._alone
        total = self._worked + batches * each
        return self._worked > _FIRST_ESTIMATE and batches > 1 and total > _WORTH_SHARING

    def _shared(self, batches: int) -> "Cluster | Pool":
        if self._scheduler is not None:
            from flexstage.studies.explore.cluster import Cluster

            self._others = self._others or Cluster(self._scheduler)
        else:
            self._others = pool = self._others if isinstance(self._others, Pool) else Pool()
            pool.start(self._count, batches)
        return self._others


def _hand_over(job: Job, number: int, arrays: dict[str, np.ndarray]) -> None:
    # a copy of the dictionary, as `joined` empties the other
    hand_over(FinishedBatch(job=job.name, start=job.span(number)[0], arrays=dict(arrays)))


@contextmanager
def open_workers(count: int | None = None, scheduler: str | None = None) -> Iterator[Workers]:
    """Yield workers for the jobs in this block; they end with it, at once after an error.

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
    """Progress of a job: number of finished batches, and remaining time."""

    def __init__(self, job: Job, done: int) -> None:
        self._job, self._before = job, done
        self._began = time.monotonic()
        self._done = done

    def report(self, done: int) -> None:
        """Report the number of finished batches and the remaining time."""
        self._done = done
        computed, remaining = done - self._before, self._job.batches - done
        note = ""
        if computed and remaining:
            seconds = time.monotonic() - self._began
            note = f", {duration(seconds / computed * remaining)} left"
        self._update(note)

    def wait(self, reason: str) -> None:
        """Report the reason for a delay."""
        self._update(f", {reason}")

    def _update(self, note: str) -> None:
        job = self._job
        update(f"{job.name}, {self._done} of {job.batches} batches{note}", self._done / job.batches)


def duration(seconds: float) -> str:
    """Return a duration as text, in its two largest units.

    Examples
    --------
    >>> duration(7.4), duration(70.0), duration(7500.0), duration(266400.0)
    ('7 s', '1 min 10 s', '2 h 5 min', '3 d 2 h')
    """
    remainder = round(seconds)
    if remainder < 60:
        return f"{remainder} s"
    units = (("d", 86400), ("h", 3600), ("min", 60), ("s", 1))
    first = next(i for i, (_, size) in enumerate(units) if remainder >= size)
    parts = []
    for name, size in units[first : first + 2]:
        number, remainder = divmod(remainder, size)
        parts.append(f"{number} {name}")
    return " ".join(parts)


def _stored_note(job: Job, store: StoredBatches | None, done: int) -> str:
    if store is None:
        return "no batch is stored, as there is no folder for finished batches"
    return (
        f"{done} of {job.batches} batches are stored in {store.folder}: run the same command again "
        "to resume"
    )
