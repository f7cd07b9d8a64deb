"""Batches on worker processes of this machine, each at the other end of a pipe of its own."""

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
from typing import Any

import numpy as np

from flexstage.elasticity.resources import cores
from flexstage.errors import FlexstageError, WorkerError
from flexstage.explore.batches import Job, deadly

#: Time in which worker processes must start [s].
_STARTS = 60.0

#: Processes that a batch may end before it is to blame.
_TRIES = 3

#: Workers are the parallelism, and threads of a library in each would only wait for one another.
ONE_THREAD = {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NGS", "NUMBA")
}


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
