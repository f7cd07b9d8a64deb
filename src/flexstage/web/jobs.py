"""Background jobs with progress and cancellation, and the STOP button of connected stages."""

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
_MAX_FINISHED = 200  # finished jobs in the list
_MIN_PROCESSES = 3  # so that a long job of one user does not block short ones of others


class Cancelled(BaseException):
    """The job of a thread was cancelled; its next progress update raises this."""


@dataclass(eq=False)
class BackgroundJob:
    """A background job; it outlives the page that started it."""

    name: str
    """Name for users."""
    owner: str = ""
    """Session that started the job; empty for a job of the panel."""
    id: str = field(default_factory=lambda: secrets.token_urlsafe(9))
    """Identifier."""
    state: State = "waiting"
    """State of the job."""
    activity: str = ""
    """Present activity."""
    share: float = 0.0
    """Completed share, 0 to 1."""
    partial_results: list[Any] = field(default_factory=list)
    """Results so far; empty once the job is done, as `result` contains them."""
    result: Any = None
    """Result of a job that is done."""
    error: str = ""
    """Message of a failed job."""
    began: float = field(default_factory=time.time)
    """Start time, by the clock of the computer [s]."""
    seconds: float = 0.0
    """Duration [s]."""
    _cancel: threading.Event = field(default_factory=threading.Event)
    _end_event: threading.Event = field(default_factory=threading.Event)

    @property
    def is_over(self) -> bool:
        """The job is done, failed or cancelled."""
        return self._end_event.is_set()

    def cancel(self) -> None:
        """Request the end of the job."""
        self._cancel.set()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the end of the job; return whether it is over."""
        return self._end_event.wait(timeout)

    def _update(self, activity: str, share: float) -> None:
        self.activity, self.share = activity, share

    def _end(self, state: State, result: Any = None, error: str = "") -> None:
        self.result, self.error, self.seconds = result, error, time.time() - self.began
        self.state = state
        if state == "done":
            self.partial_results = []
        self._end_event.set()


class Jobs:
    """The jobs of a panel.

    Parameters
    ----------
    at_once
        Largest number of processes; further jobs wait.
    """

    def __init__(self, at_once: int | None = None) -> None:
        count = at_once or max(_MIN_PROCESSES, os.cpu_count() or 1)
        self._slots = threading.BoundedSemaphore(count)
        self._jobs: dict[str, BackgroundJob] = {}
        self._idle: list[_Worker] = []
        self._lock = threading.Lock()
        self._is_closed = False

    def start(
        self, name: str, function: Callable[..., Any], *arguments: Any, owner: str = ""
    ) -> BackgroundJob:
        """Call a function in a worker process.

        The function, its arguments and its result are pickled, so that it cannot be a closure. Its
        `flexstage.base.progress` and its partial results reach the job. Cancelling kills the
        process.
        """
        job = self._new(name, owner)
        self._thread(job, lambda: self._in_process(job, function, arguments))
        return job

    def start_thread(
        self, name: str, function: Callable[..., Any], *arguments: Any, owner: str = ""
    ) -> BackgroundJob:
        """Call a function in a thread: for jobs that wait, such as for an instrument.

        Cancelling raises `Cancelled` in its next progress update.
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
            self._is_closed = True
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
            finished = [each.id for each in self._jobs.values() if each.is_over]
            for old in finished[: max(0, len(finished) - _MAX_FINISHED)]:
                del self._jobs[old]
            self._jobs[job.id] = job
        return job

    def _thread(self, job: BackgroundJob, work: Callable[[], None]) -> None:
        def guarded() -> None:
            try:
                work()
            except Exception as error:  # noqa: BLE001 - every failure of a job is reported
                _LOG.exception("the job '%s' failed", job.name)
                job._end("failed", error=f"{type(error).__name__}: {error}")

        threading.Thread(target=guarded, name=f"job {job.name}", daemon=True).start()

    def _in_process(self, job: BackgroundJob, function: Callable[..., Any], arguments: Any) -> None:
        while not self._slots.acquire(timeout=0.1):
            if job._cancel.is_set():
                job._end("cancelled")
                return
        try:
            self._run_in_worker(job, function, arguments)
        finally:
            self._slots.release()

    def _run_in_worker(
        self, job: BackgroundJob, function: Callable[..., Any], arguments: Any
    ) -> None:
        with self._lock:
            worker = self._idle.pop() if self._idle else None
        worker = worker or _Worker()
        job.state = "running"
        reusable = False
        try:
            worker.connection.send((function, arguments))
            kind = "progress"
            payload: list[Any] = ["", 0.0]
            while kind in ("progress", "partial"):
                job._update(*payload) if kind == "progress" else job.partial_results.append(
                    payload[0]
                )
                # one that reports without a pause is cancelled, too
                while not (job._cancel.is_set() or worker.connection.poll(0.1)):
                    pass
                if job._cancel.is_set():
                    job._end("cancelled")
                    return
                kind, *payload = worker.connection.recv()
            reusable = True
            if kind == "done":
                job._update("", 1.0)
                job._end("done", result=payload[0])
            else:
                job._end("failed", error=payload[0])
        except (EOFError, OSError) as error:
            raise WorkerError("its process was killed: start it again") from error
        finally:
            with self._lock:
                # the next job reuses one idle process
                reusable = reusable and not (self._is_closed or self._idle)
                if reusable:
                    self._idle.append(worker)
            if not reusable:
                worker.end()


