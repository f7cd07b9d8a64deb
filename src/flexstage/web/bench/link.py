"""The link to the stage at the bench: one for all browsers, read by a thread of its own."""

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
    WatchedInstrument,
    live_channels,
    live_values,
    read_axis,
    real_time_address,
)
from flexstage.web.emergency_stop import EmergencyStop
from flexstage.web.jobs import BackgroundJob, Cancelled, Jobs
from flexstage.web.live_history import LiveHistory

#: Who has not been seen for so long is gone, and another may take over [s].
CONTROL_TIMEOUT = 30.0


class Control:
    """Which browser drives the stage.

    Parameters
    ----------
    clock
        The time [s].

    Examples
    --------
    >>> control = Control()
    >>> control.take("a", "Ann"); control.ask("b", "Bob"); control.name, control.asker
    ('Ann', 'Bob')
    >>> control.give("a"); control.name
    'Bob'
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.RLock()
        self._holder = self._asked = ""
        self._seen = 0.0
        #: Who drives, by the name that others see; empty for nobody.
        self.name = ""
        #: Who asks to drive.
        self.asker = ""

    def holds(self, session: str) -> bool:
        """Say whether a browser drives."""
        return bool(self._holder) and session == self._holder

    def asks(self, session: str) -> bool:
        """Say whether a browser has asked to drive."""
        return bool(self._asked) and session == self._asked

    @property
    def free(self) -> bool:
        """Whether nobody drives, or who does is gone."""
        return not self._holder or self._clock() - self._seen > CONTROL_TIMEOUT

    def seen(self, session: str) -> None:
        """Take note that a browser is still there."""
        with self._lock:
            if self.holds(session):
                self._seen = self._clock()

    def take(self, session: str, name: str) -> None:
        """Begin to drive, where nobody else does.

        Raises
        ------
        ModelError
            Somebody else drives.
        """
        with self._lock:
            if not self.holds(session) and not self.free:
                raise ModelError(f"{self.name} drives the stage: ask for control")
            self._hand_over(session, name)

    def ask(self, session: str, name: str) -> None:
        """Ask whoever drives to hand it over."""
        with self._lock:
            if not self.holds(session):
                self._asked, self.asker = session, name

    def give(self, session: str) -> None:
        """Hand over to whoever asked, else to nobody."""
        with self._lock:
            self.require(session)
            self._hand_over(self._asked, self.asker)

    def release(self, session: str) -> None:
        """Drive no more; who asked may ask again."""
        with self._lock:
            self.require(session)
            self._hand_over("", "")

    def keep(self, session: str) -> None:
        """Go on driving although somebody asked."""
        with self._lock:
            self.require(session)
            self._asked = self.asker = ""

    def require(self, session: str) -> None:
        """Refuse what a browser wants that does not drive.

        Raises
        ------
        ModelError
            It does not.
        """
        with self._lock:
            if not self.holds(session):
                driver = f"{self.name} drives" if self._holder else "nobody drives"
                raise ModelError(
                    f"this browser sees the stage and does not drive it; {driver}: take control or "
                    "ask for it"
                )
            self._seen = self._clock()

    def _hand_over(self, session: str, name: str) -> None:
        self._holder, self.name, self._seen = session, name, self._clock()
        self._asked = self.asker = ""


_LOG = logging.getLogger("flexstage.web")

#: Readings of positions and voltages in a second [Hz].
RATE_HZ = 50.0
_AGAIN = 2.0  # time between attempts to open a lost link again [s]
_UNDER_STOP = "bench"


class BenchLink:
    """What is connected, what it reads, who drives it, and what is done with it.

    One thread reads, another does what it is told, in that order; `stop` waits for neither.

    Parameters
    ----------
    stops
        What the button STOP stops.
    jobs
        Where runs are carried out.
    """

    def __init__(self, stops: EmergencyStop, jobs: Jobs) -> None:
        self._stops, self._jobs = stops, jobs
        self.control = Control()
        self.device: Instrument | None = None
        #: The same with pauses that a stop ends.
        self.watched: Instrument | None = None
        self.stage: Stage | None = None
        self.address = ""
        #: Name under which the stage is locked.
        self.locked = ""
        #: Whether the drives are led to their safe voltages when the link is ended.
        self.leads_to_safe = False
        #: Whether a real stage may move, as somebody has looked that its way is clear.
        self.cleared = False
        #: What each axis was last read as.
        self.readings: dict[str, AxisReading] = {}
        self.history: LiveHistory | None = None
        #: Why the link is lost, or a reading failed; empty while all is well.
        self.trouble = ""
        #: The run that goes on, or went on last.
        self.job: BackgroundJob | None = None
        self._moves = False  # whether the run that goes on moves the stage
        #: Whether the link is lost at the moment.
        self.lost = False
        self._epoch = time.time() - time.monotonic()
        self._targets: dict[str, float] = {}
        self._opening = threading.Lock()
        self._reading = threading.Lock()
        self._stopped, self._ended = threading.Event(), threading.Event()
        self._stops_given = 0
        self._pending: list[Future[Any]] = []
        self._work: ThreadPoolExecutor | None = None
        self._poller: threading.Thread | None = None
        self._open = ExitStack()

    # the link

    @property
    def connected(self) -> bool:
        """Whether there is a stage, though its link may be lost at the moment."""
        return self.device is not None

    @property
    def busy(self) -> bool:
        """Whether a run goes on."""
        return self.job is not None and not self.job.is_over

    def connect(
        self, session: str, name: str, address: str, stage: Stage, *, leads_to_safe: bool = False
    ) -> None:
        """Connect to an instrument: nothing moves. Who does so drives.

        Raises
        ------
        FlexstageError
            There is a link already, the address leads nowhere, or another program drives the stage.
        """
        if not self._opening.acquire(blocking=False):
            raise ModelError("somebody is connecting already: wait until it is done")
        try:
            if self.device is not None:
                raise ModelError(f"'{self.address}' is connected: disconnect it first")
            with ExitStack() as opened:
                device = connect(real_time_address(address), stage)
                opened.callback(device.close)
                locked = device.identity.serial_number or stage.name
                opened.enter_context(instrument_lock(device, locked))
                self.control.take(session, name)
                self._open = opened.pop_all()
            self.address, self.stage, self.locked = address, stage, locked
            self.leads_to_safe, self.cleared = leads_to_safe, False
            self._begin(device)
        finally:
            self._opening.release()

    def disconnect(self, session: str) -> None:
        """End the link: nothing moves, but where it was said that drives are led to safety."""
        self.control.require(session)
        if self.busy:
            raise ModelError("a run goes on: stop it before you disconnect")
        if self.leads_to_safe and not self.lost:
            self.told(session, to_safe).result()
        self.control.release(session)
        self.close()

    def close(self) -> None:
        """End the link and what goes on, as where the panel is ended."""
        self._ended.set()
        self._stops.remove(_UNDER_STOP)
        if self._work is not None:
            self._work.shutdown(cancel_futures=True)
        if self._poller is not None and self._poller is not threading.current_thread():
            self._poller.join()
        self.device = self.watched = self.history = None
        self.readings, self.trouble = {}, ""
        self._open.close()

    def _begin(self, device: Instrument) -> None:
        # whoever finds a device finds who works for it
        self._work = ThreadPoolExecutor(1, "bench")
        self._use(device)
        self.lost, self.trouble = False, ""
        self._ended, self._targets = threading.Event(), {}
        self._stopped.clear()
        self.history = LiveHistory(live_channels(device), RATE_HZ)
        self._stops.add(_UNDER_STOP, self.stop)
        self._poller = threading.Thread(target=self._read_on, name="bench reader", daemon=True)
        self._poller.start()

    def _use(self, device: Instrument) -> None:
        self.device = device
        self.watched = cast(Instrument, WatchedInstrument(device, self._stopped))

    # what is read

    def _read_on(self) -> None:
        count, due = 0, time.monotonic()
        while not self._ended.is_set():
            try:
                self._read(slow=count % 5 == 0)
            except NotConnectedError as error:
                self.lost, self.trouble = True, str(error)
                self._open_again()
            except FlexstageError as error:
                self.trouble = str(error)
            except Exception as error:  # noqa: BLE001 - a thread that reads never ends silently
                said = f"{type(error).__name__}: {error}"
                if said != self.trouble:
                    _LOG.exception("reading the stage failed")
                self.trouble = said
            count += 1
            due = max(due + 1.0 / RATE_HZ, time.monotonic())
            self._ended.wait(due - time.monotonic())

    def _read(self, *, slow: bool) -> None:
        device = self.device
        if device is None or not self._reading.acquire(blocking=device.concurrent):
            return
        # by a clock that is never set back
        now = self._epoch + time.monotonic()
        try:
            found = {
                name: read_axis(axis, self.readings.get(name), slow=slow)
                for name, axis in device.axes.items()
            }
        finally:
            self._reading.release()
        self.readings, self.trouble = found, ""
        if self.history is not None:
            self.history.append([now], [live_values(device, found)])

    def _open_again(self) -> None:
        """Try to open a lost link anew until it is there, or the bench is left."""
        old, stage = self.device, self.stage
        while old is not None and stage is not None and not self._ended.wait(_AGAIN):
            if self.busy or self._pending:
                continue  # what went on ends first, by the same loss
            with suppress(FlexstageError, OSError):
                old.close()
            try:
                new = connect(real_time_address(self.address), stage)
            except FlexstageError as error:
                self.trouble = str(error)
                continue
            if new.identity != old.identity:
                new.close()
                self.trouble = (
                    f"at '{self.address}' is another instrument now, {new.identity.model} "
                    f"{new.identity.serial_number}: disconnect"
                )
                continue
            self._open.callback(new.close)
            self._targets.clear()
            self._use(new)
            # nobody has looked at the stage since
            self.cleared = False
            self.lost, self.trouble = False, ""
            return

    # what is done

    def stop(self) -> None:
        """Stop the stage, what goes on and what waits: at once, from any thread."""
        self._stops_given += 1
        self._stopped.set()
        for waiting in tuple(self._pending):
            waiting.cancel()
        job, device = self.job, self.device
        if job is not None:
            job.cancel()
        self._targets.clear()
        if device is not None:
            # a lost link is looked for elsewhere, which must not keep a page waiting
            stopping = threading.Thread(target=device.stop, name="bench stop", daemon=True)
            stopping.start()
            stopping.join(timeout=1.0)

    def clear(self, session: str, on: bool) -> None:
        """Say that the way of a real stage is clear, or is not."""
        self.control.require(session)
        self.cleared = on

    def linked(self) -> Instrument:
        """Return the instrument that is connected, with pauses that a stop ends.

        Raises
        ------
        NotConnectedError
            There is none.
        """
        if self.watched is None:
            raise NotConnectedError("nothing is connected: connect first")
        return self.watched

    def _require_clear(self) -> None:
        if self.device is not None and not (self.device.identity.simulated or self.cleared):
            raise ModelError("look whether the way of the stage is clear, and say so above")

    def told(self, session: str, function: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        """Have a function called with the instrument, after what was told before.

        Raises
        ------
        FlexstageError
            This browser does not drive, nothing is connected, or a run goes on.
        """
        self.control.require(session)
        device = self.linked()
        if self.lost:
            raise NotConnectedError(f"the link is lost: {self.trouble}")
        if self.busy and (self._moves or not device.concurrent):
            raise ModelError("a run goes on: wait for its end, or stop it")
        self._require_clear()
        if not self._pending:
            self._stopped.clear()
        assert self._work is not None
        made = self._work.submit(self._do, function, arguments, self._stops_given)
        self._pending.append(made)
        made.add_done_callback(self._pending.remove)
        return made

    def _do(
        self, function: Callable[..., Any], arguments: tuple[Any, ...], stops_given: int
    ) -> Any:
        device = self.linked()
        found: Any = None
        with nullcontext() if device.concurrent else self._reading:
            if stops_given == self._stops_given:
                with suppress(Cancelled):
                    found = function(device, *arguments)
            if stops_given != self._stops_given:
                # a command may have been on its way when the stop overtook it
                device.stop()
                raise ControllerError("the stage was stopped")
        return found

    def go(self, session: str, axis: str, value: float) -> "Future[Any]":
        """Lead an axis gently to a position [m] under control, else to a voltage [V]."""
        return self.told(session, self._go, axis, value)

    def jog(self, session: str, axis: str, step: float) -> "Future[Any]":
        """Step an axis by a length [m] under control, else by a voltage [V].

        Steps add up from where the last one led to, and not from what is read.
        """
        return self.told(session, self._jog, axis, step)

    def set_closed_loop(self, session: str, axis: str, on: bool) -> "Future[Any]":
        """Switch the position control of an axis."""
        self._targets.pop(axis, None)
        return self.told(session, lambda device: device.axes[axis].set_closed_loop(on))

    def _go(self, device: Instrument, name: str, value: float) -> None:
        axis = device.axes[name]
        self._targets.pop(name, None)
        if axis.limits.voltage is None:
            axis.move_to(value, wait=False)
        else:
            lead_to(device, {name: value}, "position" if axis.closed_loop else "voltage")
        self._targets[name] = value

    def _jog(self, device: Instrument, name: str, step: float) -> None:
        axis, before = device.axes[name], self._targets.get(name)
        closed = axis.closed_loop
        if before is None:
            before = axis.position() if closed else axis.voltage()
        if closed:
            axis.move_to(before + step, wait=False)
        else:
            axis.set_voltage(before + step)
        self._targets[name] = before + step

    def run(
        self, session: str, name: str, function: Callable[..., Any], *arguments: Any, moves: bool
    ) -> BackgroundJob:
        """Carry out a run in a thread, with the bench and what else it is given.

        Raises
        ------
        FlexstageError
            This browser does not drive, nothing is connected, or something else goes on.
        """
        self.control.require(session)
        self.linked()
        if self.lost:
            raise NotConnectedError(f"the link is lost: {self.trouble}")
        if self.busy or self._pending:
            raise ModelError("something else goes on: wait for its end, or stop it")
        if moves:
            self._require_clear()
        self._stopped.clear()
        self._targets.clear()
        self._moves = moves
        self.job = self._jobs.start_thread(name, self._run, function, arguments, owner=session)
        return self.job

    def _run(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        device = self.linked()
        with nullcontext() if device.concurrent else self._reading:
            return function(device, *arguments)
