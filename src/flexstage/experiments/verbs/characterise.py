"""Verb *characterise*: the evaluation of records as tests."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np

from flexstage.base.errors import PlanError
from flexstage.experiments.campaign.plan import KINDS, Campaign, Columns, Test
from flexstage.experiments.campaign.results import Characterisation, TestResult, figure_of
from flexstage.experiments.command import RESPONSE
from flexstage.experiments.requests import Evaluation
from flexstage.experiments.verb import PlanLookup, ResultLookup, RunContext, StepResult, Verb
from flexstage.experiments.verbs.measure import Measure, MeasuredStep
from flexstage.quantities.characteristic import MeasuredCharacteristic
from flexstage.quantities.estimate import Component
from flexstage.records import Channel, Record

_SIMULATED = ("simulated instrument: these are not measured data",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Characterise(Verb):
    """Evaluate records as tests."""

    verb: ClassVar[str] = "characterise"
    uses: ClassVar[tuple[str, ...]] = ("measure",)

    of: tuple[str, ...]
    """Steps of measure, each with a kind of test."""

    def __post_init__(self) -> None:
        if not self.of:
            raise PlanError("characterise needs at least one step of measure, got none")
        if twice := sorted({name for name in self.of if self.of.count(name) > 1}):
            raise PlanError(f"characterise names '{twice[0]}' twice: name it once")

    @property
    def needs(self) -> tuple[str, ...]:
        return self.of

    def refused(self, name: str, other: str, used: Verb) -> str:
        if message := Verb.refused(self, name, other, used):
            return message
        if cast("Measure", used).test is None:
            return f"step '{name}' evaluates '{other}', which has no kind of test: give it 'test'"
        return ""

    def missing(self, name: str, before: Mapping[str, Verb]) -> str:
        # smallest number of cycles that separates a motion from its drift
        fewest_cycles = 3
        for other in self.of:
            record = cast("Measure", before[other])
            cycles = before[record.of].motion_cycles
            if record.test == "motion" and cycles is not None and cycles < fewest_cycles:
                return (
                    f"step '{name}' evaluates the motion '{other}', which needs at least "
                    f"{fewest_cycles} cycles, got {cycles:g}"
                )
        return ""

    def depends_on(self, plan: PlanLookup) -> tuple[object, ...]:
        return (plan.sensors, *(plan.action_of(name) for name in self.of))

    def result(
        self, context: RunContext, name: str, files: list[Path], *, now: bool
    ) -> "CharacterisedStep":
        from flexstage.experiments.campaign.results import evaluate

        del files, now
        campaign = Campaign(
            stage=context.plan.stage,
            origin=context.origin,
            instruments=tuple(sensor.instrument for sensor in context.plan.sensors),
            tests=tuple(_test(context, step) for step in self.of),
            notes=(*(_SIMULATED if context.origin == "virtual" else ()), *context.plan.notes),
        )

        def load(test: Test) -> list[Record]:
            record = context.result_of(test.name, MeasuredStep).evaluated
            if test.test != "workspace":
                return [record]
            return [corner_visits(record, test.columns.x or "", test.columns.y or "")]

        evaluation = evaluate(campaign, load)
        ratios = tuple(_ratios(context, campaign, evaluation))
        return CharacterisedStep(name=name, evaluation=evaluation, ratios=ratios)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CharacterisedStep(StepResult):
    """Result of a step of characterise."""

    evaluation: Characterisation
    """Results of the tests, with the curves of each figure."""
    ratios: tuple[MeasuredCharacteristic, ...] = ()
    """Motion of the platform over that of the drive, for motions commanded in metres."""

    @property
    def tests(self) -> tuple[TestResult, ...]:
        return self.evaluation.results

    @property
    def sources(self) -> Mapping[str, str]:
        return self.evaluation.sources

    @property
    def figures(self) -> tuple[MeasuredCharacteristic, ...]:
        """All figures, test by test."""
        measured = tuple(figure for result in self.evaluation.results for figure in result.figures)
        return (*measured, *self.ratios)

    def plain(self, result: ResultLookup) -> dict[str, Any]:
        return {
            "figures": [result.plain_figure(f) for f in self.figures],
            "notes": [f"{r.test.name}: {n}" for r in self.evaluation.results for n in r.notes],
        }


def _ratios(
    context: RunContext, campaign: Campaign, evaluation: Characterisation
) -> Iterator[MeasuredCharacteristic]:
    """Yield the ratio of each axis that a screw drives."""
    for result in evaluation.results:
        stroke = result.details.get("stroke")
        record = context.result_of(result.test.name, MeasuredStep).record
        if stroke is None or record.channel("command").unit != "m":
            continue
        sensor = campaign.instrument(result.test.along)
        gain = stroke.gain.times(math.copysign(1.0, stroke.gain.value), "1")
        if sensor is not None:
            # the relative error of the sensor is that of the stroke, and so of the ratio
            share = math.hypot(sensor.calibration, 0.5 * sensor.alignment**2)
            part = Component(name="sensitivity", uncertainty=share * gain.value, kind="B")
            gain = gain.plus(part)
        note = "slope of the platform's motion over that of the drive"
        yield figure_of(campaign, result.test, "transmission_ratio", gain, note)


def _test(context: RunContext, name: str) -> Test:
    """Return the description of the test of a step of measure."""
    step = cast("Measure", context.plan.action_of(name))
    kind = KINDS[step.test or ""]
    source = context.plan.action_of(step.of)
    axis = context.plan.axis_of(name)
    roles = {r: s for r, s in step.roles.items() if r in (kind.sensors or ())}
    columns: dict[str, Any] = {**roles, **kind.further_columns}
    excitation = "auto"
    if step.test == "response":
        excitation = source.response
        outputs = step.output or ((axis,) if source.by_hammer else ())
        columns["input"] = "force" if source.by_hammer else "voltage"
        columns["output"] = tuple(map(RESPONSE.format, outputs)) if source.by_hammer else outputs
    return Test(
        name=name,
        test=step.test or "",
        axis=axis,
        records=(context.result_of(name, MeasuredStep).file.name,),
        columns=Columns(**columns),
        along=step.along or step.x,
        transverse=step.across or step.vertical,
        angle=step.yaw or step.pitch or step.roll,
        excitation=excitation,
        **{f.name: getattr(step, f.name) for f in fields(Evaluation)},
    )


def corner_visits(record: Record, x: str, y: str) -> Record:
    """Average the readings of two sensors over each dwell at a corner: one row for each visit."""
    number = record.channel("corner").values
    edges = np.flatnonzero(np.diff(number) != 0.0) + 1
    parts = [p for p in np.split(np.arange(number.size), edges) if p.size and number[p[0]] >= 0.0]
    if len(parts) < 2:
        raise PlanError("the record contains no dwell at a corner")
    return Record(
        channels=(
            Channel(name="corner", values=np.array([number[p[0]] for p in parts]), unit="1"),
            *(
                Channel(
                    name=s,
                    values=np.array([record.channel(s).values[p].mean() for p in parts]),
                    unit="m",
                )
                for s in (x, y)
            ),
        ),
        time=np.arange(float(len(parts))),
        source=record.source,
        notes=record.notes,
        over="point",
    )
