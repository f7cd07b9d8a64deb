"""Batches on Dask: worker processes of this machine, or those of a cluster by its scheduler."""

import asyncio
import logging
import os
import queue
import signal
import sys
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, cast

import dask.config
import numpy as np
import psutil
from dask.system import CPU_COUNT
from distributed import (
    Client,
    Future,
    KilledWorker,
    LocalCluster,
    Security,
    Status,
    WorkerPlugin,
    get_worker,
)
from distributed.comm.core import connect

from flexstage.errors import FlexstageError, WorkerError
from flexstage.explore.batches import Job
from flexstage.explore.kept_batches import versions

#: Batches that a worker has been given at a time: one that it computes, and the next.
_AHEAD = 2

#: Time between looks at whether scheduler and workers are still there [s].
_LOOK = 1.0

#: Time in which a scheduler must answer [s].
_ANSWER = 10.0

#: Time in which worker processes must start [s].
_STARTS = 60.0

#: Workers are the parallelism, and threads of a library in each would only wait for one another.
_ONE_THREAD = {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NGS", "NUMBA")
}

#: Dask has workers give memory back at once, and every array is then fetched anew from the system:
#: batches of the lumped model took three times as long. Read when a process starts.
_KEEPS_MEMORY = {"MALLOC_TRIM_THRESHOLD_": 2**28, "MALLOC_MMAP_THRESHOLD_": 2**25}


class _Held(WorkerPlugin):
    """What every worker holds of a job, also one that joins later or in the place of a lost one."""

    def __init__(self, job: Job) -> None:
        self.job, self.versions = job, versions()

    def setup(self, worker: Any) -> None:
        os.environ.update(_ONE_THREAD)


def _compute(held: str, number: int) -> dict[str, np.ndarray]:
    """Return a batch of the job that this worker holds."""
    worker = get_worker()
    own: _Held = worker.plugins[held]  # type: ignore[assignment]
    _require_same(f"worker {worker.address}", own.versions, versions())
    return own.job.compute(number)


class Cluster:
    """A scheduler of Dask and its workers: started here, or joined by an address."""

    def __init__(self, address: str | None) -> None:
        if address is not None:
            _require_scheduler(address)
        self._address = address
        self._quiet = ExitStack()
        for handler in logging.getLogger("distributed").handlers:
            self._quiet.callback(handler.setLevel, handler.level)
            handler.setLevel(logging.CRITICAL)
        self._local: LocalCluster | None = None
        if address is None:
            self._local = _started()
        try:
            self._client = Client(self._local or address, timeout=_ANSWER, set_as_default=False)
        except OSError as error:
            self._quiet.close()
            raise self._lost() from error

    def start(self, count: int | None, batches: int) -> None:
        """Start processes where there are fewer than a number (every core), or than batches."""
        assert self._local is not None
        wanted = min(count or CPU_COUNT, batches)
        if wanted <= len(self._local.workers):
            return
        deadline = time.monotonic() + _STARTS
        failed = False
        environment = {"distributed.nanny.pre-spawn-environ": _ONE_THREAD | _KEEPS_MEMORY}
        with dask.config.set(environment):  # read when workers are made, in another thread
            self._local.scale(wanted)
            while time.monotonic() < deadline and not failed:
                with suppress(TimeoutError):
                    self._client.wait_for_workers(wanted, timeout=_LOOK)
                    return
                failed = any(n.status == Status.failed for n in self._local.workers.values())
        raise WorkerError(
            "the worker processes do not start: compute with one worker, and put what a program "
            'does under `if __name__ == "__main__":`, as each of them imports it'
        )

    def finished(
        self, job: Job, numbers: Sequence[int], wait: Callable[[str], None]
    ) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """Yield batches of a job as they are finished; `wait` is told why nothing goes on."""
        self._require_same_versions()
        held = f"flexstage-{uuid.uuid4().hex}"
        self._client.register_plugin(_Held(job), name=held)
        ended: queue.Queue[Future] = queue.Queue()
        running: dict[Future, int] = {}
        left = list(reversed(numbers))
        # Dask blames all batches that a worker had when it died: each of them is tried alone
        suspects: list[int] = []
        alone = False
        seen = time.monotonic()  # a worker
        try:
            while left or suspects or running:
                if not running:
                    alone = bool(suspects)
                source = suspects if alone else left
                room = 1 if alone else _AHEAD * self._threads()
                while source and len(running) < room and (alone or not suspects):
                    number = source.pop()
                    future = self._client.submit(
                        _compute, held, number, key=f"{held}-{uuid.uuid4().hex}", pure=False
                    )
                    running[future] = number
                    future.add_done_callback(ended.put)
                try:
                    future = ended.get(timeout=_LOOK)
                except queue.Empty:
                    if self._threads():
                        seen = time.monotonic()
                        continue
                    wait("no worker is connected, waiting for one")
                    if self._local is not None and time.monotonic() - seen > _STARTS:
                        raise WorkerError(
                            "no worker process is left, and none starts again"
                        ) from None
                    continue
                seen = time.monotonic()
                number = running.pop(future)
                try:
                    yield number, self._result(future)
                except KilledWorker as error:
                    if alone:
                        raise _deadly(job, number, error) from error
                    suspects.append(number)
        finally:
            # a worker that is just lost does not answer, or has dropped it already
            with suppress(OSError, RuntimeError, KeyError, CancelledError):
                self._client.cancel(list(running))
                if self._local is None or not (left or running or suspects):
                    self._client.unregister_worker_plugin(held)

    def close(self, *, at_once: bool = False) -> None:
        """End the workers that were started, or leave the cluster; `at_once` amid their work."""
        if self._local is not None and at_once:
            for nanny in self._local.workers.values():
                nanny.close_gracefully()  # and do not start another process
                if nanny.pid:
                    psutil.Process(nanny.pid).kill()
        self._client.close()
        if self._local is not None:
            self._local.close()
        self._quiet.close()

    def _threads(self) -> int:
        try:
            return sum(cast(dict, self._client.nthreads()).values())
        except (OSError, RuntimeError, CancelledError) as error:
            raise self._lost() from error

    def _result(self, future: Future) -> dict[str, np.ndarray]:
        try:
            return future.result()
        except FlexstageError:
            raise
        except (CancelledError, OSError) as error:
            raise self._lost() from error

    def _require_same_versions(self) -> None:
        """Refuse a cluster whose scheduler or workers would give other numbers, or none."""
        own = versions()
        libraries = [name for name in own if name != "python"]
        try:
            found = cast(dict, self._client.get_versions(packages=libraries))
        except (OSError, RuntimeError, CancelledError) as error:
            raise self._lost() from error
        theirs = {f"worker {address}": said for address, said in found["workers"].items()}
        for who, said in {"the scheduler": found["scheduler"], **theirs}.items():
            packages: dict[str, Any] = said["packages"]
            python = ".".join(str(packages["python"]).split(".")[:2])
            _require_same(
                who, own, {**{name: packages.get(name) for name in own}, "python": python}
            )

    def _lost(self) -> WorkerError:
        return WorkerError(f"the scheduler at {self._address or 'this machine'} was lost")


