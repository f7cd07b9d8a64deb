"""The verb *compensate*: a reference, and the command that follows it by the inverse of a model."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import PlanError
from flexstage.experiments.axis_limits import axis_setting, estimated_stroke
from flexstage.experiments.command import CommandWaveform, require_size
from flexstage.experiments.verb import (
    PlanContext,
    PlannedStep,
    ResultLookup,
    RunContext,
    StepResult,
    Verb,
)
from flexstage.experiments.verbs.identify import IdentifiedStep
from flexstage.files.ranges import Count, CountOrZero, Range, require_ranges
from flexstage.instruments.protocol import Waveform
from flexstage.quantities.units import Frequency
from flexstage.stage.limits import AxisLimits

if TYPE_CHECKING:
    from flexstage.control import Trajectory
    from flexstage.hysteresis import DriveModel


#: Under which name the errors of learning are kept among the settings of a record.
LEARNING = "learning errors [m]"
#: And what a reader of its figures should know, a line each.
NOTES = "notes"
#: Samples in a cycle, at least.
_SAMPLES_PER_CYCLE = 200
#: A cycle that is compared has at least so many samples.
_FEWEST = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Positions that shall be followed, over and over."""

    rate: Annotated[Frequency, Range(low=0.0, high=1e6, above=True)] = 1.0
    """Cycles in a second [Hz]."""
    cycles: Count = 3
    """How many are evaluated."""
    settle: CountOrZero = 3
    """How many run before them."""
    shape: Literal["cosine", "triangle"] = "cosine"
    """How each runs; a triangle has rounded corners."""
    share: Annotated[float, Range(low=0.0, high=1.0, above=True)] = 0.99
    """Range, as a share of what the model was identified on [1]."""

    def __post_init__(self) -> None:
        require_ranges(self, PlanError, "a reference")

    @property
    def duration(self) -> float:
        """How long all of its cycles take [s]."""
        return (self.cycles + self.settle) / self.rate

    def what(self, stroke: float) -> str:
        """Say what is followed, of an axis that has a stroke [m]."""
        return f"{self.shape} of {1e6 * self.share * stroke:.1f} um about the middle"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceTrajectory:
    """A reference for the axis of a model."""

    trajectory: "Trajectory"
    """One period."""
    model: "DriveModel"
    """The drive."""
    limits: AxisLimits
    """Of the axis, the voltage no wider than the model allows."""
    settle: int
    """Periods before those that are evaluated."""
    cycles: int
    """Periods that are evaluated."""

    @property
    def axis(self) -> str:
        """The axis."""
        return self.trajectory.axes[0]

    @property
    def positions(self) -> Array:
        """One period [m]."""
        return np.asarray(self.trajectory.positions[self.axis], dtype=np.float64)


def reference_of(
    context: RunContext,
    model: str,
    wanted: Reference,
    drive: "DriveModel | None" = None,
    *,
    controlled: bool = False,
    rate_hz: float | None = None,
) -> ReferenceTrajectory:
    """Return the reference for the axis of the model that a step identified.

    A drive is given where the zero of the model has moved since. Where the reference is followed
    under control too, it keeps within the positions that may be commanded. The rate of its samples
    [Hz] is that of the plan's commands where not given.
    """
    found = context.result_of(model, IdentifiedStep)
    used = found.model if drive is None else drive
    limits = context.instrument.axes[found.axis].limits
    setting = axis_setting(context.stage, found.axis, limits=limits)
    voltages, readings = settled_range(used, (setting.low, setting.high), wanted.rate)
    if controlled and limits.position is not None:
        readings = _within(readings, limits.position, found.axis)
    trajectory = reference_trajectory(
        wanted,
        found.axis,
        readings,
        rate_hz or context.plan.defaults.command_rate,
        context.base_rate_hz,
    )
    own = AxisLimits(
        position=limits.position, voltage=voltages, speed=limits.speed, slew=limits.slew,
        safe_voltage=min(max(limits.safe_voltage, voltages[0]), voltages[1]),
    )  # fmt: skip
    return ReferenceTrajectory(
        trajectory=trajectory,
        model=used,
        limits=own,
        settle=wanted.settle,
        cycles=wanted.cycles,
    )


def _within(
    readings: tuple[float, float], position: tuple[float, float], axis: str
) -> tuple[float, float]:
    """Return the readings that may be commanded as positions."""
    # share of the positions that may be commanded that is kept clear at each end
    clear = 0.002
    room = clear * (position[1] - position[0])
    low, high = max(readings[0], position[0] + room), min(readings[1], position[1] - room)
    if not low < high:
        raise PlanError(
            f"axis '{axis}' is controlled from {1e6 * position[0]:.4g} to {1e6 * position[1]:.4g} "
            f"um, and its drive leads it from {1e6 * readings[0]:.4g} to {1e6 * readings[1]:.4g} "
            "um: look at the zero of its sensor"
        )
    return low, high


def joined(
    course: ReferenceTrajectory, lead_in: Waveform, voltage: Waveform, notes: tuple[str, ...]
) -> CommandWaveform:
    """Return voltages over all periods, after those that condition the drive."""
    axis, period = course.axis, course.positions
    before = lead_in.values[axis]
    values = np.concatenate((before, voltage.values[axis], voltage.values[axis][-1:]))
    periods = course.settle + course.cycles
    reference = np.concatenate(
        (np.full(before.size, period[0]), np.tile(period, periods), period[:1])
    )
    return CommandWaveform(
        waveform=Waveform(
            values={axis: values}, sample_rate_hz=voltage.sample_rate_hz, quantity="voltage"
        ),
        first=before.size + course.settle * period.size,
        period=period.size,
        reference={axis: reference},
        notes=notes,
    )


