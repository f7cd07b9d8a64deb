"""Command by which a drive follows a reference, once or repeatedly."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter1d

from flexstage.base.errors import ModelError, RecordError
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.hysteresis.chain.creep import Creep, Start, creep_start
from flexstage.hysteresis.chain.element import positive_step
from flexstage.hysteresis.drive_model import (
    DriveModel,
    DriveState,
    range_warnings,
    requested_readings,
)
from flexstage.hysteresis.earlier_motion import state_after
from flexstage.hysteresis.limited_inverse import (
    HIGHEST,
    command_limits,
    limited_inverse,
    reach,
    steady_displacement,
    steady_input,
    steady_reading,
    within_band,
)
from flexstage.hysteresis.model import Array, checked, samples
from flexstage.hysteresis.model_file import ModelFile
from flexstage.hysteresis.requests import CompensateRequest, earlier_files, require_after
from flexstage.quantities.units import readable
from flexstage.records import Channel, Record
from flexstage.records.read import read_files
from flexstage.records.read_options import ReadOptions

if TYPE_CHECKING:
    import pandas

#: Bandwidth of a smoothed reference over the lowest resonance.
_BAND = 0.25
#: Largest change of a smooth reference by smoothing, over its range.
_SMOOTH = 1e-6
#: Smallest jump to the first sample that is reported, as a share of the limits.
_JUMP = 0.01
#: The first state of creep depends on the command, and the command on that state: both are found
#: in turn, until they change by less than this share of the range, at most so many times.
_CONVERGED = 1e-12
_ITERATIONS = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Feedforward:
    """Command for a reference, with its prediction and changes."""

    time: Array
    """Times [s], shape (n,)."""
    command: Array
    """The command [unit of the input], shape (n,)."""
    reference: Array
    """The smoothed reference [unit of the output], shape (n,)."""
    requested: Array
    """The reference before smoothing, shape (n,)."""
    predicted: Array
    """Reading of the model for the command, shape (n,)."""
    before: DriveState
    """State of the drive before the first sample."""
    state: DriveState
    """State at the last sample, for what follows; for an endless repetition without its creep."""
    smoothing: float
    """Largest change of the reference by smoothing [unit of the output]."""
    limited: int
    """Number of samples at which a limit changed the command."""
    limit_note: str
    """Message about this change; empty for none."""
    notes: tuple[str, ...]
    """Changes of the reference and the command, with the resulting errors."""

    @property
    def rms_error(self) -> float:
        """Rms of the prediction less the requested reference [unit of the output]."""
        return float(np.sqrt(np.mean((self.predicted - self.requested) ** 2)))

    @property
    def largest_error(self) -> float:
        """Largest absolute value of the prediction less the requested reference."""
        return float(np.max(np.abs(self.predicted - self.requested)))


def command_of_request(
    model: DriveModel,
    reference: ArrayLike,
    dt: float,
    request: CompensateRequest,
    *,
    periods: int | None = None,
    after: DriveState | None = None,
) -> Feedforward:
    """Return the command of `feedforward` within the limits of a request, and after its state."""
    return feedforward(
        model,
        reference,
        dt,
        periods=periods,
        limits=request.voltage,
        largest_rate=request.amplifier.largest_rate,
        band_hz=request.reference_bandwidth,
        after=request.after if after is None else after,
    )


def feedforward(
    model: DriveModel,
    reference: ArrayLike,
    dt: float,
    *,
    periods: int | None = None,
    limits: tuple[float, float] | None = None,
    largest_rate: float | None = None,
    band_hz: float | None = None,
    after: DriveState | float | str = "conditioned",
) -> Feedforward:
    r"""Return the command that makes a drive follow a reference.

    .. math:: u = H^{-1} \circ C^{-1} \circ S^{-1} (r(t + t_d))

    The hysteresis is inverted sample by sample. For a single motion, the delay is compensated by a
    lead, the modes by derivatives of the reference, and creep by its exact recursion. The reference
    needs two derivatives for this: for a model with a resonance, corners are rounded first. For a
    repeated motion, modes and lag are inverted for each harmonic, which is exact without rounding.

    Parameters
    ----------
    model : DriveModel
        The drive.
    reference : array_like
        Requested readings [unit of the output], shape (n,); one period of them if `periods` is
        given.
    dt : float
        Time from one sample to the next [s].
    periods : int, optional
        Number of repetitions of the reference; the commands of the periods differ by creep. 0 for
        one endlessly repeated period: the memory of the hysteresis is then periodic, and slow
        creep, which is not, has its value ten seconds after the start. A single motion where not
        given.
    limits : tuple of float, optional
        Lowest and highest command; the range of the identification where not given.
    largest_rate : float, optional
        Largest rate of the command [unit of the input per second]; none where not given or
        infinite.
    band_hz : float, optional
        Bandwidth of the smoothed reference [Hz]. For a single motion it is that of a Gaussian
        filter; a quarter of the lowest resonance where not given, and none for a model without
        resonance. For a repeated one, harmonics above it are omitted; 0.4 of the sample rate where
        not given.
    after : "conditioned", "rest", float or DriveState
        State before the first sample: after conditioning cycles, with creep as before the record of
        the identification; unused; conditioned, and then in motion as in the reference for a time
        [s]; or a state, such as that at the end of another command. An endless repetition has its
        own memory.

    Returns
    -------
    Feedforward
        The command.

    Raises
    ------
    ModelError
        The reference is no finite sequence or completely out of reach, or the model has no inverse.
    """
    values = samples(reference, "reference")
    positive_step(dt)
    if largest_rate == math.inf:  # of an amplifier without a limit
        largest_rate = None
    if periods is not None and periods < 0:
        raise ModelError(
            f"the number of periods must be at least 1, or 0 for endless, got {periods}"
        )
    endless, count = periods == 0, periods or 1
    requested = np.tile(values, count)
    before = model.before() if endless else _before(model, after)
    memory = before.hysteresis
    low, high = command_limits(model, limits)
    period_reference, notes = _smooth_reference(
        model, values, dt, band_hz, repeats=periods is not None
    )
    smooth = np.tile(period_reference, count)
    if endless:
        inverse = steady_input(
            model,
            steady_displacement(model, period_reference, 1.0 / dt, band_hz=band_hz),
            (low, high),
            requested=values,
        )
    else:
        if periods is None:
            target = _single_motion_target(model, smooth, dt)
        else:
            x = steady_displacement(model, period_reference, 1.0 / dt, creep=False, band_hz=band_hz)
            target = np.tile(x, count)
        if model.creep is not None:
            target = _invert_creep(model.creep, target, dt, before.creep)
        inverse = limited_inverse(model, target, memory, (low, high), requested)
    slow = _rate_limited(inverse.command, largest_rate, dt, closed=endless)
    limited = inverse.missed | (np.abs(slow - inverse.command) > 1e-9 * (high - low))
    if endless:
        predicted = steady_reading(model, slow, 1.0 / dt)
        state = DriveState(hysteresis=inverse.state)
    else:
        predicted, state = model.response(slow, dt, before)
    limit_note = ""
    if limited.any():
        lost = float(np.max(np.abs(predicted - smooth)))
        limit_note = (
            f"limits changed {int(limited.sum())} of {requested.size} samples of the command; the "
            f"largest resulting error is {readable(model.output_unit, lost)}"
        )
        if inverse.missed.any():
            reached = readable(model.output_unit, *reach(model, (low, high), memory), digits=4)
            ends = readable(model.input_unit, low, high, digits=4)
            limit_note += f"; with a command of {ends} the drive reaches {reached}"
        notes.append(limit_note)
    rest_command = float(memory[0])
    if not endless and abs(slow[0] - rest_command) > max(
        _JUMP * (high - low), (largest_rate or 0.0) * dt
    ):
        notes.append(
            f"the command begins at {readable(model.input_unit, slow[0], digits=5)}, but the drive "
            f"rests at {readable(model.input_unit, rest_command, digits=5)}: move it to the first "
            "command slowly, in one direction"
        )
    return Feedforward(
        time=(np.arange(requested.size) * dt).astype(np.float64),
        command=slow,
        reference=smooth,
        requested=requested,
        predicted=predicted,
        before=before,
        state=state,
        smoothing=float(np.max(np.abs(smooth - requested))),
        limited=int(limited.sum()),
        limit_note=limit_note,
        notes=(*notes, *range_warnings(model, dt, command=slow, reading=requested)),
    )


def _before(model: DriveModel, after: DriveState | float | str) -> DriveState:
    """Return the state before the first sample, in a memory of cycles unless it is known."""
    if isinstance(after, DriveState):
        return after
    require_after(after, "conditioned", "rest")
    if earlier_files(after):
        raise ModelError(f"the record '{after}' was not read: give the state that it leaves")
    if after == "rest":
        return DriveState(hysteresis=model.hysteresis.initial_state())
    creep = model.start if isinstance(after, str) else after
    return DriveState(hysteresis=model.conditioned(), creep=creep)


def _single_motion_target(model: DriveModel, reading: Array, dt: float) -> Array:
    """Invert the delay and the modes of a single motion."""
    target = model.sign * (reading - model.offset)
    if model.lag is not None:
        target = model.lag.lead(target, dt)
    if model.modes is not None:
        target = model.modes.inverse(target, dt).values
    return target


def _invert_creep(creep: Creep, target: Array, dt: float, start: Start | Array) -> Array:
    """Invert creep, whose first state depends on the command."""
    if isinstance(start, np.ndarray):
        return creep.inverse(target, dt, start).values
    if start == "rested":
        return creep.inverse(target, dt).values
    x = target / creep.static_gain
    for _ in range(_ITERATIONS):
        change = creep.inverse(target, dt, creep_start(creep, x, dt, start)).values - x
        # a state that is too high makes x too low, by less than the gain of all lags
        x = x + change / creep.static_gain
        if np.max(np.abs(change)) <= _CONVERGED * max(float(np.ptp(x)), 1e-300):
            break
    return x


def _smooth_reference(
    model: DriveModel, requested: Array, dt: float, band_hz: float | None, *, repeats: bool
) -> tuple[Array, list[str]]:
    if band_hz is None and repeats:
        band_hz = HIGHEST / dt
    if band_hz is None and model.modes is not None:
        band_hz = _BAND * min(model.modes.frequency_hz)
    if band_hz is None:
        return requested, []
    smooth = (
        within_band(requested, 1.0 / dt, band_hz) if repeats else smoothed(requested, dt, band_hz)
    )
    change = np.abs(smooth - requested)
    if change.max() <= _SMOOTH * max(float(np.ptp(requested)), 1e-300):
        return requested, []
    unit = model.output_unit
    return smooth, [
        f"the reference was smoothed to a bandwidth of {band_hz:.3g} Hz: it changed by at most "
        f"{readable(unit, change.max())}, {readable(unit, np.sqrt(np.mean(change**2)))} rms"
    ]


def reading_in_proportion(
    model: DriveModel,
    result: Feedforward,
    *,
    endless: bool = False,
) -> Array:
    """Return the reading for a command that is linear in the reference, without an inverse.

    The command is on the straight line between the commands of `result` at the lowest and highest
    reference, from the same state of the drive, and endless as `result` is.
    """
    first, last = int(result.requested.argmin()), int(result.requested.argmax())
    low, high = result.requested[first], result.requested[last]
    slope = (result.command[last] - result.command[first]) / (high - low) if high > low else 0.0
    command = result.command[first] + slope * (result.requested - low)
    dt = float(result.time[1] - result.time[0])
    if endless:
        return steady_reading(model, command, 1.0 / dt)
    return model.response(command, dt, result.before)[0]


def smoothed(values: ArrayLike, dt: float, band_hz: float) -> Array:
    """Return a sequence after a low-pass filter without delay.

    Parameters
    ----------
    values : array_like
        The sequence, shape (n,); it is constant before and after.
    dt : float
        Time from one sample to the next [s].
    band_hz : float
        Frequency of an attenuation of 3 dB [Hz].

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
    sequence = samples(values, "sequence")
    checked(band_hz, "band", "positive and finite", "Hz")
    duration = sequence.size * dt
    if band_hz * duration < 0.1:
        raise ModelError(
            f"a bandwidth of {band_hz:g} Hz is too low for a sequence of {duration:g} s: use at "
            f"least {0.1 / duration:.3g} Hz"
        )
    # exp(-(2 pi f s)^2 / 2) = 1/sqrt(2) at the band
    spread = np.sqrt(np.log(2.0)) / (2.0 * np.pi * band_hz * dt)
    return np.asarray(gaussian_filter1d(sequence, spread, mode="nearest", truncate=6.0))


