"""Ways of following a reference: open loop, inverse, feedback, both, and learning."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from flexstage.base.errors import ModelError, PlanError
from flexstage.control import LearningSettings, Way, compensate, control_run, learn, tune
from flexstage.control.feedforward import conditioning_waveform, shifted_model
from flexstage.control.two_degree_of_freedom import ControlRun, made_ready, with_feedforward
from flexstage.experiments.command import CommandWaveform, park, prepare_loops
from flexstage.experiments.verb import RunContext
from flexstage.experiments.verbs.compensate import (
    LEARNING,
    NOTES,
    Reference,
    ReferenceTrajectory,
    joined,
    reference_of,
    settled_range,
)
from flexstage.experiments.verbs.measure import from_sample
from flexstage.instruments.protocol import Capability, Signal, Waveform
from flexstage.instruments.record_run import run_waveform
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.records import Record
from flexstage.system.servo import ServoSettings

#: Samples of the loop from a reading to the voltage that answers it; and from reading to target.
_LOOP_DELAY, _READING_DELAY = 2.0, 1.0
#: A reference slower than this does not need what is at the mains' frequency [Hz].
_SLOW_HZ, _MAINS_HZ = 10.0, 50.0
#: What an axis can where voltages are learned beside its control.
_BESIDE = (Capability.CLOSED_LOOP, Capability.FEEDFORWARD_TABLE, Capability.SERVO_TUNING)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingSetup:
    """What all ways of a step share."""

    name: str
    """Name of the step."""
    model: str
    """The step that identified the model."""
    along: str
    """The sensor that reads the position."""
    reference: Reference
    """What shall be followed."""
    trials: int
    """Trials of learning."""
    course: ReferenceTrajectory
    """The reference, by the model with the zero that the sensor has now."""
    signals: tuple[Signal, ...]
    """What is recorded."""
    rate_hz: float
    """Rate of samples of the records [Hz]."""
    shift: float
    """By how much the zero of the sensor has moved since the model was identified [m]."""


def tracking_setup(
    context: RunContext,
    name: str,
    *,
    model: str,
    along: str,
    reference: Reference,
    rate_hz: float,
    trials: int,
    controlled: bool,
) -> TrackingSetup:
    """Look where the zero of the sensor is now, and make the reference for it.

    `controlled` is whether it is followed under control in one of the ways.
    """
    # readings that are averaged to find by how much the zero of the sensor has moved
    readings = 20
    course = reference_of(context, model, reference, controlled=controlled)
    axis = course.axis
    signals = (
        context.signal(along),
        Signal(kind="voltage", source=axis, name="voltage", unit="V"),
    )
    made = compensate(
        {axis: course.model},
        course.trajectory,
        periods=course.settle + course.cycles,
        limits={axis: course.limits},
    )
    prepare_loops(context.instrument, [axis], "voltage")
    park(context.instrument, [axis])
    record = run_waveform(context.instrument, made.lead_in, signals, rate_hz=min(rate_hz, 1000.0))
    reading = float(np.mean(record.channel(along).values[-readings:]))
    shift = reading - made.predicted[axis]
    moved = shifted_model(course.model, shift)
    course = reference_of(context, model, reference, moved, controlled=controlled)
    return TrackingSetup(
        name=name,
        model=model,
        along=along,
        reference=reference,
        trials=trials,
        course=course,
        signals=signals,
        rate_hz=rate_hz,
        shift=shift,
    )


def follow(context: RunContext, own: TrackingSetup, way: str) -> Path:
    """Follow a reference in one way, and record it."""
    about = context.metadata(own.name, f"verify {way}", own.course.axis)
    about = _with_settings(about, {"way": way, "shift of the zero [m]": f"{own.shift:.3e}"})
    return _WAYS[way](context, own, about)


def _with_settings(about: RunMetadata, more: Mapping[str, str]) -> RunMetadata:
    return replace(about, settings={**about.settings, **more})


def _recorded(
    context: RunContext,
    own: TrackingSetup,
    command: CommandWaveform,
    about: RunMetadata,
    feedforward: Waveform | None = None,
) -> Path:
    """Record a command with its notes, so that a run that is taken up again tells them too."""
    if command.notes:
        about = _with_settings(about, {NOTES: "\n".join(dict.fromkeys(command.notes))})
    way = about.settings["way"].replace(" ", "-")
    stream = context.folder / "records" / f"{own.name}.{way}.stream"
    return command.record(
        context.instrument, own.signals, own.rate_hz, stream, about, feedforward=feedforward
    )


def _open_loop(context: RunContext, own: TrackingSetup, about: RunMetadata) -> Path:
    """The voltage in proportion to the reference."""
    course = own.course
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
    return _recorded(context, own, joined(course, lead_in, voltage, ()), about)


def _reach(course: ReferenceTrajectory) -> float:
    """Range of readings over all of the voltage [m]."""
    voltage = course.limits.voltage or (0.0, 0.0)
    _, (low, high) = settled_range(course.model, voltage, 1.0 / course.trajectory.period)
    return high - low


def _inverse(context: RunContext, own: TrackingSetup, about: RunMetadata) -> Path:
    run = _planned_run(own.course, Way.FEEDFORWARD)
    assert run.lead_in is not None
    return _recorded(context, own, joined(own.course, run.lead_in, run.waveform, run.notes), about)


def _planned_run(
    course: ReferenceTrajectory,
    way: Way,
    servo: ServoSettings | None = None,
    reading_delay: float | None = None,
    *,
    repeat: bool = False,
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
        repeat=repeat,
    )


def _controlled(way: Way, context: RunContext, own: TrackingSetup, about: RunMetadata) -> Path:
    """Follow the reference under position control, with or without voltages beside it."""
    course = own.course
    can = context.instrument.axes[course.axis].capabilities
    if Capability.CLOSED_LOOP not in can:
        name = about.settings["way"]
        raise PlanError(
            f"axis '{course.axis}' of the instrument has no position control: leave '{name}'"
        )
    if way is Way.BOTH and Capability.FEEDFORWARD_TABLE not in can:
        raise PlanError(
            f"axis '{course.axis}' takes no voltages under control: leave 'both' out of the ways"
        )
    servo, untuned = None, "the controller takes no other settings"
    if Capability.SERVO_TUNING in can:
        servo, untuned = _servo(course, context.base_rate_hz)
    run = _planned_run(course, way, servo, _READING_DELAY / context.base_rate_hz)
    if untuned:
        said = f"the control kept the settings that the controller had: {untuned}"
        run = replace(run, notes=(said, *run.notes))
    if servo is not None:
        about = _with_settings(about, {"servo": repr(servo)})
    with _ready(context, own, run):
        command = _command(course, run, run.waveform, run.notes)
        return _recorded(context, own, command, about, run.feedforward)


@contextmanager
def _ready(context: RunContext, own: TrackingSetup, run: ControlRun) -> Iterator[None]:
    """Condition the drive and close the loop; settings of the control are as before after it."""
    axis = own.course.axis
    mover = context.instrument.axes[axis]
    before = mover.servo() if run.servo else None
    prepare_loops(context.instrument, [axis], "voltage")
    park(context.instrument, [axis])
    try:
        with made_ready(context.instrument, run, own.signals):
            yield
    finally:
        if before is not None:
            mover.set_servo(before)


def _command(
    course: ReferenceTrajectory, run: ControlRun, waveform: Waveform, notes: tuple[str, ...]
) -> CommandWaveform:
    """Return one period, over and over, for what is wanted: the targets of a control are later."""
    return CommandWaveform(
        waveform=waveform,
        cycles=run.cycles,
        first=course.settle * course.positions.size,
        period=course.positions.size,
        reference={course.axis: course.positions},
        notes=notes,
    )


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


def _learned(context: RunContext, own: TrackingSetup, about: RunMetadata) -> Path:
    """Learn the voltages of one period, then run the best ones.

    They are learned beside a control where the axis takes both and the model can tune it: it takes
    up creep and drift, which go on between the trials, and learning what repeats.
    """
    axis = own.course.axis
    course, run = _to_learn(context, own)
    skip = course.settle * course.trajectory.period

    def sent(voltage: Waveform) -> ControlRun:
        return with_feedforward(run, voltage) if run.servo else replace(run, waveform=voltage)

    def trial(voltage: Waveform) -> Record:
        made = sent(voltage)
        record = run_waveform(
            context.instrument,
            made.waveform,
            own.signals,
            rate_hz=own.rate_hz,
            cycles=made.cycles,
            feedforward=made.feedforward,
        )
        return from_sample(record, round(skip * record.sample_rate_hz))

    with _ready(context, own, run):
        found = learn(
            trial,
            course.trajectory,
            run.feedforward or run.waveform,
            {axis: course.model},
            LearningSettings(trials=own.trials - 1, periods=max(course.cycles, 2)),
            limits={axis: course.limits},
            columns={axis: own.along},
            servo=run.servo or None,
        )
        errors = " ".join(f"{t.rms:.6e}" for t in found.axes[axis].trials)
        about = _with_settings(about, {LEARNING: errors})
        if run.servo:
            about = _with_settings(about, {"servo": repr(run.servo[axis])})
        best = sent(found.waveform)
        command = _command(course, best, best.waveform, found.notes)
        return _recorded(context, own, command, about, best.feedforward)


def _to_learn(context: RunContext, own: TrackingSetup) -> tuple[ReferenceTrajectory, ControlRun]:
    """Return the reference, and the run that learning begins with: beside a control, or alone."""
    course = own.course
    can = context.instrument.axes[course.axis].capabilities
    servo = None
    if {*_BESIDE} <= can:
        servo, _ = _servo(course, context.base_rate_hz)
    if servo is None:
        return course, _planned_run(course, Way.FEEDFORWARD, repeat=True)
    # what the control leaves of a voltage is known at the rate of its loop
    rate = context.base_rate_hz
    course = reference_of(
        context, own.model, own.reference, course.model, controlled=True, rate_hz=rate
    )
    return course, _planned_run(course, Way.BOTH, servo, _READING_DELAY / rate)


#: What each way does.
_WAYS: dict[str, Callable[[RunContext, TrackingSetup, RunMetadata], Path]] = {
    "open loop": _open_loop,
    "inverse": _inverse,
    "feedback": partial(_controlled, Way.FEEDBACK),
    "both": partial(_controlled, Way.BOTH),
    "learning": _learned,
}
