"""Whatever ends a run, the stage is stopped first: errors, Ctrl-C, a kill, a run that hangs."""

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any, Self

from flexstage.base.errors import ControllerError
from flexstage.instruments.protocol import Instrument
from flexstage.instruments.ramp import to_safe

#: Signals that end a run: Ctrl-C, a polite kill, a terminal that is closed.
_ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


class Guard:
    """Watches over an instrument while a block runs; made by `guarded`."""

    def __init__(
        self, instrument: Instrument, *, lead_to_safe: bool = True, timeout: float | None = None
    ) -> None:
        self._instrument = instrument
        self._lead_to_safe = lead_to_safe
        self._timeout = timeout
        self._lock = threading.RLock()  # waking the thread of the block, and that it has gone
        self._thread = 0
        self._awake = False  # the block runs
        self._leaving = False  # the stage is being stopped, and no signal may come between
        self._reason: str | None = None
        self._handlers: dict[int, Any] = {}
        self._timer: threading.Timer | None = None
        self._stopping: threading.Thread | None = None

    # the block --------------------------------------------------------------------------------

    def __enter__(self) -> Self:
        self._thread = threading.get_ident()
        if threading.current_thread() is threading.main_thread():
            for number in _ENDING:
                before = signal.getsignal(number)
                # What the surroundings ignore (nohup) or handle outside Python stays so.
                if before is None or (before is signal.SIG_IGN and number != signal.SIGINT):
                    continue
                self._handlers[number] = before
                signal.signal(number, self._handle)
        with self._lock:
            self._awake = True
        if self._reason is not None:  # stopped before it began
            self._restore()
            raise ControllerError(self._reason)
        if self._timeout is not None:
            self.allow(self._timeout)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._leaving = True
            if error is None and self._reason is not None:
                raise ControllerError(self._reason)
            self._settle(error)
        except BaseException as interruption:
            # A signal came before `_leaving` was set, and there is no second; or the block was
            # stopped from another thread, and nothing has told it so until now.
            self._settle(error if error is not None else interruption)
            if error is None:
                raise
        finally:
            self._restore()

    def allow(self, seconds: float) -> None:
        """Let the block run that much longer from now on, in real time [s], and no longer."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = threading.Timer(
            seconds, self._end, [f"the run took longer than the {seconds:g} s it was given"]
        )
        self._timer.daemon = True
        self._timer.start()

    def stop(self, reason: str = "the run was stopped") -> None:
        """Stop the stage now and end the block with the reason, from any thread."""
        self._end(reason)

    def check(self) -> None:
        """End the block here if it was stopped: for blocks that run beside the main thread."""
        if self._reason is not None and not self._leaving:
            raise ControllerError(self._reason)

    # what ends it -----------------------------------------------------------------------------

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
                # The thread of the block is woken even where it waits for an answer.
                if hasattr(signal, "pthread_kill"):
                    signal.pthread_kill(self._thread, signal.SIGINT)
                else:
                    _thread.interrupt_main()

    def _handle(self, number: int, frame: FrameType | None) -> None:
        del frame
        if self._leaving:
            return
        if self._reason is None and self._handlers.get(number) is signal.SIG_IGN:
            return
        self._leaving = True
        # Not from here: what was interrupted may hold what sending needs.
        self._stopping = threading.Thread(target=self._instrument.stop, daemon=True)
        self._stopping.start()
        if self._reason is not None:
            raise ControllerError(self._reason)
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        sys.exit(128 + number)

    def _settle(self, error: BaseException | None) -> None:
        self._leaving = True
        if error is None:
            return
        with _noted(error, "the stage could not be stopped"):
            self._instrument.stop()
        # A stop that comes late would halt the ramp.
        if self._stopping is not None:
            self._stopping.join(timeout=5.0)
        if self._lead_to_safe:
            with _noted(error, "the drives could not be led to their safe voltages"):
                to_safe(self._instrument)

    def _restore(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        with self._lock:
            self._awake = False
        for number, before in self._handlers.items():
            signal.signal(number, before)
        self._handlers = {}


def guarded(
    instrument: Instrument, *, lead_to_safe: bool = True, timeout: float | None = None
) -> Guard:
    """Stop an instrument whenever a block does not end as it should.

    On an error, Ctrl-C, SIGTERM, SIGHUP, a lost link, or after too long a time the instrument is
    stopped at once; then its drives are led to their safe voltages where the link still allows it.
    A second Ctrl-C does not come between. The error that ended the block is the one that is
    raised, with a note of what went wrong after it. SIGTERM and SIGHUP end the program with
    status 128 + their number.

    With `timeout` the block may take that long, in real time [s]; without, it may run without end.

    Validity: signals come to the main thread of a program only; a block in another thread is ended
    by `Guard.check`. A time-out ends what Python waits for, and not a library that does not return.
    A block that ends well leaves the stage as it is.
    """
    return Guard(instrument, lead_to_safe=lead_to_safe, timeout=timeout)


@contextmanager
def _noted(error: BaseException, what: str) -> Iterator[None]:
    """Let no trouble of cleaning up hide the error that it cleans up after."""
    try:
        yield
    except Exception as trouble:  # noqa: BLE001 - told with the error
        error.add_note(f"{what}: {trouble}")
