"""Wiring and settings of an NI card, and the interface of its drivers."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError

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
    """Name of the reading."""
    unit: str = "m"
    """SI unit of the reading: ``m``, ``rad``, ``N``."""
    gain: float
    """Sensitivity [m/V, rad/V, N/V]; negative where the sensor faces the motion."""
    offset: float = 0.0
    """Reading at 0 V [m, rad, N]."""
    voltage_range: Range = (-10.0, 10.0)
    """Range of the input [V]."""
    terminal: Terminal = "default"
    """Terminal configuration: ``default``, ``diff``, ``nrse``, ``pseudo_diff``, ``rse``."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.gain) and self.gain != 0.0 and math.isfinite(self.offset)):
            raise ModelError(
                f"the gain of sensor '{self.name}' must be finite and not zero, got {self.gain!r}: "
                "give its reading per volt"
            )
        _require_rise(self.voltage_range, f"sensor '{self.name}'")

    def reading(self, volts: Array) -> Array:
        """Return the readings [m, rad, N] at voltages [V] of the input, any shape."""
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
    """Voltage at the drive for 0 V of the card [V]."""
    voltage_range: Range = (-10.0, 10.0)
    """Range of the output [V]."""
    standing: float | None = None
    """Voltage at the drive when the program starts [V]. A card that can read its outputs back must
    confirm it. Without a value, a card that cannot is assumed to output 0 V, as after power-on.
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
                f"the drive of axis '{self.axis}' cannot be at {self.begins_at:g} V: the range of "
                f"its output and amplifier is {low:g} to {high:g} V"
            )

    @property
    def begins_at(self) -> float:
        """Voltage at the drive when the program starts [V]."""
        return self.offset if self.standing is None else self.standing

    @property
    def drive_range(self) -> Range:
        """Voltage range of the output with its amplifier at the drive [V]."""
        low, high = self.voltage_range
        return self.gain * low + self.offset, self.gain * high + self.offset

    def output(self, voltage: Array) -> Array:
        """Return the voltages of the card [V] for voltages at the drive [V], any shape."""
        return (voltage - self.offset) / self.gain

    def voltage(self, output: Array) -> Array:
        """Return the voltages at the drive [V] for voltages of the card [V], any shape."""
        return self.gain * output + self.offset


@dataclass(frozen=True, slots=True, kw_only=True)
class NiSetup:
    """A card with its wiring."""

    device: str
    """Name of the card: ``Dev1``."""
    inputs: tuple[SensorInput, ...]
    """Its sensors; they are numbered from 1 in this order."""
    outputs: tuple[DriveOutput, ...] = ()
    """Its drives."""
    output_rate_hz: float = 10e3
    """Lowest update rate of the outputs during a waveform [Hz]."""
    lead_to_safe: bool = True
    """Whether `close` ramps the drives to their safe voltages. Without this, a card keeps its
    output voltages after the program has ended.
    """

    def __post_init__(self) -> None:
        if not self.inputs:
            raise ModelError(f"card '{self.device}' needs at least one sensor, got none")
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


@dataclass(frozen=True, slots=True, kw_only=True)
class CardInfo:
    """Properties of a card that the driver reports.

    Examples
    --------
    >>> card = CardInfo(
    ...     vendor="NI", model="USB-6211", simulated=False, note="", single_rate_hz=250e3,
    ...     total_rate_hz=250e3, output_rate_hz=250e3, simultaneous=False,
    ... )
    >>> card.largest_rate_hz(4), card.rate_limit(4)
    (62500.0, '62500 Hz (250000 samples/s shared by 4 inputs)')
    """

    vendor: str
    """Manufacturer."""
    model: str
    """Model."""
    serial_number: str = ""
    """Serial number; empty where it has none."""
    simulated: bool
    """Whether it is a simulation, whose data are not measured."""
    note: str
    """Note on the driver, for records."""
    single_rate_hz: float
    """Largest rate of a single input [Hz]."""
    total_rate_hz: float
    """Largest number of samples in a second of several inputs together [Hz]."""
    output_rate_hz: float
    """Largest rate of its outputs [Hz]; infinite where none is used."""
    simultaneous: bool
    """Whether each input has its own converter; otherwise they share one by a multiplexer."""

    def largest_rate_hz(self, inputs: int) -> float:
        """Return the largest common rate of a number of inputs and the outputs in use."""
        return min(self._input_rate_hz(inputs), self.output_rate_hz)

    def rate_limit(self, inputs: int) -> str:
        """Return this rate as text, with the reason of the limit."""
        rate = self.largest_rate_hz(inputs)
        if rate < self._input_rate_hz(inputs):
            return f"{rate:.6g} Hz (limit of its outputs)"
        if rate < self.single_rate_hz and not self.simultaneous:
            return f"{rate:.6g} Hz ({self.total_rate_hz:.6g} samples/s shared by {inputs} inputs)"
        return f"{rate:.6g} Hz (limit of its inputs)"

    def _input_rate_hz(self, inputs: int) -> float:
        shared = self.total_rate_hz / (1 if self.simultaneous else inputs)
        return min(self.single_rate_hz, shared if inputs > 1 else self.single_rate_hz)


class InputTask(Protocol):
    """Inputs that are sampled by a clock continuously, once started."""

    rate_hz: float
    """Actual rate of the card [Hz]."""
    interval: float
    """Time between the conversions of successive inputs [s]; zero for simultaneous conversion, NaN
    where the driver does not report it.
    """

    def start(self) -> None:
        """Start the clock."""
        ...

    def available(self) -> int:
        """Return the number of unread samples of each input."""
        ...

    def read(self, count: int) -> Array:
        """Return the oldest unread samples [V], shape (channels, count)."""
        ...

    def close(self) -> None:
        """Stop the clock and release the inputs."""
        ...


class OutputTask(Protocol):
    """Samples that are output once by a clock; the outputs keep the last one."""

    def start(self) -> None:
        """Start with the next edge of the clock."""
        ...

    def done(self) -> bool:
        """Return whether the last sample was output; after a stop, whether it was before."""
        ...

    def stop(self) -> None:
        """Stop at the present sample, from any thread."""
        ...

    def generated(self) -> int:
        """Return the number of samples that left the driver; -1 where it is unknown.

        It may exceed the number of samples that were output by up to the card's memory.
        """
        ...

    def close(self) -> None:
        """Release the outputs; they keep their voltages."""
        ...


class NiBackend(Protocol):
    """A driver of NI cards; voltages are those at the terminals of the card, channels first."""

    def describe(self, setup: NiSetup) -> CardInfo:
        """Ask the driver about a card, and whether its outputs can take the clock of its inputs."""
        ...

    def read_now(self, inputs: Sequence[SensorInput]) -> Array:
        """Return the present voltages of inputs [V], shape (channels,)."""
        ...

    def write_now(self, outputs: Sequence[DriveOutput], volts: Array) -> None:
        """Output voltages now [V], shape (channels,)."""
        ...

    def read_outputs(self, outputs: Sequence[DriveOutput]) -> Array:
        """Measure the voltages of outputs, by internal channels of the card [V], shape (channels,).

        NaN where the card has no such channels; refused while the inputs are in use.
        """
        ...

    def open_input(self, inputs: Sequence[SensorInput], rate_hz: float, buffer: int) -> InputTask:
        """Prepare inputs; `buffer` is the number of buffered samples of each."""
        ...

    def open_output(
        self,
        outputs: Sequence[DriveOutput],
        volts: Array,
        rate_hz: float,
        *,
        clock: InputTask | None,
    ) -> OutputTask:
        """Prepare outputs for voltages [V], shape (channels, n).

        They use the clock of the inputs, or their own clock of `rate_hz` without inputs. If the
        inputs start later, the first sample is output with their first one.
        """
        ...

    def pause(self, seconds: float) -> None:
        """Let time pass."""
        ...

    def close(self) -> None:
        """Release all resources."""
        ...
