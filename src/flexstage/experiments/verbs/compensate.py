"""Verb *compensate*: the command that follows a reference by the inverse of a model."""

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


#: Setting of a record that contains the errors of learning.
LEARNING = "learning errors [m]"
#: Setting of a record that contains its notes, one per line.
NOTES = "notes"
#: Smallest number of samples in a cycle of a command.
_SAMPLES_PER_CYCLE = 200
#: Smallest number of samples in a compared cycle.
_FEWEST = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Reference positions of repeated cycles."""

    rate: Annotated[Frequency, Range(low=0.0, high=1e6, above=True)] = 1.0
    """Frequency of the cycles [Hz]."""
    cycles: Count = 3
    """Number of evaluated cycles."""
    settle: CountOrZero = 3
    """Number of settling cycles before them."""
    shape: Literal["cosine", "triangle", "steps"] = "cosine"
    """Shape of a cycle; a triangle has rounded corners, steps are jerk-limited moves with rests."""
    share: Annotated[float, Range(low=0.0, high=1.0, above=True)] = 0.99
    """Range of the reference over that of the identified model [1]."""

    def __post_init__(self) -> None:
        require_ranges(self, PlanError, "a reference")

    @property
    def duration(self) -> float:
        """Duration of all cycles [s]."""
        return (self.cycles + self.settle) / self.rate

    def what(self, stroke: float) -> str:
        """Return a description of the reference for an axis with a stroke [m]."""
        return f"{self.shape} of {1e6 * self.share * stroke:.1f} um about the middle"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceTrajectory:
    """A reference for the axis of a model."""

    one_period: "Trajectory"
    """One period."""
    model: "DriveModel"
    """The drive."""
    limits: AxisLimits
    """Limits of the axis; the voltage range is within that of the model."""
    settle: int
    """Settling periods before the evaluated ones."""
    cycles: int
    """Evaluated periods."""

    @property
    def axis(self) -> str:
        """The axis."""
        return self.one_period.axes[0]

    @property
    def positions(self) -> Array:
        """One period [m]."""
        return np.asarray(self.one_period.positions[self.axis], dtype=np.float64)


def reference_of(
    context: RunContext,
    model: str,
    reference: Reference,
    drive: "DriveModel | None" = None,
    *,
    controlled: bool = False,
    rate_hz: float | None = None,
) -> ReferenceTrajectory:
    """Return the reference for the axis of the model that a step identified.

    Give a `drive` where the zero of the model has shifted since. With `controlled` the reference
    stays within the positions that may be commanded. The sample rate [Hz] is by default that of the
    plan's commands.
    """
    identified = context.result_of(model, IdentifiedStep)
    drive_model = identified.model if drive is None else drive
    limits = context.instrument.axes[identified.axis].limits
    setting = axis_setting(context.stage, identified.axis, limits=limits)
    voltages, readings = settled_range(drive_model, (setting.low, setting.high), reference.rate)
    if controlled and limits.position is not None:
        readings = _within(readings, limits.position, identified.axis)
    trajectory = reference_trajectory(
        reference,
        identified.axis,
        readings,
        rate_hz or context.plan.defaults.command_rate,
        context.base_rate_hz,
    )
    axis_limits = AxisLimits(
        position=limits.position, voltage=voltages, speed=limits.speed, slew=limits.slew,
        safe_voltage=min(max(limits.safe_voltage, voltages[0]), voltages[1]),
    )  # fmt: skip
    return ReferenceTrajectory(
        one_period=trajectory,
        model=drive_model,
        limits=axis_limits,
        settle=reference.settle,
        cycles=reference.cycles,
    )


def _within(
    readings: tuple[float, float], position: tuple[float, float], axis: str
) -> tuple[float, float]:
    """Return the readings that may be commanded as positions."""
    # clearance at each end of the positions that may be commanded, over their range
    clearance = 0.002 * (position[1] - position[0])
    low, high = max(readings[0], position[0] + clearance), min(readings[1], position[1] - clearance)
    if not low < high:
        raise PlanError(
            f"axis '{axis}' can be commanded from {1e6 * position[0]:.4g} to "
            f"{1e6 * position[1]:.4g} um, but its drive reaches {1e6 * readings[0]:.4g} to "
            f"{1e6 * readings[1]:.4g} um: check the zero of its sensor"
        )
    return low, high


def joined(
    trajectory: ReferenceTrajectory, lead_in: Waveform, voltage: Waveform, notes: tuple[str, ...]
) -> CommandWaveform:
    """Return the voltages over all periods, after those that condition the drive."""
    axis, period = trajectory.axis, trajectory.positions
    before = lead_in.values[axis]
    values = np.concatenate((before, voltage.values[axis], voltage.values[axis][-1:]))
    periods = trajectory.settle + trajectory.cycles
    reference = np.concatenate(
        (np.full(before.size, period[0]), np.tile(period, periods), period[:1])
    )
    return CommandWaveform(
        waveform=Waveform(
            values={axis: values}, sample_rate_hz=voltage.sample_rate_hz, quantity="voltage"
        ),
        first=before.size + trajectory.settle * period.size,
        period=period.size,
        reference={axis: reference},
        notes=notes,
    )


def settled_range(
    model: "DriveModel", voltage_range: tuple[float, float], rate_hz: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the voltage range of a model, and the range of readings over it."""
    # cycles after which the response of the model is periodic
    steady = 4
    low, high = voltage_range
    if model.validity is not None:
        identified = model.validity.input_range
        low, high = max(low, identified[0]), min(high, identified[1])
    if not low < high:
        raise PlanError(
            f"the voltage range of the drive is {voltage_range[0]:g} to {voltage_range[1]:g} V, "
            "and its model was identified outside this range: identify it again"
        )
    n = _SAMPLES_PER_CYCLE
    swing = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(steady * n) / n)
    reading = model.simulate(low + (high - low) * swing, 1.0 / (n * rate_hz), model.conditioned())
    late = reading[-n:]
    return (low, high), (float(late.min()), float(late.max()))


