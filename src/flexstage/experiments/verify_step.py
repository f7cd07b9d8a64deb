"""The step that follows a reference in several ways, and compares what is left of the loop.

The ways are open loop, inverse, feedback, both, and learning.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from flexstage.characteristic import MeasuredCharacteristic
from flexstage.control import LearningSettings, compensate, control_run, learn, tune
from flexstage.control.feedforward import conditioning_waveform, shifted_model
from flexstage.control.two_degree_of_freedom import ControlRun
from flexstage.errors import ModelError, PlanError
from flexstage.estimate import Component, Estimate
from flexstage.experiments.command import CommandWaveform, park, prepare_loops, record_command
from flexstage.experiments.compensate_step import ReferenceTrajectory, joined, reference_of
from flexstage.experiments.reference import require_whole_cycles, settled_range
from flexstage.experiments.results import VerifiedStep
from flexstage.experiments.run_context import RunContext
from flexstage.experiments.step_results import FollowedRun
from flexstage.experiments.verbs import Verify
from flexstage.hysteresis import loop_width, tracking
from flexstage.instruments.protocol import Capability, Signal
from flexstage.instruments.record_run import run_waveform
from flexstage.instruments.recording.metadata import RunMetadata, read_metadata
from flexstage.instruments.waveform import Waveform
from flexstage.measure.uncertainty.sensor import measured
from flexstage.records import Record, read_record
from flexstage.system.servo import ServoSettings

#: Under which name the errors of learning are kept among the settings of a record.
LEARNING = "learning errors [m]"
#: And what a reader of its figures should know, a line each.
NOTES = "notes"
#: Samples of the loop from a reading to the voltage that answers it; and from reading to target.
_LOOP_DELAY, _READING_DELAY = 2.0, 1.0
#: A reference slower than this does not need what is at the mains' frequency [Hz].
_SLOW_HZ, _MAINS_HZ = 10.0, 50.0
#: Readings that are averaged to find by how much the zero of the sensor has moved.
_READINGS = 20
_OPEN = "open loop"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingSetup:
    """What all ways of a step share."""

    course: ReferenceTrajectory
    """The reference, by the model with the zero that the sensor has now."""
    signals: tuple[Signal, ...]
    """What is recorded."""
    rate_hz: float
    """Rate of samples of the records [Hz]."""
    shift: float
    """By how much the zero of the sensor has moved since the model was identified [m]."""


def verify(context: RunContext, name: str, action: Verify) -> list[Path]:
    """Follow a reference in several ways, and record each."""
    require_whole_cycles(name, action, context.plan.defaults.rate)
    own = tracking_setup(context, action)
    files = []
    for way in action.ways:
        stream = context.folder / "records" / f"{name}.{way.replace(' ', '-')}.stream"
        files.append(follow(context, name, action, way, own, stream))
    return files


def tracking_setup(context: RunContext, action: Verify) -> TrackingSetup:
    """Look where the zero of the sensor is now, and make the reference for it."""
    controlled = any(way in ("feedback", "both") for way in action.ways)
    course = reference_of(context, action.model, action.reference, controlled=controlled)
    axis = course.axis
    signals = (
        context.signal(action.along),
        Signal(kind="voltage", source=axis, name="voltage", unit="V"),
    )
    rate = action.rate or context.plan.defaults.rate
    made = compensate(
        {axis: course.model},
        course.trajectory,
        periods=course.settle + course.cycles,
        limits={axis: course.limits},
    )
    prepare_loops(context.instrument, [axis], "voltage")
    park(context.instrument, [axis])
    record = run_waveform(context.instrument, made.lead_in, signals, rate_hz=min(rate, 1000.0))
    reading = float(np.mean(record.channel(action.along).values[-_READINGS:]))
    shift = reading - made.predicted[axis]
    moved = shifted_model(course.model, shift)
    course = reference_of(context, action.model, action.reference, moved, controlled=controlled)
    return TrackingSetup(course=course, signals=signals, rate_hz=rate, shift=shift)


def follow(
    context: RunContext, name: str, action: Verify, way: str, own: TrackingSetup, stream: Path
) -> Path:
    """Follow a reference in one way, and record it."""
    about = context.metadata(name, f"verify {way}", own.course.axis)
    about = replace(
        about,
        settings={**about.settings, "way": way, "shift of the zero [m]": f"{own.shift:.3e}"},
    )
    if way in ("open loop", "inverse"):
        command = _open_loop(own.course) if way == "open loop" else _inverse(own.course)
        about = _with_notes(about, command.notes)
        return record_command(context.instrument, command, own.signals, own.rate_hz, stream, about)
    if way == "learning":
        return _learned(context, action, own, stream, about)
    return _controlled(context, way, own, stream, about)


def _with_notes(about: RunMetadata, notes: tuple[str, ...]) -> RunMetadata:
    """Keep notes with the record, so that a run that is taken up again tells them too."""
    if not notes:
        return about
    return replace(about, settings={**about.settings, NOTES: "\n".join(dict.fromkeys(notes))})


def _open_loop(course: ReferenceTrajectory) -> CommandWaveform:
    """The voltage in proportion to the reference."""
    axis, period = course.axis, course.positions
    low, high = course.limits.voltage or (0.0, 0.0)
    # the share of the stroke is that of the voltage too
    bottom, top = float(period.min()), float(period.max())
    span = (top - bottom) / _reach(course) * (high - low)
    unit = (period - bottom) / (top - bottom)
    unit = unit if course.model.sign > 0.0 else 1.0 - unit
    one = 0.5 * (low + high) + span * (unit - 0.5)
    rate = course.trajectory.sample_rate_hz
    lead_in = conditioning_waveform(
        {axis: (low, high)}, sample_rate_hz=rate, end={axis: float(one[0])}
    )
    whole = np.tile(one, course.settle + course.cycles)
    voltage = Waveform(values={axis: whole}, sample_rate_hz=rate, quantity="voltage")
    return joined(course, lead_in, voltage, ())


def _reach(course: ReferenceTrajectory) -> float:
    """Range of readings over all of the voltage [m]."""
    voltage = course.limits.voltage or (0.0, 0.0)
    _, (low, high) = settled_range(course.model, voltage, 1.0 / course.trajectory.period)
    return high - low


def _inverse(course: ReferenceTrajectory) -> CommandWaveform:
    run = _planned_run(course, "feedforward", None, None)
    assert run.lead_in is not None
    return joined(course, run.lead_in, run.waveform, run.notes)


def _planned_run(
    course: ReferenceTrajectory, way: str, servo: ServoSettings | None, reading_delay: float | None
) -> ControlRun:
    return control_run(
        way,
        course.trajectory,
        periods=course.cycles,
        models={course.axis: course.model},
        servo=None if servo is None else {course.axis: servo},
        limits={course.axis: course.limits},
        reading_delay=reading_delay,
        settling=course.settle,
    )


def _controlled(
    context: RunContext, way: str, own: TrackingSetup, stream: Path, about: RunMetadata
) -> Path:
    """Follow the reference under position control, with or without voltages beside it."""
    course, axis = own.course, own.course.axis
    mover = context.instrument.axes[axis]
    if Capability.CLOSED_LOOP not in mover.capabilities:
        raise PlanError(f"axis '{axis}' of the instrument has no position control: leave '{way}'")
    if way == "both" and Capability.FEEDFORWARD_TABLE not in mover.capabilities:
        raise PlanError(
            f"axis '{axis}' takes no voltages under control: leave 'both' out of the ways"
        )
    loop_rate = context.base_rate_hz
    servo, untuned = None, "the controller takes no other settings"
    if Capability.SERVO_TUNING in mover.capabilities:
        servo, untuned = _servo(course, loop_rate)
    run = _planned_run(
        course,
        "feedback" if way == "feedback" else "feedforward and feedback",
        servo,
        _READING_DELAY / loop_rate,
    )
    before = mover.servo() if servo is not None else None
    try:
        if run.lead_in is not None:
            prepare_loops(context.instrument, [axis], "voltage")
            park(context.instrument, [axis])
            run_waveform(context.instrument, run.lead_in, own.signals, rate_hz=100.0)
        if servo is not None:
            mover.set_servo(servo)
            about = replace(about, settings={**about.settings, "servo": repr(servo)})
        notes = run.notes
        if untuned:
            notes = (f"the control kept the settings that the controller had: {untuned}", *notes)
        command = CommandWaveform(
            waveform=run.waveform,
            cycles=run.cycles,
            first=course.settle * course.positions.size,
            period=course.positions.size,
            # what is wanted, and not the later target that the control is told
            reference={axis: course.positions},
            notes=notes,
        )
        return record_command(
            context.instrument,
            command,
            own.signals,
            own.rate_hz,
            stream,
            _with_notes(about, notes),
            feedforward=run.feedforward,
        )
    finally:
        if before is not None:
            mover.set_closed_loop(False)
            mover.set_servo(before)


def _servo(course: ReferenceTrajectory, loop_rate_hz: float) -> tuple[ServoSettings | None, str]:
    """Settings by the model; or none, and why."""
    if course.model.modes is None:
        return None, (
            "the model knows no natural frequency to tune to; give its step of identify a resonance"
        )
    lag = 0.0 if course.model.lag is None else course.model.lag.delay
    slow = 1.0 / course.trajectory.period < _SLOW_HZ
    try:
        tuned = tune(
            course.model,
            sample_rate_hz=loop_rate_hz,
            delay=max(lag, _LOOP_DELAY / loop_rate_hz),
            mains_hz=_MAINS_HZ if slow else None,
        )
    except ModelError as error:
        return None, f"the model gives no others ({error})"
    return tuned.settings, ""


def _learned(
    context: RunContext, action: Verify, own: TrackingSetup, stream: Path, about: RunMetadata
) -> Path:
    """Learn the voltages of one period, then run the best ones."""
    course, axis = own.course, own.course.axis
    made = compensate({axis: course.model}, course.trajectory, limits={axis: course.limits})
    skip = course.settle * course.positions.size / course.trajectory.sample_rate_hz
    prepare_loops(context.instrument, [axis], "voltage")
    park(context.instrument, [axis])
    run_waveform(context.instrument, made.lead_in, own.signals, rate_hz=100.0)

    def trial(voltage: Waveform) -> Record:
        record = run_waveform(
            context.instrument,
            voltage,
            own.signals,
            rate_hz=own.rate_hz,
            cycles=course.settle + course.cycles,
        )
        first = round(skip * record.sample_rate_hz)
        return replace(
            record,
            channels=tuple(replace(c, values=c.values[first:]) for c in record.channels),
            time=record.time[first:] - record.time[first],
        )

    settings = LearningSettings(trials=action.trials - 1, periods=max(course.cycles, 2))
    found = learn(
        trial,
        course.trajectory,
        made.voltage,
        {axis: course.model},
        settings,
        limits={axis: course.limits},
        columns={axis: action.along},
    )
    errors = " ".join(f"{t.rms:.6e}" for t in found.axes[axis].trials)
    about = replace(about, settings={**about.settings, LEARNING: errors})
    about = _with_notes(about, found.notes)
    command = CommandWaveform(
        waveform=found.waveform,
        cycles=course.settle + course.cycles,
        first=course.settle * course.positions.size,
        period=course.positions.size,
        reference={axis: course.positions},
        notes=found.notes,
    )
    return record_command(context.instrument, command, own.signals, own.rate_hz, stream, about)


def verified_from(
    context: RunContext, name: str, action: Verify, files: list[Path]
) -> VerifiedStep:
    """Return the result of a step from its records."""
    model = context.identified(action.model)
    runs = [
        _run(way, read_record(file), file, action)
        for way, file in zip(action.ways, files, strict=True)
    ]
    still = next((run.tracking.loop_width for run in runs if run.way == _OPEN), None)
    if still is not None:
        runs = [
            replace(run, reduction_percent=100.0 * (1.0 - run.tracking.loop_width / still))
            for run in runs
        ]
    figures = tuple(
        MeasuredCharacteristic.from_estimate(
            _estimate(context, run, action),
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
        model=action.model,
        kind=model.kind,
        stroke=float(np.ptp(runs[0].reference)),
        rate_hz=action.reference.rate,
        runs=tuple(runs),
        figures=figures,
    )


def _run(way: str, record: Record, file: Path, action: Verify) -> FollowedRun:
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
