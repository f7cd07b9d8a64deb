"""The step that makes a command from the inverse of a model."""

from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.control import Trajectory, compensate
from flexstage.errors import PlanError
from flexstage.experiments.axis_limits import axis_setting
from flexstage.experiments.command import CommandWaveform
from flexstage.experiments.reference import reference_trajectory, settled_range
from flexstage.experiments.results import CompensatedStep
from flexstage.experiments.run_context import RunContext
from flexstage.experiments.verbs import Compensate, Reference
from flexstage.hysteresis import DriveModel
from flexstage.instruments.waveform import Waveform
from flexstage.stage.limits import AxisLimits

#: Share of the positions that may be commanded that is kept clear at each end.
_CLEAR = 0.002


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceTrajectory:
    """A reference for the axis of a model."""

    trajectory: Trajectory
    """One period."""
    model: DriveModel
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
    drive: DriveModel | None = None,
    *,
    controlled: bool = False,
) -> ReferenceTrajectory:
    """Return the reference for the axis of the model that a step identified.

    A drive is given where the zero of the model has moved since. Where the reference is followed
    under control too, it keeps within the positions that may be commanded.
    """
    found = context.identified(model)
    used = found.model if drive is None else drive
    limits = context.instrument.axes[found.axis].limits
    setting = axis_setting(context.stage, found.axis, limits=limits)
    voltages, readings = settled_range(used, (setting.low, setting.high), wanted.rate)
    if controlled and limits.position is not None:
        readings = _within(readings, limits.position, found.axis)
    trajectory = reference_trajectory(
        wanted, found.axis, readings, context.plan.defaults.command_rate, context.base_rate_hz
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
    room = _CLEAR * (position[1] - position[0])
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


def compensated(
    context: RunContext, name: str, action: Compensate
) -> tuple[CompensatedStep, CommandWaveform]:
    """Make the command by which an axis follows a reference."""
    course = reference_of(context, action.model, action.reference)
    axis = course.axis
    made = compensate(
        {axis: course.model},
        course.trajectory,
        periods=course.settle + course.cycles,
        limits={axis: course.limits},
    )
    command = joined(course, made.lead_in, made.voltage, made.notes)
    values = command.waveform.values[axis]
    rate = command.waveform.sample_rate_hz
    # from rest, through all that comes before
    predicted = course.model.simulate(values, 1.0 / rate)
    kept = slice(made.lead_in.size, None)
    result = CompensatedStep(
        name=name,
        axis=axis,
        time=np.arange(values.size - made.lead_in.size) / rate,
        reference=command.reference[axis][kept],
        voltage=values[kept],
        predicted=predicted[kept],
        notes=made.notes,
    )
    return result, command