def _started() -> LocalCluster:
    """Return a scheduler in this process, whose workers are processes of this machine."""
    options: dict[str, Any] = {
        "n_workers": 0,
        "threads_per_worker": 1,
        "memory_limit": None,
        "silence_logs": logging.CRITICAL,
        # its pages are shown nowhere, and need no port that another one may have
        "dashboard_address": "127.0.0.1:0",
        "scheduler_kwargs": {"dashboard": False},
    }
    with _unheard():
        return LocalCluster(**options)


@contextmanager
def _unheard() -> Iterator[None]:
    """Have the threads that are started in this block, and their processes, ignore Ctrl-C.

    A terminal sends it to all processes, and only this one knows what is to be kept.
    """
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _require_scheduler(address: str) -> None:
    """Refuse an address at which no scheduler answers: a client there could not be closed."""
    with ThreadPoolExecutor(1) as thread:  # as there may be a loop in this one
        fault = thread.submit(asyncio.run, _fault_at(address)).result()
    if fault:
        raise WorkerError(
            f"no Dask scheduler answers at {address}: {fault}; give the address that it prints "
            "when it starts, such as tcp://HOST:8786"
        )


async def _fault_at(address: str) -> str | None:
    """Return what is wrong with the address of a scheduler, if anything."""
    secured = Security().get_connection_args("client")
    try:
        async with asyncio.timeout(_ANSWER):
            comm = await connect(address, timeout=_ANSWER, **secured)
            try:
                await comm.write({"op": "identity", "reply": True})
                kind = (await comm.read()).get("type")
            finally:
                comm.abort()
    except TimeoutError:
        return f"nothing of Dask came within {_ANSWER:g} s"
    except TypeError:  # it has no certificates
        return "tls:// needs certificates, distributed.comm.tls in the configuration of Dask"
    except (OSError, ValueError) as error:
        return " ".join(str(error).split()) or type(error).__name__
    return None if kind == "Scheduler" else f"it is a {kind}"


def _require_same(who: str, own: dict[str, str], found: dict[str, Any]) -> None:
    for name, version in own.items():
        if found.get(name) != version:
            has = f"{name} {found[name]}" if found.get(name) else f"no {name}"
            raise WorkerError(
                f"{who} has {has} and this computer {name} {version}: numbers could differ; "
                "install the same on all of them"
            )


def _deadly(job: Job, number: int, error: KilledWorker) -> WorkerError:
    start, stop = job.span(number)
    return WorkerError(
        f"batch {number} of {job.name} (samples {start} to {stop - 1}) ended the process of its "
        f"worker {error.allowed_failures + 1} times: it needs more memory than there is, or a "
        "library fails on a sample; compute it with one worker to see"
    )
