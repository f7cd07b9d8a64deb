"""One axis of a controller that speaks GCS, and the settings of its position control."""

import contextlib
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from flexstage.base.errors import ControllerError, FlexstageError, ModelError, NotConnectedError
from flexstage.instruments.limits import check_position, check_voltage
from flexstage.instruments.pi.connection import Connection, ControllerProfile
from flexstage.instruments.pi.replies import VOLTS, WireUnit
from flexstage.instruments.protocol import Capability, MotionAxis, not_able
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import Notch, ServoSettings

_PROPORTIONAL = r"servo loop p-term.*\[V/um\]"
_INTEGRAL = r"servo loop i-term.*\[V/\(um s\)\]"
_LOWPASS = r"low-?pass.*\[Hz\]"
_NOTCH = r"notch frequency {}\b.*\[Hz\]"
_REJECTION = r"notch rejection {}\b.*gain"
_BANDWIDTH = r"notch bandwidth {}\b.*damping"
_MICRO = 1e-6


def tunable(profile: ControllerProfile) -> bool:
    """Return whether the gains of a controller have units in their names; others are never set."""
    return (
        profile.knows("SPA", "SPA?")
        and profile.parameter(_PROPORTIONAL) is not None
        and profile.parameter(_INTEGRAL) is not None
    )


class ServoTuning:
    """Settings of the position control of one axis.

    A notch is sent as frequency, gain at it, and bandwidth, which is twice the damping ratio of its
    poles. Validity: only for controllers whose parameters have these names.
    """

    def __init__(self, connection: Connection, axis: str) -> None:
        self._connection, self._axis = connection, axis

    def read(self) -> ServoSettings:
        """Read the settings."""
        notches = []
        for slot in self._slots():
            frequency = self._number(slot[0])
            if frequency > 0.0:
                rejection, width = self._number(slot[1]), self._number(slot[2])
                notches.append(
                    Notch(
                        frequency_hz=frequency,
                        zero_damping=0.5 * rejection * width,
                        pole_damping=0.5 * width,
                    )
                )
        lowpass = self._connection.profile.parameter(_LOWPASS)
        corner = self._number(lowpass) if lowpass is not None else 0.0
        return ServoSettings(
            proportional=self._number(self._known(_PROPORTIONAL)) / _MICRO,
            integral=self._number(self._known(_INTEGRAL)) / _MICRO,
            notches=tuple(notches),
            lowpass_hz=corner or None,
        )

    def write(self, settings: ServoSettings) -> None:
        """Write settings in one line, or if it is too long, with the gains at 0 in between."""
        if settings.leads or settings.filters or settings.second_integral_hz is not None:
            raise ModelError(
                "the control of this controller has notches, a low-pass, and no other filter: "
                "omit leads, filters and a second integral"
            )
        gains = [
            (self._known(_PROPORTIONAL), settings.proportional * _MICRO),
            (self._known(_INTEGRAL), settings.integral * _MICRO),
        ]
        filters = [*self._notches(settings), *self._lowpass(settings)]
        one_line = self._line([*filters, *gains])
        if len(one_line) <= self._connection.transfer.line_limit:
            self._connection.tell(one_line)
            return
        # between two lines the loop must not run with new gains and old filters
        self._connection.tell(self._line([(key, 0.0) for key, _ in gains]))
        for line in self._lines(filters):
            self._connection.tell(line)
        self._connection.tell(self._line(gains))

    def _notches(self, settings: ServoSettings) -> Iterator[tuple[int, float]]:
        slots = list(self._slots())
        if len(settings.notches) > len(slots):
            raise ModelError(
                f"the settings have {len(settings.notches)} notches, and the controller has "
                f"{len(slots)}: omit the weakest"
            )
        for slot, notch in zip(slots, settings.notches, strict=False):
            numbers = notch.zero_damping / notch.pole_damping, 2.0 * notch.pole_damping
            yield from zip(slot, (notch.frequency_hz, *numbers), strict=True)
        for slot in slots[len(settings.notches) :]:
            yield slot[0], 0.0

    def _lowpass(self, settings: ServoSettings) -> Iterator[tuple[int, float]]:
        key = self._connection.profile.parameter(_LOWPASS)
        if key is not None:
            yield key, settings.lowpass_hz or 0.0
        elif settings.lowpass_hz is not None:
            raise ModelError("the control of this controller has no low-pass: omit it")

    def _slots(self) -> Iterator[list[int]]:
        """Yield the parameters of each notch: frequency, rejection and bandwidth."""
        profile = self._connection.profile
        count = sum(
            bool(re.search(r"notch frequency \d+", name, re.IGNORECASE))
            for name in profile.parameters.values()
        )
        for slot in range(1, count + 1):
            keys = [profile.parameter(p.format(slot)) for p in (_NOTCH, _REJECTION, _BANDWIDTH)]
            known = [key for key in keys if key is not None]
            if len(known) == len(keys):
                yield known

    def _known(self, pattern: str) -> int:
        key = self._connection.profile.parameter(pattern)
        if key is None:
            raise ModelError(
                "the controller does not report the unit of its control gains, so they cannot be "
                "set"
            )
        return key

    def _number(self, key: int) -> float:
        text = self._connection.read_parameter(self._axis, key)
        try:
            return float(text)
        except ValueError:
            raise ControllerError(
                f"parameter 0x{key:08X} of axis {self._axis} should be a number, got {text[:40]!r}"
            ) from None

    def _line(self, pairs: list[tuple[int, float]]) -> str:
        return "SPA " + " ".join(f"{self._axis} 0x{key:08X} {v:.9g}" for key, v in pairs)

    def _lines(self, pairs: list[tuple[int, float]]) -> Iterator[str]:
        part: list[tuple[int, float]] = []
        for pair in pairs:
            if part and len(self._line([*part, pair])) > self._connection.transfer.line_limit:
                yield self._line(part)
                part = []
            part.append(pair)
        if part:
            yield self._line(part)


