"""The verb *compensate*: a command is made from the inverse of a model."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from flexstage.arrays import Array
from flexstage.experiments.axis_limits import estimated_stroke
from flexstage.experiments.reference import Reference, joined, reference_of, reference_rate
from flexstage.experiments.verb import PlanContext, PlannedStep, StepResult, Verb

if TYPE_CHECKING:
    from flexstage.experiments.results import PlanResult
    from flexstage.experiments.run_context import RunContext


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
        self, context: "RunContext", name: str, files: list[Path], *, now: bool
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

    def plain(self, result: "PlanResult") -> dict[str, Any]:
        del result
        error = self.predicted - self.reference
        return {
            "axis": self.axis,
            "samples": int(self.time.size),
            "predicted_rms_error": float(np.sqrt(np.mean(error**2))),
            "notes": list(self.notes),
        }
