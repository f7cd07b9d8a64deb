"""How a card is wired and set, and what a driver of it must be able to do."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class CardInfo:
    """What the driver reports about a card.

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
    """Who made it."""
    model: str
    """Which card it is."""
    serial_number: str = ""
    """Its serial number; empty where it has none."""
    simulated: bool
    """Whether there is no hardware behind it, so that nothing it gives was measured."""
    note: str
    """What a reader of a record should know of the driver."""
    single_rate_hz: float
    """Largest rate of a single input [Hz]."""
    total_rate_hz: float
    """Largest number of samples in a second of several inputs together [Hz]."""
    output_rate_hz: float
    """Largest rate of its outputs [Hz]; infinite where none is used."""
    simultaneous: bool
    """Whether each input has a converter of its own; else they share one by a multiplexer."""

    def largest_rate_hz(self, inputs: int) -> float:
        """Return the largest rate at which so many inputs, and the outputs in use, go together."""
        return min(self._input_rate_hz(inputs), self.output_rate_hz)

    def rate_limit(self, inputs: int) -> str:
        """Return the same rate as text, with what it is limited by."""
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
    """Inputs that are sampled by a clock without end, once started."""

    rate_hz: float
    """Rate that the card keeps [Hz]."""
    interval: float
    """Time from one input's conversion to the next one's [s]; zero where all are converted at once,
    not a number where the driver does not report it.
    """

    def start(self) -> None:
        """Start the clock."""
        ...

    def available(self) -> int:
        """Return how many samples of each input wait to be read."""
        ...

    def read(self, count: int) -> Array:
        """Return the oldest samples that were not read [V], shape (channels, count)."""
        ...

    def close(self) -> None:
        """Stop the clock and give the inputs free."""
        ...


class OutputTask(Protocol):
    """Samples that are put out once by a clock; the outputs hold the last one."""

    def start(self) -> None:
        """Begin, with the next edge of the clock."""
        ...

    def done(self) -> bool:
        """Say whether the last sample was put out; after a stop, whether it was before."""
        ...

    def stop(self) -> None:
        """Stop where it is, from any thread."""
        ...

    def generated(self) -> int:
        """Return how many samples left the driver; -1 where it is not known.

        Up to the size of the card's memory they may be ahead of what was put out.
        """
        ...

    def close(self) -> None:
        """Give the outputs free; they hold what they give."""
        ...


class NiBackend(Protocol):
    """A driver of NI cards; voltages are those at the terminals of the card, channels first."""

    def describe(self, setup: NiSetup) -> CardInfo:
        """Ask the driver about a card, and whether its outputs can take the clock of its inputs."""
        ...

    def read_now(self, inputs: Sequence[SensorInput]) -> Array:
        """Return what stands at inputs now [V], shape (channels,)."""
        ...

    def write_now(self, outputs: Sequence[DriveOutput], volts: Array) -> None:
        """Put out voltages now [V], shape (channels,)."""
        ...

    def read_outputs(self, outputs: Sequence[DriveOutput]) -> Array:
        """Measure what outputs give, by internal channels of the card [V], shape (channels,).

        Not a number where the card has none; refused while the inputs are in use.
        """
        ...

    def open_input(self, inputs: Sequence[SensorInput], rate_hz: float, buffer: int) -> InputTask:
        """Prepare inputs; `buffer` samples of each are kept until they are read."""
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

        They take the clock of the inputs, and their own of `rate_hz` where there are none. Inputs
        that start later put out the first sample with their own first one.
        """
        ...

    def pause(self, seconds: float) -> None:
        """Let time pass."""
        ...

    def close(self) -> None:
        """Give all free."""
        ...
