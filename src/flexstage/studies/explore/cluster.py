"""Batches on the workers of a Dask cluster, by the address of its scheduler."""

import asyncio
import logging
import os
import queue
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from typing import Any, cast

import dask.config
import numpy as np
from distributed import Client, Future, KilledWorker, Security, WorkerPlugin, get_worker
from distributed.comm.core import connect

from flexstage.base.errors import FlexstageError, WorkerError
from flexstage.studies.explore.batches import ONE_THREAD, Job, deadly, versions

#: Batches that a worker has been given at a time: one that it computes, and the next.
_AHEAD = 2

#: Time between looks at whether scheduler and workers are still there [s].
_LOOK = 1.0

#: Time in which a scheduler must answer [s].
_ANSWER = 10.0


class _Held(WorkerPlugin):
    """What every worker holds of a job, also one that joins later or in the place of a lost one."""

    def __init__(self, job: Job) -> None:
        self.job, self.versions = job, versions()

    def setup(self, worker: Any) -> None:
        os.environ.update(ONE_THREAD)


def _compute(held: str, number: int) -> dict[str, np.ndarray]:
    """Return a batch of the job that this worker holds."""
    worker = get_worker()
    own: _Held = worker.plugins[held]  # type: ignore[assignment]
    _require_same(f"worker {worker.address}", own.versions, versions())
    return own.job.compute(number)


class Cluster:
    """A Dask cluster, joined by the address of its scheduler."""

    def __init__(self, address: str) -> None:
        self._address = _encrypted(address)
        _require_scheduler(self._address)
        self._quiet = ExitStack()
        for handler in logging.getLogger("distributed").handlers:
            self._quiet.callback(handler.setLevel, handler.level)
            handler.setLevel(logging.CRITICAL)
        try:
            self._client = Client(self._address, timeout=_ANSWER, set_as_default=False)
        except OSError as error:
            self._quiet.close()
            raise self._lost() from error

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
                    if not self._threads():
                        wait("no worker is connected, waiting for one")
                    continue
                number = running.pop(future)
                try:
                    yield number, self._result(future)
                except KilledWorker as error:
                    if alone:
                        raise deadly(job, number, error.allowed_failures + 1) from error
                    suspects.append(number)
        finally:
            # a worker that is just lost does not answer, or has dropped it already
            with suppress(OSError, RuntimeError, KeyError, CancelledError):
                self._client.cancel(list(running))
                self._client.unregister_worker_plugin(held)

    def close(self, *, at_once: bool = False) -> None:
        """Leave the cluster: its workers are there for others."""
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
        return WorkerError(f"the scheduler at {self._address} was lost")


def _encrypted(address: str) -> str:
    """Return an address by TLS, if it says nothing else; refuse one whose traffic others can read.

    Scheduler, workers and this process run what they are sent.
    """
    if "://" not in address:
        address = f"tls://{address}"
    wants = dask.config.get("distributed.comm.require-encryption", None)
    if address.startswith(("tcp://", "ws://", "ucx://")) and wants is not False:
        raise WorkerError(
            f"{address} is not encrypted, and whoever reaches it has the workers run what they "
            "like: start the cluster with certificates and give its tls:// address "
            "(distributed.comm.tls in the configuration of Dask), or, in a network of trusted "
            "people alone, set distributed.comm.require-encryption there to false"
        )
    return address


def _require_scheduler(address: str) -> None:
    """Refuse an address at which no scheduler answers: a client there could not be closed."""
    with ThreadPoolExecutor(1) as thread:  # as there may be a loop in this one
        fault = thread.submit(asyncio.run, _fault_at(address)).result()
    if fault:
        raise WorkerError(
            f"no Dask scheduler answers at {address}: {fault}; give the address that it prints "
            "when it starts, such as tls://HOST:8786"
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
