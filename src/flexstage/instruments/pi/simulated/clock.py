"""Pace of simulated time during a session: real time, or as fast as possible.

A server holds `Pace.lock` while it carries out a command. Before each command, with the lock held,
it states whether the command is a question that clients repeat while they wait.
"""

import math
import threading
import time
from typing import ClassVar

from flexstage.base.errors import ControllerError, ModelError
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.controller_core import duration
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError

#: Simulated time of one command in fast time [s].
_COMMAND = 1e-3
#: Interval in which fast time checks for changes, and its longest advance for a question [s].
_LOOK, _PATIENCE = 5e-3, 0.25
#: Longest simulated time with the lock held, and the pause after it [s].
_PIECE, _BREATH = 20e-3, 1e-4


class Clock:
    """The monotonic clock of the computer."""

    def now(self) -> float:
        """Return the time since an arbitrary origin [s]."""
        return time.monotonic()

    def wait(self, seconds: float, ended: threading.Event) -> bool:
        """Wait for a time, or until an event is set."""
        return ended.wait(seconds)


class Pace:
    """Pace of the simulated time of a device."""

    fast: ClassVar[bool]
    """Whether simulated time advances by commands only, as fast as it can be computed."""

    def __init__(self, device: VirtualController) -> None:
        self._device = device
        #: Held while the device is used.
        self.lock = threading.RLock()
        #: Real time that was skipped because the computer was too slow [s].
        self.lost = 0.0

    def start(self) -> None:
        """Start; repeated calls have no effect."""

    def before_command(self, poll: bool = False) -> None:
        """Advance the device to the time of a command; the lock is held.

        A `poll` is a question about motion, waveforms or the recorder, which clients repeat while
        they wait.
        """
        raise NotImplementedError

    def before_error(self) -> None:
        """Account for a question for the error of a command, which does not use the device."""
        self.before_command()

    def pass_time(self, seconds: float) -> None:
        """Let simulated time pass for a client that waits; only in fast time."""
        raise NotImplementedError

    def close(self) -> None:
        """End; repeated calls have no effect."""


class Pacemaker(Pace):
    """Real time: a thread keeps the simulated time of a device synchronous with real time.

    It checks the clock every `tick` [s]. If the computer was too slow, it catches up at most
    `catch_up` [s]; longer times are skipped, and counted in `lost`.

    Notes
    -----
    A command acts at its own time, not at a tick: the device is advanced before it. The lock is
    released after each 20 ms of simulated time, and a command advances by no more, so that even on
    a slow computer a stop acts immediately.
    """

    fast = False

    def __init__(
        self,
        device: VirtualController,
        *,
        clock: Clock | None = None,
        tick: float = 5e-3,
        catch_up: float = 1.0,
    ) -> None:
        if not (0.0 < tick < math.inf and tick <= catch_up < math.inf):
            raise ModelError(
                "a pacemaker needs a positive tick and a catch-up time that is not shorter, got "
                f"{tick!r} and {catch_up!r} s"
            )
        super().__init__(device)
        self._clock = Clock() if clock is None else clock
        self._tick, self._catch_up = tick, catch_up
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._last: float | None = None
        self._failure: BaseException | None = None
        #: Number of checks that were more than two ticks late.
        self.late = 0

    def start(self) -> None:
        with self.lock:
            if self._ended.is_set():
                raise ModelError("a closed pacemaker cannot start again: create another one")
            if self._thread is None:
                self._last = self._clock.now()
                self._thread = threading.Thread(target=self._run, name="pacemaker", daemon=True)
                self._thread.start()

    def before_command(self, poll: bool = False) -> None:
        """Advance the device to the present time."""
        if self._failure is not None:
            raise ControllerError(
                f"the simulation of the stage has failed ({self._failure}): restart it"
            ) from self._failure
        with self.lock:
            self._piece()

    def pass_time(self, seconds: float) -> None:
        """Refuse: real time cannot be advanced."""
        raise RefusedError(Refusal.NOT_ABLE)

    def close(self) -> None:
        self._ended.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()

    def _run(self) -> None:
        try:
            while not self._clock.wait(self._tick, self._ended):
                while not self._ended.is_set():
                    with self.lock:
                        more = self._piece()
                    if not more:
                        break
                    # other threads rarely acquire a lock that is released only for an instant
                    self._ended.wait(_BREATH)
        except BaseException as error:
            self._failure = error
            raise

    def _piece(self) -> bool:
        """Advance by the due time, at most one piece; return whether more time is due."""
        if self._last is None or self._ended.is_set():
            return False
        due = self._clock.now() - self._last
        if due > self._catch_up:
            self.lost += due - self._catch_up
            self._last += due - self._catch_up
            due = self._catch_up
        if due > 2.0 * self._tick:
            self.late += 1
        step = min(due, _PIECE)
        if step <= 0.0:
            return False
        self._last += step
        self._device.advance(step)
        return due > step


class FastTime(Pace):
    """Fast time: simulated time advances by the commands of a session, without waiting.

    Each command takes 1 ms. A repeated question advances to the next change of its answer, and at
    most 0.25 s: a motion of one minute needs 240 questions. The same session always gives the same
    numbers, on any computer.

    Notes
    -----
    With several clients the numbers depend on the order of their commands.
    """

    fast = True
    #: Time of questions that did not use the device, which passes with the next command [s].
    _owed = 0.0

    def before_command(self, poll: bool = False) -> None:
        """Let the time of a command pass."""
        with self.lock:
            self._advance(_COMMAND)
            if not poll:
                return
            before = self._state()
            if not any(before[0]):
                return
            passed = 0.0
            while passed < _PATIENCE and self._state() == before:
                self._device.advance(_LOOK)
                passed += _LOOK

    def before_error(self) -> None:
        with self.lock:
            self._owed += _COMMAND

    def pass_time(self, seconds: float) -> None:
        with self.lock:
            self._advance(duration(seconds))

    def _advance(self, seconds: float) -> None:
        """Let time pass, including the owed time."""
        owed, self._owed = self._owed, 0.0
        self._device.advance(owed + seconds)

    def _state(self) -> tuple[tuple[bool, ...], tuple[bool, ...]]:
        """Return the processes that will end by themselves, then the on-target states."""
        device = self._device
        arrived = tuple(device.on_target(axis) for axis in device.axes)
        waves = tuple(device.wave_running(axis) for axis in device.axes)
        moves = tuple(device.moving(axis) for axis in device.axes)
        waits = tuple(not there for there in arrived)
        return (*waves, *moves, *waits, device.recorder.recording), arrived
