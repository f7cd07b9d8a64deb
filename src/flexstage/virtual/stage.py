"""Virtual stages sample by sample, for a simulated controller; stages with adjustment screws."""

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
from flexstage.records.record import SIMULATED
from flexstage.stage import Stage
from flexstage.stage.limits import AxisLimits
from flexstage.system.environment import Environment
from flexstage.system.servo import ServoSettings
from flexstage.virtual.imperfections import GuideErrors
from flexstage.virtual.laboratory import Hammer, HammerImpact
from flexstage.virtual.sensors import (
    ChannelDescription,
    Disturbances,
    SensorBench,
    SourceSignals,
    error_motion_sources,
    kinds_of,
    neighbour,
    polynomial,
    read_error_motions,
    sensor_channels,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StageSamples:
    """Signals of a stage over some samples of its loop.

    All values of a sample belong to its time: a reading is that of this instant, although the loop
    receives it one sample later.
    """

    time: Array
    """Time since the stage was relaxed [s], shape (n,)."""
    reading: Array
    """Reading of each sensor [m, or rad], in the order of `VirtualStage.channels`, shape (channels,
    n).
    """
    position: Array
    """True motion of the platform along each axis, from the relaxed stage [m], shape (axes, n)."""
    voltage: Array
    """Voltage at each stack [V]; zeros for screws, shape (axes, n)."""
    command: Array
    """Input of the drive: voltage requested of each amplifier after limits and rounding [V], or
    advance of each screw [m], shape (axes, n).
    """


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conditions:
    """Settings of a virtual stage: loop rate, noise, sensors, hammer."""

    sample_rate_hz: float = 10e3
    """Loop rate [Hz]."""
    seed: int = 0
    """Seed of the random errors of its sensors."""
    quiet: bool = False
    """Without noise, mains, drift, and steps of converters and sensors."""
    scatter: bool = True
    """With random gain errors of its sensors."""
    environment: Environment | None = None
    """Sources of disturbance in place of noise, mains, drift and steps; the stage is quiet then."""
    sensors: SensorBench = field(default_factory=SensorBench)
    """Sensors."""
    hammer: Hammer | None = None
    """Hammer."""
    notes: tuple[str, ...] = ()
    """Notes on random, adjusted and neglected properties, as sentences."""

    def disturbances(self, channels: Sequence[ChannelDescription]) -> Disturbances:
        """Return drift and noise of its sensors from time 0."""
        return Disturbances(
            kinds_of(channels), self.sensors, self.sample_rate_hz, self.seed, quiet=self.quiet,
            scatter=self.scatter,
        )  # fmt: skip

    def shaking(self) -> SourceSignals | None:
        """Return the sources of its environment from time 0, or None."""
        if self.environment is None:
            return None
        return SourceSignals(self.environment, self.sample_rate_hz, self.seed)


class VirtualStage(ABC):
    """A stage simulated sample by sample, with its position control."""

    stage: Stage
    """The nominal stage."""
    kind: Literal["piezo", "screw"]
    """Kind of its drives."""
    axes: tuple[str, ...]
    """Names of its axes."""
    limits: Mapping[str, AxisLimits]
    """Limits of the commands by axis."""
    channels: tuple[ChannelDescription, ...]
    """Sensors; those of the axes come first."""
    conditions: Conditions
    """Settings of the simulation."""
    sample_rate_hz: float
    """Loop rate [Hz]."""
    notes: tuple[str, ...]
    """Notes on random, adjusted and neglected properties, as sentences."""
    platform_ratio: Array | float = 1.0
    """Motion of the platform over that of the limits of each axis [1]."""
    samples_at_once: ClassVar[int] = 50_000
    """Block size of the simulation of a record, in samples."""

    def __init__(
        self, stage: Stage, limits: Mapping[str, AxisLimits], conditions: Conditions
    ) -> None:
        self.stage, self.limits, self.conditions = stage, limits, conditions
        self.sample_rate_hz, self.notes = conditions.sample_rate_hz, conditions.notes
        self.axes = tuple(limits)
        self.channels = sensor_channels(self.axes)

    def servo_settings(self, axis: str) -> ServoSettings:
        """Return the servo settings of an axis; `ModelError` for a screw, which has no servo."""
        raise ModelError(f"axis '{axis}' is driven by a {self.kind}: it has no position control")

    def set_servo_settings(self, axis: str, settings: ServoSettings) -> None:
        """Change them; filters keep their state if their number does not change."""
        del settings
        self.servo_settings(axis)

    @abstractmethod
    def run(
        self, command: Array, servo: Sequence[bool], feedforward: Array | None = None
    ) -> StageSamples:
        """Run the loop over the samples of a command.

        The command of an axis is the target position [m] with servo on, else the voltage of its
        stack [V]; for a screw, the advance [m]; shape (axes, n). A feedforward voltage is added
        with servo on [V], shape (axes, n), NaN for none. The voltage does not jump when the servo
        is switched on, nor when a feedforward begins or ends: the integral term takes over.

        A run in two parts returns the same numbers. A command reaches the amplifier one sample
        later; a reading affects the voltage two samples later.
        """

    def played(self, axis: str, voltage: Array, rate_hz: float, *, before: float = 0.0) -> Record:
        """Play a voltage [V] on the stack of one axis, 0 on the others; return voltage and reading.

        `rate_hz` is the sample rate, which divides the loop rate. The voltage first ramps from that
        `before` to its first value in half a second.
        """
        axis_number, decimation = self.axes.index(axis), round(self.sample_rate_hz / rate_hz)
        lead = max(round(0.5 * rate_hz), 1)
        ramp = before + (voltage[0] - before) * np.arange(lead) / lead
        full = np.concatenate((ramp, voltage))
        outputs = np.empty((2, full.size))
        block = self.samples_at_once
        for first in range(0, full.size, block):
            at = np.arange(first, min(first + block, full.size), 1.0 / decimation)
            command = np.zeros((len(self.axes), at.size))
            command[axis_number] = np.interp(at, np.arange(full.size), full)
            samples = self.run(command, [False] * len(self.axes))
            channels = samples.voltage[axis_number], samples.reading[axis_number]
            outputs[:, first : first + block] = [values[::decimation] for values in channels]
            progress.update("playing", min(1.0, (first + block) / full.size))
        return Record(
            channels=(
                Channel(name="voltage", values=outputs[0, lead:], unit="V"),
                Channel(
                    name="position", values=outputs[1, lead:], unit=self.channels[axis_number].unit
                ),
            ),
            time=np.arange(voltage.size) / rate_hz,
            source=f"twin of {self.stage.name}",
            attributes={SIMULATED: f"twin of {self.stage.name}, axis {axis}"},
        )

    def strike(self, axis: str) -> HammerImpact:
        """Strike the platform along an axis with a hammer, drives removed.

        Each impact is different.
        """
        if self.conditions.hammer is None:
            raise ModelError(f"this virtual stage of {self.stage.name} has no hammer")
        return self.conditions.hammer.strike(axis)

    @abstractmethod
    def reset(self) -> None:
        """Relax the stage: time 0, no history, the same noise again."""


def commands(command: ArrayLike, axes: int) -> Array:
    """Return a copy of commands as an array for the loop, shape (axes, n)."""
    values = np.array(command, dtype=np.float64, order="C")
    if values.ndim != 2 or values.shape[0] != axes:
        raise ModelError(
            f"the command of {axes} axes must have the shape ({axes}, n), got {values.shape}"
        )
    if not np.all(np.isfinite(values)):
        a, k = np.argwhere(~np.isfinite(values))[0]
        raise ModelError(
            f"the command of axis {a} is {values[a, k]} at sample {k}, which is not finite"
        )
    return values


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScrewAxis:
    """One axis of a manufactured stage with screws."""

    name: str
    """Name of the axis."""
    limits: AxisLimits
    """Range and largest speed of the advance of its screw."""
    smallest_step: float
    """Smallest step of the advance [m]."""
    backlash: float
    """Backlash as advance of the screw [m]."""
    ratio: float
    """Motion of the platform over advance of the screw [1]."""
    guide: GuideErrors
    """Error motions of its guide, and position error."""

    @property
    def low(self) -> float:
        """Position of the low end of the stroke, backlash taken up [m]."""
        return 0.5 * self.backlash * self.ratio


class ScrewStage(VirtualStage):
    """A stage with screws sample by sample, a `VirtualStage`.

    A screw turns towards its command in whole steps, within its largest speed; the stage follows
    behind its backlash. There is no position control: the command is the advance of the screw.

    Notes
    -----
    Validity: quasi-static, since a screw is slow compared with the modes of its stage; the backlash
    is constant, and thread errors are neglected.
    """

    kind = "screw"

    def __init__(self, *, stage: Stage, axes: Sequence[ScrewAxis], conditions: Conditions) -> None:
        super().__init__(stage, {a.name: a.limits for a in axes}, conditions)
        #: The axes.
        self.parts = tuple(axes)
        self.platform_ratio = np.array([a.ratio for a in axes])
        names = self.axes
        self._source, self._rows = error_motion_sources(
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
        command_values = commands(command, axes)
        n = command_values.shape[1]
        advance, motion, position = (np.empty((axes, n)) for _ in range(3))
        _turn(self._screws, self._state, command_values, advance, motion)
        reading = np.empty((len(self.channels), n))
        drift, noise = self._disturbances.take(self._count, n)
        d = self._disturbances
        _read(self._curves, motion, drift, noise, d.gain, d.step, position, reading)
        read_error_motions(
            self._source, self._rows, position, drift, noise, d.gain, d.step, reading
        )
        time = (self._count + np.arange(n)) / self.sample_rate_hz
        self._count += n
        return StageSamples(
            time=time, reading=reading, position=position, voltage=np.zeros((axes, n)),
            command=advance,
        )  # fmt: skip

    def reset(self) -> None:
        """Turn the screws back; time 0, the same noise again."""
        self._count = 0
        self._disturbances = self.conditions.disturbances(self.channels)
        #: advance of each screw [m], and advance behind its backlash [m]
        self._state = np.zeros((len(self.parts), 2))
        if self.conditions.hammer is not None:
            self.conditions.hammer.reset()


@compiled
def _turn(screws: Array, state: Array, command: Array, advance: Array, motion: Array) -> None:
    """Turn the screws in whole steps at a limited speed; the stage follows behind a play."""
    for a in range(command.shape[0]):
        step, fastest, half, ratio, low, high = screws[a]
        advance_now, output = state[a]
        for k in range(command.shape[1]):
            goal = min(max(step * np.round(command[a, k] / step), low), high)
            advance_now += min(max(goal - advance_now, -fastest), fastest)
            output = max(advance_now - half, min(advance_now + half, output))
            advance[a, k] = advance_now
            motion[a, k] = ratio * output
        state[a, 0], state[a, 1] = advance_now, output


@compiled
def _read(
    curves: Array,
    motion: Array,
    drift: Array,
    noise: Array,
    gain: Array,
    step: Array,
    position: Array,
    reading: Array,
) -> None:
    """Add the guide errors, and read along the axes."""
    axes, n = motion.shape
    for a in range(axes):
        for k in range(n):
            at = motion[a, k] + drift[a, k]
            for s in range(axes):
                c, x = curves[a, s], motion[s, k]
                value = c[5]
                for i in range(4, -1, -1):
                    value = value * x + c[i]
                at += value
            position[a, k] = at
            y = gain[a] * at + noise[a, k]
            if step[a] > 0.0:
                y = step[a] * np.round(y / step[a])
            reading[a, k] = y
