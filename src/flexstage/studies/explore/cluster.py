"""Computation of batches on a Dask cluster, by the address of its scheduler."""

import asyncio
import logging
import os
import queue
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from threading import Thread
from typing import Any, cast

import dask.config
import numpy as np
from distributed import Client, Future, KilledWorker, Security, WorkerPlugin, get_worker
from distributed.comm.core import connect

from flexstage.base.errors import FlexstageError, WorkerError
from flexstage.studies.explore.batches import ONE_THREAD, Job, crash_error, versions

#: Number of batches at a worker: the current one and the next.
_QUEUE_LENGTH = 2

#: Time between two checks of scheduler and workers [s].
_POLL = 1.0

#: Timeout for an answer of the scheduler [s].
_TIMEOUT = 10.0


class _JobPlugin(WorkerPlugin):
    """The job at each worker, also at one that joins later."""

    def __init__(self, job: Job) -> None:
        self.job, self.versions = job, versions()

    def setup(self, worker: Any) -> None:
        os.environ.update(ONE_THREAD)


def _compute(name: str, number: int) -> dict[str, np.ndarray]:
    """Return a batch of the job with a plugin name, on a worker."""
    worker = get_worker()
    plugin: _JobPlugin = worker.plugins[name]  # type: ignore[assignment]
    _require_same(f"worker {worker.address}", plugin.versions, versions())
    return plugin.job.compute(number)


class Cluster:
    """A Dask cluster by the address of its scheduler."""

    def __init__(self, address: str) -> None:
        self._address = _encrypted(address)
        _require_scheduler(self._address)
        self._quiet = ExitStack()
        for handler in logging.getLogger("distributed").handlers:
            self._quiet.callback(handler.setLevel, handler.level)
            handler.setLevel(logging.CRITICAL)
        try:
            self._client = Client(self._address, timeout=_TIMEOUT, set_as_default=False)
        except OSError as error:
            self._quiet.close()
            raise self._lost() from error
        # waits of Dask that end with its loop would be printed; a fault of a batch is raised
        cast(Any, self._client.loop).asyncio_loop.set_exception_handler(lambda *_: None)

    def finished(
        self, job: Job, numbers: Sequence[int], wait: Callable[[str], None]
    ) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """Yield batches of a job when they are finished; `wait` receives the reason for a delay."""
        self._require_same_versions()
        name = f"flexstage-{uuid.uuid4().hex}"
        self._client.register_plugin(_JobPlugin(job), name=name)
        ended: queue.Queue[Future] = queue.Queue()
        running: dict[Future, int] = {}
        remaining = list(reversed(numbers))
        # Dask reports all batches of a worker that died: each of them is repeated alone
        suspects: list[int] = []
        alone = False
        try:
            while remaining or suspects or running:
                if not running:
                    alone = bool(suspects)
                source = suspects if alone else remaining
                room = 1 if alone else _QUEUE_LENGTH * self._threads()
                while source and len(running) < room and (alone or not suspects):
                    number = source.pop()
                    future = self._client.submit(
                        _compute, name, number, key=f"{name}-{uuid.uuid4().hex}", pure=False
                    )
                    running[future] = number
                    future.add_done_callback(ended.put)
                try:
                    future = ended.get(timeout=_POLL)
                except queue.Empty:
                    if not self._threads():
                        wait("no worker is connected, waiting for one")
                    continue
                number = running.pop(future)
                try:
                    yield number, self._result(future)
                except KilledWorker as error:
                    if alone:
                        raise crash_error(job, number, error.allowed_failures + 1) from error
                    suspects.append(number)
        finally:
            # a cluster that does not answer any more must not hold up Ctrl-C
            cleanup = Thread(target=self._forget, args=(list(running), name), daemon=True)
            cleanup.start()
            cleanup.join(_TIMEOUT)

    def _forget(self, running: list[Future], name: str) -> None:
        # a lost worker does not answer, or has no plugin any more
        with suppress(OSError, RuntimeError, KeyError, CancelledError):
            self._client.cancel(running)
            self._client.unregister_worker_plugin(name)

    def close(self, *, at_once: bool = False) -> None:
        """Disconnect from the cluster, whose workers continue for others."""
        self._client.close()
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
        """Reject a cluster with other versions, whose numbers could differ."""
        local = versions()
        libraries = [name for name in local if name != "python"]
        try:
            remote = cast(dict, self._client.get_versions(packages=libraries))
        except (OSError, RuntimeError, CancelledError) as error:
            raise self._lost() from error
        workers = {f"worker {address}": info for address, info in remote["workers"].items()}
        for name, info in {"the scheduler": remote["scheduler"], **workers}.items():
            packages: dict[str, Any] = info["packages"]
            python = ".".join(str(packages["python"]).split(".")[:2])
            _require_same(
                name, local, {**{key: packages.get(key) for key in local}, "python": python}
            )

    def _lost(self) -> WorkerError:
        return WorkerError(f"the connection to the scheduler at {self._address} was lost")


def _encrypted(address: str) -> str:
    """Return an address with TLS as the default protocol; reject an unencrypted connection.

    Scheduler, workers and this process execute the code that they receive.
    """
    if "://" not in address:
        address = f"tls://{address}"
    wants = dask.config.get("distributed.comm.require-encryption", None)
    if address.startswith(("tcp://", "ws://", "ucx://")) and wants is not False:
        raise WorkerError(
            f"{address} is not encrypted: anyone with access to it can run code on the workers. "
            "Start the cluster with certificates and give its tls:// address (distributed.comm.tls "
            "in the configuration of Dask), or set distributed.comm.require-encryption there to "
            "false, in a network of trusted users only"
        )
    return address


def _require_scheduler(address: str) -> None:
    """Reject an address without a scheduler, as a client for it could not be closed."""
    with ThreadPoolExecutor(1) as thread:  # as this thread may have an event loop
        fault = thread.submit(asyncio.run, _fault_at(address)).result()
    if fault:
        raise WorkerError(
            f"no Dask scheduler answers at {address}: {fault}; give the address that the scheduler "
            "prints at its start, such as tls://HOST:8786"
        )


async def _fault_at(address: str) -> str | None:
    """Return the fault of the address of a scheduler, if any."""
    secured = Security().get_connection_args("client")
    try:
        async with asyncio.timeout(_TIMEOUT):
            comm = await connect(address, timeout=_TIMEOUT, **secured)
            try:
                await comm.write({"op": "identity", "reply": True})
                kind = (await comm.read()).get("type")
            finally:
                comm.abort()
    except TimeoutError:
        return f"no answer of Dask within {_TIMEOUT:g} s"
    except TypeError:  # there are no certificates
        return "tls:// needs certificates, distributed.comm.tls in the configuration of Dask"
    except (OSError, ValueError) as error:
        return " ".join(str(error).split()) or type(error).__name__
    return None if kind == "Scheduler" else f"it is a {kind}"


def _require_same(owner: str, local: dict[str, str], remote: dict[str, Any]) -> None:
    for name, version in local.items():
        if remote.get(name) != version:
            has = f"{name} {remote[name]}" if remote.get(name) else f"no {name}"
            raise WorkerError(
                f"{owner} has {has} and this computer {name} {version}: numbers could differ; "
                "install the same on all of them"
            )
