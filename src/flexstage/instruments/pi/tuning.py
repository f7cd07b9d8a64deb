"""Settings of a position control as parameters of a controller that names their units."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from flexstage.errors import ControllerError, ModelError
from flexstage.instruments.pi.connection import Connection
from flexstage.instruments.pi.profile import ControllerProfile
from flexstage.system.servo import Notch, ServoSettings

_PROPORTIONAL = r"servo loop p-term.*\[V/um\]"
_INTEGRAL = r"servo loop i-term.*\[V/\(um s\)\]"
_LOWPASS = r"low-?pass.*\[Hz\]"
_NOTCH = r"notch frequency {}\b.*\[Hz\]"
_REJECTION = r"notch rejection {}\b.*gain"
_BANDWIDTH = r"notch bandwidth {}\b.*damping"
_MICRO = 1e-6


@dataclass(frozen=True, slots=True)
class _Slot:
    """Numbers of the parameters of one notch."""

    frequency: int
    rejection: int
    bandwidth: int


def tunable(profile: ControllerProfile) -> bool:
    """Say whether a controller names its gains with their units: others are never set."""
    return (
        profile.knows("SPA", "SPA?")
        and profile.parameter(_PROPORTIONAL) is not None
        and profile.parameter(_INTEGRAL) is not None
    )


class ServoTuning:
    """Settings of the position control of one axis.

    A notch is sent as frequency, gain at it, and bandwidth, that is twice the damping ratio of its
    poles. Validity: only for controllers whose parameters say so in their names.
    """

    def __init__(self, connection: Connection, axis: str) -> None:
        self._connection, self._axis = connection, axis

    def read(self) -> ServoSettings:
        """Read the settings."""
        notches = []
        for slot in self._slots():
            frequency = self._number(slot.frequency)
            if frequency > 0.0:
                rejection, width = self._number(slot.rejection), self._number(slot.bandwidth)
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
        """Write settings: in one line if not too long, else with the gains at 0 meanwhile."""
        gains = [
            (self._known(_PROPORTIONAL), settings.proportional * _MICRO),
            (self._known(_INTEGRAL), settings.integral * _MICRO),
        ]
        filters = [*self._notches(settings), *self._lowpass(settings)]
        whole = self._line([*filters, *gains])
        if len(whole) <= self._connection.transfer.line_limit:
            self._connection.tell(whole)
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
                f"{len(slots)}: leave the weakest out"
            )
        for slot, notch in zip(slots, settings.notches, strict=False):
            yield slot.frequency, notch.frequency_hz
            yield slot.rejection, notch.zero_damping / notch.pole_damping
            yield slot.bandwidth, 2.0 * notch.pole_damping
        for slot in slots[len(settings.notches) :]:
            yield slot.frequency, 0.0

    def _lowpass(self, settings: ServoSettings) -> Iterator[tuple[int, float]]:
        key = self._connection.profile.parameter(_LOWPASS)
        if key is not None:
            yield key, settings.lowpass_hz or 0.0
        elif settings.lowpass_hz is not None:
            raise ModelError("the controller has no low-pass in its control: leave it out")

    def _slots(self) -> Iterator[_Slot]:
        profile = self._connection.profile
        count = sum(
            bool(re.search(r"notch frequency \d+", name, re.IGNORECASE))
            for name in profile.parameters.values()
        )
        for slot in range(1, count + 1):
            keys = [profile.parameter(p.format(slot)) for p in (_NOTCH, _REJECTION, _BANDWIDTH)]
            if None not in keys:
                yield _Slot(*(key for key in keys if key is not None))

    def _known(self, pattern: str) -> int:
        key = self._connection.profile.parameter(pattern)
        if key is None:
            raise ModelError(
                "the controller does not report the unit of its control gains, so they cannot be "
                "set from here"
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
