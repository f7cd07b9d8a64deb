"""Verb *verify*: tracking errors of a reference in several control modes."""

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
from flexstage.quantities.table import Bullets, Column, Picture, Pictures, Section, Table, table
from flexstage.records import Record, read_record

if TYPE_CHECKING:
    from flexstage.hysteresis import Tracking
    from flexstage.stage import Stage

#: Control modes with their descriptions; `control_modes` carries them out.
CONTROL_MODES: dict[str, str] = {
    "open loop": "open loop, proportional voltage",
    "inverse": "inverse of {kind}",
    "feedback": "feedback",
    "both": "feedback and inverse of {kind}",
    "learning": "learned over trials",
}
#: Units of the figures of a run.
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
    """Follow a reference in several control modes, and compare the tracking errors."""

    verb: ClassVar[str] = "verify"
    uses: ClassVar[tuple[str, ...]] = ("identify",)

    model: str
    """The step that identified the model."""
    along: str
    """The sensor that reads the position."""
    reference: Reference = field(default_factory=Reference)
    """The reference."""
    control_modes: tuple[str, ...] = ("open loop", "inverse")
    """``open loop`` (voltage proportional to the reference), ``inverse``, ``feedback``, ``both``,
    ``learning``.
    """
    trials: Annotated[int, Range(low=1, high=100)] = 5
    """Trials of learning."""

    def __post_init__(self) -> None:
        modes = self.control_modes
        for mode in modes:
            if mode not in CONTROL_MODES:
                raise PlanError(
                    f"unknown control mode '{mode}': choose from {', '.join(CONTROL_MODES)}"
                )
        if not modes or len(set(modes)) < len(modes):
            raise PlanError(
                f"verify needs control_modes, each once, got {', '.join(modes) or 'none'}"
            )
        require_ranges(self, PlanError, self.verb)

    @property
    def needs(self) -> tuple[str, ...]:
        return (self.model,)

    def reads(self, before: Mapping[str, Verb]) -> tuple[str, ...]:
        del before
        return (self.along,)

    def preview(self, context: PlanContext, name: str) -> PlannedStep:
        plan, reference = context.plan, self.reference
        reference_rate(reference, plan.defaults.command_rate, context.base_rate_hz)
        require_whole_cycles(name, reference, self.rate(plan))
        stroke = estimated_stroke(context.stage, self.axis_of(plan))
        # of the trials of learning, the last one is the run of that mode
        modes = self.control_modes
        runs = len(modes) + (self.trials - 1.0) * ("learning" in modes)
        return PlannedStep(
            name=name,
            verb=self.verb,
            what=f"{', '.join(modes)}: {reference.what(stroke)}, {reference.rate:g} Hz",
            duration=runs * reference.duration,
            command_duration=reference.duration,
            notes=("the voltages depend on the model, which is not identified yet",),
        )

    def run(self, context: RunContext, name: str) -> list[Path]:
        from flexstage.experiments.control_modes import follow, tracking_setup

        require_whole_cycles(name, self.reference, self.rate(context.plan))
        setup = tracking_setup(
            context,
            name,
            model=self.model,
            along=self.along,
            reference=self.reference,
            rate_hz=self.rate(context.plan),
            trials=self.trials,
            controlled=not {"feedback", "both"}.isdisjoint(self.control_modes),
        )
        return [follow(context, setup, mode) for mode in self.control_modes]

    def result(
        self, context: RunContext, name: str, files: list[Path], *, now: bool
    ) -> "VerifiedStep":
        del now
        model = context.result_of(self.model, IdentifiedStep)
        runs = [
            _run(mode, read_record(file), file, self)
            for mode, file in zip(self.control_modes, files, strict=True)
        ]
        open_loop = next((run.tracking.loop_width for run in runs if run.mode == _OPEN), None)
        if open_loop is not None:
            runs = [
                replace(run, reduction_percent=100.0 * (1.0 - run.tracking.loop_width / open_loop))
                for run in runs
            ]
        figures = tuple(
            MeasuredCharacteristic.from_estimate(
                _estimate(context, run, self),
                quantity="hysteresis_loop_width" if run.mode == _OPEN else "compensated_loop_width",
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
            Column("", "title"), "stroke [µm]", "rate [Hz]", "loop width [µm]", "reduction [%]",
            "error [nm rms]", "[% of the stroke]", "largest error [nm]",
        )  # fmt: skip
        rows: list[tuple[str, ...]] = []
        notes: dict[str, None] = {}
        axes: set[str] = set()
        for step in steps:
            rows += [_row(step, run) for run in step.runs]
            if step.axis not in axes:
                rows += _published(result.stage, step.axis)
                axes.add(step.axis)
            notes |= dict.fromkeys(step.notes)
        titles = [f"{step.name}: a reference in {len(step.runs)} control modes" for step in steps]
        pictures = (
            Picture(result=step, title=title, caption=f"Step {title}.")
            for step, title in zip(steps, titles, strict=True)
        )
        words = (
            "Errors include the noise of the reading. The loop width does not include errors that "
            "both branches share; therefore the table also lists the error from the reference. In "
            "open loop the mean difference from the reference is subtracted from the reading."
        )
        return Section(
            title="Tracking of a reference",
            key="following",
            content=(
                words,
                table("", heads, rows),
                Pictures(pictures=tuple(pictures)),
                Bullets(tuple(notes)),
            ),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FollowedRun:
    """Run of a reference in one control mode."""

    mode: str
    """``open loop``, ``inverse``, ``feedback``, ``both`` or ``learning``."""
    time: Array
    """Times of the compared cycles [s], shape (n,)."""
    reference: Array
    """The reference [m], shape (n,)."""
    output: Array
    """Reading of the sensor [m], shape (n,); in open loop less the mean difference from the
    reference.
    """
    voltage: Array
    """Voltage at the drive [V], shape (n,)."""
    tracking: "Tracking"
    """Loop width, and errors [m]."""
    widths: tuple[float, ...]
    """Loop width of each cycle [m]."""
    reduction_percent: float | None
    """Reduction of the loop width against open loop [%]; None without a run in open loop."""
    errors: tuple[float, ...] = ()
    """Of learning: rms error of each trial [m]."""
    file: Path
    """The file of the record."""
    notes: tuple[str, ...] = ()
    """Notes for the report."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VerifiedStep(StepResult):
    """Result of a step of verify."""

    axis: str
    """The axis."""
    model: str
    """Step that identified the model."""
    kind: str
    """Name of its hysteresis model."""
    stroke: float
    """Range of the reference [m]."""
    rate_hz: float
    """Frequency of the cycles [Hz]."""
    runs: tuple[FollowedRun, ...]
    """One run in each control mode."""
    loop_widths: tuple[MeasuredCharacteristic, ...]
    """Loop width in open loop, and compensated."""

    @property
    def figures(self) -> tuple[MeasuredCharacteristic, ...]:
        return self.loop_widths

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of each run."""
        return tuple(f"{self.name}, {run.mode}: {note}" for run in self.runs for note in run.notes)

    def run(self, mode: str) -> FollowedRun:
        """Return the run in a control mode; refused where there is none."""
        for run in self.runs:
            if run.mode == mode:
                return run
        available = ", ".join(run.mode for run in self.runs)
        raise PlanError(
            f"step '{self.name}' has no run in the control mode '{mode}': it has {available}"
        )

    def plain(self, result: ResultLookup) -> dict[str, Any]:
        return {
            **picked(self, "axis", "model=kind", "stroke", "rate_hz"),
            "units": dict(_UNITS),
            "runs": [
                {
                    **picked(run, "mode", "loop_width=tracking.loop_width"),
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
        heads = ("mode", "loop, nm", "reduction, %", "rms, nm", "rms, %", "largest, nm")
        rows = (
            (
                run.mode,
                f"{_NM * run.tracking.loop_width:.1f}",
                _reduction(run, 2),
                f"{_NM * run.tracking.rms:.1f}",
                f"{100.0 * run.tracking.rms / self.stroke:.3f}",
                f"{_NM * run.tracking.largest:.1f}",
            )
            for run in self.runs
        )
        caption = f"{self.name}: {_UM * self.stroke:.2f} um, {self.rate_hz:g} Hz, {self.kind}"
        return table(caption, heads, rows, notes=self.notes)


def _run(mode: str, record: Record, file: Path, step: Verify) -> FollowedRun:
    from flexstage.hysteresis import loop_width, tracking
    from flexstage.instruments.recording.metadata import read_metadata

    period = round(record.sample_rate_hz / step.reference.rate)
    cycles = step.reference.cycles
    # the compared cycles are the last ones; a command that ran once has one more sample, which ends
    # the last cycle
    extra = record.size % period == 1 or mode in (_OPEN, "inverse")
    end = record.size - 1 if extra else record.size
    first = max(end - period * cycles, 0)
    compared = slice(first, end + 1)
    reference = record.channel("reference").values[compared]
    output = record.channel(step.along).values[compared]
    bounds = np.minimum(np.arange(cycles + 1) * period, reference.size - 1)
    if mode == _OPEN:
        # the output with a constant gain, and the best offset
        output = output - float(np.mean(output) - np.mean(reference))
    settings = read_metadata(record).settings
    return FollowedRun(
        mode=mode,
        time=record.time[compared] - record.time[first],
        reference=reference,
        output=output,
        voltage=record.channel("voltage").values[compared],
        tracking=tracking(reference, output, bounds),
        widths=tuple(
            loop_width(reference, output, bounds[k : k + 2]) for k in range(bounds.size - 1)
        ),
        reduction_percent=None,
        errors=tuple(float(e) for e in settings.get(LEARNING, "").split()),
        file=file,
        notes=tuple(line for line in settings.get(NOTES, "").split("\n") if line),
    )


def _estimate(context: RunContext, run: FollowedRun, step: Verify) -> Estimate:
    """Return the loop width of the mean cycle, with the uncertainty of cycles and sensor."""
    from flexstage.measure.uncertainty.sensor import measured

    n = len(run.widths)
    parts: tuple[Component, ...] = ()
    if n > 1:
        spread = float(np.std(run.widths, ddof=1)) / n**0.5
        parts = (Component(name="cycle to cycle", uncertainty=spread, degrees_of_freedom=n - 1.0),)
    raw = Estimate(value=run.tracking.loop_width, unit="m", components=parts)
    total = measured(raw, context.plan.sensor(step.along), role="transverse range")
    note = (
        f"{run.mode}, {step.reference.rate:g} Hz, {100.0 * step.reference.share:g} % of the "
        "stroke, mean cycle"
    )
    return replace(total, note=note)


def _reduction(run: FollowedRun, digits: int) -> str:
    less = run.reduction_percent
    return "" if less is None or run.mode == _OPEN else f"{less:.{digits}f}"


def _row(step: VerifiedStep, run: FollowedRun) -> tuple[str, ...]:
    errors = run.tracking
    return (
        f"{step.name}, axis {step.axis}: {CONTROL_MODES[run.mode].format(kind=step.kind)}",
        number(_UM * step.stroke),
        number(step.rate_hz),
        number(_UM * errors.loop_width),
        _reduction(run, 1),
        number(_NM * errors.rms),
        number(100.0 * errors.rms / step.stroke),
        number(_NM * errors.largest),
    )


def _published(stage: "Stage", axis: str) -> Iterator[tuple[str, ...]]:
    """Yield rows of the published values of an axis, with their printed digits."""
    width, compensated, stroke = (
        measured_value(stage.published, quantity, axis)
        for quantity in ("hysteresis_loop_width", "compensated_loop_width", "output_displacement")
    )
    if width is None:
        return
    first = "" if stroke is None else f"{_UM * stroke:.10g}"
    rows = [("open loop", width, "")]
    if compensated is not None:
        rows.append(
            ("inverse of Bouc-Wen", compensated, f"{100.0 * (1.0 - compensated / width):.1f}")
        )
    for mode, value, less in rows:
        name = f"published, axis {axis}: {mode}"
        yield (name, first, "", f"{_UM * value:.10g}", less, "", "", "")
