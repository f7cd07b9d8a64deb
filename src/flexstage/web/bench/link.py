"""The connection to the stage at the bench, shared by all browsers, and its control."""

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, nullcontext, suppress
from typing import Any, cast

from flexstage.base.errors import ControllerError, FlexstageError, ModelError, NotConnectedError
from flexstage.instruments.connect import connect
from flexstage.instruments.lock import instrument_lock
from flexstage.instruments.protocol import Instrument
from flexstage.instruments.ramp import lead_to, to_safe
from flexstage.stage import Stage
from flexstage.web.bench.instrument import (
    AxisReading,
    InterruptibleInstrument,
    live_channels,
    live_values,
    read_axis,
    real_time_address,
)
from flexstage.web.jobs import BackgroundJob, Cancelled, EmergencyStop, Jobs
from flexstage.web.live_history import LiveHistory

#: Time after which another browser can take control from one that is gone [s].
CONTROL_TIMEOUT = 30.0


class Control:
    """Control of the stage: one browser has it, all others watch.

    Parameters
    ----------
    clock
        Clock [s].

    Examples
    --------
    >>> control = Control()
    >>> control.take("a", "Ann"); control.ask("b", "Bob"); control.name, control.requester
    ('Ann', 'Bob')
    >>> control.give("a"); control.name
    'Bob'
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.RLock()
        self._holder = self._requesting = ""
        self._last_sign = 0.0
        #: Name of the user in control; empty without one.
        self.name = ""
        #: Name of the user who requests control.
        self.requester = ""

    def holds(self, session: str) -> bool:
        """Return whether a browser has control."""
        return bool(self._holder) and session == self._holder

    def asks(self, session: str) -> bool:
        """Return whether a browser has requested control."""
        return bool(self._requesting) and session == self._requesting

    @property
    def free(self) -> bool:
        """No browser has control, or the one in control is gone."""
        return not self._holder or self._clock() - self._last_sign > CONTROL_TIMEOUT

    def keep_alive(self, session: str) -> None:
        """Record a sign of a browser."""
        with self._lock:
            if self.holds(session):
                self._last_sign = self._clock()

    def take(self, session: str, name: str) -> None:
        """Take control, if no other browser has it.

        Raises
        ------
        ModelError
            Another browser has control.
        """
        with self._lock:
            if not self.holds(session) and not self.free:
                raise ModelError(f"{self.name} has control of the stage: ask for control")
            self._hand_over(session, name)

    def ask(self, session: str, name: str) -> None:
        """Request control from the browser that has it."""
        with self._lock:
            if not self.holds(session):
                self._requesting, self.requester = session, name

    def give(self, session: str) -> None:
        """Grant control to the browser that requested it; without one, release control."""
        with self._lock:
            self.require(session)
            self._hand_over(self._requesting, self.requester)

    def release(self, session: str) -> None:
        """Release control, and discard a request for it."""
        with self._lock:
            self.require(session)
            self._hand_over("", "")

    def keep(self, session: str) -> None:
        """Keep control, and discard a request for it."""
        with self._lock:
            self.require(session)
            self._requesting = self.requester = ""

    def require(self, session: str) -> None:
        """Require that a browser has control.

        Raises
        ------
        ModelError
            It does not have control.
        """
        with self._lock:
            if not self.holds(session):
                holder = f"{self.name} has control" if self._holder else "no browser has control"
                raise ModelError(
                    f"this browser does not have control of the stage; {holder}: take control "
                    "or ask for it"
                )
            self._last_sign = self._clock()

    def _hand_over(self, session: str, name: str) -> None:
        self._holder, self.name, self._last_sign = session, name, self._clock()
        self._requesting = self.requester = ""


_LOG = logging.getLogger("flexstage.web")

#: Rate of the readings of positions and voltages [Hz].
RATE_HZ = 50.0
_RETRY_INTERVAL = 2.0  # between two attempts to reconnect [s]
_STOP_NAME = "bench"


class BenchLink:
    """The connected instrument, its readings, its control, and its commands and runs.

    One thread reads; another one executes the commands in their order. `stop` waits for neither.

    Parameters
    ----------
    emergency_stop
        The STOP button of the panel.
    jobs
        Jobs of the panel, for runs.
    """

    def __init__(self, emergency_stop: EmergencyStop, jobs: Jobs) -> None:
        self._emergency_stop, self._jobs = emergency_stop, jobs
        self.control = Control()
        self.device: Instrument | None = None
        #: The same with pauses that a stop interrupts.
        self.interruptible: Instrument | None = None
        self.stage: Stage | None = None
        self.address = ""
        #: Name of the lock of the stage.
        self.lock_name = ""
        #: Ramp the drives to their safe voltages on disconnecting.
        self.ramps_to_safe = False
        #: The user has confirmed that the way of a real stage is clear, so that it may move.
        self.path_clear = False
        #: Last reading of each axis.
        self.readings: dict[str, AxisReading] = {}
        self.history: LiveHistory | None = None
        #: Message of a lost connection or a failed reading; empty otherwise.
        self.fault = ""
        #: The present or the last run.
        self.job: BackgroundJob | None = None
        self._moves = False  # the present run moves the stage
        #: The connection is lost at present.
        self.is_lost = False
        self._epoch = time.time() - time.monotonic()
        self._targets: dict[str, float] = {}
        self._connect_lock = threading.Lock()
        self._reading_lock = threading.Lock()
        self._stop_event, self._ended = threading.Event(), threading.Event()
        self._stop_count = 0
        self._pending: list[Future[Any]] = []
        self._work: ThreadPoolExecutor | None = None
        self._poller: threading.Thread | None = None
        self._open = ExitStack()

    # connection

    @property
    def connected(self) -> bool:
        """A stage is connected, though the connection may be lost at present."""
        return self.device is not None

    @property
    def busy(self) -> bool:
        """A run is in progress."""
        return self.job is not None and not self.job.is_over

    def connect(
        self, session: str, name: str, address: str, stage: Stage, *, ramps_to_safe: bool = False
    ) -> None:
        """Connect to an instrument without moving it; the connecting browser gets control.

        Raises
        ------
        FlexstageError
            A stage is connected already, the address has no instrument, or another program uses it.
        """
        if not self._connect_lock.acquire(blocking=False):
            raise ModelError("another browser is connecting: wait until it has finished")
        try:
            if self.device is not None:
                raise ModelError(f"'{self.address}' is connected: disconnect it first")
            with ExitStack() as resources:
                device = connect(real_time_address(address), stage)
                resources.callback(device.close)
                lock_name = device.identity.serial_number or stage.name
                resources.enter_context(instrument_lock(device, lock_name))
                self.control.take(session, name)
                self._open = resources.pop_all()
            self.address, self.stage, self.lock_name = address, stage, lock_name
            self.ramps_to_safe, self.path_clear = ramps_to_safe, False
            self._begin(device)
        finally:
            self._connect_lock.release()

    def disconnect(self, session: str) -> None:
        """Disconnect. Nothing moves, unless the ramp to the safe voltages was chosen."""
        self.control.require(session)
        if self.busy:
            raise ModelError("a run is in progress: stop it before you disconnect")
        if self.ramps_to_safe and not self.is_lost:
            self.submit(session, to_safe).result()
        self.control.release(session)
        self.close()

    def close(self) -> None:
        """Disconnect and end the threads, as at the end of the panel."""
        self._ended.set()
        self._emergency_stop.remove(_STOP_NAME)
        if self._work is not None:
            self._work.shutdown(cancel_futures=True)
        if self._poller is not None and self._poller is not threading.current_thread():
            self._poller.join()
        self.device = self.interruptible = self.history = None
        self.readings, self.fault = {}, ""
        self._open.close()

    def _begin(self, device: Instrument) -> None:
        # a device always has a thread for its commands
        self._work = ThreadPoolExecutor(1, "bench")
        self._use(device)
        self.is_lost, self.fault = False, ""
        self._ended, self._targets = threading.Event(), {}
        self._stop_event.clear()
        self.history = LiveHistory(live_channels(device), RATE_HZ)
        self._emergency_stop.add(_STOP_NAME, self.stop)
        self._poller = threading.Thread(target=self._read_loop, name="bench reader", daemon=True)
        self._poller.start()

    def _use(self, device: Instrument) -> None:
        self.device = device
        self.interruptible = cast(Instrument, InterruptibleInstrument(device, self._stop_event))

    # readings

    def _read_loop(self) -> None:
        count, due = 0, time.monotonic()
        while not self._ended.is_set():
            try:
                self._read(slow=count % 5 == 0)
            except NotConnectedError as error:
                self.is_lost, self.fault = True, str(error)
                self._reconnect()
            except FlexstageError as error:
                self.fault = str(error)
            except Exception as error:  # noqa: BLE001 - a thread that reads never ends silently
                message = f"{type(error).__name__}: {error}"
                if message != self.fault:
                    _LOG.exception("reading the stage failed")
                self.fault = message
            count += 1
            due = max(due + 1.0 / RATE_HZ, time.monotonic())
            self._ended.wait(due - time.monotonic())

    def _read(self, *, slow: bool) -> None:
        device = self.device
        if device is None or not self._reading_lock.acquire(blocking=device.concurrent):
            return
        # a clock that is never set back
        now = self._epoch + time.monotonic()
        try:
            readings = {
                name: read_axis(axis, self.readings.get(name), slow=slow)
                for name, axis in device.axes.items()
            }
        finally:
            self._reading_lock.release()
        self.readings, self.fault = readings, ""
        if self.history is not None:
            self.history.append([now], [live_values(device, readings)])

    def _reconnect(self) -> None:
        """Try to reconnect until it succeeds, or the bench is closed."""
        old, stage = self.device, self.stage
        while old is not None and stage is not None and not self._ended.wait(_RETRY_INTERVAL):
            if self.busy or self._pending:
                continue  # the present run or command fails first, for the same reason
            with suppress(FlexstageError, OSError):
                old.close()
            try:
                new = connect(real_time_address(self.address), stage)
            except FlexstageError as error:
                self.fault = str(error)
                continue
            if new.identity != old.identity:
                new.close()
                self.fault = (
                    f"'{self.address}' is now another instrument, {new.identity.model} "
                    f"{new.identity.serial_number}: disconnect"
                )
                continue
            self._open.callback(new.close)
            self._targets.clear()
            self._use(new)
            # the way of the stage must be confirmed again
            self.path_clear = False
            self.is_lost, self.fault = False, ""
            return

    # commands and runs

    def stop(self) -> None:
        """Stop motion, the present run and the queue immediately; any thread may call it."""
        self._stop_count += 1
        self._stop_event.set()
        for future in tuple(self._pending):
            future.cancel()
        job, device = self.job, self.device
        if job is not None:
            job.cancel()
        self._targets.clear()
        if device is not None:
            # a lost connection must not block the page
            thread = threading.Thread(target=device.stop, name="bench stop", daemon=True)
            thread.start()
            thread.join(timeout=1.0)

    def clear(self, session: str, on: bool) -> None:
        """Confirm that the way of a real stage is clear, or withdraw the confirmation."""
        self.control.require(session)
        self.path_clear = on

    def linked(self) -> Instrument:
        """Return the connected instrument, with pauses that a stop interrupts.

        Raises
        ------
        NotConnectedError
            No instrument is connected.
        """
        if self.interruptible is None:
            raise NotConnectedError("no instrument is connected: connect first")
        return self.interruptible

    def _require_clear(self) -> None:
        if self.device is not None and not (self.device.identity.simulated or self.path_clear):
            raise ModelError("check that the way of the stage is clear, and confirm it above")

    def submit(self, session: str, function: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        """Queue a function that is called with the instrument.

        Raises
        ------
        FlexstageError
            This browser has no control, no instrument is connected, or a run is in progress.
        """
        self.control.require(session)
        device = self.linked()
        if self.is_lost:
            raise NotConnectedError(f"the connection is lost: {self.fault}")
        if self.busy and (self._moves or not device.concurrent):
            raise ModelError("a run is in progress: wait for its end, or stop it")
        self._require_clear()
        if not self._pending:
            self._stop_event.clear()
        assert self._work is not None
        future = self._work.submit(self._do, function, arguments, self._stop_count)
        self._pending.append(future)
        future.add_done_callback(self._pending.remove)
        return future

    def _do(self, function: Callable[..., Any], arguments: tuple[Any, ...], stop_count: int) -> Any:
        device = self.linked()
        result: Any = None
        with nullcontext() if device.concurrent else self._reading_lock:
            if stop_count == self._stop_count:
                with suppress(Cancelled):
                    result = function(device, *arguments)
            if stop_count != self._stop_count:
                # a command may have started just before the stop
                device.stop()
                raise ControllerError("the stage was stopped")
        return result

    def go(self, session: str, axis: str, value: float) -> "Future[Any]":
        """Ramp an axis to a position [m] in closed loop, else to a voltage [V]."""
        return self.submit(session, self._go, axis, value)

    def jog(self, session: str, axis: str, step: float) -> "Future[Any]":
        """Step an axis by a length [m] in closed loop, else by a voltage [V].

        A step is relative to the last target, not to the reading.
        """
        return self.submit(session, self._jog, axis, step)

    def set_closed_loop(self, session: str, axis: str, on: bool) -> "Future[Any]":
        """Switch the position control of an axis on or off."""
        self._targets.pop(axis, None)
        return self.submit(session, lambda device: device.axes[axis].set_closed_loop(on))

    def _go(self, device: Instrument, name: str, value: float) -> None:
        axis = device.axes[name]
        self._targets.pop(name, None)
        if axis.limits.voltage is None:
            axis.move_to(value, wait=False)
        else:
            lead_to(device, {name: value}, "position" if axis.closed_loop else "voltage")
        self._targets[name] = value

    def _jog(self, device: Instrument, name: str, step: float) -> None:
        axis, target = device.axes[name], self._targets.get(name)
        closed_loop = axis.closed_loop
        if target is None:
            target = axis.position() if closed_loop else axis.voltage()
        if closed_loop:
            axis.move_to(target + step, wait=False)
        else:
            axis.set_voltage(target + step)
        self._targets[name] = target + step

    def run(
        self, session: str, name: str, function: Callable[..., Any], *arguments: Any, moves: bool
    ) -> BackgroundJob:
        """Start a run in a thread; its function gets the instrument and the arguments.

        Raises
        ------
        FlexstageError
            This browser has no control, no instrument is connected, or it is busy.
        """
        self.control.require(session)
        self.linked()
        if self.is_lost:
            raise NotConnectedError(f"the connection is lost: {self.fault}")
        if self.busy or self._pending:
            raise ModelError("another command or run is in progress: wait for its end, or stop it")
        if moves:
            self._require_clear()
        self._stop_event.clear()
        self._targets.clear()
        self._moves = moves
        self.job = self._jobs.start_thread(name, self._run, function, arguments, owner=session)
        return self.job

    def _run(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        device = self.linked()
        with nullcontext() if device.concurrent else self._reading_lock:
            return function(device, *arguments)
