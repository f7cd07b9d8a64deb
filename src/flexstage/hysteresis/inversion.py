"""The command that makes a drive follow a reference: once, or over and over."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter1d

from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.creep import Creep, Start, creep_start
from flexstage.hysteresis.chain.element import positive_step
from flexstage.hysteresis.drive_model import DriveModel, unsuited
from flexstage.hysteresis.limited_inverse import (
    HIGHEST,
    command_limits,
    limited_inverse,
    steady_displacement,
    steady_input,
    steady_reading,
    steady_start,
    within_band,
)
from flexstage.hysteresis.model import Array, checked, samples
from flexstage.hysteresis.requests import CompensateRequest
from flexstage.quantities.units import readable
from flexstage.records import Channel, Record

#: A reference is made smooth up to this share of the lowest resonance.
_BAND = 0.25
#: A reference that changes less than this by smoothing, over its range, was smooth.
_SMOOTH = 1e-6
#: A first sample farther from where the drive stands than this share of the limits is told.
_JUMP = 0.01
#: What the lags of creep begin with is known from the command, and that from them: they are found
#: in turn, until they change by less than this share of the range, at most so many times.
_ALIKE = 1e-12
_TURNS = 200
#: The mean of an endless repetition creeps for ever: it is that at this time after the start [s].
_SETTLED = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Feedforward:
    """A command, what it should give, and what had to be changed."""

    time: Array
    """Times [s], shape (n,)."""
    command: Array
    """The command [unit of the input], shape (n,)."""
    reference: Array
    """The reference that it follows, after smoothing [unit of the output], shape (n,)."""
    wanted: Array
    """The reference as it was given, shape (n,)."""
    predicted: Array
    """What the model gives for the command, shape (n,)."""
    start: Array
    """State of the hysteresis before the first sample."""
    smoothing: float
    """Largest change of the reference by smoothing [unit of the output]."""
    limited: int
    """Number of samples at which a limit changed the command."""
    limit_note: str
    """How much of the reference is lost by that; empty where nothing is."""
    notes: tuple[str, ...]
    """What was changed, and how much of the reference is lost by it."""

    @property
    def rms_error(self) -> float:
        """Root mean square of the prediction less the given reference [unit of the output]."""
        return float(np.sqrt(np.mean((self.predicted - self.wanted) ** 2)))

    @property
    def largest_error(self) -> float:
        """Largest absolute value of the prediction less the given reference."""
        return float(np.max(np.abs(self.predicted - self.wanted)))


def command_of_request(
    model: DriveModel,
    reference: ArrayLike,
    dt: float,
    asked: CompensateRequest,
    *,
    periods: int | None = None,
) -> Feedforward:
    """Return the command of `feedforward` within the limits, and from the start, of a request."""
    return feedforward(
        model,
        reference,
        dt,
        periods=periods,
        limits=asked.voltage,
        largest_rate=asked.amplifier.largest_rate,
        state=model.hysteresis.initial_state() if asked.start == "rest" else None,
        start=None if isinstance(asked.start, str) else asked.start,
        band_hz=asked.reference_bandwidth,
    )


def feedforward(
    model: DriveModel,
    reference: ArrayLike,
    dt: float,
    *,
    periods: int | None = None,
    limits: tuple[float, float] | None = None,
    largest_rate: float | None = None,
    state: ArrayLike | None = None,
    band_hz: float | None = None,
    start: Start | Array | None = None,
) -> Feedforward:
    r"""Return the command that makes a drive follow a reference.

    .. math:: u = H^{-1} \circ C^{-1} \circ S^{-1} (r(t + t_d))

    The hysteresis is undone sample by sample, and what is behind it according to the reference. Of
    a motion that is made once the delay is led, the modes are undone by the derivatives of the
    reference, and creep by its exact recursion. The reference must have two derivatives for this:
    where the model has a resonance, corners are rounded first. Of a motion that repeats, modes and
    lag are undone harmonic by harmonic, which is exact and needs no rounding.

    Parameters
    ----------
    model : DriveModel
        The drive.
    reference : array_like
        Readings that are wanted [unit of the output], shape (n,); one period of them where
        `periods` are given.
    dt : float
        Time from one sample to the next [s].
    periods : int, optional
        How often the reference is repeated; the commands of the periods differ by what creeps. 0
        for one period that repeats without end: then the memory of the hysteresis is sought that is
        the same after each, and the slow part of creep, which never repeats, is taken as it is ten
        seconds after the start. A motion that is made once where not given.
    limits : tuple of float, optional
        Lowest and highest command; the range that the model was identified on where not given.
    largest_rate : float, optional
        Largest rate of the command [unit of the input per second]; none where not given or
        infinite.
    state : array_like, optional
        State of the hysteresis before the first sample; that after conditioning cycles where not
        given. An endless repetition has its own.
    band_hz : float, optional
        Band that the reference is smoothed to [Hz]. Of a motion that is made once it is that of a
        Gaussian filter; a quarter of the lowest resonance where not given, and none where the model
        has no resonance. Of one that repeats, harmonics above it are left out; 0.4 of the sample
        rate where not given.
    start : "rested", float or numpy.ndarray, optional
        What the drive did before, for its creep, or the state of its creep, as in
        `DriveModel.simulate`. Where not given it had settled at the first reference if a state is
        given, and else did what it did before the record that the model was identified from.

    Returns
    -------
    Feedforward
        The command.

    Raises
    ------
    ModelError
        The reference is no finite sequence or wholly out of reach, or the model has no inverse.
    """
    given = samples(reference, "reference")
    positive_step(dt)
    if largest_rate == math.inf:  # of an amplifier without a limit
        largest_rate = None
    if periods is not None and periods < 0:
        raise ModelError(f"a motion is repeated once or more, or 0 for without end, got {periods}")
    if start is None:
        start = model.start if state is None else "rested"
    endless, count = periods == 0, periods or 1
    wanted = np.tile(given, count)
    memory = steady_start(model) if endless else _memory(model, state)
    low, high = command_limits(model, limits)
    one, notes = _made_smooth(model, given, dt, band_hz, repeats=periods is not None)
    smooth = np.tile(one, count)
    if endless:
        found = steady_input(model, _endless(model, one, dt, band_hz), (low, high), wanted=given)
    else:
        if periods is None:
            target = _made_once(model, smooth, dt)
        else:
            x = steady_displacement(model, one, 1.0 / dt, creep=False, band_hz=band_hz)
            target = np.tile(x, count)
        if model.creep is not None:
            target = _without_creep(model.creep, target, dt, start)
        found = limited_inverse(model, target, memory, (low, high), wanted)
    slow = _rate_limited(found.command, largest_rate, dt, closed=endless)
    limited = found.missed | (np.abs(slow - found.command) > 1e-9 * (high - low))
    if endless:
        predicted = steady_reading(model, slow, 1.0 / dt, _SETTLED)
    else:
        predicted = model.simulate(slow, dt, memory, start=start)
    limit_note = ""
    if limited.any():
        lost = float(np.max(np.abs(predicted - smooth)))
        limit_note = (
            f"limits changed {int(limited.sum())} of {wanted.size} samples of the command; the "
            f"largest error that follows is {readable(model.output_unit, lost)}"
        )
        notes.append(limit_note)
    before = float(memory[0])
    if not endless and abs(slow[0] - before) > max(
        _JUMP * (high - low), (largest_rate or 0.0) * dt
    ):
        notes.append(
            f"the command begins at {readable(model.input_unit, slow[0], digits=5)}, the drive "
            f"stands at {readable(model.input_unit, before, digits=5)} before: lead it there "
            "slowly, in one movement"
        )
    return Feedforward(
        time=(np.arange(wanted.size) * dt).astype(np.float64),
        command=slow,
        reference=smooth,
        wanted=wanted,
        predicted=predicted,
        start=memory,
        smoothing=float(np.max(np.abs(smooth - wanted))),
        limited=int(limited.sum()),
        limit_note=limit_note,
        notes=(*notes, *unsuited(model, dt, command=slow, reading=wanted)),
    )


def _memory(model: DriveModel, state: ArrayLike | None) -> Array:
    return np.array(model.conditioned() if state is None else state, dtype=np.float64)


def _made_once(model: DriveModel, reading: Array, dt: float) -> Array:
    """Undo the delay and the modes of a motion that is made once."""
    target = model.sign * (reading - model.offset)
    if model.lag is not None:
        target = model.lag.lead(target, dt)
    if model.modes is not None:
        target = model.modes.inverse(target, dt).values
    return target


def _endless(model: DriveModel, reading: Array, dt: float, band_hz: float | None) -> Array:
    """Undo all that is behind the hysteresis, of one period of many."""
    x = steady_displacement(model, reading, 1.0 / dt, band_hz=band_hz)
    if model.creep is not None:
        mean = float(np.mean(reading) - model.offset) * model.sign
        settled = float(model.creep.step_response([_SETTLED])[0])
        x += mean / settled - float(np.mean(x))
    return x


def _without_creep(creep: Creep, target: Array, dt: float, start: Start | Array) -> Array:
    """Undo creep, by what the drive did before: that is told by the command which is looked for."""
    if isinstance(start, np.ndarray):
        return creep.inverse(target, dt, start).values
    if start == "rested":
        return creep.inverse(target, dt).values
    x = target / creep.static_gain
    for _ in range(_TURNS):
        change = creep.inverse(target, dt, creep_start(creep, x, dt, start)).values - x
        # a state too high makes it too low, by less than the gain of all lags
        x = x + change / creep.static_gain
        if np.max(np.abs(change)) <= _ALIKE * max(float(np.ptp(x)), 1e-300):
            break
    return x


def _made_smooth(
    model: DriveModel, wanted: Array, dt: float, band_hz: float | None, *, repeats: bool
) -> tuple[Array, list[str]]:
    if band_hz is None and repeats:
        band_hz = HIGHEST / dt
    if band_hz is None and model.modes is not None:
        band_hz = _BAND * min(model.modes.frequency_hz)
    if band_hz is None:
        return wanted, []
    smooth = within_band(wanted, 1.0 / dt, band_hz) if repeats else smoothed(wanted, dt, band_hz)
    change = np.abs(smooth - wanted)
    if change.max() <= _SMOOTH * max(float(np.ptp(wanted)), 1e-300):
        return wanted, []
    unit = model.output_unit
    return smooth, [
        f"the reference was smoothed to a band of {band_hz:.3g} Hz: it changed by at most "
        f"{readable(unit, change.max())}, {readable(unit, np.sqrt(np.mean(change**2)))} rms"
    ]


def reading_in_proportion(
    model: DriveModel,
    made: Feedforward,
    *,
    endless: bool = False,
    start: Start | Array | None = None,
) -> Array:
    """Return what a model gives for a command in proportion to the reference, without its inverse.

    The command is on the straight line between those that `made` has where the reference is lowest
    and highest, from the same state of the drive; `endless` and `start` are as for `made`.
    """
    first, last = int(made.wanted.argmin()), int(made.wanted.argmax())
    low, high = made.wanted[first], made.wanted[last]
    slope = (made.command[last] - made.command[first]) / (high - low) if high > low else 0.0
    command = made.command[first] + slope * (made.wanted - low)
    dt = float(made.time[1] - made.time[0])
    if endless:
        return steady_reading(model, command, 1.0 / dt, _SETTLED)
    return model.simulate(command, dt, made.start, start=model.start if start is None else start)


def smoothed(values: ArrayLike, dt: float, band_hz: float) -> Array:
    """Return a sequence without what is above a band, and without delay.

    Parameters
    ----------
    values : array_like
        The sequence, shape (n,); it is taken to stand still before and after.
    dt : float
        Time from one sample to the next [s].
    band_hz : float
        Frequency at which 3 dB are lost [Hz].

    Returns
    -------
    numpy.ndarray
        The sequence after a Gaussian filter, shape (n,).

    Raises
    ------
    ModelError
        The band is not positive and finite, or lower than a tenth of a cycle in the sequence.

    Examples
    --------
    >>> corner = np.abs(np.arange(-50, 51) * 1.0)
    >>> round(float(smoothed(corner, 1e-3, 50.0)[50]), 3)
    2.089
    """
    given = samples(values, "sequence")
    checked(band_hz, "band", "positive and finite", "Hz")
    duration = given.size * dt
    if band_hz * duration < 0.1:
        raise ModelError(
            f"a band of {band_hz:g} Hz leaves nothing of a sequence of {duration:g} s: take at "
            f"least {0.1 / duration:.3g} Hz"
        )
    # exp(-(2 pi f s)^2 / 2) = 1/sqrt(2) at the band
    spread = np.sqrt(np.log(2.0)) / (2.0 * np.pi * band_hz * dt)
    return np.asarray(gaussian_filter1d(given, spread, mode="nearest", truncate=6.0))


def _rate_limited(command: Array, largest_rate: float | None, dt: float, *, closed: bool) -> Array:
    """Change the command by no more than a rate; also from its end to its beginning if closed."""
    if largest_rate is None:
        return command
    checked(largest_rate, "largest rate", "positive and finite")
    step = largest_rate * dt
    turns = 2 if closed else 1
    made = np.tile(command, turns)
    if np.max(np.abs(np.diff(made)), initial=0.0) <= step:
        return command
    for k in range(1, made.size):
        made[k] = min(max(made[k], made[k - 1] - step), made[k - 1] + step)
    return made[-command.size :]


def command_record(made: Feedforward, drive: DriveModel) -> Record:
    """Return time, command, reference and prediction as a record."""
    return Record(
        channels=(
            Channel(name="command", values=made.command, unit=drive.input_unit),
            Channel(name="reference", values=made.reference, unit=drive.output_unit),
            Channel(name="predicted", values=made.predicted, unit=drive.output_unit),
        ),
        time=made.time,
        source="flexstage compensate",
    )
