"""What every instrument offers, whatever it is: axes, a recorder, a generator of waveforms.

A caller asks for what an instrument can do (`Capability`) and never for what it is. All values are
SI: positions in m, voltages in V, times in s; the drivers convert at the wire. A driver derives its
classes from `Instrument` and `MotionAxis`, and writes what its instrument can do; what is left out
refuses with a sentence.
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
    """Something that an instrument, or one of its axes, can do."""

    CLOSED_LOOP = "position control by a sensor"
    OPEN_LOOP = "command of the voltage"
    SERVO_TUNING = "setting of the position control that can be read and written"
    WAVE_GENERATOR = "waveform from a table"
    FEEDFORWARD_TABLE = "a table of voltages beside the position control"
    DATA_RECORDER = "record at the rate of the controller"
    CHANNELS = "further sensor that can be read and recorded"
    IMPACT = "a blow of a hammer on the stage, its drives taken out"


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """What an instrument says it is."""

    vendor: str
    """Who made it."""
    model: str
    """What it is."""
    serial_number: str = ""
    """Its serial number; empty where it tells none."""
    firmware: str = ""
    """Version of its firmware."""
    simulated: bool = False
    """Whether it is a simulation, so that nothing measured with it is a measurement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """Something that can be recorded."""

    kind: str
    """``position``, ``target``, ``voltage`` (of an axis, named by `source`), ``channel`` (a sensor,
    whose number is `source`), ``force`` and ``response`` (of a blow).
    """
    source: str
    """The axis, or the number of the channel."""
    name: str
    """What its column is called in the record."""
    unit: str = "m"
    """SI unit of the recorded values: ``m``, ``V``, ``rad``, ``N``, ``m/s^2``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelMap:
    """Sensors of an instrument by what they read."""

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
    """What axes are to follow.

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
    """Samples in a second [Hz]; straight lines between them."""
    quantity: Quantity
    """Whether the values are voltages of the drives, or positions under control."""

    def __post_init__(self) -> None:
        if self.quantity not in ("voltage", "position"):
            raise ModelError(
                f"a waveform is made of 'voltage' or 'position', got {self.quantity!r}"
            )
        if not 0.0 < self.sample_rate_hz < float("inf"):
            raise ModelError(
                f"the rate of a waveform must be positive and finite, got {self.sample_rate_hz!r}"
            )
        sizes = {np.shape(v) for v in self.values.values()}
        if len(sizes) != 1 or len(next(iter(sizes))) != 1 or next(iter(sizes))[0] < 2:
            raise ModelError(
                "a waveform needs one axis or more, each with the same number of samples, 2 at "
                f"least, got {sorted(sizes) or 'none'}"
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
        """Time that it takes [s], the step after the last sample included."""
        return self.size / self.sample_rate_hz

    def largest_rate(self, axis: str, *, closed: bool = False) -> float:
        """Return the largest slope of an axis [V/s, or m/s].

        Where the waveform is repeated (`closed`), the step from its end to its start counts.
        """
        v = self.values[axis]
        steps = np.diff(np.append(v, v[0]) if closed else v)
        return float(np.max(np.abs(steps))) * self.sample_rate_hz


@runtime_checkable
class MotionAxis(Protocol):
    """One axis of an instrument."""

    name: str
    """Its name, as the controller knows it."""
    capabilities: frozenset[Capability]
    """What it can do."""

    @property
    def limits(self) -> AxisLimits:
        """What may be commanded: the narrower of the stage's limits and the controller's."""
        ...

    @property
    def closed_loop(self) -> bool:
        """Whether its position control is on; always, or never, where it has no other way."""
        return Capability.OPEN_LOOP not in self.capabilities

    def set_closed_loop(self, on: bool) -> None:
        """Switch its position control on or off; the stage stays where it is as far as it can."""
        if on != self.closed_loop:
            raise not_able(self, Capability.CLOSED_LOOP if on else Capability.OPEN_LOOP)

    def position(self) -> float:
        """Return what its sensor reads [m]."""
        ...

    def voltage(self) -> float:
        """Return the voltage at its drive [V]; not a number where nobody knows."""
        return math.nan

    def move_to(self, position: float, *, wait: bool = True) -> None:
        """Move to a position [m]; the limits are checked before any command leaves."""
        raise not_able(self, Capability.CLOSED_LOOP)

    def reference(self) -> None:
        """Move to a switch where its positions do not count yet; nothing where they do."""

    def set_voltage(self, voltage: float) -> None:
        """Set the voltage [V] in open loop, by a ramp where a step would pass the slew limit."""
        raise not_able(self, Capability.OPEN_LOOP)

    def moving(self) -> bool:
        """Say whether it moves."""
        ...

    def wait(self, timeout: float = 30.0) -> None:
        """Wait until it stands, and in closed loop is on target; stop it on time-out [s]."""
        ...

    def servo(self) -> ServoSettings:
        """Return the settings of its position control."""
        raise not_able(self, Capability.SERVO_TUNING)

    def set_servo(self, settings: ServoSettings) -> None:
        """Change the settings of its position control."""
        raise not_able(self, Capability.SERVO_TUNING)

    def __repr__(self) -> str:
        # what is known without a question: nothing is asked of a controller to show it
        able = sorted(c.name.lower().replace("_", " ") for c in self.capabilities)
        return f"<axis '{self.name}': {', '.join(able)}>"


def not_able(axis: MotionAxis, capability: Capability) -> ModelError:
    """Return the error of an axis that is asked for what it cannot do."""
    return ModelError(
        f"axis '{axis.name}' of this controller cannot do this: there is no {capability.value}"
    )


@runtime_checkable
class Recorder(Protocol):
    """Records signals at a fixed rate."""

    base_rate_hz: float
    """Highest rate of samples [Hz]; slower ones are whole parts of it."""
    capacity: int
    """Largest number of samples of a signal."""
    signals: int
    """Largest number of signals at once."""

    def configure(self, signals: Sequence[Signal], rate_hz: float, samples: int) -> float:
        """Choose what to record and how much; return the rate that will be kept [Hz]."""
        ...

    def arm(self) -> None:
        """Start with the next waveform, blow or `start`."""
        ...

    def start(self) -> None:
        """Start now."""
        ...

    def available(self) -> int:
        """Return the number of samples of each signal that are there."""
        ...

    def read(self, first: int, count: int) -> Record:
        """Return samples ``first`` to ``first + count - 1``, counted from 0."""
        ...


@runtime_checkable
class WaveGenerator(Protocol):
    """Runs waveforms from tables, all axes in step."""

    base_rate_hz: float
    """Highest rate of samples [Hz]; slower tables are joined by straight lines."""
    capacity: int
    """Largest number of samples over all tables."""

    def load(self, waveform: Waveform, *, feedforward: Waveform | None = None) -> None:
        """Check a waveform whole against the limits, then write it to the tables.

        The feedforward is of voltages, beside a waveform of positions.
        """
        ...

    def start(self, cycles: int = 1) -> None:
        """Run the waveform that was loaded; the axes must stand at its first sample.

        It runs endlessly for 0 cycles, where the instrument can.
        """
        ...

    def running(self) -> bool:
        """Say whether a waveform runs."""
        ...

    def stop(self) -> None:
        """Stop the waveform where it is."""
        ...


@runtime_checkable
class Instrument(Protocol):
    """A controller with its stage. Connecting moves nothing and switches nothing."""

    identity: Identity
    """What it is."""
    concurrent: bool = False
    """Whether a second thread may read axes while another one works."""

    @property
    def capabilities(self) -> frozenset[Capability]:
        """What it can do: what one of its axes can, where it does not say more."""
        return frozenset().union(*(axis.capabilities for axis in self.axes.values()))

    @property
    def axes(self) -> Mapping[str, MotionAxis]:
        """Its axes, by the names of the stage's axes where it has them."""
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
        """Return what a sensor, by its number, reads now [m, rad, N]."""
        raise ModelError(f"there is no sensor {number}: this instrument has none")

    def strike(self, axis: str) -> None:
        """Strike the stage along an axis with a hammer; only where `Capability.IMPACT` is there."""
        del axis
        raise ModelError(
            "this controller cannot strike the stage: strike it by hand, and record it"
        )

    def pause(self, seconds: float) -> None:
        """Let time pass [s] on the instrument's own clock, which in a simulation may run fast."""
        time.sleep(seconds)

    def stop(self) -> None:
        """Stop all motion, from any thread, whatever else goes on; never raises on a lost link."""
        ...

    def settings(self) -> Mapping[str, str]:
        """Return what was set, as text for the record."""
        return {}

    def close(self) -> None:
        """End the link; nothing moves by it."""
        ...

    def __repr__(self) -> str:
        identity = self.identity
        number = f" no. {identity.serial_number}" if identity.serial_number else ""
        kind = "simulated " if identity.simulated and "simulated" not in identity.model else ""
        axes = ", ".join(self.axes)
        return f"<{kind}{identity.vendor} {identity.model}{number}, axes {axes or 'none'}>"
