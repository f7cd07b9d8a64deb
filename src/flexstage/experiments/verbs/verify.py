"""The verb *verify*: a reference is followed in several ways, and what is left is compared."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import PlanError
from flexstage.experiments.axis_limits import estimated_stroke
from flexstage.experiments.verb import (
    PlanContext,
    PlannedStep,
    ResultLookup,
    RunContext,
    StepResult,
    Verb,
)
from flexstage.experiments.verbs.compensate import (
    LEARNING,
    NOTES,
    Reference,
    reference_rate,
    require_whole_cycles,
)
from flexstage.experiments.verbs.identify import IdentifiedStep
from flexstage.experiments.verbs.measure import Recording
from flexstage.files.plain import picked
from flexstage.files.ranges import Range, require_ranges
from flexstage.quantities.characteristic import MeasuredCharacteristic, measured_value
from flexstage.quantities.estimate import Component, Estimate
from flexstage.quantities.quantity import number
from flexstage.quantities.section import Bullets, Picture, Pictures, Section
from flexstage.quantities.table import Column, Table, table
from flexstage.records import Record, read_record

if TYPE_CHECKING:
    from flexstage.hysteresis import Tracking
    from flexstage.stage import Stage

#: Ways in which a reference can be followed, and how they are told; `ways` has what they do.
WAYS: dict[str, str] = {
    "open loop": "open loop, voltage in proportion",
    "inverse": "inverse of {kind}",
    "feedback": "feedback",
    "both": "feedback and inverse of {kind}",
    "learning": "learned over trials",
}
#: What the figures of a reference that was followed are given in.
_UNITS = {
    "loop_width": "m",
    "tracking_rms": "m",
    "tracking_max": "m",
    "tracking_rms_percent": "% of the stroke",
    "reduction_percent": "% of the loop in open loop",
    "learning_errors": "m rms",
}
_OPEN = "open loop"
_UM, _NM = 1e6, 1e9


@dataclass(frozen=True, slots=True, kw_only=True)
class Verify(Recording):
    """Follows a reference in several ways, and compares what is left of the loop."""

    verb: ClassVar[str] = "verify"
    uses: ClassVar[tuple[str, ...]] = ("identify",)

    model: str
    """The step that identified the model."""
    along: str
    """The sensor that reads the position."""
    reference: Reference = field(default_factory=Reference)
    """What shall be followed."""
    ways: tuple[str, ...] = ("open loop", "inverse")
    """``open loop`` (the voltage in proportion to the reference), ``inverse``, ``feedback``,
    ``both``, ``learning``.
    """
    trials: Annotated[int, Range(low=1, high=100)] = 5
    """Trials of learning."""

    def __post_init__(self) -> None:
        for way in self.ways:
            if way not in WAYS:
                raise PlanError(
                    f"the way '{way}' to follow a reference is not known: choose from "
                    f"{', '.join(WAYS)}"
                )
        if not self.ways or len(set(self.ways)) < len(self.ways):
            raise PlanError(f"verify needs ways, each once, got {', '.join(self.ways) or 'none'}")
        require_ranges(self, PlanError, self.verb)

    @property
    def needs(self) -> tuple[str, ...]:
        return (self.model,)

    def reads(self, before: Mapping[str, Verb]) -> tuple[str, ...]:
        del before
        return (self.along,)

    def preview(self, context: PlanContext, name: str) -> PlannedStep:
        plan, wanted = context.plan, self.reference
        reference_rate(wanted, plan.defaults.command_rate, context.base_rate_hz)
        require_whole_cycles(name, wanted, self.rate(plan))
        stroke = estimated_stroke(context.stage, self.axis_of(plan))
        # the trials of learning are counted, the last of which is kept
        runs = len(self.ways) + (self.trials - 1.0) * ("learning" in self.ways)
        return PlannedStep(
            name=name,
            verb=self.verb,
            what=f"{', '.join(self.ways)}: {wanted.what(stroke)}, {wanted.rate:g} Hz",
            duration=runs * wanted.duration,
            command_duration=wanted.duration,
            notes=("the voltages follow from the model that is identified",),
        )

    def run(self, context: RunContext, name: str) -> list[Path]:
        from flexstage.experiments.ways import follow, tracking_setup

        require_whole_cycles(name, self.reference, self.rate(context.plan))
        own = tracking_setup(
            context,
            name,
            model=self.model,
            along=self.along,
            reference=self.reference,
            rate_hz=self.rate(context.plan),
            trials=self.trials,
            controlled=not {"feedback", "both"}.isdisjoint(self.ways),
        )
        return [follow(context, own, way) for way in self.ways]

    def result(
        self, context: RunContext, name: str, files: list[Path], *, now: bool
    ) -> "VerifiedStep":
        del now
        model = context.result_of(self.model, IdentifiedStep)
        runs = [
            _run(way, read_record(file), file, self)
            for way, file in zip(self.ways, files, strict=True)
        ]
        still = next((run.tracking.loop_width for run in runs if run.way == _OPEN), None)
        if still is not None:
            runs = [
                replace(run, reduction_percent=100.0 * (1.0 - run.tracking.loop_width / still))
                for run in runs
            ]
        figures = tuple(
            MeasuredCharacteristic.from_estimate(
                _estimate(context, run, self),
                quantity="hysteresis_loop_width" if run.way == _OPEN else "compensated_loop_width",
                axis=model.axis,
                origin=context.origin,
                test=name,
            )
            for run in runs
        )
        return VerifiedStep(
            name=name,
            axis=model.axis,
            model=self.model,
            kind=model.kind,
            stroke=float(np.ptp(runs[0].reference)),
            rate_hz=self.reference.rate,
            runs=tuple(runs),
            loop_widths=figures,
        )

    @staticmethod
    def section(steps: "Sequence[VerifiedStep]", result: ResultLookup) -> Section:
        heads = (
            Column("", "title"), "stroke [µm]", "rate [Hz]", "loop width [µm]", "narrowed by [%]",
            "error [nm rms]", "[% of the stroke]", "largest error [nm]",
        )  # fmt: skip
        rows: list[tuple[str, ...]] = []
        told: dict[str, None] = {}
        shown: set[str] = set()
        for step in steps:
            rows += [_row(step, run) for run in step.runs]
            if step.axis not in shown:
                rows += _published(result.stage, step.axis)
                shown.add(step.axis)
            told |= dict.fromkeys(step.notes)
        titles = [f"{step.name}: a reference followed in {len(step.runs)} ways" for step in steps]
        pictures = (
            Picture(result=step, title=title, caption=f"Step {title}.")
            for step, title in zip(steps, titles, strict=True)
        )
        words = (
            "Errors include the noise of the reading. The loop width hides every error that both "
            "branches share; therefore the error from the reference is given as well. In "
            "open loop the reading is shifted by its mean difference from the reference."
        )
        return Section(
            title="Following a reference",
            key="following",
            content=(
                words,
                table("", heads, rows),
                Pictures(pictures=tuple(pictures)),
                Bullets(tuple(told)),
            ),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FollowedRun:
    """A reference that was followed in one way."""

    way: str
    """``open loop``, ``inverse``, ``feedback``, ``both`` or ``learning``."""
    time: Array
    """Times of the compared cycles [s], shape (n,)."""
    reference: Array
    """What was wanted [m], shape (n,)."""
    output: Array
    """What the sensor read [m], shape (n,); in open loop less the mean difference from the
    reference.
    """
    voltage: Array
    """Voltage at the drive [V], shape (n,)."""
    tracking: "Tracking"
    """Width of the loop, and errors [m]."""
    widths: tuple[float, ...]
    """Width of the loop of each cycle [m]."""
    reduction_percent: float | None
    """By how much the loop is narrower than in open loop [%]; None without that."""
    errors: tuple[float, ...] = ()
    """Of learning: rms of the error at each trial [m]."""
    file: Path
    """The file of the record."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VerifiedStep(StepResult):
    """A reference that was followed in several ways."""

    axis: str
    """The axis."""
    model: str
    """Step that identified the model."""
    kind: str
    """Name of its hysteresis model."""
    stroke: float
    """Range of the reference [m]."""
    rate_hz: float
    """Cycles in a second [Hz]."""
    runs: tuple[FollowedRun, ...]
    """One of each way."""
    loop_widths: tuple[MeasuredCharacteristic, ...]
    """Width of the loop in open loop, and compensated."""

    @property
    def figures(self) -> tuple[MeasuredCharacteristic, ...]:
        return self.loop_widths

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know of each run."""
        return tuple(f"{self.name}, {run.way}: {note}" for run in self.runs for note in run.notes)

    def run(self, way: str) -> FollowedRun:
        """Return one run; refused where the reference was not followed in that way."""
        for run in self.runs:
            if run.way == way:
                return run
        done = ", ".join(run.way for run in self.runs)
        raise PlanError(f"step '{self.name}' was not run in the way '{way}': there is {done}")

    def plain(self, result: ResultLookup) -> dict[str, Any]:
        return {
            **picked(self, "axis", "model=kind", "stroke", "rate_hz"),
            "units": dict(_UNITS),
            "runs": [
                {
                    **picked(run, "way", "loop_width=tracking.loop_width"),
                    **picked(run, "tracking_rms=tracking.rms", "tracking_max=tracking.largest"),
                    "tracking_rms_percent": 100.0 * run.tracking.rms / self.stroke,
                    **picked(run, "reduction_percent", "learning_errors=errors"),
                    "file": result.relative(run.file),
                    "notes": list(run.notes),
                }
                for run in self.runs
            ],
        }

    @property
    def table(self) -> Table:
        heads = ("way", "loop, nm", "narrower, %", "rms, nm", "rms, %", "largest, nm")
        rows = (
            (
                run.way,
                f"{_NM * run.tracking.loop_width:.1f}",
                _narrower(run, 2),
                f"{_NM * run.tracking.rms:.1f}",
                f"{100.0 * run.tracking.rms / self.stroke:.3f}",
                f"{_NM * run.tracking.largest:.1f}",
            )
            for run in self.runs
        )
        caption = f"{self.name}: {_UM * self.stroke:.2f} um, {self.rate_hz:g} Hz, {self.kind}"
        return table(caption, heads, rows, notes=self.notes)


def _run(way: str, record: Record, file: Path, action: Verify) -> FollowedRun:
    from flexstage.hysteresis import loop_width, tracking
    from flexstage.instruments.recording.metadata import read_metadata

    period = round(record.sample_rate_hz / action.reference.rate)
    cycles = action.reference.cycles
    # the compared cycles are the last ones, whatever was run before them; the sample that ends the
    # last one is there where the whole command ran once
    end = record.size - 1 if record.size % period == 1 or way in (_OPEN, "inverse") else record.size
    first = max(end - period * cycles, 0)
    kept = slice(first, end + 1)
    reference = record.channel("reference").values[kept]
    output = record.channel(action.along).values[kept]
    bounds = np.minimum(np.arange(cycles + 1) * period, reference.size - 1)
    if way == _OPEN:
        # what a constant gain, and the best offset, would have given
        output = output - float(np.mean(output) - np.mean(reference))
    settings = read_metadata(record).settings
    return FollowedRun(
        way=way,
        time=record.time[kept] - record.time[first],
        reference=reference,
        output=output,
        voltage=record.channel("voltage").values[kept],
        tracking=tracking(reference, output, bounds),
        widths=tuple(
            loop_width(reference, output, bounds[k : k + 2]) for k in range(bounds.size - 1)
        ),
        reduction_percent=None,
        errors=tuple(float(e) for e in settings.get(LEARNING, "").split()),
        file=file,
        notes=tuple(line for line in settings.get(NOTES, "").split("\n") if line),
    )


def _estimate(context: RunContext, run: FollowedRun, action: Verify) -> Estimate:
    """Width of the loop of the mean cycle, with the spread of the cycles and the sensor."""
    from flexstage.measure.uncertainty.sensor import measured

    n = len(run.widths)
    parts: tuple[Component, ...] = ()
    if n > 1:
        spread = float(np.std(run.widths, ddof=1)) / n**0.5
        parts = (Component(name="cycle to cycle", uncertainty=spread, degrees_of_freedom=n - 1.0),)
    raw = Estimate(value=run.tracking.loop_width, unit="m", components=parts)
    whole = measured(raw, context.plan.sensor(action.along), role="transverse range")
    note = (
        f"{run.way}, {action.reference.rate:g} Hz, {100.0 * action.reference.share:g} % of the "
        "stroke, mean cycle"
    )
    return replace(whole, note=note)


def _narrower(run: FollowedRun, digits: int) -> str:
    less = run.reduction_percent
    return "" if less is None or run.way == _OPEN else f"{less:.{digits}f}"


def _row(step: VerifiedStep, run: FollowedRun) -> tuple[str, ...]:
    errors = run.tracking
    return (
        f"{step.name}, axis {step.axis}: {WAYS[run.way].format(kind=step.kind)}",
        number(_UM * step.stroke),
        number(step.rate_hz),
        number(_UM * errors.loop_width),
        _narrower(run, 1),
        number(_NM * errors.rms),
        number(100.0 * errors.rms / step.stroke),
        number(_NM * errors.largest),
    )


def _published(stage: "Stage", axis: str) -> Iterator[tuple[str, ...]]:
    """Give rows of what was published of an axis, with the digits that were printed."""
    width, left, stroke = (
        measured_value(stage.published, quantity, axis)
        for quantity in ("hysteresis_loop_width", "compensated_loop_width", "output_displacement")
    )
    if width is None:
        return
    first = "" if stroke is None else f"{_UM * stroke:.10g}"
    rows = [("open loop", width, "")]
    if left is not None:
        rows.append(("inverse of Bouc-Wen", left, f"{100.0 * (1.0 - left / width):.1f}"))
    for way, value, less in rows:
        name = f"published, axis {axis}: {way}"
        yield (name, first, "", f"{_UM * value:.10g}", less, "", "", "")
