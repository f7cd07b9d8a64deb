"""Interface of all instruments: axes, a recorder, a wave generator.

Callers check what an instrument can do (`Capability`), never which instrument it is. All values are
SI: positions in m, voltages in V, times in s; the drivers convert units. A driver derives its
classes from `Instrument` and `MotionAxis`, and implements the methods that its instrument supports;
the others raise an error with a message.
"""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal, Protocol, runtime_checkable

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.records import Record
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import ServoSettings


class Capability(StrEnum):
    """Capability of an instrument, or of one of its axes."""

    CLOSED_LOOP = "position control by a sensor"
    OPEN_LOOP = "command of the voltage"
    SERVO_TUNING = "setting of the position control that can be read and written"
    WAVE_GENERATOR = "waveform from a table"
    FEEDFORWARD_TABLE = "table of voltages that are added under position control"
    DATA_RECORDER = "record at the rate of the controller"
    CHANNELS = "further sensor that can be read and recorded"
    IMPACT = "hammer impact on the stage with its drives removed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Identity that an instrument reports."""

    vendor: str
    """Manufacturer."""
    model: str
    """Model."""
    serial_number: str = ""
    """Serial number; empty where it reports none."""
    firmware: str = ""
    """Version of its firmware."""
    simulated: bool = False
    """Whether it is a simulation, whose data are not measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """A signal that can be recorded."""

    kind: str
    """``position``, ``target``, ``voltage`` (of the axis `source`), ``channel`` (the sensor with
    the number `source`), ``force`` and ``response`` (of a hammer impact).
    """
    source: str
    """The axis, or the number of the channel."""
    name: str
    """Name of its column in the record."""
    unit: str = "m"
    """SI unit of the recorded values: ``m``, ``V``, ``rad``, ``N``, ``m/s^2``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelMap:
    """Channels of an instrument by the name of their sensor."""

    numbers: Mapping[str, int] = field(default_factory=dict)
    """Number of the channel by name."""
    units: Mapping[str, str] = field(default_factory=dict)
    """SI unit by name."""

    def signal(self, name: str) -> Signal:
        """Return the signal of a sensor."""
        return Signal(
            kind="channel",
            source=str(self.numbers[name]),
            name=name,
            unit=self.units.get(name, "m"),
        )


