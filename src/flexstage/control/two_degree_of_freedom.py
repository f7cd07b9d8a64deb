"""Three control modes: feedforward, feedback, and both together.

- *Feedforward*: the inverse of the identified drive gives the voltages, without feedback.
- *Feedback*: the position control follows the trajectory and corrects its error.
- *Both*: the control follows the trajectory while the voltages of the inverse are added to its own,
  so that it corrects only the error of the inverse.

A control compares the target of a sample with the last converted reading, which is one sample old.
So that the stage is on the trajectory, the target is the trajectory delayed by that sample. With
feedback alone this is the smallest part of the lag.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum

from flexstage.base.choose import has_no
from flexstage.base.errors import ModelError
from flexstage.control.feedforward import Compensation, compensate
from flexstage.control.trajectory import Trajectory, delayed
from flexstage.hysteresis import DriveModel
from flexstage.instruments.protocol import Capability, Instrument, Signal, Waveform
from flexstage.records import Record
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import ServoSettings

#: Periods before the evaluated ones, in which transients decay.
_SETTLING = 2
#: Settling time of a loop that was just closed [s].
_CLOSING = 0.2


class ControlMode(StrEnum):
    """Mode of control by which a trajectory is followed."""

    FEEDFORWARD = "feedforward"
    FEEDBACK = "feedback"
    BOTH = "feedforward and feedback"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControlRun:
    """Waveforms that are sent to an instrument in one control mode."""

    mode: ControlMode
    """The control mode."""
    trajectory: Trajectory
    """The reference."""
    waveform: Waveform
    """Voltages, or the targets of the control."""
    feedforward: Waveform | None
    """Voltages that are added under control."""
    lead_in: Waveform | None
    """Preceding voltages, which condition the drive."""
    cycles: int
    """Number of repetitions of the waveform."""
    settling: int
    """First periods, which are not evaluated."""
    servo: Mapping[str, ServoSettings]
    """Settings of the control by axis."""
    notes: tuple[str, ...]
    """Changes, for the report."""

    @property
    def periods(self) -> int:
        """Number of periods of the trajectory in the run."""
        return self.cycles * round(self.waveform.size / self.trajectory.size)


def control_run(
    mode: ControlMode | str,
    trajectory: Trajectory,
    *,
    periods: int,
    models: Mapping[str, DriveModel] | None = None,
    servo: Mapping[str, ServoSettings] | None = None,
    limits: Mapping[str, AxisLimits] | None = None,
    reading_delay: float | None = None,
    settling: int = _SETTLING,
    repeat: bool = False,
) -> ControlRun:
    """Return the waveforms by which an instrument follows a trajectory.

    Parameters
    ----------
    mode : ControlMode or str
        Feedforward, feedback, or both.
    trajectory : Trajectory
        The reference, at the rate of the wave generator.
    periods : int
        Evaluated periods.
    models : Mapping, optional
        Model of each axis, for a mode with feedforward.
    servo : Mapping, optional
        Settings of the control by axis, for a mode with feedback (default: the present settings).
    limits : Mapping, optional
        Limits by axis.
    reading_delay : float, optional
        Age of a reading when the control compares it [s], usually one sample of the loop (default:
        the targets are not delayed).
    settling : int
        Periods before the evaluated ones.
    repeat : bool
        Whether feedforward alone repeats one period too, which makes its tables short but does not
        compensate the creep that does not repeat.

    Returns
    -------
    ControlRun
        The waveforms.

    Raises
    ------
    ModelError
        There is no model for a mode that needs one, or no period.
    LimitError
        The trajectory, or its voltages, exceed the limits.

    Notes
    -----
    Validity: under control, the voltages of one repeating period are added, since the control
    corrects creep and drift by itself.
    """
    control_mode = ControlMode(mode)
    if periods < 1 or settling < 0:
        raise ModelError(f"a run needs at least one period, got {periods} after {settling}")
    if control_mode is not ControlMode.FEEDFORWARD:
        # voltages have their own limits; the limits of positions apply to targets of a control
        trajectory.check(limits or {})
    total = periods + settling
    compensation: Compensation | None = None
    if control_mode is not ControlMode.FEEDBACK:
        if not models:
            raise ModelError(
                "feedforward needs the model of each axis: identify them, or choose 'feedback'"
            )
        repeats = total if control_mode is ControlMode.FEEDFORWARD and not repeat else 0
        compensation = compensate(models, trajectory, periods=repeats, limits=limits)
    if control_mode is ControlMode.FEEDFORWARD:
        assert compensation is not None
        return ControlRun(
            mode=control_mode, trajectory=trajectory, waveform=compensation.voltage,
            feedforward=None, lead_in=compensation.lead_in, cycles=total if repeat else 1,
            settling=settling, servo={}, notes=compensation.notes,
        )  # fmt: skip
    target = trajectory if not reading_delay else delayed(trajectory, reading_delay)
    return ControlRun(
        mode=control_mode,
        trajectory=trajectory,
        waveform=target.waveform(),
        feedforward=None if compensation is None else compensation.voltage,
        lead_in=None if compensation is None else compensation.lead_in,
        cycles=total,
        settling=settling,
        servo=dict(servo or {}),
        notes=trajectory.notes if compensation is None else compensation.notes,
    )


def carry_out(
    instrument: Instrument,
    run: ControlRun,
    signals: Sequence[Signal],
    *,
    rate_hz: float,
) -> Record:
    """Carry out a run on an instrument and record it.

    The drives are conditioned in open loop. Then the control is switched on where the mode needs
    it, which does not move the stage, and the waveform is run. Afterwards the control is on or off
    as before.

    Parameters
    ----------
    instrument : Instrument
        The instrument; its axes have the same names as those of the trajectory.
    run : ControlRun
        The run.
    signals : sequence of Signal
        The recorded signals.
    rate_hz : float
        Samples in a second [Hz].

    Returns
    -------
    Record
        The record of all periods, including the settling ones.

    Raises
    ------
    ModelError
        An axis does not support the mode, such as voltages that are added under control.
    LimitError
        A waveform exceeds the limits; it did not move the stage.
    """
    from flexstage.instruments.record_run import run_waveform

    with prepare(instrument, run, signals, rate_hz=min(rate_hz, 100.0)):
        return run_waveform(
            instrument,
            run.waveform,
            signals,
            rate_hz=rate_hz,
            cycles=run.cycles,
            feedforward=run.feedforward,
        )


@contextmanager
def prepare(
    instrument: Instrument,
    run: ControlRun,
    signals: Sequence[Signal],
    *,
    rate_hz: float = 100.0,
) -> Iterator[None]:
    """Condition the drives, and switch the control on where the mode needs it.

    Afterwards the control is on or off as before. The first of the signals is read during the
    lead-in, at any rate [Hz].
    """
    from flexstage.instruments.record_run import run_waveform

    _require(instrument, run)
    axes = [instrument.axes[a] for a in run.trajectory.axes]
    before = {axis.name: axis.closed_loop for axis in axes}
    named = dict(zip(run.trajectory.axes, axes, strict=True))
    try:
        if run.lead_in is not None:
            for axis in axes:
                if axis.closed_loop:
                    axis.set_closed_loop(False)
            run_waveform(instrument, run.lead_in, signals[:1], rate_hz=rate_hz)
        if run.mode is not ControlMode.FEEDFORWARD:
            for name, axis in named.items():
                if name in run.servo:
                    axis.set_servo(run.servo[name])
                if not axis.closed_loop:
                    axis.set_closed_loop(True)
            instrument.pause(_CLOSING)
        else:
            for axis in axes:
                if axis.closed_loop:
                    axis.set_closed_loop(False)
        yield
    finally:
        for axis in axes:
            if axis.closed_loop != before[axis.name]:
                axis.set_closed_loop(before[axis.name])


def _require(instrument: Instrument, run: ControlRun) -> None:
    """Refuse a run that an axis of the instrument cannot carry out."""
    required = {
        Capability.OPEN_LOOP: (
            run.mode is not ControlMode.FEEDBACK,
            "axis '{}' accepts no voltages, which feedforward needs",
        ),
        Capability.CLOSED_LOOP: (
            run.mode is not ControlMode.FEEDFORWARD,
            "axis '{}' has no position control, which feedback needs",
        ),
        Capability.FEEDFORWARD_TABLE: (
            run.mode is ControlMode.BOTH,
            "axis '{}' accepts no voltages under position control, so this instrument cannot "
            "combine feedforward and feedback: choose one of them, or learn the targets",
        ),
    }  # fmt: skip
    for name in run.trajectory.axes:
        if name not in instrument.axes:
            raise ModelError(has_no("the instrument", "axis", name, instrument.axes))
        able = instrument.axes[name].capabilities | instrument.capabilities
        fixed = "the settings of the control of axis '{}' cannot be changed: omit them"
        needs = {**required, Capability.SERVO_TUNING: (run.servo.get(name) is not None, fixed)}
        for capability, (needed, sentence) in needs.items():
            if needed and capability not in able:
                raise ModelError(sentence.format(name))


def with_feedforward(run: ControlRun, voltage: Waveform) -> ControlRun:
    """Return a run under control with other voltages added, such as learned ones.

    Parameters
    ----------
    run : ControlRun
        The run, with feedback.
    voltage : Waveform
        The voltages of one period.

    Returns
    -------
    ControlRun
        The run.

    Raises
    ------
    ModelError
        The run has no feedback, or the voltages have another length.
    """
    if run.mode is ControlMode.FEEDFORWARD or voltage.size != run.waveform.size:
        raise ModelError(
            "voltages can be added only to a run with feedback, one for each target; got "
            f"{voltage.size} for {run.waveform.size} targets in a run by {run.mode}"
        )
    return replace(run, mode=ControlMode.BOTH, feedforward=voltage)