#: Time of the amplifier for the largest step of a command [s].
_STEP_TIME = 1e-4
#: First step of an axis whose unit of voltage is not verified yet, and its tolerance [V].
_FIRST_STEP, _VOLT_TOLERANCE = 1.0, 0.5
#: Relative tolerance of the voltage after a step, and the time to reach it [s].
_VOLT_SHARE, _VOLT_TIME = 0.02, 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisFacts:
    """Properties of an axis that are known after the discovery."""

    name: str
    """Its name at the stage."""
    identifier: str
    """Its identifier at the controller."""
    index: int
    """Its index among all axes of the controller, from 0."""
    output: str | None
    """Number of its piezo channel; None where it has none."""
    unit: WireUnit
    """Unit of its positions."""
    limits: AxisLimits
    """Limits of commands."""
    capabilities: frozenset[Capability]
    """Its capabilities."""


class PiAxis(MotionAxis):
    """An axis of a controller; positions and voltages are checked before any command is sent.

    Its voltage is set in steps that the amplifier completes within 0.1 ms each. If the link is lost
    during a wait, a stop is sent, over a second link if possible.

    Validity: voltages are commanded by ``SVA``, whose unit is volts at the drive only if the
    controller is configured so. The first motion of each axis starts with a step of at most 1 V,
    which is read back; if the voltage differs, the motion ends with an error.
    """

    def __init__(self, connection: Connection, facts: AxisFacts) -> None:
        self._connection, self.facts = connection, facts
        self.name, self.capabilities = facts.name, facts.capabilities
        self._client = connection.client
        self._tuning = ServoTuning(connection, facts.identifier)
        self._volts_seen = facts.output is None
        self._target: float | None = None
        self._stops = connection.client.stops

    @property
    def limits(self) -> AxisLimits:
        return self.facts.limits

    @property
    def closed_loop(self) -> bool:
        if not self._connection.profile.knows("SVO?"):
            return Capability.CLOSED_LOOP in self.capabilities
        return bool(self._client.ask_values("SVO?", [self.facts.identifier])[0])

    def set_closed_loop(self, on: bool) -> None:
        self._require(Capability.CLOSED_LOOP)
        axis = self.facts.identifier
        if self._connection.servo.get(axis) == on and self.closed_loop == on:
            return
        self._connection.restore_drives()
        self._connection.servo.pop(axis, None)
        self._connection.tell(f"SVO {axis} {int(on)}")
        if self.closed_loop != on:
            raise ControllerError(
                f"the position control of axis '{self.name}' was switched {_on(on)} but is still "
                f"{_on(not on)}: read the messages of the controller"
            )
        self._connection.servo[axis] = on
        self._target = None

    def position(self) -> float:
        value = self._client.ask_values("POS?", [self.facts.identifier])[0]
        if not math.isfinite(value):
            raise ControllerError(
                f"the sensor of axis '{self.name}' reads {value} instead of a position: check the "
                "sensor and its cable before you move the stage"
            )
        return value * self.facts.unit.factor

    def voltage(self) -> float:
        value = self._client.ask_values("VOL?", [self._output()])[0]
        if not math.isfinite(value):
            raise ControllerError(
                f"the voltage of axis '{self.name}' reads {value}: check the amplifier"
            )
        return value

    def move_to(self, position: float, *, wait: bool = True) -> None:
        check_position(self.limits, position, self.name)
        self._require(Capability.CLOSED_LOOP)
        self._connection.restore_drives()
        text = self.facts.unit.text(position, self.limits.position)
        self._stops, self._target = self._client.stops, None
        self._connection.tell(f"MOV {self.facts.identifier} {text}")
        self._target = float(text)
        if wait:
            self.wait()

    def set_voltage(self, voltage: float) -> None:
        check_voltage(self.limits, voltage, self.name)
        self._require(Capability.OPEN_LOOP)
        if self._connection.servo.get(self.facts.identifier):
            raise ControllerError(
                f"axis '{self.name}' is under position control, which sets its voltage: switch it "
                "off first"
            )
        self._connection.restore_drives()
        self._target, self._stops = None, self._client.stops
        here = begin = self.voltage()
        while here != voltage:
            here = self._next(here, voltage, first=not self._volts_seen and here == begin)
            self._refuse_stopped()
            text = VOLTS.text(here, self.limits.voltage)
            self._connection.tell(f"SVA {self.facts.identifier} {text}")
            if not self._volts_seen:
                self._see_volts(begin, here, ended=here == voltage)

    def reference(self) -> None:
        profile, axis = self._connection.profile, self.facts.identifier
        if not profile.knows("FRF", "FRF?") or self._client.ask_values("FRF?", [axis])[0]:
            return
        switch = not profile.knows("TRS?") or self._client.ask_values("TRS?", [axis])[0]
        self._stops, self._target = self._client.stops, None
        self._connection.tell(f"{'FRF' if switch else 'FNL'} {axis}")
        self.wait(timeout=120.0)
        if not self._client.ask_values("FRF?", [axis])[0]:
            raise ControllerError(
                f"axis '{self.name}' is not referenced after its move to the switch: check that it "
                "is free to move, and read the messages of the controller"
            )

    def moving(self) -> bool:
        if self._connection.profile.knows("#5"):
            return bool(self._client.ask_whole("\x05", base=16) >> self.facts.index & 1)
        return not self._client.ask_values("ONT?", [self.facts.identifier])[0]

    def wait(self, timeout: float = 30.0) -> None:
        patience = self._connection.patience(timeout)
        try:
            closed = self.closed_loop
            while not self._arrived(closed):
                self._refuse_stopped()
                if patience.over():
                    self._client.stop()
                    off = closed and self._switch_off()
                    raise ControllerError(
                        f"axis '{self.name}' was not {'on target' if closed else 'at rest'} after "
                        f"{timeout:g} s and was stopped"
                        f"{', with its position control switched off' if off else ''}: check that "
                        "it is free to move, and the settings of its control"
                    )
                self._connection.between_questions()
        except (KeyboardInterrupt, NotConnectedError):
            self._client.stop()
            raise
        self._refuse_stopped()
        if closed:
            self._check_target()

    def _switch_off(self) -> bool:
        """Switch control off, which may oscillate; return whether this was possible."""
        if Capability.OPEN_LOOP not in self.capabilities:
            return False
        # the stop itself is a pending error, which the first command receives
        for _ in range(2):
            with contextlib.suppress(FlexstageError):
                self.set_closed_loop(False)
                return True
        return False

    def servo(self) -> ServoSettings:
        self._require(Capability.SERVO_TUNING)
        return self._tuning.read()

    def set_servo(self, settings: ServoSettings) -> None:
        self._require(Capability.SERVO_TUNING)
        self._tuning.write(settings)

    def _arrived(self, closed: bool) -> bool:
        if closed and self._connection.profile.knows("ONT?"):
            return bool(self._client.ask_values("ONT?", [self.facts.identifier])[0])
        return not self.moving()

    def started(self) -> None:
        """Note that a waveform moves the axis: stops from now on end its motion."""
        self._stops, self._target = self._client.stops, None

    def _refuse_stopped(self) -> None:
        if self._client.stops != self._stops:
            self._stops, self._target = self._client.stops, None
            raise ControllerError(
                f"axis '{self.name}' was stopped before it reached its target", 10
            )

    def _check_target(self) -> None:
        """Verify that the target is still the commanded one, and not that of another program."""
        target, self._target = self._target, None
        if target is None or not self._connection.profile.knows("MOV?"):
            return
        present = self._client.ask_values("MOV?", [self.facts.identifier])[0]
        if not abs(present - target) <= 1e-6 * max(1.0, abs(target)):
            self._connection.check_state()
            raise ControllerError(
                f"axis '{self.name}' was sent to {target:g}, but its target is now {present:g} (in "
                "units of the controller): it was stopped, or another program commands it"
            )

    def _next(self, here: float, voltage: float, *, first: bool) -> float:
        slew = self.limits.slew
        largest = math.inf if slew is None else slew * _STEP_TIME
        if first:
            largest = min(largest, _FIRST_STEP)
        if abs(voltage - here) <= largest:
            return voltage
        return here + math.copysign(largest, voltage - here)

    def _see_volts(self, begin: float, here: float, *, ended: bool) -> None:
        """Compare the voltage at the drive with what was commanded."""
        if abs(here - begin) < 0.9 * _FIRST_STEP:
            return  # the step is too small for the check
        allowed = _VOLT_TOLERANCE + _VOLT_SHARE * abs(here - begin)
        patience = self._connection.patience(_VOLT_TIME)
        while not abs((measured := self.voltage()) - here) <= allowed:
            if patience.over():
                raise ControllerError(
                    f"axis '{self.name}' was sent to {here:.4g} V, but its drive is at "
                    f"{measured:.4g} V: the unit of open-loop commands of the controller is not "
                    "volts, or the amplifier is off; no further command was sent"
                )
            self._connection.between_questions()
        self._volts_seen = ended

    def _output(self) -> str:
        if self.facts.output is None:
            raise ModelError(f"axis '{self.name}' has no voltage: it is not a piezo axis")
        return self.facts.output

    def _require(self, capability: Capability) -> None:
        if capability not in self.capabilities:
            raise not_able(self, capability)


def _on(on: bool) -> str:
    return "on" if on else "off"
