"""Verb *measure*: the run of a command, with a record of the sensors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

from flexstage.base.errors import PlanError
from flexstage.experiments.campaign.plan import KINDS
from flexstage.experiments.requests import Evaluation, Roles
from flexstage.experiments.verb import (
    PlanContext,
    PlanLookup,
    PlannedStep,
    ResultLookup,
    RunContext,
    StepResult,
    Verb,
)
from flexstage.files.plain import picked
from flexstage.files.ranges import Range
from flexstage.quantities.quantity import number
from flexstage.quantities.table import Column, Section, table
from flexstage.quantities.units import Frequency
from flexstage.records import Record, read_record

_TESTS = tuple(name for name, kind in KINDS.items() if kind.sensors is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording(Verb):
    """Base class of steps that move the stage and record sensors."""

    moving: ClassVar[bool] = True

    sample_rate: Annotated[Frequency, Range(low=1e-3, high=1e7)] | None = None
    """Sample rate [Hz] (default: that of the plan)."""

    def rate(self, plan: PlanLookup) -> float:
        """Return the sample rate [Hz]."""
        return self.sample_rate or plan.defaults.sample_rate


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure(Recording, Roles, Evaluation):
    """Run a command, and record sensors."""

    verb: ClassVar[str] = "measure"
    uses: ClassVar[tuple[str, ...]] = ("excite", "compensate")

    of: str
    """The earlier step of the command."""
    test: str | None = None
    """Kind of test, for `characterise`; none for a record that is used only to identify."""
    output: tuple[str, ...] = ()
    """Of a response: sensors of the output. With hammer impacts: axes of the accelerometers."""
    also: tuple[str, ...] = ()
    """Further sensors to record."""

    def __post_init__(self) -> None:
        if self.test is not None and self.test not in _TESTS:
            reason = "is not possible in a plan" if self.test in KINDS else "is unknown"
            raise PlanError(
                f"the kind of test '{self.test}' {reason}: choose from {', '.join(_TESTS)}"
            )
        self.require(PlanError, self.verb)

    @property
    def needs(self) -> tuple[str, ...]:
        return (self.of,)

    def reads(self, before: Mapping[str, Verb]) -> tuple[str, ...]:
        # accelerometers are not sensors of the plan
        output = () if before[self.of].by_hammer else self.output
        return (*self.roles.values(), *output, *self.also)

    def missing(self, name: str, before: Mapping[str, Verb]) -> str:
        if self.test is None:
            return ""
        source = before[self.of]
        if missing := [r for r in KINDS[self.test].needed if r not in self.roles]:
            return (
                f"step '{name}' is a test of kind {self.test}: name the sensor of "
                f"{' and '.join(missing)}"
            )
        if self.test == "workspace" and not source.visits_corners:
            return (
                f"step '{name}' is a test of kind workspace: it needs a step of excite with kind "
                "workspace-corners"
            )
        if self.test == "response" and not self.output and not source.by_hammer:
            return f"step '{name}' is a test of kind response: name its sensors as 'output'"
        return ""

    def preview(self, context: PlanContext, name: str) -> PlannedStep:
        source = context.planned[self.of]
        step = PlannedStep(name=name, verb=self.verb, what="")
        if source.problem:
            return replace(step, problem=f"step '{source.name}' has no command")
        if context.plan.action_of(self.of).by_hammer:
            return replace(step, what=f"force and response of {source.what}", signals=2)
        return replace(
            step,
            what=f"{self.test or 'for identification'}, {self.rate(context.plan):g} Hz",
            duration=source.command_duration,
            samples=source.samples,
            signals=len({*self.roles.values(), *self.output, *self.also}),
            motions=source.motions,
        )

    def run(self, context: RunContext, name: str) -> list[Path]:
        command = context.commands[self.of]
        about = context.metadata(name, self.test or "identification", self.axis_of(context.plan))
        sensors = self.reads({self.of: context.plan.action_of(self.of)})
        read = [context.signal(sensor) for sensor in dict.fromkeys(sensors)]
        signals = command.signals(read, self.output, context.stage)
        if not signals:
            raise PlanError(f"step '{name}' records no signal: name a sensor")
        stream = context.folder / "records" / f"{name}.stream"
        rate = self.rate(context.plan)
        return [command.record(context.instrument, signals, rate, stream, about)]

    def result(
        self, context: RunContext, name: str, files: list[Path], *, now: bool
    ) -> "MeasuredStep":
        record = read_record(files[0])
        first, period = context.commands[self.of].prepared(record)
        return MeasuredStep(
            name=name,
            axis=self.axis_of(context.plan),
            test=self.test or "",
            record=record,
            first=first,
            period=period,
            file=files[0],
            repeated=now,
            notes=record.notes,
        )

    @staticmethod
    def section(steps: "Sequence[MeasuredStep]", result: ResultLookup) -> Section:
        del result
        rows = (
            (
                step.name,
                step.axis,
                step.test or "identification",
                len(step.record.channels),
                step.record.size,
                number(step.record.sample_rate_hz),
                step.file.name,
                "" if step.repeated else "recorded by an earlier run of this plan",
            )
            for step in steps
        )
        heads = (
            Column("Step", "title"), "<Axis", "<Test", "Signals", "Samples", "Rate [Hz]", "<File",
            "<",
        )  # fmt: skip
        return Section(title="Records", key="record", content=(table("", heads, rows),))


def from_sample(record: Record, first: int) -> Record:
    """Return the part of a record from a sample, with time from 0."""
    return replace(
        record,
        channels=tuple(replace(c, values=c.values[first:]) for c in record.channels),
        time=record.time[first:] - record.time[first],
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredStep(StepResult):
    """Result of a step of measure."""

    axis: str
    """The axis, or both such as ``xy``."""
    test: str
    """Kind of test; empty for a record that is used only to identify."""
    record: Record
    """All samples."""
    first: int
    """Number of conditioning samples at the start, which are not evaluated."""
    period: int
    """Samples of a cycle; 0 where there are none."""
    file: Path
    """The file of the record."""
    repeated: bool
    """Whether this run recorded it; False for a record of an earlier run of the same plan."""
    notes: tuple[str, ...] = ()
    """Notes for the report."""

    @property
    def evaluated(self) -> Record:
        """The record without the conditioning samples."""
        if self.first == 0 or self.record.over != "time":
            return self.record
        return from_sample(self.record, self.first)

    def plain(self, result: ResultLookup) -> dict[str, Any]:
        return {
            **picked(self, "axis", "test"),
            "file": result.relative(self.file),
            **picked(self.record, "samples=size", "sample_rate_hz"),
            "columns": {c.name: c.unit for c in self.record.channels},
            **picked(self, "taken_now=repeated", "notes"),
        }
