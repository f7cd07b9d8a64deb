"""A guard that stops the stage however a run ends: error, Ctrl-C, signal or timeout."""

import _thread
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any, Self

from flexstage.base.errors import ControllerError
from flexstage.instruments.protocol import Instrument
from flexstage.instruments.ramp import to_safe

#: Signals that end a run: Ctrl-C, termination, a closed terminal.
_ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


class Guard:
    """Guard of an instrument while a block runs; created by `guarded`."""

    def __init__(
        self, instrument: Instrument, *, lead_to_safe: bool = True, timeout: float | None = None
    ) -> None:
        self._instrument = instrument
        self._lead_to_safe = lead_to_safe
        self._timeout = timeout
        self._lock = threading.RLock()  # for waking the thread of the block, and for its end
        self._thread = 0
        self._awake = False  # the block runs
        self._leaving = False  # the stage is being stopped, and signals must not interrupt this
        self._reason: str | None = None
        self._late: BaseException | None = None  # of a signal at the start of `__exit__`
        self._handlers: dict[int, Any] = {}
        self._timer: threading.Timer | None = None
        self._stopping: threading.Thread | None = None

    # the block --------------------------------------------------------------------------------

    def __enter__(self) -> Self:
        self._thread = threading.get_ident()
        try:
            if threading.current_thread() is threading.main_thread():
                self._take_signals()
            with self._lock:
                self._awake = True
            if self._timeout is not None and self._reason is None:
                self.allow(self._timeout)
        except BaseException as interruption:  # a signal: `__exit__` is not called after it
            self._settle(interruption)
            self._restore()
            raise
        if self._reason is not None:  # stopped before the block started
            self._restore()
            raise ControllerError(self._reason)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._leaving = True
            if error is None and self._late is not None:
                raise self._late
            if error is None and self._reason is not None:
                raise ControllerError(self._reason)
            self._settle(error)
        except BaseException as interruption:
            # A signal came before `_leaving` was set, and no further one can come; or another
            # thread stopped the block, and the block has not noticed it yet.
            self._settle(error if error is not None else interruption)
            if error is None:
                raise
        finally:
            self._restore()

    def allow(self, seconds: float) -> None:
        """Set the remaining time of the block, from now on, in real time [s]."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = threading.Timer(
            seconds, self._end, [f"the run exceeded its time limit of {seconds:g} s"]
        )
        self._timer.daemon = True
        self._timer.start()

    def stop(self, reason: str = "the run was stopped") -> None:
        """Stop the stage immediately and end the block with a reason, from any thread."""
        self._end(reason)

    def check(self) -> None:
        """End the block here if it was stopped, for blocks outside the main thread."""
        if self._reason is not None and not self._leaving:
            raise ControllerError(self._reason)

    # the end of the block ---------------------------------------------------------------------

    def _end(self, reason: str) -> None:
        if self._reason is None:
            self._reason = reason
        self._instrument.stop()
        with self._lock:
            if self._leaving or not self._awake:
                return
            if threading.get_ident() == self._thread:
                raise ControllerError(self._reason)
            if signal.SIGINT in self._handlers:
                # This wakes the thread of the block even while it waits for an answer.
                if hasattr(signal, "pthread_kill"):
                    signal.pthread_kill(self._thread, signal.SIGINT)
                else:
                    _thread.interrupt_main()

    def _take_signals(self) -> None:
        for number in _ENDING:
            before = signal.getsignal(number)
            # Signals that are ignored (nohup) or handled outside Python are not changed.
            if before is None or (before is signal.SIG_IGN and number != signal.SIGINT):
                continue
            self._handlers[number] = before
            signal.signal(number, self._handle)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self._leaving:
            return
        if self._reason is None and self._handlers.get(number) is signal.SIG_IGN:
            return
        self._leaving = True
        # In another thread, since the interrupted code may hold a lock that sending needs.
        self._stopping = threading.Thread(target=self._instrument.stop, daemon=True)
        self._stopping.start()
        error: BaseException
        if self._reason is not None:
            error = ControllerError(self._reason)
        else:
            error = KeyboardInterrupt() if number == signal.SIGINT else SystemExit(128 + number)
        # Raised at the first instruction of `__exit__`, it would pass by its `finally`.
        if frame is not None and frame.f_code is Guard.__exit__.__code__:
            self._late = error
        else:
            raise error

    def _settle(self, error: BaseException | None) -> None:
        self._leaving = True
        if error is None:
            return
        with _noted(error, "the stage could not be stopped"):
            self._instrument.stop()
        # A late stop would halt the ramp.
        if self._stopping is not None:
            self._stopping.join(timeout=5.0)
        if self._lead_to_safe:
            with _noted(error, "the drives could not be ramped to their safe voltages"):
                to_safe(self._instrument)

    def _restore(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        with self._lock:
            self._awake = False
        # Ctrl-C last: from then on it raises here again.
        for number in reversed(list(self._handlers)):
            signal.signal(number, self._handlers[number])
        self._handlers = {}


def guarded(
    instrument: Instrument, *, lead_to_safe: bool = True, timeout: float | None = None
) -> Guard:
    """Stop an instrument whenever a block does not end normally.

    On an error, Ctrl-C, SIGTERM, SIGHUP, a lost connection or a timeout the guard stops the
    instrument immediately. It then ramps the drives to their safe voltages, if the connection still
    permits this. A second Ctrl-C does not interrupt the stop. The guard raises the error that ended
    the block, with notes on problems after it. SIGTERM and SIGHUP end the program with status 128 +
    their number.

    `timeout` is the longest time of the block, in real time [s]; None for no limit.

    Validity: only the main thread of a program receives signals; `Guard.check` ends a block in
    another thread. A timeout interrupts Python code, but not a library call that does not return.
    After a normal end of the block the stage stays as it is.
    """
    return Guard(instrument, lead_to_safe=lead_to_safe, timeout=timeout)


@contextmanager
def _noted(error: BaseException, what: str) -> Iterator[None]:
    """Add a problem of the clean-up to the error as a note, so that it does not replace it."""
    try:
        yield
    except Exception as trouble:  # noqa: BLE001 - reported with the error
        error.add_note(f"{what}: {trouble}")
