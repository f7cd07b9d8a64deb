"""Long work outside the page: in a process of its own, or in a thread, with progress and cancel."""

import contextlib
import logging
import multiprocessing
import os
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, Literal

from flexstage.base.errors import FlexstageError, WorkerError
from flexstage.base.progress import listen

_LOG = logging.getLogger("flexstage.web")

State = Literal["waiting", "running", "done", "failed", "cancelled"]
_KEPT = 200  # finished jobs that are remembered
_AT_ONCE = 3  # a long job of one person leaves room for the short ones of others


class Cancelled(BaseException):
    """The work of a thread was cancelled; raised where it says how far it has come."""


@dataclass(eq=False)
class BackgroundJob:
    """A piece of long work; the page that started it may be gone."""

    name: str
    """What it is, for people."""
    owner: str = ""
    """Session that started it; empty where it belongs to the panel."""
    id: str = field(default_factory=lambda: secrets.token_urlsafe(9))
    """What it is found by."""
    state: State = "waiting"
    """How it stands."""
    what: str = ""
    """What it is doing."""
    share: float = 0.0
    """Which share is done, 0 to 1."""
    found: list[Any] = field(default_factory=list)
    """What it handed over on its way; nothing any more once it is done, as the result has it."""
    result: Any = None
    """What it gave, once it is done."""
    error: str = ""
    """Why it failed, in a sentence."""
    began: float = field(default_factory=time.time)
    """When it was started, by the clock of the computer [s]."""
    seconds: float = 0.0
    """How long it took [s]."""
    _cancel: threading.Event = field(default_factory=threading.Event)
    _ended: threading.Event = field(default_factory=threading.Event)

    @property
    def is_over(self) -> bool:
        """Whether it is done, failed or cancelled."""
        return self._ended.is_set()

    def cancel(self) -> None:
        """Ask it to end."""
        self._cancel.set()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it is over; say whether it is."""
        return self._ended.wait(timeout)

    def _tell(self, what: str, share: float) -> None:
        self.what, self.share = what, share

    def _end(self, state: State, result: Any = None, error: str = "") -> None:
        self.result, self.error, self.seconds = result, error, time.time() - self.began
        self.state = state
        if state == "done":
            self.found = []
        self._ended.set()


class Jobs:
    """The jobs of a panel.

    Parameters
    ----------
    at_once
        Processes that work at the same time: others wait.
    """

    def __init__(self, at_once: int | None = None) -> None:
        count = at_once or max(_AT_ONCE, os.cpu_count() or 1)
        self._room = threading.BoundedSemaphore(count)
        self._jobs: dict[str, BackgroundJob] = {}
        self._idle: list[_Worker] = []
        self._lock = threading.Lock()
        self._closed = False

    def start(
        self, name: str, function: Callable[..., Any], *arguments: Any, owner: str = ""
    ) -> BackgroundJob:
        """Have a function called in a process of its own.

        It is found by its module and name, and what it is given and returns is sent: no closures.
        Its `flexstage.base.progress` is the job's, and so is what it hands over; to cancel it ends
        the process.
        """
        job = self._new(name, owner)
        self._thread(job, lambda: self._in_process(job, function, arguments))
        return job

    def start_thread(
        self, name: str, function: Callable[..., Any], *arguments: Any, owner: str = ""
    ) -> BackgroundJob:
        """Have a function called in a thread: for work that waits, as for an instrument.

        To cancel raises `Cancelled` in it where it next says how far it has come.
        """
        job = self._new(name, owner)
        self._thread(job, lambda: _in_thread(job, function, arguments))
        return job

    def of(self, owner: str) -> list[BackgroundJob]:
        """Return the jobs of a session, the newest first."""
        with self._lock:
            return [job for job in reversed(self._jobs.values()) if job.owner == owner]

    def close(self) -> None:
        """Cancel all jobs and end the processes."""
        with self._lock:
            self._closed = True
            jobs, idle, self._idle = [*self._jobs.values()], self._idle, []
        for job in jobs:
            job.cancel()
        for worker in idle:
            worker.end()
        for job in jobs:
            job.wait(5.0)

    def _new(self, name: str, owner: str) -> BackgroundJob:
        job = BackgroundJob(name, owner)
        with self._lock:
            over = [each.id for each in self._jobs.values() if each.is_over]
            for old in over[: max(0, len(over) - _KEPT)]:
                del self._jobs[old]
            self._jobs[job.id] = job
        return job

    def _thread(self, job: BackgroundJob, work: Callable[[], None]) -> None:
        def guarded() -> None:
            try:
                work()
            except Exception as error:  # noqa: BLE001 - a job never ends silently
                _LOG.exception("the job '%s' failed", job.name)
                job._end("failed", error=f"{type(error).__name__}: {error}")

        threading.Thread(target=guarded, name=f"job {job.name}", daemon=True).start()

    def _in_process(self, job: BackgroundJob, function: Callable[..., Any], arguments: Any) -> None:
        while not self._room.acquire(timeout=0.1):
            if job._cancel.is_set():
                job._end("cancelled")
                return
        try:
            self._worked(job, function, arguments)
        finally:
            self._room.release()

    def _worked(self, job: BackgroundJob, function: Callable[..., Any], arguments: Any) -> None:
        with self._lock:
            worker = self._idle.pop() if self._idle else None
        worker = worker or _Worker()
        job.state = "running"
        kept = False
        try:
            worker.connection.send((function, arguments))
            kind, told = "progress", ["", 0.0]
            while kind in ("progress", "found"):
                job._tell(*told) if kind == "progress" else job.found.append(told[0])
                while not worker.connection.poll(0.1):
                    if job._cancel.is_set():
                        job._end("cancelled")
                        return
                kind, *told = worker.connection.recv()
            kept = True
            if kind == "done":
                job._tell("", 1.0)
                job._end("done", result=told[0])
            else:
                job._end("failed", error=told[0])
        except (EOFError, OSError) as error:
            raise WorkerError("its process was ended from outside: start it again") from error
        finally:
            with self._lock:
                # one idle process is kept for the next job
                kept = kept and not (self._closed or self._idle)
                if kept:
                    self._idle.append(worker)
            if not kept:
                worker.end()


def _in_thread(job: BackgroundJob, function: Callable[..., Any], arguments: Any) -> None:
    def tell(what: str, share: float) -> None:
        if job._cancel.is_set():
            raise Cancelled
        job._tell(what, share)

    job.state = "running"
    try:
        with listen(tell, job.found.append):
            result = function(*arguments)
    except Cancelled:
        job._end("cancelled")
    except FlexstageError as error:
        job._end("failed", error=str(error))
    else:
        job._tell("", 1.0)
        job._end("done", result=result)


class _Worker:
    """A process that does one job after another."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def end(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.join(5.0)
        self.connection.close()


def _work(connection: Connection) -> None:
    """Do what is sent, and say how far it has come, until the other end is closed."""
    import signal

    # an interrupt at the terminal is for the panel, which ends this process
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(5)  # the page, and what drives a stage, come first

    def tell(what: str, share: float) -> None:
        connection.send(("progress", what, share))

    def take(found: Any) -> None:
        connection.send(("found", found))

    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            try:
                function, arguments = connection.recv()
                with listen(tell, take):
                    answer = ("done", function(*arguments))
            except FlexstageError as error:
                answer = ("failed", str(error))
            except (EOFError, BrokenPipeError):
                raise
            except Exception as error:  # told in the page, and the process lives on
                logging.getLogger("flexstage.web").exception("a job failed")
                answer = ("failed", f"{type(error).__name__}: {error}")
            connection.send(answer)