def _in_thread(job: BackgroundJob, function: Callable[..., Any], arguments: Any) -> None:
    def update(activity: str, share: float) -> None:
        if job._cancel.is_set():
            raise Cancelled
        job._update(activity, share)

    job.state = "running"
    try:
        with listen(update, job.partial_results.append):
            result = function(*arguments)
    except Cancelled:
        job._end("cancelled")
    except FlexstageError as error:
        job._end("failed", error=str(error))
    else:
        job._update("", 1.0)
        job._end("done", result=result)


class _Worker:
    """A worker process for one job after another."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def end(self) -> None:
        """Kill the process."""
        self._process.kill()
        self._process.join(5.0)
        self.connection.close()


def _work(connection: Connection) -> None:
    """Call the received functions and report their progress, until the connection is closed."""
    import signal

    # the panel handles an interrupt at the terminal, and ends this process
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(5)  # the page and the bench have priority

    def send_progress(activity: str, share: float) -> None:
        connection.send(("progress", activity, share))

    def send_partial(partial: Any) -> None:
        connection.send(("partial", partial))

    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            try:
                function, arguments = connection.recv()
                with listen(send_progress, send_partial):
                    answer = ("done", function(*arguments))
            except FlexstageError as error:
                answer = ("failed", str(error))
            except (EOFError, BrokenPipeError):
                raise
            except Exception as error:  # reported in the page; the process continues
                logging.getLogger("flexstage.web").exception("a job failed")
                answer = ("failed", f"{type(error).__name__}: {error}")
            connection.send(answer)


class EmergencyStop:
    """The connected stages, each with the function that stops it.

    Examples
    --------
    >>> emergency_stop = EmergencyStop()
    >>> emergency_stop.add("twin", lambda: print("stopped")); emergency_stop.active
    True
    >>> emergency_stop.stop()
    stopped
    """

    def __init__(self) -> None:
        self._stops: dict[str, Callable[[], object]] = {}
        self._lock = threading.Lock()
        self.active = False

    def add(self, name: str, stop: Callable[[], object]) -> None:
        """Add a stage; `stop` may be called at any time, from any thread."""
        with self._lock:
            self._stops[name] = stop
            self.active = True

    def remove(self, name: str) -> None:
        """Remove a stage that is no longer connected."""
        with self._lock:
            self._stops.pop(name, None)
            self.active = bool(self._stops)

    def stop(self) -> None:
        """Stop all stages; the failure of one does not keep the others from being stopped."""
        with self._lock:
            functions = dict(self._stops)
        for name, stop in functions.items():
            try:
                stop()
            except Exception:  # noqa: BLE001 - the other stages are stopped in any case
                _LOG.exception("stopping '%s' failed", name)
