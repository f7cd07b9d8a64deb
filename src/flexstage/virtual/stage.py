"""A virtual stage sample by sample, as the controller that is simulated around it sees it."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis.compiled import compiled
from flexstage.records import Channel, Record
from flexstage.stage import Stage
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import ServoSettings
from flexstage.virtual.imperfections import GuideErrors
from flexstage.virtual.laboratory import Blow, Hammer
from flexstage.virtual.sensors import (
    ChannelDescription,
    Disturbances,
    SensorBench,
    beside_channels,
    kinds_of,
    neighbour,
    polynomial,
    readings_beside,
    sources,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StageSamples:
    """What a stage did over some samples of its loop.

    All values of a sample belong to its time: a reading is what the sensor sees then, though a loop
    gets it one sample later.
    """

    time: Array
    """Times since the stage was relaxed [s], shape (n,)."""
    reading: Array
    """What each sensor reads [m, or rad], in the order of `VirtualStage.channels`, shape (channels,
    n).
    """
    position: Array
    """True motion of the platform along each axis, from where it is relaxed [m], shape (axes, n).
    """
    voltage: Array
    """Voltage at each stack [V]; zeros for screws, shape (axes, n)."""
    command: Array
    """What the drive is told: the voltage asked of each amplifier [V], after its range and its
    steps; the advance that each screw has [m], shape (axes, n).
    """


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conditions:
    """How a virtual stage runs, what is drawn for it, and what it is read and struck by."""

    sample_rate_hz: float = 10e3
    """Rate of its loop [Hz]."""
    seed: int = 0
    """Seed of the draws of its sensors."""
    quiet: bool = False
    """Whether noise, mains, drift and all steps of converters and sensors are left out."""
    scatter: bool = True
    """Whether its sensors have gains of their own."""
    sensors: SensorBench = field(default_factory=SensorBench)
    """What it is read by."""
    hammer: Hammer | None = None
    """What it is struck by."""
    notes: tuple[str, ...] = ()
    """What was drawn, set and left out, as sentences."""

    def disturbances(self, channels: Sequence[ChannelDescription]) -> Disturbances:
        """Return what its sensors add to their readings, from the start."""
        return Disturbances(
            kinds_of(channels), self.sensors, self.sample_rate_hz, self.seed, quiet=self.quiet,
            scatter=self.scatter,
        )  # fmt: skip


class VirtualStage(ABC):
    """A stage that is simulated sample by sample, its feedback inside."""

    stage: Stage
    """The stage as drawn."""
    kind: Literal["piezo", "screw"]
    """What drives it."""
    axes: tuple[str, ...]
    """Names of its axes."""
    limits: Mapping[str, AxisLimits]
    """What may be commanded, by axis."""
    channels: tuple[ChannelDescription, ...]
    """Its sensors: those of the axes first."""
    conditions: Conditions
    """How it runs."""
    sample_rate_hz: float
    """Rate of its loop [Hz]."""
    notes: tuple[str, ...]
    """What was drawn, set and left out, as sentences."""
    samples_at_once: ClassVar[int] = 50_000
    """Samples of a record that are simulated at once."""

    def __init__(
        self, stage: Stage, limits: Mapping[str, AxisLimits], conditions: Conditions
    ) -> None:
        self.stage, self.limits, self.conditions = stage, limits, conditions
        self.sample_rate_hz, self.notes = conditions.sample_rate_hz, conditions.notes
        self.axes = tuple(limits)
        self.channels = beside_channels(self.axes)

    def servo_settings(self, axis: str) -> ServoSettings:
        """Return the settings of an axis's position control.

        `ModelError` where it has none, as a screw.
        """
        raise ModelError(f"axis '{axis}' is driven by a {self.kind}: it has no position control")

    def set_servo_settings(self, axis: str, settings: ServoSettings) -> None:
        """Change them; the filters keep their state where their number stays."""
        del settings
        self.servo_settings(axis)

    @abstractmethod
    def run(
        self, command: Array, servo: Sequence[bool], feedforward: Array | None = None
    ) -> StageSamples:
        """Let samples of the loop pass.

        A command is, where control is on, the position wanted [m], else the voltage of a stack [V];
        of a screw always its advance [m]; shape (axes, n). Where control is switched on the voltage
        does not jump. A feedforward is a voltage that is added under control [V], shape (axes, n),
        NaN where there is none; where it begins and ends the integral takes over its value, so that
        the voltage does not jump.

        A run that is cut in two gives the same numbers. What is commanded at a sample is at the
        amplifier one sample later; what is read at a sample is two samples later in the voltage.
        """

    def played(self, axis: str, voltage: Array, rate_hz: float) -> Record:
        """Return voltage and reading while the stack of an axis gets a voltage [V], the others 0.

        `rate_hz` is that of the samples, which divides the rate of the loop. The voltage is first
        led to its first value, in half a second.
        """
        number, many = self.axes.index(axis), round(self.sample_rate_hz / rate_hz)
        lead = max(round(0.5 * rate_hz), 1)
        whole = np.concatenate((voltage[0] * np.arange(lead) / lead, voltage))
        found = np.empty((2, whole.size))
        block = self.samples_at_once
        for first in range(0, whole.size, block):
            at = np.arange(first, min(first + block, whole.size), 1.0 / many)
            command = np.zeros((len(self.axes), at.size))
            command[number] = np.interp(at, np.arange(whole.size), whole)
            samples = self.run(command, [False] * len(self.axes))
            own = samples.voltage[number], samples.reading[number]
            found[:, first : first + block] = [values[::many] for values in own]
            progress.update("playing", min(1.0, (first + block) / whole.size))
        return Record(
            channels=(
                Channel(name="voltage", values=found[0, lead:], unit="V"),
                Channel(name="position", values=found[1, lead:], unit=self.channels[number].unit),
            ),
            time=np.arange(voltage.size) / rate_hz,
            source=f"twin of {self.stage.name}",
            notes=("simulated: nothing in it was measured",),
            attributes={"simulated": "yes", "axis": axis},
        )

    def strike(self, axis: str) -> Blow:
        """Strike the platform along an axis with a hammer, the drives taken out for it.

        The next blow differs from it.
        """
        if self.conditions.hammer is None:
            raise ModelError(f"there is no hammer beside this model of {self.stage.name}")
        return self.conditions.hammer.strike(axis)

    @abstractmethod
    def reset(self) -> None:
        """Relax the stage: time and all memory back to 0, the same noise once more."""


def commands(command: ArrayLike, axes: int) -> Array:
    """Return a copy of commands as a loop takes them, shape (axes, n)."""
    given = np.array(command, dtype=np.float64, order="C")
    if given.ndim != 2 or given.shape[0] != axes:
        raise ModelError(f"a command of {axes} axes has the shape ({axes}, n), got {given.shape}")
    if not np.all(np.isfinite(given)):
        a, k = np.argwhere(~np.isfinite(given))[0]
        raise ModelError(f"the command of axis {a} is {given[a, k]} at sample {k}: not finite")
    return given


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScrewAxis:
    """One axis of a screw-driven stage as it was made."""

    name: str
    """Name of the axis."""
    limits: AxisLimits
    """Range and largest speed of the advance of the screw."""
    smallest_step: float
    """Smallest step of the advance [m]."""
    backlash: float
    """By how much the screw turns back before the stage follows, as its advance [m]."""
    ratio: float
    """Motion of the platform over that of the screw [1]."""
    guide: GuideErrors
    """What its guide does beside it, and what the position is off by."""

    @property
    def low(self) -> float:
        """Position of the low end of the stroke, once the backlash has been gone through [m]."""
        return 0.5 * self.backlash * self.ratio


class ScrewStage(VirtualStage):
    """A screw-driven stage sample by sample, as `VirtualStage` says.

    A screw turns towards what is commanded, in whole steps and no faster than it may; the stage
    follows behind its backlash. It has no position control: its position is the advance of the
    screw.

    Notes
    -----
    Validity: at rest at every instant, since a screw is slow beside the modes of its stage; the
    backlash is the same everywhere, and the error of the thread is left out.
    """

    kind = "screw"

    def __init__(self, *, stage: Stage, axes: Sequence[ScrewAxis], conditions: Conditions) -> None:
        super().__init__(stage, {a.name: a.limits for a in axes}, conditions)
        #: What drives and guides each axis.
        self.parts = tuple(axes)
        names = self.axes
        self._source, self._rows = sources(
            names, {a.name: a.guide for a in axes}, {a.name: a.low for a in axes}
        )
        self._screws = np.array(
            [
                (a.smallest_step, (a.limits.speed or np.inf) / self.sample_rate_hz,
                 0.5 * a.backlash, a.ratio, *(a.limits.position or (-np.inf, np.inf)))
                for a in axes
            ]
        )  # fmt: skip
        self._curves = np.zeros((len(names), len(names), 6))
        for s, part in enumerate(axes):
            self._curves[s, s] = polynomial(part.guide, "along", part.low)
            other = neighbour(names, part.name)
            if other is not None:
                self._curves[names.index(other), s] = polynomial(part.guide, "across", part.low)
        self.reset()

    def run(
        self, command: Array, servo: Sequence[bool], feedforward: Array | None = None
    ) -> StageSamples:
        del servo, feedforward
        axes = len(self.parts)
        wanted = commands(command, axes)
        n = wanted.shape[1]
        advance, own, position = (np.empty((axes, n)) for _ in range(3))
        _turn(self._screws, self._state, wanted, advance, own)
        reading = np.empty((len(self.channels), n))
        drift, noise = self._disturbances.take(self._count, n)
        d = self._disturbances
        _read(self._curves, own, drift, noise, d.gain, d.step, position, reading)
        readings_beside(self._source, self._rows, position, drift, noise, d.gain, d.step, reading)
        time = (self._count + np.arange(n)) / self.sample_rate_hz
        self._count += n
        return StageSamples(
            time=time, reading=reading, position=position, voltage=np.zeros((axes, n)),
            command=advance,
        )  # fmt: skip

    def reset(self) -> None:
        """Turn the screws back, and begin at time 0 with the same noise."""
        self._count = 0
        self._disturbances = self.conditions.disturbances(self.channels)
        #: advance of each screw [m], and what the stage follows behind its backlash [m]
        self._state = np.zeros((len(self.parts), 2))
        if self.conditions.hammer is not None:
            self.conditions.hammer.reset()


@compiled
def _turn(screws: Array, state: Array, wanted: Array, advance: Array, own: Array) -> None:
    """Turn screws in whole steps, at a limited speed, and let the stage follow by a play."""
    for a in range(wanted.shape[0]):
        step, fastest, half, ratio, low, high = screws[a]
        at, follows = state[a]
        for k in range(wanted.shape[1]):
            goal = min(max(step * np.round(wanted[a, k] / step), low), high)
            at += min(max(goal - at, -fastest), fastest)
            follows = max(at - half, min(at + half, follows))
            advance[a, k] = at
            own[a, k] = ratio * follows
        state[a, 0], state[a, 1] = at, follows


@compiled
def _read(
    curves: Array,
    own: Array,
    drift: Array,
    noise: Array,
    gain: Array,
    step: Array,
    position: Array,
    reading: Array,
) -> None:
    """Add what the guides do, and read along the axes."""
    axes, n = own.shape
    for a in range(axes):
        for k in range(n):
            at = own[a, k] + drift[a, k]
            for s in range(axes):
                c, x = curves[a, s], own[s, k]
                value = c[5]
                for i in range(4, -1, -1):
                    value = value * x + c[i]
                at += value
            position[a, k] = at
            seen = gain[a] * at + noise[a, k]
            if step[a] > 0.0:
                seen = step[a] * np.round(seen / step[a])
            reading[a, k] = seen
