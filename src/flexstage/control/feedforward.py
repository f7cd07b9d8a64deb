r"""Feedforward: voltages that make a stage follow trajectories, by the inverse of its model.

The response of a hysteretic drive depends on its history. So every run begins with cycles over the
entire range, which erase the history. The inverse begins with the memory of the drive after them:
the loops of its hysteresis and the states of its creep.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.errors import LimitError, ModelError, RecordError
from flexstage.control.trajectory import Trajectory, smooth_step, whole_periods
from flexstage.hysteresis import DriveModel, DriveState, Feedforward, Lag, feedforward
from flexstage.hysteresis.limited_inverse import command_limits
from flexstage.instruments.protocol import Waveform
from flexstage.stage.limits import AxisLimits

#: Cycles that condition a drive, at 1 Hz, and the time of the move to the start [s].
_CYCLES, _APPROACH = 3, 0.25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Compensation:
    """Voltages for a trajectory."""

    lead_in: Waveform
    """Preceding voltages: from rest over the conditioning cycles to the first voltage."""
    voltage: Waveform
    """Voltages of the trajectory: one period that repeats, or several that do not."""
    trajectory: Trajectory
    """The reference."""
    periods: int
    """Number of periods in `voltage`; 0 for one that can be repeated endlessly."""
    predicted: Mapping[str, float]
    """Reading at the end of the lead-in by the model, by axis [m]. A different reading of the
    sensor means that its zero has shifted (`shifted_model`).
    """
    after: Mapping[str, DriveState] = field(default_factory=dict)
    """State of each drive at the end of `voltage`, for the motion that follows at once."""
    limited: int = 0
    """Samples that were clipped to the limits."""
    notes: tuple[str, ...] = field(default=())
    """Changes, for the report."""


def conditioning_waveform(
    voltage_range: Mapping[str, tuple[float, float]],
    *,
    sample_rate_hz: float,
    end: Mapping[str, float] | None = None,
) -> Waveform:
    """Return voltages that bring drives to a known state of their memory.

    Full cycles over the range of each, all axes synchronous, then a short move from the low end to
    the first voltage of the run. An axis starts at its low end, and ends there where no end is
    given.

    Examples
    --------
    >>> wave = conditioning_waveform({"x": (0.0, 120.0)}, sample_rate_hz=1e3, end={"x": 2.0})
    >>> wave.duration, round(wave.largest_rate("x"))
    (3.75, 377)
    """
    count, approach = round(sample_rate_hz), round(_APPROACH * sample_rate_hz)
    if sample_rate_hz < 16.0:
        raise ModelError(
            f"conditioning needs at least 16 samples per second, got {sample_rate_hz!r}"
        )
    swing = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(_CYCLES * count) / count)
    way = smooth_step(np.arange(approach) / approach)
    values = {}
    for axis, (low, high) in voltage_range.items():
        last = low if end is None else end.get(axis, low)
        values[axis] = np.concatenate(
            (
                np.full(approach, low),
                low + (high - low) * swing,
                low + (last - low) * way,
                np.full(approach, last),
            )
        )
    return Waveform(values=values, sample_rate_hz=float(sample_rate_hz), quantity="voltage")


def compensate(
    models: Mapping[str, DriveModel],
    trajectory: Trajectory,
    *,
    periods: int = 0,
    limits: Mapping[str, AxisLimits] | None = None,
    after: Mapping[str, DriveState] | None = None,
) -> Compensation:
    r"""Return the voltages that make a stage follow a trajectory.

    Modes and lag are inverted harmonic by harmonic over the closed period, which is exact for a
    periodic motion. With `periods` creep is inverted by its recursion from the state after the
    lead-in, and the voltages of the periods differ. Without, the result is one period that repeats:
    the inverse of the hysteresis is run over it until its memory is periodic. The slow part of
    creep, which never repeats, is that at ten seconds after the start.

    Parameters
    ----------
    models : Mapping
        Model of each axis that the trajectory moves.
    trajectory : Trajectory
        The reference, as the sensors read it.
    periods : int
        Number of periods; 0 for one that is repeated.
    limits : Mapping, optional
        Limits by axis: the range of the voltage, and its slew (default: the range that each model
        was identified on).
    after : Mapping, optional
        State of drives before the lead-in, by axis, such as `Compensation.after` of the motion
        before, for the creep that continues (default: the drives were at rest).

    Returns
    -------
    Compensation
        The voltages.

    Raises
    ------
    ModelError
        An axis has no model, the motion is outside the range of the drive, or there is no inverse.
    LimitError
        The voltages would rise or fall faster than the drive or its amplifier allows.

    Notes
    -----
    Validity: that of the model. Each axis separately: cross-coupling of the axes is not
    compensated.

    Examples
    --------
    >>> from flexstage.control.trajectory import sine
    >>> from flexstage.hysteresis import Duhem, DriveModel, ValidityRange
    >>> drive = DriveModel(
    ...     hysteresis=Duhem(rate=0.02, anhysteretic=np.array([0.0, 5e-7]),
    ...                      tangent=np.array([4e-7]), input_range=(0.0, 120.0)),
    ...     validity=ValidityRange(input_range=(0.0, 120.0), output_range=(0.0, 6e-5),
    ...                            rate_range_hz=(1.0, 5.0)))
    >>> reference = sine("x", 8e-6, 50e-6, 1.0, sample_rate_hz=1e3)
    >>> compensation = compensate({"x": drive}, reference)
    >>> u = np.tile(compensation.voltage.values["x"], 12)
    >>> y = drive.simulate(u, 1e-3, drive.conditioned())[-1000:]
    >>> bool(np.max(np.abs(y - reference.positions["x"])) < 1e-12)
    True
    """
    missing = [a for a in trajectory.axes if a not in models]
    if missing:
        raise ModelError(
            f"the trajectory moves {', '.join(missing)}, but there is no model of it: identify one"
        )
    ranges = {a: _range(models[a], (limits or {}).get(a)) for a in trajectory.axes}
    rate = trajectory.sample_rate_hz
    dt = 1.0 / rate
    before = {a: _rest(models[a], dt) for a in trajectory.axes} | dict(after or {})
    voltages: dict[str, Feedforward] = {}
    # the move to the first voltage is part of the memory of the drive: three iterations suffice
    ends = {a: ranges[a][0] for a in trajectory.axes}
    for _ in range(3):
        lead_in = conditioning_waveform(ranges, sample_rate_hz=rate, end=ends)
        for a, reference in trajectory.positions.items():
            _, then = models[a].response(lead_in.values[a], dt, before[a])
            voltages[a] = feedforward(
                models[a], reference, dt, periods=periods, limits=ranges[a], after=then
            )
            ends[a] = float(voltages[a].command[0])
    lead_in = conditioning_waveform(ranges, sample_rate_hz=rate, end=ends)
    samples = {a: follower.command for a, follower in voltages.items()}
    waveform = Waveform(values=samples, sample_rate_hz=rate, quantity="voltage")
    _check_slew(waveform, limits or {}, closed=periods == 0)
    notes = [s for a in voltages for s in (models[a].outside(samples[a]),) if s]
    notes += [
        f"axis '{a}': {follower.limit_note}" for a, follower in voltages.items() if follower.limited
    ]
    return Compensation(
        lead_in=lead_in,
        voltage=waveform,
        trajectory=trajectory,
        periods=periods,
        predicted={
            a: float(models[a].response(lead_in.values[a], dt, before[a])[0][-1]) for a in voltages
        },
        after={a: follower.state for a, follower in voltages.items()},
        limited=sum(follower.limited for follower in voltages.values()),
        notes=(*trajectory.notes, *notes),
    )


def shifted_model(model: DriveModel, shift: float) -> DriveModel:
    """Return a drive with a shift of the zero of its sensor, by a constant [unit of output]."""
    return replace(model, offset=model.offset + shift)


def trimmed_model(
    model: DriveModel,
    trajectory: Trajectory,
    axis: str,
    reading: ArrayLike,
    *,
    skip: int = 0,
) -> DriveModel:
    r"""Return a drive with the delay that a run by its inverse shows.

    Hysteresis lags too, so that an identification determines the delay of a drive only to some
    microseconds. A fast motion shows the error of the delay: the phases of reference and reading at
    the first harmonic, frequency f, differ by :math:`2 \pi f` times it.

    Parameters
    ----------
    model : DriveModel
        The drive whose inverse was run.
    trajectory : Trajectory
        The reference; preferably a sine at the highest rate of the motions to come.
    axis : str
        The axis.
    reading : array_like
        Reading of the sensor in open loop, feedforward alone, from the first sample of the
        trajectory and at its rate [m], shape (n,).
    skip : int
        First periods that are skipped.

    Returns
    -------
    DriveModel
        The drive, with another delay.

    Raises
    ------
    RecordError
        There is no complete period, or the reading does not move with the trajectory.
    ModelError
        The delay would be negative.

    Notes
    -----
    Validity: a disturbance of the sensor at the rate of the motion, such as mains at 50 Hz of
    amplitude a, causes an error of phase of up to a over the amplitude of the motion. The lag of an
    amplifier equals a pure delay only at this rate.

    Examples
    --------
    >>> from flexstage.control.trajectory import sine
    >>> from flexstage.hysteresis import PrandtlIshlinskii
    >>> drive = DriveModel(
    ...     hysteresis=PrandtlIshlinskii(gain=5e-7, thresholds=[5.0], weights=[1e-7]),
    ...     lag=Lag(delay=2.36e-4))
    >>> reference = sine("x", 10e-6, 60e-6, 50.0, sample_rate_hz=10e3)
    >>> t = np.arange(600) / 10e3
    >>> late = 35e-6 - 25e-6 * np.cos(2.0 * np.pi * 50.0 * (t - 6e-6))
    >>> print(f"{1e6 * trimmed_model(drive, reference, 'x', late).lag.delay:.2f} us")
    242.00 us
    """
    mean_period = whole_periods(reading, trajectory.size, skip).mean(axis=0)
    reference = np.fft.rfft(trajectory.positions[axis])[1]
    response = np.fft.rfft(mean_period)[1]
    if not 0.5 * abs(reference) < abs(response) < 2.0 * abs(reference):
        raise RecordError(
            f"the reading moves {abs(response) / max(abs(reference), 1e-300):.3g} times as far as "
            f"the trajectory of axis '{axis}' at its first harmonic: give the record of that run"
        )
    change = float(-np.angle(response / reference)) / (2.0 * math.pi) * trajectory.period
    lag = model.lag or Lag()
    if lag.delay + change < 0.0:
        raise ModelError(
            f"the reading is {-change:.3g} s ahead of the trajectory, more than the model's delay "
            f"of {lag.delay:.3g} s: check that the first samples of both coincide"
        )
    return replace(model, lag=replace(lag, delay=lag.delay + change))


def _rest(model: DriveModel, dt: float) -> DriveState:
    """Return the state of a drive at rest, without voltage."""
    creep = None if model.creep is None else model.creep.settled(0.0, dt)
    memory = model.hysteresis.initial_state()
    return DriveState(hysteresis=memory, creep="rested" if creep is None else creep)


def _range(model: DriveModel, limits: AxisLimits | None) -> tuple[float, float]:
    allowed = command_limits(model, None if limits is None else limits.voltage)
    if model.validity is None:
        return allowed
    identified = model.validity.input_range
    # the narrower of both: the model is not used beyond its range of identification
    low, high = max(allowed[0], identified[0]), min(allowed[1], identified[1])
    if not low < high:
        raise ModelError(
            f"the limits {allowed[0]:g} to {allowed[1]:g} and the range {identified[0]:g} to "
            f"{identified[1]:g} that the model was identified on do not overlap: it is the model "
            "of another drive"
        )
    return low, high


def _check_slew(waveform: Waveform, limits: Mapping[str, AxisLimits], *, closed: bool) -> None:
    for axis in waveform.values:
        largest = limits[axis].slew if axis in limits else None
        if largest is None:
            continue
        fastest = waveform.largest_rate(axis, closed=closed)
        if fastest > largest:
            raise LimitError(
                f"the voltage of axis '{axis}' would change at {fastest:.4g} V/s, and its limit is "
                f"{largest:.4g} V/s: lower the rate, make the motion smaller, or its turns longer"
            )