Quantity = Literal["voltage", "position"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Waveform:
    """Command of one or more axes over time.

    Examples
    --------
    >>> ramp = Waveform(values={"x": np.array([0.0, 60.0, 120.0])}, sample_rate_hz=10.0,
    ...                 quantity="voltage")
    >>> ramp.duration, ramp.largest_rate("x")
    (0.3, 600.0)
    """

    values: Mapping[str, Array]
    """Samples by axis [V, or m], shape (n,), n at least 2."""
    sample_rate_hz: float
    """Samples in a second [Hz]; linear interpolation between them."""
    quantity: Quantity
    """Quantity of the values: voltage of the drives, or position under control."""

    def __post_init__(self) -> None:
        if self.quantity not in ("voltage", "position"):
            raise ModelError(
                f"the quantity of a waveform is 'voltage' or 'position', got {self.quantity!r}"
            )
        if not 0.0 < self.sample_rate_hz < float("inf"):
            raise ModelError(
                f"the rate of a waveform must be positive and finite, got {self.sample_rate_hz!r}"
            )
        sizes = {np.shape(v) for v in self.values.values()}
        if len(sizes) != 1 or len(next(iter(sizes))) != 1 or next(iter(sizes))[0] < 2:
            raise ModelError(
                "a waveform needs at least one axis, each with the same number of samples, at "
                f"least 2, got {sorted(sizes) or 'none'}"
            )
        for name, v in self.values.items():
            bad = np.flatnonzero(~np.isfinite(v))
            if bad.size:
                raise ModelError(
                    f"the waveform of axis '{name}' has the value {v[bad[0]]} at sample {bad[0]}: "
                    "every sample must be finite"
                )

    @property
    def size(self) -> int:
        """Number of samples."""
        return len(next(iter(self.values.values())))

    @property
    def duration(self) -> float:
        """Duration [s], including the interval after the last sample."""
        return self.size / self.sample_rate_hz

    def largest_rate(self, axis: str, *, closed: bool = False) -> float:
        """Return the largest slope of an axis [V/s, or m/s].

        For a repeated waveform (`closed`), this includes the step from its end to its start.
        """
        v = self.values[axis]
        steps = np.diff(np.append(v, v[0]) if closed else v)
        return float(np.max(np.abs(steps))) * self.sample_rate_hz


@runtime_checkable
class MotionAxis(Protocol):
    """One axis of an instrument."""

    name: str
    """Its name at the instrument."""
    capabilities: frozenset[Capability]
    """Its capabilities."""

    @property
    def limits(self) -> AxisLimits:
        """Limits of commands: the narrower of those of the stage and of the controller."""
        ...

    @property
    def closed_loop(self) -> bool:
        """Whether its position control is on; constant where it cannot be switched."""
        return Capability.OPEN_LOOP not in self.capabilities

    def set_closed_loop(self, on: bool) -> None:
        """Switch its position control on or off; the stage keeps its position if possible."""
        if on != self.closed_loop:
            raise not_able(self, Capability.CLOSED_LOOP if on else Capability.OPEN_LOOP)

    def position(self) -> float:
        """Return the reading of its sensor [m]."""
        ...

    def voltage(self) -> float:
        """Return the voltage at its drive [V]; NaN where it is unknown."""
        return math.nan

    def move_to(self, position: float, *, wait: bool = True) -> None:
        """Move to a position [m]; the limits are checked before any command is sent."""
        raise not_able(self, Capability.CLOSED_LOOP)

    def reference(self) -> None:
        """Move to a reference switch if it is not referenced yet; otherwise do nothing."""
        return

    def set_voltage(self, voltage: float) -> None:
        """Set the voltage [V] in open loop, as a ramp if a step would exceed the slew limit."""
        raise not_able(self, Capability.OPEN_LOOP)

    def moving(self) -> bool:
        """Return whether it moves."""
        ...

    def wait(self, timeout: float = 30.0) -> None:
        """Wait until it is at rest, and in closed loop on target; stop it on timeout [s]."""
        ...

    def servo(self) -> ServoSettings:
        """Return the settings of its position control."""
        raise not_able(self, Capability.SERVO_TUNING)

    def set_servo(self, settings: ServoSettings) -> None:
        """Change the settings of its position control."""
        raise not_able(self, Capability.SERVO_TUNING)

    def __repr__(self) -> str:
        # known properties only: this sends no question to a controller
        able = sorted(c.name.lower().replace("_", " ") for c in self.capabilities)
        return f"<axis '{self.name}': {', '.join(able)}>"


def not_able(axis: MotionAxis, capability: Capability) -> ModelError:
    """Return the error of an axis that lacks a capability."""
    return ModelError(
        f"axis '{axis.name}' of this controller does not support this: it has no {capability.value}"
    )


@runtime_checkable
class Recorder(Protocol):
    """Recorder of signals at a fixed rate."""

    base_rate_hz: float
    """Highest sample rate [Hz]; lower rates are integer fractions of it."""
    capacity: int
    """Largest number of samples of a signal."""
    signals: int
    """Largest number of signals at once."""

    def configure(self, signals: Sequence[Signal], rate_hz: float, samples: int) -> float:
        """Set signals, rate and number of samples; return the actual sample rate [Hz]."""
        ...

    def arm(self) -> None:
        """Start with the next waveform, impact or `start`."""
        ...

    def start(self) -> None:
        """Start now."""
        ...

    def available(self) -> int:
        """Return the number of available samples of each signal."""
        ...

    def read(self, first: int, count: int) -> Record:
        """Return samples ``first`` to ``first + count - 1``, counted from 0."""
        ...


@runtime_checkable
class WaveGenerator(Protocol):
    """Generator of waveforms from tables, synchronous for all axes."""

    base_rate_hz: float
    """Highest sample rate [Hz]; slower tables are interpolated linearly."""
    capacity: int
    """Largest number of samples over all tables."""

    def load(self, waveform: Waveform, *, feedforward: Waveform | None = None) -> None:
        """Check the complete waveform against the limits, then write it to the tables.

        Feedforward voltages can be added to a waveform of positions.
        """
        ...

    def start(self, cycles: int = 1) -> None:
        """Run the loaded waveform; the axes must be at its first sample.

        0 cycles run it endlessly, where the instrument can.
        """
        ...

    def running(self) -> bool:
        """Return whether a waveform runs."""
        ...

    def stop(self) -> None:
        """Stop the waveform at its present value."""
        ...


@runtime_checkable
class Instrument(Protocol):
    """A controller with its stage. Connecting neither moves the stage nor switches anything."""

    identity: Identity
    """Its identity."""
    concurrent: bool = False
    """Whether a second thread may read axes while another one works."""

    @property
    def capabilities(self) -> frozenset[Capability]:
        """Its capabilities, including those of its axes."""
        return frozenset().union(*(axis.capabilities for axis in self.axes.values()))

    @property
    def axes(self) -> Mapping[str, MotionAxis]:
        """Its axes, by the names of the stage's axes where possible."""
        ...

    @property
    def recorder(self) -> Recorder:
        """Its recorder; `ModelError` where it has none."""
        raise ModelError("this instrument has no data recorder")

    @property
    def waves(self) -> WaveGenerator:
        """Its wave generator; `ModelError` where it has none."""
        raise ModelError("this instrument has no wave generator")

    def channel(self, number: int) -> float:
        """Return the present reading of a sensor, by its number [m, rad, N]."""
        raise ModelError(f"there is no sensor {number}: this instrument has no sensors")

    def strike(self, axis: str) -> None:
        """Excite the stage along an axis with a hammer impact; needs `Capability.IMPACT`."""
        del axis
        raise ModelError(
            "this controller has no hammer: excite the stage by hand, and record the impact"
        )

    def pause(self, seconds: float) -> None:
        """Let time pass [s] on the instrument's own clock, which in a simulation may run fast."""
        time.sleep(seconds)

    def stop(self) -> None:
        """Stop all motion immediately, from any thread; never raises on a lost connection."""
        ...

    def settings(self) -> Mapping[str, str]:
        """Return the settings, as text for the record."""
        return {}

    def close(self) -> None:
        """Disconnect; this does not move the stage."""
        ...

    def __repr__(self) -> str:
        identity = self.identity
        number = f" no. {identity.serial_number}" if identity.serial_number else ""
        kind = "simulated " if identity.simulated and "simulated" not in identity.model else ""
        axes = ", ".join(self.axes)
        return f"<{kind}{identity.vendor} {identity.model}{number}, axes {axes or 'none'}>"