def _rate_limited(command: Array, largest_rate: float | None, dt: float, *, closed: bool) -> Array:
    """Limit the rate of the command; also from its end to its beginning if closed."""
    if largest_rate is None:
        return command
    checked(largest_rate, "largest rate", "positive and finite")
    step = largest_rate * dt
    turns = 2 if closed else 1
    limited = np.tile(command, turns)
    if np.max(np.abs(np.diff(limited)), initial=0.0) <= step:
        return command
    for k in range(1, limited.size):
        limited[k] = min(max(limited[k], limited[k - 1] - step), limited[k - 1] + step)
    return limited[-command.size :]


def command_record(command: Feedforward, drive: DriveModel) -> Record:
    """Return time, command, reference and prediction as a record."""
    return Record(
        channels=(
            Channel(name="command", values=command.command, unit=drive.input_unit),
            Channel(name="reference", values=command.reference, unit=drive.output_unit),
            Channel(name="predicted", values=command.predicted, unit=drive.output_unit),
        ),
        time=command.time,
        source="flexstage compensate",
    )


def after_commands(
    model: DriveModel,
    earlier: Sequence[Record],
    reference: Record,
    column: str | int | None = None,
) -> tuple[DriveState | None, tuple[str, ...]]:
    """Return the state of a drive at the end of records of commands, and notes; None for none.

    The column of the command is by default the only one in the unit of the input, or of these the
    one called command.
    """
    if not earlier:
        return None, ()
    commands = []
    for record in earlier:
        columns = record.channels if column is None else [record.channel(column)]
        columns = [c for c in columns if c.unit == model.input_unit]
        columns = [c for c in columns if c.name == "command"] or columns
        if len(columns) != 1:
            names = ", ".join(f"{c.name} [{c.unit}]" for c in record.channels)
            raise RecordError(
                f"{record.source or 'the record'} has {len(columns)} columns in "
                f"{model.input_unit or 'no unit'}, of {names}: call the column of the command "
                f"'command ({model.input_unit})'"
            )
        commands.append((record, columns[0].values))
    return state_after(model, commands, reference, _before(model, "conditioned"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompensationCommand(Result):
    """Command with its model file."""

    file: ModelFile
    """The model, with the errors of its identification."""
    feedforward: Feedforward
    """The command."""
    notes: tuple[str, ...]
    """Warnings."""

    @property
    def band(self) -> float | None:
        """Half the width of the 95 % band of held-out errors, over the stroke [%]."""
        return self.file.errors.get("heldout_95")

    @property
    def drive(self) -> DriveModel:
        """The model."""
        return self.file.model

    def data(self) -> dict[str, Any]:
        command = self.feedforward.command
        return {
            **picked(self, "model=drive.hysteresis.kind", "samples=feedforward.time.size"),
            "command_range": [float(command.min()), float(command.max())],
            **picked(self, "input_unit=drive.input_unit", "output_unit=drive.output_unit"),
            **picked(self.feedforward, "predicted_rms_error=rms_error"),
            **picked(self.feedforward, "predicted_max_error=largest_error"),
            **picked(self.feedforward, "smoothing", "limited_samples=limited"),
            "notes": list(self.notes),
        }

    def to_frame(self) -> "pandas.DataFrame":
        return command_record(self.feedforward, self.drive).to_frame()


def compensate(
    file: ModelFile,
    reference: Record,
    column: str | int,
    request: CompensateRequest,
    options: ReadOptions = ReadOptions(),
) -> CompensationCommand:
    """Return the command by which a drive follows a column of a record.

    The options are for reading the commands before, all rows of them.
    """
    drive, channel = file.model, reference.channel(column)
    values, converted = requested_readings(drive, channel, relative=request.relative)
    how = replace(options, rows=None)
    earlier = read_files(earlier_files(request.after), [], options=how, even=True)
    after, earlier_notes = after_commands(drive, earlier, reference)
    dt = 1.0 / reference.sample_rate_hz
    command = command_of_request(drive, values, dt, request, after=after)
    notes = (*file.notes, *converted, *earlier_notes, *command.notes, *reference.notes)
    return CompensationCommand(request=request, file=file, feedforward=command, notes=notes)
