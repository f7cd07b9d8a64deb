"""Control modes of the verb verify: open loop, inverse, feedback, both, and learning."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from flexstage.base.errors import ModelError, PlanError
from flexstage.control import ControlMode, LearningSettings, compensate, control_run, learn, tune
from flexstage.control.feedforward import conditioning_waveform, shifted_model
from flexstage.control.two_degree_of_freedom import ControlRun, prepare, with_feedforward
from flexstage.experiments.command import CommandWaveform, move_to_rest, prepare_loops
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

#: Samples of the loop from a reading to its correcting voltage, and from a reading to its target.
_LOOP_DELAY, _READING_DELAY = 2.0, 1.0
#: A slower reference allows a notch at the frequency of the mains [Hz].
_SLOW_HZ, _MAINS_HZ = 10.0, 50.0
#: Capabilities of an axis whose learned voltages are added to those of its control.
_FOR_ADDED_VOLTAGES = (
    Capability.CLOSED_LOOP,
    Capability.FEEDFORWARD_TABLE,
    Capability.SERVO_TUNING,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingSetup:
    """Setup that all control modes of a step share."""

    name: str
    """Name of the step."""
    model: str
    """The step that identified the model."""
    along: str
    """The sensor that reads the position."""
    reference: Reference
    """The reference."""
    trials: int
    """Trials of learning."""
    trajectory: ReferenceTrajectory
    """The reference, by the model with the present zero of the sensor."""
    signals: tuple[Signal, ...]
    """The recorded signals."""
    rate_hz: float
    """Rate of samples of the records [Hz]."""
    shift: float
    """Shift of the zero of the sensor since the identification of the model [m]."""


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
    """Measure the zero of the sensor, and return the reference for it.

    `controlled` is whether one of the control modes uses feedback.
    """
    # readings that are averaged to measure the shift of the zero of the sensor
    readings = 20
    trajectory = reference_of(context, model, reference, controlled=controlled)
    axis = trajectory.axis
    signals = (
        context.signal(along),
        Signal(kind="voltage", source=axis, name="voltage", unit="V"),
    )
    lead = compensate(
        {axis: trajectory.model},
        trajectory.one_period,
        periods=trajectory.settle + trajectory.cycles,
        limits={axis: trajectory.limits},
    )
    prepare_loops(context.instrument, [axis], "voltage")
    move_to_rest(context.instrument, [axis])
    record = run_waveform(context.instrument, lead.lead_in, signals, rate_hz=min(rate_hz, 1000.0))
    reading = float(np.mean(record.channel(along).values[-readings:]))
    shift = reading - lead.predicted[axis]
    moved = shifted_model(trajectory.model, shift)
    trajectory = reference_of(context, model, reference, moved, controlled=controlled)
    return TrackingSetup(
        name=name,
        model=model,
        along=along,
        reference=reference,
        trials=trials,
        trajectory=trajectory,
        signals=signals,
        rate_hz=rate_hz,
        shift=shift,
    )


def follow(context: RunContext, setup: TrackingSetup, mode: str) -> Path:
    """Follow a reference in one control mode, and record it."""
    about = context.metadata(setup.name, f"verify {mode}", setup.trajectory.axis)
    settings = {"control mode": mode, "shift of the zero [m]": f"{setup.shift:.3e}"}
    return _RUN_OF_MODE[mode](context, setup, _with_settings(about, settings))


def _with_settings(about: RunMetadata, settings: Mapping[str, str]) -> RunMetadata:
    return replace(about, settings={**about.settings, **settings})


def _recorded(
    context: RunContext,
    setup: TrackingSetup,
    command: CommandWaveform,
    about: RunMetadata,
    feedforward: Waveform | None = None,
) -> Path:
    """Record a command with its notes, so that a resumed run reports them too."""
    if command.notes:
        about = _with_settings(about, {NOTES: "\n".join(dict.fromkeys(command.notes))})
    mode = about.settings["control mode"].replace(" ", "-")
    stream = context.folder / "records" / f"{setup.name}.{mode}.stream"
    return command.record(
        context.instrument, setup.signals, setup.rate_hz, stream, about, feedforward=feedforward
    )


def _open_loop(context: RunContext, setup: TrackingSetup, about: RunMetadata) -> Path:
    """Apply a voltage that is proportional to the reference."""
    trajectory = setup.trajectory
    axis, period = trajectory.axis, trajectory.positions
    low, high = trajectory.limits.voltage or (0.0, 0.0)
    # the fraction of the stroke is that of the voltage
    bottom, top = float(period.min()), float(period.max())
    span = (top - bottom) / _reach(trajectory) * (high - low)
    unit = (period - bottom) / (top - bottom)
    unit = unit if trajectory.model.sign > 0.0 else 1.0 - unit
    one_period = 0.5 * (low + high) + span * (unit - 0.5)
    rate = trajectory.one_period.sample_rate_hz
    lead_in = conditioning_waveform(
        {axis: (low, high)}, sample_rate_hz=rate, end={axis: float(one_period[0])}
    )
    voltages = np.tile(one_period, trajectory.settle + trajectory.cycles)
    voltage = Waveform(values={axis: voltages}, sample_rate_hz=rate, quantity="voltage")
    return _recorded(context, setup, joined(trajectory, lead_in, voltage, ()), about)


def _reach(trajectory: ReferenceTrajectory) -> float:
    """Return the range of readings over the full voltage range [m]."""
    voltage = trajectory.limits.voltage or (0.0, 0.0)
    _, (low, high) = settled_range(trajectory.model, voltage, 1.0 / trajectory.one_period.period)
    return high - low


def _inverse(context: RunContext, setup: TrackingSetup, about: RunMetadata) -> Path:
    run = _planned_run(setup.trajectory, ControlMode.FEEDFORWARD)
    assert run.lead_in is not None
    return _recorded(
        context, setup, joined(setup.trajectory, run.lead_in, run.waveform, run.notes), about
    )


def _planned_run(
    trajectory: ReferenceTrajectory,
    mode: ControlMode,
    servo: ServoSettings | None = None,
    reading_delay: float | None = None,
    *,
    repeat: bool = False,
) -> ControlRun:
    return control_run(
        mode,
        trajectory.one_period,
        periods=trajectory.cycles,
        models={trajectory.axis: trajectory.model},
        servo=None if servo is None else {trajectory.axis: servo},
        limits={trajectory.axis: trajectory.limits},
        reading_delay=reading_delay,
        settling=trajectory.settle,
        repeat=repeat,
    )


def _controlled(
    mode: ControlMode, context: RunContext, setup: TrackingSetup, about: RunMetadata
) -> Path:
    """Follow the reference under position control, with or without feedforward voltages."""
    trajectory = setup.trajectory
    capabilities = context.instrument.axes[trajectory.axis].capabilities
    if Capability.CLOSED_LOOP not in capabilities:
        name = about.settings["control mode"]
        raise PlanError(
            f"axis '{trajectory.axis}' of the instrument has no position control: remove '{name}' "
            "from control_modes"
        )
    if mode is ControlMode.BOTH and Capability.FEEDFORWARD_TABLE not in capabilities:
        raise PlanError(
            f"axis '{trajectory.axis}' accepts no voltages under position control: remove 'both' "
            "from control_modes"
        )
    servo, untuned = None, "the controller accepts no other settings"
    if Capability.SERVO_TUNING in capabilities:
        servo, untuned = _servo(trajectory, context.base_rate_hz)
    run = _planned_run(trajectory, mode, servo, _READING_DELAY / context.base_rate_hz)
    if untuned:
        note = f"the controller kept its present control settings: {untuned}"
        run = replace(run, notes=(note, *run.notes))
    if servo is not None:
        about = _with_settings(about, {"servo": repr(servo)})
    with _ready(context, setup, run):
        command = _command(trajectory, run, run.waveform, run.notes)
        return _recorded(context, setup, command, about, run.feedforward)


@contextmanager
def _ready(context: RunContext, setup: TrackingSetup, run: ControlRun) -> Iterator[None]:
    """Condition the drive and close the loop; restore the settings of the control afterwards."""
    axis = setup.trajectory.axis
    mover = context.instrument.axes[axis]
    before = mover.servo() if run.servo else None
    prepare_loops(context.instrument, [axis], "voltage")
    move_to_rest(context.instrument, [axis])
    try:
        with prepare(context.instrument, run, setup.signals):
            yield
    finally:
        if before is not None:
            mover.set_servo(before)


def _command(
    trajectory: ReferenceTrajectory, run: ControlRun, waveform: Waveform, notes: tuple[str, ...]
) -> CommandWaveform:
    """Return a repeated period with its reference, which the targets of a control lag behind."""
    return CommandWaveform(
        waveform=waveform,
        cycles=run.cycles,
        first=trajectory.settle * trajectory.positions.size,
        period=trajectory.positions.size,
        reference={trajectory.axis: trajectory.positions},
        notes=notes,
    )


def _servo(
    trajectory: ReferenceTrajectory, loop_rate_hz: float
) -> tuple[ServoSettings | None, str]:
    """Return settings by the model; or None, and the reason."""
    if trajectory.model.modes is None:
        return None, (
            "the model has no natural frequency for the tuning; give its step of identify a "
            "resonance"
        )
    lag = 0.0 if trajectory.model.lag is None else trajectory.model.lag.delay
    slow = 1.0 / trajectory.one_period.period < _SLOW_HZ
    try:
        tuned = tune(
            trajectory.model,
            sample_rate_hz=loop_rate_hz,
            delay=max(lag, _LOOP_DELAY / loop_rate_hz),
            mains_hz=_MAINS_HZ if slow else None,
        )
    except ModelError as error:
        return None, f"the model gives no settings ({error})"
    return tuned.settings, ""


def _learned(context: RunContext, setup: TrackingSetup, about: RunMetadata) -> Path:
    """Learn the voltages of one period, then run the best ones.

    The voltages are added to those of a control where the axis accepts both and the model can tune
    it. The control corrects creep and drift, which continue between the trials; learning corrects
    what repeats.
    """
    axis = setup.trajectory.axis
    trajectory, run = _to_learn(context, setup)
    skip = trajectory.settle * trajectory.one_period.period

    def sent(voltage: Waveform) -> ControlRun:
        return with_feedforward(run, voltage) if run.servo else replace(run, waveform=voltage)

    def trial(voltage: Waveform) -> Record:
        trial_run = sent(voltage)
        record = run_waveform(
            context.instrument,
            trial_run.waveform,
            setup.signals,
            rate_hz=setup.rate_hz,
            cycles=trial_run.cycles,
            feedforward=trial_run.feedforward,
        )
        return from_sample(record, round(skip * record.sample_rate_hz))

    with _ready(context, setup, run):
        learned = learn(
            trial,
            trajectory.one_period,
            run.feedforward or run.waveform,
            {axis: trajectory.model},
            LearningSettings(trials=setup.trials - 1, periods=max(trajectory.cycles, 2)),
            limits={axis: trajectory.limits},
            columns={axis: setup.along},
            servo=run.servo or None,
        )
        errors = " ".join(f"{t.rms:.6e}" for t in learned.axes[axis].trials)
        about = _with_settings(about, {LEARNING: errors})
        if run.servo:
            about = _with_settings(about, {"servo": repr(run.servo[axis])})
        best = sent(learned.waveform)
        command = _command(trajectory, best, best.waveform, learned.notes)
        return _recorded(context, setup, command, about, best.feedforward)


def _to_learn(context: RunContext, setup: TrackingSetup) -> tuple[ReferenceTrajectory, ControlRun]:
    """Return the reference, and the first run of learning: under control, or in open loop."""
    trajectory = setup.trajectory
    capabilities = context.instrument.axes[trajectory.axis].capabilities
    servo = None
    if {*_FOR_ADDED_VOLTAGES} <= capabilities:
        servo, _ = _servo(trajectory, context.base_rate_hz)
    if servo is None:
        return trajectory, _planned_run(trajectory, ControlMode.FEEDFORWARD, repeat=True)
    # the sensitivity of the control is known at the rate of its loop
    rate = context.base_rate_hz
    trajectory = reference_of(
        context, setup.model, setup.reference, trajectory.model, controlled=True, rate_hz=rate
    )
    return trajectory, _planned_run(trajectory, ControlMode.BOTH, servo, _READING_DELAY / rate)


#: Function that runs each control mode.
_RUN_OF_MODE: dict[str, Callable[[RunContext, TrackingSetup, RunMetadata], Path]] = {
    "open loop": _open_loop,
    "inverse": _inverse,
    "feedback": partial(_controlled, ControlMode.FEEDBACK),
    "both": partial(_controlled, ControlMode.BOTH),
    "learning": _learned,
}
