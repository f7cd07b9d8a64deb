r"""Voltages that make a stage follow trajectories, without looking: the inverse of its model.

A hysteretic drive answers to a voltage according to what was before. So every run begins with
cycles over the whole range, which wipe out what was, and the inverse begins with what the drive
remembers then: the loops of its hysteresis and the lags of its creep.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from flexstage.arrays import Array
from flexstage.control.trajectories.trajectory import Trajectory, smooth_step
from flexstage.errors import LimitError, ModelError
from flexstage.hysteresis import DriveModel, Feedforward, feedforward
from flexstage.hysteresis.limited_inverse import command_limits
from flexstage.instruments.waveform import Waveform
from flexstage.stage.limits import AxisLimits

#: How a drive is conditioned: rate of the cycles [Hz], their number, and the way to the start [s].
_RATE_HZ = 1.0
_CYCLES = 3
_APPROACH = 0.25


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
    start: Mapping[str, float] | None = None,
    rate_hz: float = _RATE_HZ,
    cycles: int = _CYCLES,
) -> Waveform:
    """Return voltages that bring drives to a known state of their memory.

    Whole cycles over the range of each, all axes in step, then a short way from the low end to the
    first voltage of what follows. Where neither is given, an axis starts, and ends, at its low end.

    Examples
    --------
    >>> made = conditioning_waveform({"x": (0.0, 120.0)}, sample_rate_hz=1e3, end={"x": 2.0})
    >>> made.duration, round(made.largest_rate("x"))
    (3.75, 377)
    """
    count = round(sample_rate_hz / rate_hz) if rate_hz > 0.0 else 0
    approach = round(_APPROACH * sample_rate_hz)
    if cycles < 1 or count < 8 or approach < 4:
        raise ModelError(
            f"conditioning takes one cycle or more of 8 samples at least, got {cycles} cycles at "
            f"{rate_hz!r} Hz and {sample_rate_hz!r} samples a second"
        )
    swing = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(cycles * count) / count)
    way = smooth_step(np.arange(approach) / approach)
    values = {}
    for axis, (low, high) in voltage_range.items():
        first = low if start is None else start.get(axis, low)
        last = low if end is None else end.get(axis, low)
        values[axis] = np.concatenate(
            (
                first + (low - first) * way,
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
    band_hz: float | None = None,
    cycles: int = _CYCLES,
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
    band_hz : float, optional
        Highest frequency that is undone [Hz].
    cycles : int
        Conditioning cycles of the lead-in.
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
    >>> from flexstage.control.trajectories.sine import sine
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
        lead_in = conditioning_waveform(ranges, sample_rate_hz=rate, end=ends, cycles=cycles)
        for a, own in made.items():
            found[a] = own.follow(trajectory.positions[a], periods, lead_in.values[a], band_hz)
            ends[a] = float(found[a].command[0])
    lead_in = conditioning_waveform(ranges, sample_rate_hz=rate, end=ends, cycles=cycles)
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

    def follow(
        self, wanted: Array, periods: int, lead_in: Array, band_hz: float | None
    ) -> Feedforward:
        """Return the voltages of some periods, with the creep that goes on, or of one endless."""
        dt = 1.0 / self.rate
        before = self.model.hysteresis.simulate(lead_in, self.before)
        creep = None
        if self.model.creep is not None:
            creep = self.model.creep.simulate(before.values, dt, self.creeping).state
        return feedforward(
            self.model, wanted, dt, periods=periods, limits=self.limits, state=before.state,
            band_hz=band_hz, start=creep,
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
