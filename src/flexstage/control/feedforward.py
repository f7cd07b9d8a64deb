r"""Voltages that make a stage follow trajectories, without looking: the inverse of its model.

A hysteretic drive answers to a voltage according to what was before. So every run begins with
cycles over the whole range, which wipe out what was, and the inverse begins with what the drive
remembers then: the loops of its hysteresis and the lags of its creep.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import LimitError, ModelError, RecordError
from flexstage.control.tracking_run import whole_periods
from flexstage.control.trajectory import Trajectory, smooth_step
from flexstage.hysteresis import DriveModel, Feedforward, Lag, feedforward
from flexstage.hysteresis.limited_inverse import command_limits
from flexstage.instruments.protocol import Waveform
from flexstage.stage.limits import AxisLimits

#: Cycles that condition a drive, one a second, and the time of the way to the start [s].
_CYCLES, _APPROACH = 3, 0.25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Compensation:
    """Voltages for a trajectory."""

    lead_in: Waveform
    """Voltages before: from rest over the conditioning cycles to the first voltage."""
    voltage: Waveform
    """Voltages of the trajectory: one period that repeats, or several that do not."""
    trajectory: Trajectory
    """What they follow."""
    periods: int
    """Number of periods in `voltage`; 0 for one that is repeated as often as wanted."""
    predicted: Mapping[str, float]
    """Reading at the end of the lead-in by the model, by axis [m]: where the sensor reads
    otherwise, its zero has moved (`shifted_model`).
    """
    limited: int = 0
    """Samples that limits changed."""
    notes: tuple[str, ...] = field(default=())
    """What was changed, to be told."""


def conditioning_waveform(
    voltage_range: Mapping[str, tuple[float, float]],
    *,
    sample_rate_hz: float,
    end: Mapping[str, float] | None = None,
) -> Waveform:
    """Return voltages that bring drives to a known state of their memory.

    Whole cycles over the range of each, all axes in step, then a short way from the low end to the
    first voltage of what follows. An axis starts at its low end, and ends there where no end is
    given.

    Examples
    --------
    >>> made = conditioning_waveform({"x": (0.0, 120.0)}, sample_rate_hz=1e3, end={"x": 2.0})
    >>> made.duration, round(made.largest_rate("x"))
    (3.75, 377)
    """
    count, approach = round(sample_rate_hz), round(_APPROACH * sample_rate_hz)
    if sample_rate_hz < 16.0:
        raise ModelError(f"conditioning takes 16 samples a second or more, got {sample_rate_hz!r}")
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
    history: Waveform | None = None,
) -> Compensation:
    r"""Return the voltages that make a stage follow a trajectory.

    Modes and lag are undone harmonic by harmonic over the closed period, which is exact for a
    motion that repeats. With `periods` creep is undone by its recursion from the state that the
    lead-in leaves, and the voltages of the periods differ. Without, one period is sought that
    repeats: the inverse of the hysteresis is run over it until its memory is the same again; the
    slow part of creep, which never repeats, is taken as it is ten seconds after the start.

    Parameters
    ----------
    models : Mapping
        Model of each axis that the trajectory moves.
    trajectory : Trajectory
        What is to be followed, as the sensors read it.
    periods : int
        Number of periods; 0 for one that is repeated.
    limits : Mapping, optional
        Limits by axis: the range of the voltage, and its slew. The range that each model was
        identified on where not given.
    history : Waveform, optional
        Voltages that the drives had before the lead-in, as far back as is known, at any rate: the
        creep of them goes on. The drives have rested where not given.

    Returns
    -------
    Compensation
        The voltages.

    Raises
    ------
    ModelError
        An axis has no model, the drive reaches nothing of the motion, or has no inverse.
    LimitError
        The voltages would rise or fall faster than the drive or its amplifier allows.

    Notes
    -----
    Validity: as good as the model. Each axis for itself: what one axis moves of the other is not
    undone.

    Examples
    --------
    >>> from flexstage.control.trajectory_shapes import sine
    >>> from flexstage.hysteresis import Duhem, DriveModel, ValidityRange
    >>> drive = DriveModel(
    ...     hysteresis=Duhem(rate=0.02, anhysteretic=np.array([0.0, 5e-7]),
    ...                      tangent=np.array([4e-7]), input_range=(0.0, 120.0)),
    ...     validity=ValidityRange(input_range=(0.0, 120.0), output_range=(0.0, 6e-5),
    ...                            rate_range_hz=(1.0, 5.0)))
    >>> wanted = sine("x", 8e-6, 50e-6, 1.0, sample_rate_hz=1e3)
    >>> made = compensate({"x": drive}, wanted)
    >>> u = np.tile(made.voltage.values["x"], 12)
    >>> y = drive.simulate(u, 1e-3, drive.conditioned())[-1000:]
    >>> bool(np.max(np.abs(y - wanted.positions["x"])) < 1e-12)
    True
    """
    missing = [a for a in trajectory.axes if a not in models]
    if missing:
        raise ModelError(
            f"the trajectory moves {', '.join(missing)}, of which there is no model: identify it"
        )
    ranges = {a: _range(models[a], (limits or {}).get(a)) for a in trajectory.axes}
    rate = trajectory.sample_rate_hz
    made = {a: _Axis(models[a], ranges[a], rate, history, a) for a in trajectory.axes}
    found: dict[str, Feedforward] = {}
    # the way to the first voltage is part of what the drive remembers: found in two rounds
    ends = {a: ranges[a][0] for a in trajectory.axes}
    for _ in range(3):
        lead_in = conditioning_waveform(ranges, sample_rate_hz=rate, end=ends)
        for a, own in made.items():
            found[a] = own.follow(trajectory.positions[a], periods, lead_in.values[a])
            ends[a] = float(found[a].command[0])
    lead_in = conditioning_waveform(ranges, sample_rate_hz=rate, end=ends)
    voltage = {a: own.command for a, own in found.items()}
    whole = Waveform(values=voltage, sample_rate_hz=rate, quantity="voltage")
    _check_slew(whole, limits or {}, closed=periods == 0)
    notes = [s for a in made for s in (models[a].outside(voltage[a]),) if s]
    notes += [f"axis '{a}': {own.limit_note}" for a, own in found.items() if own.limited]
    return Compensation(
        lead_in=lead_in,
        voltage=whole,
        trajectory=trajectory,
        periods=periods,
        predicted={a: own.reading_after(lead_in.values[a]) for a, own in made.items()},
        limited=sum(own.limited for own in found.values()),
        notes=(*trajectory.notes, *notes),
    )


def shifted_model(model: DriveModel, by: float) -> DriveModel:
    """Return a drive whose sensor reads more by a constant [unit of output]: its zero has moved."""
    return replace(model, offset=model.offset + by)


def trimmed_model(
    model: DriveModel,
    trajectory: Trajectory,
    axis: str,
    reading: ArrayLike,
    *,
    skip: int = 0,
) -> DriveModel:
    r"""Return a drive with the delay that a run by its inverse shows.

    Hysteresis is a lag as well, so that an identification tells the delay of a drive only to some
    microseconds. A fast motion shows what is left: the phases of wanted motion and reading at the
    first harmonic, frequency f, differ by :math:`2 \pi f` times what the delay of the model lacks.

    Parameters
    ----------
    model : DriveModel
        The drive whose inverse was run.
    trajectory : Trajectory
        What was wanted; a sine at the highest rate that is to be followed is best.
    axis : str
        The axis.
    reading : array_like
        What the sensor read in open loop, feedforward alone, from the first sample of the
        trajectory on and at its rate [m], shape (n,).
    skip : int
        First periods that are left out.

    Returns
    -------
    DriveModel
        The drive, with another delay.

    Raises
    ------
    RecordError
        There is no whole period, or the reading does not move with the trajectory.
    ModelError
        The delay would be negative.

    Notes
    -----
    Validity: what the sensor picks up at the rate of the motion, such as mains at 50 Hz of an
    amplitude a, is taken for an angle of up to a over the amplitude of the motion. What an
    amplifier does beyond a pure delay is one only at this rate.

    Examples
    --------
    >>> from flexstage.control.trajectory_shapes import sine
    >>> from flexstage.hysteresis import PrandtlIshlinskii
    >>> drive = DriveModel(
    ...     hysteresis=PrandtlIshlinskii(gain=5e-7, thresholds=[5.0], weights=[1e-7]),
    ...     lag=Lag(delay=2.36e-4))
    >>> wanted = sine("x", 10e-6, 60e-6, 50.0, sample_rate_hz=10e3)
    >>> t = np.arange(600) / 10e3
    >>> late = 35e-6 - 25e-6 * np.cos(2.0 * np.pi * 50.0 * (t - 6e-6))
    >>> print(f"{1e6 * trimmed_model(drive, wanted, 'x', late).lag.delay:.2f} us")
    242.00 us
    """
    late = whole_periods(reading, trajectory.size, skip).mean(axis=0)
    wanted = np.fft.rfft(trajectory.positions[axis])[1]
    came = np.fft.rfft(late)[1]
    if not 0.5 * abs(wanted) < abs(came) < 2.0 * abs(wanted):
        raise RecordError(
            f"the reading moves {abs(came) / max(abs(wanted), 1e-300):.3g} times as far as the "
            f"trajectory of axis '{axis}' at its first harmonic: give the run that followed it"
        )
    by = float(-np.angle(came / wanted)) / (2.0 * math.pi) * trajectory.period
    lag = model.lag or Lag()
    if lag.delay + by < 0.0:
        raise ModelError(
            f"the reading is {-by:.3g} s ahead of the trajectory, more than the model's delay of "
            f"{lag.delay:.3g} s: does its first sample belong to that of the trajectory?"
        )
    return replace(model, lag=replace(lag, delay=lag.delay + by))


class _Axis:
    """One axis: what it remembers, and its inverse."""

    def __init__(
        self,
        model: DriveModel,
        limits: tuple[float, float],
        rate: float,
        history: Waveform | None,
        axis: str,
    ) -> None:
        self.model, self.limits, self.rate = model, limits, rate
        self.before: Array = model.hysteresis.initial_state()
        creep = model.creep
        self.creeping = None if creep is None else creep.settled(0.0, 1.0 / rate)
        if history is not None and axis in history.values:
            made = model.hysteresis.simulate(history.values[axis])
            self.before = made.state
            if creep is not None:
                dt = 1.0 / history.sample_rate_hz
                self.creeping = creep.simulate(made.values, dt, creep.settled(0.0, dt)).state

    def follow(self, wanted: Array, periods: int, lead_in: Array) -> Feedforward:
        """Return the voltages of some periods, with the creep that goes on, or of one endless."""
        dt = 1.0 / self.rate
        before = self.model.hysteresis.simulate(lead_in, self.before)
        creep = None
        if self.model.creep is not None:
            creep = self.model.creep.simulate(before.values, dt, self.creeping).state
        return feedforward(
            self.model, wanted, dt, periods=periods, limits=self.limits, state=before.state,
            start=creep,
        )  # fmt: skip

    def reading_after(self, lead_in: Array) -> float:
        """What the sensor should read at the end of the lead-in."""
        model, dt = self.model, 1.0 / self.rate
        y = model.hysteresis.simulate(lead_in, self.before).values
        if model.creep is not None:
            y = model.creep.simulate(y, dt, self.creeping).values
        return model.offset + model.sign * float(y[-1])


def _range(model: DriveModel, limits: AxisLimits | None) -> tuple[float, float]:
    own = command_limits(model, None if limits is None else limits.voltage)
    if model.validity is None:
        return own
    seen = model.validity.input_range
    # the narrower of both: what was not identified is not used
    low, high = max(own[0], seen[0]), min(own[1], seen[1])
    if not low < high:
        raise ModelError(
            f"the limits {own[0]:g} to {own[1]:g} and the range {seen[0]:g} to {seen[1]:g} that "
            "the model was identified on have nothing in common: it is the model of another drive"
        )
    return low, high


def _check_slew(whole: Waveform, limits: Mapping[str, AxisLimits], *, closed: bool) -> None:
    for axis in whole.values:
        most = limits[axis].slew if axis in limits else None
        if most is None:
            continue
        steepest = whole.largest_rate(axis, closed=closed)
        if steepest > most:
            raise LimitError(
                f"the voltage of axis '{axis}' would change by {steepest:.4g} V/s, at most "
                f"{most:.4g} V/s are allowed: lower the rate, make the motion smaller, or its "
                "turns longer"
            )
