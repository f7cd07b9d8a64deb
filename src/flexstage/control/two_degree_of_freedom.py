"""Three ways to make a stage follow: feedforward, feedback, and both together.

- *Feedforward*: the inverse of the identified drive gives voltages, nobody looks.
- *Feedback*: the position control follows the trajectory, its error is what it corrects by.
- *Both*: the control follows the trajectory while the voltages of the inverse are added to its own,
  so that it corrects only what the inverse leaves.

A control compares the target of a sample with the last reading that was converted, which is one
sample old. To have the stage at the trajectory, the target has to be where the sensor was: the
trajectory as much later. For feedback alone this is the smallest part of what it lags behind.
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

#: Periods before those that are looked at, in which what was before dies out.
_SETTLING = 2
#: Time given to a loop that was just closed [s].
_CLOSING = 0.2


class Way(StrEnum):
    """How a trajectory is followed."""

    FEEDFORWARD = "feedforward"
    FEEDBACK = "feedback"
    BOTH = "feedforward and feedback"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControlRun:
    """What is sent to an instrument for one way of control."""

    way: Way
    """The way."""
    trajectory: Trajectory
    """Where the stage is to be."""
    waveform: Waveform
    """Voltages, or the targets of the control."""
    feedforward: Waveform | None
    """Voltages that are added under control."""
    lead_in: Waveform | None
    """Voltages before, which condition the drive."""
    cycles: int
    """How often the waveform runs."""
    settling: int
    """First periods that are left out of an evaluation."""
    servo: Mapping[str, ServoSettings]
    """Settings of the control by axis."""
    notes: tuple[str, ...]
    """What was changed, to be told."""

    @property
    def periods(self) -> int:
        """Number of periods of the trajectory that are run."""
        return self.cycles * round(self.waveform.size / self.trajectory.size)


def control_run(
    way: Way | str,
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
    """Return what is sent to an instrument to follow a trajectory.

    Parameters
    ----------
    way : Way or str
        Feedforward, feedback, or both.
    trajectory : Trajectory
        Where the stage is to be, at the rate of the wave generator.
    periods : int
        Periods that are to be looked at.
    models : Mapping, optional
        Model of each axis, for a way with feedforward.
    servo : Mapping, optional
        Settings of the control by axis, for a way with feedback; those that are set where not
        given.
    limits : Mapping, optional
        Limits by axis.
    reading_delay : float, optional
        Age of a reading when the control compares it [s]; no shift of the targets where not given.
        One sample of the loop is usual.
    settling : int
        Periods before those that are looked at.
    repeat : bool
        Whether feedforward alone repeats one period as well, which makes its tables short but
        leaves the creep that does not repeat.

    Returns
    -------
    ControlRun
        The waveforms.

    Raises
    ------
    ModelError
        There is no model for a way that needs one, or no period.
    LimitError
        The trajectory, or its voltages, leave the limits.

    Notes
    -----
    Validity: voltages of one period that repeats are added under control, since the control takes
    up creep and drift by itself.
    """
    chosen = Way(way)
    if periods < 1 or settling < 0:
        raise ModelError(f"a run takes one period or more, got {periods} after {settling}")
    if chosen is not Way.FEEDFORWARD:
        # voltages have limits of their own; those of positions are what a control may reach
        trajectory.check(limits or {})
    total = periods + settling
    made: Compensation | None = None
    if chosen is not Way.FEEDBACK:
        if not models:
            raise ModelError(
                "feedforward needs the model of each axis: identify them, or choose 'feedback'"
            )
        several = total if chosen is Way.FEEDFORWARD and not repeat else 0
        made = compensate(models, trajectory, periods=several, limits=limits)
    if chosen is Way.FEEDFORWARD:
        assert made is not None
        return ControlRun(
            way=chosen, trajectory=trajectory, waveform=made.voltage, feedforward=None,
            lead_in=made.lead_in, cycles=total if repeat else 1, settling=settling, servo={},
            notes=made.notes,
        )  # fmt: skip
    seen = trajectory if not reading_delay else delayed(trajectory, reading_delay)
    return ControlRun(
        way=chosen,
        trajectory=trajectory,
        waveform=seen.waveform(),
        feedforward=None if made is None else made.voltage,
        lead_in=None if made is None else made.lead_in,
        cycles=total,
        settling=settling,
        servo=dict(servo or {}),
        notes=trajectory.notes if made is None else made.notes,
    )


def carry_out(
    instrument: Instrument,
    run: ControlRun,
    signals: Sequence[Signal],
    *,
    rate_hz: float,
) -> Record:
    """Carry out a run on an instrument and record it.

    The drives are conditioned in open loop. Then the control is switched on where the way needs it,
    which moves nothing, and the waveform is run. Afterwards the control is on or off as before.

    Parameters
    ----------
    instrument : Instrument
        The instrument, whose axes have the names of the trajectory's.
    run : ControlRun
        The run.
    signals : sequence of Signal
        What is recorded.
    rate_hz : float
        Samples in a second [Hz].

    Returns
    -------
    Record
        The record of all periods, the settling ones included.

    Raises
    ------
    ModelError
        An axis cannot do what the way asks for, such as to take voltages under control.
    LimitError
        A waveform leaves the limits; nothing has been moved by it.
    """
    from flexstage.instruments.record_run import run_waveform

    with made_ready(instrument, run, signals, rate_hz=min(rate_hz, 100.0)):
        return run_waveform(
            instrument,
            run.waveform,
            signals,
            rate_hz=rate_hz,
            cycles=run.cycles,
            feedforward=run.feedforward,
        )


@contextmanager
def made_ready(
    instrument: Instrument,
    run: ControlRun,
    signals: Sequence[Signal],
    *,
    rate_hz: float = 100.0,
) -> Iterator[None]:
    """Condition the drives, and switch the control on where the way needs it.

    Afterwards the control is on or off as before. `signals` are read along the lead-in, at a rate
    [Hz] that nothing depends on.
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
        if run.way is not Way.FEEDFORWARD:
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
    """Refuse a run that an axis of the instrument cannot do."""
    ways = {
        Capability.OPEN_LOOP: (
            run.way is not Way.FEEDBACK, "axis '{}' takes no voltages: feedforward needs them"
        ),
        Capability.CLOSED_LOOP: (
            run.way is not Way.FEEDFORWARD,
            "axis '{}' has no position control: feedback needs it",
        ),
        Capability.FEEDFORWARD_TABLE: (
            run.way is Way.BOTH,
            "axis '{}' takes no voltages under control, so that feedforward and feedback cannot be "
            "joined on this instrument: choose one of them, or learn the targets",
        ),
    }  # fmt: skip
    for name in run.trajectory.axes:
        if name not in instrument.axes:
            raise ModelError(has_no("the instrument", "axis", name, instrument.axes))
        able = instrument.axes[name].capabilities | instrument.capabilities
        tuned = "the control of axis '{}' cannot be set from here: leave its settings out"
        needs = {**ways, Capability.SERVO_TUNING: (run.servo.get(name) is not None, tuned)}
        for capability, (needed, sentence) in needs.items():
            if needed and capability not in able:
                raise ModelError(sentence.format(name))


def with_feedforward(run: ControlRun, voltage: Waveform) -> ControlRun:
    """Return a run under control with other voltages added, such as ones that were learned.

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
        It has no feedback, or the voltages last another time.
    """
    if run.way is Way.FEEDFORWARD or voltage.size != run.waveform.size:
        raise ModelError(
            "voltages are added to a run with feedback, and as many as its targets; got "
            f"{voltage.size} for {run.waveform.size} in a run by {run.way}"
        )
    return replace(run, way=Way.BOTH, feedforward=voltage)
