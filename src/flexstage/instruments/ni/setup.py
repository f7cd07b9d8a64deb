"""What is wired to an NI card: drives behind amplifiers, and sensors."""

import math
from collections import Counter
from dataclasses import dataclass
from typing import Literal

from flexstage.arrays import Array
from flexstage.errors import ModelError

Range = tuple[float, float]
Terminal = Literal["default", "diff", "nrse", "pseudo_diff", "rse"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorInput:
    r"""A sensor at an analogue input.

    .. math:: y = g\,v + y_0

    Examples
    --------
    >>> import numpy as np
    >>> sensor = SensorInput(channel="Dev1/ai0", name="x", gain=-2.5e-5, offset=1.1e-4)
    >>> round(float(sensor.reading(np.array(1.3))) * 1e6, 6)
    77.5
    """

    channel: str
    """The input: ``Dev1/ai0``."""
    name: str
    """What it reads."""
    unit: str = "m"
    """SI unit of what it reads: ``m``, ``rad``, ``N``."""
    gain: float
    """What it reads for a volt [m/V, rad/V, N/V]; negative where the sensor faces the motion."""
    offset: float = 0.0
    """What it reads at 0 V [m, rad, N]."""
    voltage_range: Range = (-10.0, 10.0)
    """Range of the input [V]."""
    terminal: Terminal = "default"
    """How it is wired: ``default``, ``diff``, ``nrse``, ``pseudo_diff``, ``rse``."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.gain) and self.gain != 0.0 and math.isfinite(self.offset)):
            raise ModelError(
                f"the gain of sensor '{self.name}' must be finite and not zero, got {self.gain!r}: "
                "give what it reads for a volt"
            )
        _require_rise(self.voltage_range, f"sensor '{self.name}'")

    def reading(self, volts: Array) -> Array:
        """Return what the sensor reads [m, rad, N] at voltages [V] of the input, any shape."""
        return self.gain * volts + self.offset


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveOutput:
    r"""A drive behind an amplifier at an analogue output.

    .. math:: u = g\,v + u_0

    Examples
    --------
    >>> import numpy as np
    >>> drive = DriveOutput(channel="Dev1/ao0", axis="x", sensor="x", gain=15.0)
    >>> drive.drive_range, float(drive.output(np.array(120.0)))
    ((-150.0, 150.0), 8.0)
    """

    channel: str
    """The output: ``Dev1/ao0``."""
    axis: str
    """The axis of the stage."""
    sensor: str
    """Name of the sensor that reads the axis."""
    gain: float = 1.0
    """Gain of the amplifier [V/V]."""
    offset: float = 0.0
    """Voltage at the drive when the card gives 0 V [V]."""
    voltage_range: Range = (-10.0, 10.0)
    """Range of the output [V]."""
    standing: float | None = None
    """Voltage at the drive when the program begins [V]. A card that can read its outputs back is
    asked, and must agree; one that cannot is taken to give 0 V, as after it is switched on,
    where nothing is given.
    """

    def __post_init__(self) -> None:
        if not (0.0 < self.gain < math.inf and math.isfinite(self.offset)):
            raise ModelError(
                f"the gain of the amplifier of axis '{self.axis}' must be positive and finite, got "
                f"{self.gain!r}"
            )
        _require_rise(self.voltage_range, f"the drive of axis '{self.axis}'")
        low, high = self.drive_range
        if not low <= self.begins_at <= high:
            raise ModelError(
                f"the drive of axis '{self.axis}' cannot stand at {self.begins_at:g} V: its output "
                f"and amplifier give {low:g} to {high:g} V"
            )

    @property
    def begins_at(self) -> float:
        """Voltage at the drive when the program begins [V]."""
        return self.offset if self.standing is None else self.standing

    @property
    def drive_range(self) -> Range:
        """What the output and the amplifier can give to the drive [V]."""
        low, high = self.voltage_range
        return self.gain * low + self.offset, self.gain * high + self.offset

    def output(self, voltage: Array) -> Array:
        """Return what the card must give [V] for voltages at the drive [V], any shape."""
        return (voltage - self.offset) / self.gain

    def voltage(self, output: Array) -> Array:
        """Return what the drive gets [V] for voltages of the card [V], any shape."""
        return self.gain * output + self.offset


@dataclass(frozen=True, slots=True, kw_only=True)
class NiSetup:
    """A card and all that is wired to it."""

    device: str
    """Name of the card: ``Dev1``."""
    inputs: tuple[SensorInput, ...]
    """Its sensors; their numbers count from 1 in this order."""
    outputs: tuple[DriveOutput, ...] = ()
    """Its drives."""
    output_rate_hz: float = 10e3
    """How often the outputs change at least while a waveform runs [Hz]."""
    lead_to_safe: bool = True
    """Whether `close` leads the drives to their safe voltages: a card goes on giving what it gave
    when nobody watches any more.
    """

    def __post_init__(self) -> None:
        if not self.inputs:
            raise ModelError(f"card '{self.device}' needs one sensor or more, got none")
        for what, names in (
            ("sensors have the name", [s.name for s in self.inputs]),
            ("axes have the name", [d.axis for d in self.outputs]),
            ("channels are", [c.channel for c in (*self.inputs, *self.outputs)]),
        ):
            if twice := [n for n, count in Counter(names).items() if count > 1]:
                raise ModelError(f"two {what} '{twice[0]}' at card '{self.device}': name each once")
        for drive in self.outputs:
            self.number(drive.sensor)
        if not 0.0 < self.output_rate_hz < math.inf:
            raise ModelError(
                f"the rate of the outputs must be positive and finite, got {self.output_rate_hz!r}"
            )

    def number(self, sensor: str) -> int:
        """Return the number of a sensor, from 1."""
        names = [s.name for s in self.inputs]
        if sensor not in names:
            raise ModelError(
                f"card '{self.device}' has no sensor '{sensor}': it has "
                f"{', '.join(map(repr, names))}"
            )
        return names.index(sensor) + 1


def _require_rise(bounds: Range, what: str) -> None:
    if not -math.inf < bounds[0] < bounds[1] < math.inf:
        raise ModelError(f"the voltage range of {what} must rise and be finite, got {bounds!r}")