def reference_rate(reference: Reference, sample_rate_hz: float, base_rate_hz: float) -> float:
    """Return the rate of samples of a reference.

    Examples
    --------
    >>> reference_rate(Reference(rate=2.0), 1000.0, 10e3)
    1000.0
    """
    rate = base_rate_hz / max(
        math.floor(base_rate_hz / max(sample_rate_hz, _SAMPLES_PER_CYCLE * reference.rate)), 1
    )
    samples = rate / reference.rate
    if not _is_whole(samples):
        raise PlanError(
            f"a cycle of the reference at {reference.rate:g} Hz needs an integer number of "
            f"samples, at least 20: {rate:g} Hz gives {samples:g}; choose another rate"
        )
    require_size(samples * (reference.cycles + reference.settle), "reference")
    return rate


def require_whole_cycles(name: str, reference: Reference, rate: float) -> None:
    """Refuse a sample rate [Hz] at which cycles cannot be compared."""
    samples = rate / reference.rate
    if not _is_whole(samples):
        raise PlanError(
            f"step '{name}' compares cycles, which need an integer number of samples, at least "
            f"{_FEWEST:g}: {rate:g} Hz gives {samples:g}; choose another rate"
        )


def reference_trajectory(
    reference: Reference,
    axis: str,
    readings: tuple[float, float],
    sample_rate_hz: float,
    base_rate_hz: float,
) -> "Trajectory":
    """Return one period of a reference."""
    from flexstage.control import sine, steps, triangle

    rate = reference_rate(reference, sample_rate_hz, base_rate_hz)
    middle = 0.5 * (readings[0] + readings[1])
    half = 0.5 * reference.share * (readings[1] - readings[0])
    make = {"cosine": sine, "triangle": triangle, "steps": steps}[reference.shape]
    return make(axis, middle - half, middle + half, reference.rate, sample_rate_hz=rate)


def _is_whole(samples: float) -> bool:
    return samples >= _FEWEST and abs(samples - round(samples)) <= 1e-6 * samples


@dataclass(frozen=True, slots=True, kw_only=True)
class Compensate(Verb):
    """Compute the command by which an axis follows a reference, by the inverse of its model.

    Notes
    -----
    Validity: the zero of the sensor is that of the record from which the model was identified.
    Creep and drift since then are an offset, which `Verify` measures and corrects.
    """

    verb: ClassVar[str] = "compensate"
    uses: ClassVar[tuple[str, ...]] = ("identify",)

    model: str
    """The step that identified the model."""
    reference: Reference = field(default_factory=Reference)
    """The reference."""

    @property
    def needs(self) -> tuple[str, ...]:
        return (self.model,)

    def preview(self, context: PlanContext, name: str) -> PlannedStep:
        reference = self.reference
        reference_rate(reference, context.plan.defaults.command_rate, context.base_rate_hz)
        stroke = estimated_stroke(context.stage, self.axis_of(context.plan))
        return PlannedStep(
            name=name,
            verb=self.verb,
            what=f"{reference.what(stroke)}, {reference.rate:g} Hz",
            command_duration=reference.duration,
            notes=("the voltages depend on the model, which is not identified yet",),
        )

    def result(
        self, context: RunContext, name: str, files: list[Path], *, now: bool
    ) -> "CompensatedStep":
        from flexstage.control import compensate

        del files, now
        trajectory = reference_of(context, self.model, self.reference)
        axis = trajectory.axis
        inverse = compensate(
            {axis: trajectory.model},
            trajectory.one_period,
            periods=trajectory.settle + trajectory.cycles,
            limits={axis: trajectory.limits},
        )
        command = joined(trajectory, inverse.lead_in, inverse.voltage, inverse.notes)
        context.commands[name] = command
        values, rate = command.values[axis], command.waveform.sample_rate_hz
        # from rest, including the lead-in
        predicted = trajectory.model.simulate(values, 1.0 / rate)
        after_lead_in = slice(inverse.lead_in.size, None)
        return CompensatedStep(
            name=name,
            axis=axis,
            time=np.arange(values.size - inverse.lead_in.size) / rate,
            reference=command.reference[axis][after_lead_in],
            voltage=values[after_lead_in],
            predicted=predicted[after_lead_in],
            notes=inverse.notes,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompensatedStep(StepResult):
    """A command by the inverse of a model."""

    axis: str
    """The axis."""
    time: Array
    """Times [s], shape (n,)."""
    reference: Array
    """The reference [m], shape (n,)."""
    voltage: Array
    """The command [V], shape (n,)."""
    predicted: Array
    """Prediction of the model [m], shape (n,)."""
    notes: tuple[str, ...] = ()
    """Changes."""

    def plain(self, result: ResultLookup) -> dict[str, Any]:
        del result
        error = self.predicted - self.reference
        return {
            "axis": self.axis,
            "samples": int(self.time.size),
            "predicted_rms_error": float(np.sqrt(np.mean(error**2))),
            "notes": list(self.notes),
        }