def settled_range(
    model: "DriveModel", voltage_range: tuple[float, float], rate_hz: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the voltages that a model may be asked for, and the readings that they lead to."""
    # cycles after which the model repeats itself
    steady = 4
    low, high = voltage_range
    if model.validity is not None:
        own = model.validity.input_range
        low, high = max(low, own[0]), min(high, own[1])
    if not low < high:
        raise PlanError(
            f"the drive takes {voltage_range[0]:g} to {voltage_range[1]:g} V, and its model was "
            "identified outside of it: identify it again"
        )
    n = _SAMPLES_PER_CYCLE
    swing = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(steady * n) / n)
    reading = model.simulate(low + (high - low) * swing, 1.0 / (n * rate_hz), model.conditioned())
    late = reading[-n:]
    return (low, high), (float(late.min()), float(late.max()))


def reference_rate(wanted: Reference, sample_rate_hz: float, base_rate_hz: float) -> float:
    """Return the rate of samples of a reference.

    Examples
    --------
    >>> reference_rate(Reference(rate=2.0), 1000.0, 10e3)
    1000.0
    """
    rate = base_rate_hz / max(
        math.floor(base_rate_hz / max(sample_rate_hz, _SAMPLES_PER_CYCLE * wanted.rate)), 1
    )
    samples = rate / wanted.rate
    if not _is_whole(samples):
        raise PlanError(
            f"a reference of {wanted.rate:g} Hz has no whole number of samples at {rate:g} Hz, 20 "
            "at least: choose another rate"
        )
    require_size(samples * (wanted.cycles + wanted.settle), "reference")
    return rate


def require_whole_cycles(name: str, wanted: Reference, rate: float) -> None:
    """Refuse a rate of samples [Hz] at which cycles cannot be compared."""
    samples = rate / wanted.rate
    if not _is_whole(samples):
        raise PlanError(
            f"step '{name}' compares cycles, which need a whole number of samples, "
            f"{_FEWEST:g} at least: {rate:g} Hz gives {samples:g}; choose another rate"
        )


def reference_trajectory(
    wanted: Reference,
    axis: str,
    readings: tuple[float, float],
    sample_rate_hz: float,
    base_rate_hz: float,
) -> "Trajectory":
    """Return one period of a reference."""
    from flexstage.control import sine, triangle

    rate = reference_rate(wanted, sample_rate_hz, base_rate_hz)
    middle = 0.5 * (readings[0] + readings[1])
    half = 0.5 * wanted.share * (readings[1] - readings[0])
    make = triangle if wanted.shape == "triangle" else sine
    return make(axis, middle - half, middle + half, wanted.rate, sample_rate_hz=rate)


def _is_whole(samples: float) -> bool:
    return samples >= _FEWEST and abs(samples - round(samples)) <= 1e-6 * samples


@dataclass(frozen=True, slots=True, kw_only=True)
class Compensate(Verb):
    """Makes the command by which an axis follows a reference, from the inverse of its model.

    Notes
    -----
    Validity: the zero of the sensor is that of the record from which the model was identified. What
    the stage has crept and drifted since is an offset; `Verify` measures it, and takes it off.
    """

    verb: ClassVar[str] = "compensate"
    uses: ClassVar[tuple[str, ...]] = ("identify",)

    model: str
    """The step that identified it."""
    reference: Reference = field(default_factory=Reference)
    """What shall be followed."""

    @property
    def needs(self) -> tuple[str, ...]:
        return (self.model,)

    def preview(self, context: PlanContext, name: str) -> PlannedStep:
        wanted = self.reference
        reference_rate(wanted, context.plan.defaults.command_rate, context.base_rate_hz)
        stroke = estimated_stroke(context.stage, self.axis_of(context.plan))
        return PlannedStep(
            name=name,
            verb=self.verb,
            what=f"{wanted.what(stroke)}, {wanted.rate:g} Hz",
            command_duration=wanted.duration,
            notes=("the voltages follow from the model that is identified",),
        )

    def result(
        self, context: RunContext, name: str, files: list[Path], *, now: bool
    ) -> "CompensatedStep":
        from flexstage.control import compensate

        del files, now
        course = reference_of(context, self.model, self.reference)
        axis = course.axis
        made = compensate(
            {axis: course.model},
            course.trajectory,
            periods=course.settle + course.cycles,
            limits={axis: course.limits},
        )
        command = joined(course, made.lead_in, made.voltage, made.notes)
        context.commands[name] = command
        values, rate = command.values[axis], command.waveform.sample_rate_hz
        # from rest, through all that comes before
        predicted = course.model.simulate(values, 1.0 / rate)
        kept = slice(made.lead_in.size, None)
        return CompensatedStep(
            name=name,
            axis=axis,
            time=np.arange(values.size - made.lead_in.size) / rate,
            reference=command.reference[axis][kept],
            voltage=values[kept],
            predicted=predicted[kept],
            notes=made.notes,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompensatedStep(StepResult):
    """A command that was made from the inverse of a model."""

    axis: str
    """The axis."""
    time: Array
    """Times [s], shape (n,)."""
    reference: Array
    """What shall be followed [m], shape (n,)."""
    voltage: Array
    """The command [V], shape (n,)."""
    predicted: Array
    """What the model says will come [m], shape (n,)."""
    notes: tuple[str, ...] = ()
    """What was changed."""

    def plain(self, result: ResultLookup) -> dict[str, Any]:
        del result
        error = self.predicted - self.reference
        return {
            "axis": self.axis,
            "samples": int(self.time.size),
            "predicted_rms_error": float(np.sqrt(np.mean(error**2))),
            "notes": list(self.notes),
        }
