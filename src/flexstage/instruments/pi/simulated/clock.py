"""How simulated time passes beside a conversation: in step with real time, or as fast as it can.

A server holds `Pace.lock` while it carries out a command, and says before each one, with the lock
held, whether it is a question that a client repeats while it waits.
"""

import math
import threading
import time
from typing import ClassVar

from flexstage.base.errors import ControllerError, ModelError
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.controller_core import duration
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError

#: Simulated time of one command of a fast conversation [s].
_COMMAND = 1e-3
#: Steps in which a fast conversation looks whether something happened [s], and when it gives up.
_LOOK, _PATIENCE = 5e-3, 0.25
#: Longest time for which the lock is held at once [s of simulated time], and the pause after it.
_PIECE, _BREATH = 20e-3, 1e-4


class Clock:
    """The clock of the computer, which is never set back."""

    def now(self) -> float:
        """Return the time from some moment on [s]."""
        return time.monotonic()

    def wait(self, seconds: float, ended: threading.Event) -> bool:
        """Wait some time, or until an event is set."""
        return ended.wait(seconds)


class Pace:
    """Lets the simulated time of a device pass."""

    fast: ClassVar[bool]
    """Whether simulated time passes only with commands, and as fast as it can be computed."""

    def __init__(self, device: VirtualController) -> None:
        self._device = device
        #: Held while the device is used.
        self.lock = threading.RLock()
        #: Real time that has been left out because the computer was too slow [s].
        self.lost = 0.0

    def start(self) -> None:
        """Begin; calling it again changes nothing."""

    def before_command(self, poll: bool = False) -> None:
        """Bring the device to the moment of a command; the lock is held.

        It is a `poll` where it asks about motion, waveforms or the recorder, as a client does again
        and again while it waits.
        """
        raise NotImplementedError

    def before_error(self) -> None:
        """Let a question for the error of a command come, which sees nothing of the device."""
        self.before_command()

    def pass_time(self, seconds: float) -> None:
        """Let simulated time pass because a client wants to wait; only where it is fast."""
        raise NotImplementedError

    def close(self) -> None:
        """End; calling it again changes nothing."""


class Pacemaker(Pace):
    """Keeps the simulated time of a device in step with real time, in a thread.

    It looks at the clock every `tick` [s]. Where the computer was too slow, it makes up for
    `catch_up` [s] at most; what is beyond that is left out, and counted in `lost`.

    Notes
    -----
    A command acts at its own moment and not at a tick: the device is brought up to date before it.
    The lock is let go after each 20 ms of simulated time, and a command leads on by no more, so
    that on a computer that is too slow a command to stop still acts at once.
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
                "a pacemaker needs a positive tick and a time to catch up that is no shorter, got "
                f"{tick!r} and {catch_up!r} s"
            )
        super().__init__(device)
        self._clock = Clock() if clock is None else clock
        self._tick, self._catch_up = tick, catch_up
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._last: float | None = None
        self._failure: BaseException | None = None
        #: Looks at the clock that found more than two ticks to make up for.
        self.late = 0

    def start(self) -> None:
        with self.lock:
            if self._ended.is_set():
                raise ModelError("a pacemaker that was closed cannot start again: make another one")
            if self._thread is None:
                self._last = self._clock.now()
                self._thread = threading.Thread(target=self._run, name="pacemaker", daemon=True)
                self._thread.start()

    def before_command(self, poll: bool = False) -> None:
        """Bring the device up to now."""
        if self._failure is not None:
            raise ControllerError(
                f"the simulation of the stage has broken down ({self._failure}): start it again"
            ) from self._failure
        with self.lock:
            self._piece()

    def pass_time(self, seconds: float) -> None:
        """Refuse: real time cannot be made to pass."""
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
                    # a lock that is let go and taken at once seldom comes to another thread
                    self._ended.wait(_BREATH)
        except BaseException as error:
            self._failure = error
            raise

    def _piece(self) -> bool:
        """Advance by what is due, at most one piece; say whether more is due."""
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
    """Lets simulated time pass with the commands of a conversation, so that nobody waits for it.

    Each command takes 1 ms. A question that a client repeats while it waits leads on to the next
    change of what it asks for, and at most 0.25 s: a motion that takes a minute is answered for
    after 240 questions. The same conversation always gives the same numbers, whatever the computer.

    Notes
    -----
    With several clients the numbers depend on the order in which their commands come.
    """

    fast = True
    #: Time of questions that saw nothing of the device: it passes with the next command [s].
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
        """Let time pass, after that which is owed."""
        owed, self._owed = self._owed, 0.0
        self._device.advance(owed + seconds)

    def _state(self) -> tuple[tuple[bool, ...], tuple[bool, ...]]:
        """Return what goes on, first whatever will end by itself, then where axes stand."""
        device = self._device
        arrived = tuple(device.on_target(axis) for axis in device.axes)
        waves = tuple(device.wave_running(axis) for axis in device.axes)
        moves = tuple(device.moving(axis) for axis in device.axes)
        waits = tuple(not there for there in arrived)
        return (*waves, *moves, *waits, device.recorder.recording), arrived
