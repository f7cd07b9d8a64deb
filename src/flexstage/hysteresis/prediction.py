"""Prediction of a record by an identified drive."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import Polynomial

from flexstage.base.errors import ModelError, RecordError
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.hysteresis.chain.creep import Start
from flexstage.hysteresis.drive_model import DriveModel, DriveState, range_warnings, start_data
from flexstage.hysteresis.earlier_motion import part_before, state_after
from flexstage.hysteresis.identification.cycles import (
    USUAL_MEMORY,
    Cycles,
    RecordSection,
    by_rate,
    cycles,
    first_moving,
    memories,
    unknown_history_warning,
    warm_up,
)
from flexstage.hysteresis.identification.faults import denoised, input_noise_warning
from flexstage.hysteresis.identification.measurement import RecordEnds, require_usable
from flexstage.hysteresis.identification.residuals import root_mean_square
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.model_file import ModelFile, read_model_file
from flexstage.hysteresis.requests import PredictRequest, earlier_files, require_after
from flexstage.records import Record
from flexstage.records.read import read_files
from flexstage.records.read_options import ReadOptions

#: State before a record: auto, rest, a time of motion [s], a known one, or the end of records.
After = str | float | DriveState | Record | Sequence[Record]

#: Possible starts of a record: motion for long, motion for a time [s] since the low end of the
#: range, and rest at the first command.
_STARTS: tuple[Start, ...] = (math.inf, *np.geomspace(1000.0, 1.0, 19).tolist(), 0.0, "rested")
#: Largest ratio of the error of a start to that of the best for equal likelihood.
_EQUAL = 1.01
#: Difference of errors that is rounding, as a share of the range of the output.
_ROUNDING = 1e-9
#: Fewest samples of a warm-up for an estimate of the start.
_FEWEST_SAMPLES = 20
_NO_CYCLE = (
    "the record has no complete cycle: its initial memory is assumed to be that of cycles over the "
    "full range, and every sample is counted"
)
_ONE_PERIOD = "the record is one period, taken as repeated: every sample is counted"
#: Errors over all records.
_ERRORS = "as_predicted_rms_percent", "free_constant_rms_percent"


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleError:
    """Error of a model over one cycle of a record."""

    time: float
    """Time of its beginning [s]."""
    rate_hz: float
    """Its rate [Hz]."""
    swing: float
    """Range of its input, as a share of that of the record [1]."""
    as_predicted_rms_percent: float
    """Root mean square error over the stroke of the record [%]."""
    free_constant_rms_percent: float
    """The same less its mean over the cycle [%]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """Prediction of a record, without any fit to the counted samples."""

    source: str
    """The record."""
    time: Array
    """Times from the first sample on [s], shape (n,)."""
    command: Array
    """Input, without noise that the output does not follow, shape (n,)."""
    measured: Array
    """Measured output, shape (n,)."""
    predicted: Array
    """Predicted output, shape (n,). If each record has its zero, the constant, or the drift, is
    fitted to the samples that are counted.
    """
    warm_up: int
    """Number of first samples that depend on motion before the record; they are not counted."""
    starts: tuple[Start, ...]
    """Possible starts of the record, by the samples that are not counted: first the one in use.
    Only one if it was given, and none after another record or in one period.
    """
    state: DriveState
    """State of the drive at the last sample, for what follows."""
    stroke: float
    """Range of the measured output after the warm-up, in its unit."""
    as_predicted_rms_percent: float
    """Rms of measured less predicted output, over the stroke [%]."""
    free_constant_rms_percent: float
    """The same less its mean: the error with a free constant [%]."""
    constant_percent: float
    """That mean [%]."""
    largest_percent: float
    """Largest absolute error as predicted [%]."""
    cycles: tuple[CycleError, ...]
    """Complete cycles after the warm-up."""
    notes: tuple[str, ...]
    """Warnings about the record and the model."""

    def data(self) -> dict[str, Any]:
        """Return the prediction as plain data."""
        rate = "rate_hz", "cycles", "as_predicted_rms_percent", "free_constant_rms_percent"
        return {
            **picked(self, "record=source", "as_predicted_rms_percent"),
            **picked(self, "free_constant_rms_percent", "constant_percent", "largest_percent"),
            "stroke": self.stroke,
            "start": start_data(self.starts[0]) if self.starts else None,
            "samples_not_counted": self.warm_up,
            "rates": [dict(zip(rate, row, strict=True)) for row in self.rates],
            **picked(self, "cycles", "notes"),
        }

    @property
    def rates(self) -> tuple[tuple[float, int, float, float], ...]:
        """Rate [Hz], number of cycles, and both errors [%] over all cycles of that rate."""
        rows = []
        groups = by_rate(
            np.array([c.rate_hz for c in self.cycles]), np.array([c.swing for c in self.cycles])
        )
        for rate, members in sorted(groups, key=lambda group: group[0]):
            cycles_of_rate = [self.cycles[i] for i in members]
            squares = [
                (c.as_predicted_rms_percent**2, c.free_constant_rms_percent**2)
                for c in cycles_of_rate
            ]
            both = np.sqrt(np.mean(squares, axis=0))
            rows.append((rate, len(cycles_of_rate), float(both[0]), float(both[1])))
        return tuple(rows)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Predictions(Result):
    """Predictions of several records by the model of a file."""

    table_key: ClassVar[str] = "records"

    file: ModelFile
    """The model, with the errors of its identification."""
    path: str
    """Name of its file."""
    predictions: tuple[Prediction, ...]
    """Prediction of each record."""
    notes: tuple[str, ...]
    """Assumptions about the columns of the records."""

    def data(self) -> dict[str, Any]:
        return {
            **picked(self, "model=file.model.hysteresis.kind", "file=path"),
            **picked(self, "output_unit=file.model.output_unit"),
            **picked(self, "errors_percent_of_stroke=file.errors"),
            **{name: self._total(name) for name in _ERRORS},
            "records": [p.data() for p in self.predictions],
            **picked(self, "warnings=file.warnings", "notes"),
        }

    @property
    def first(self) -> Prediction:
        """Prediction of the first record."""
        return self.predictions[0]

    @property
    def band(self) -> float | None:
        """Half the width of the 95 % band of held-out errors, over the stroke [%]."""
        return self.file.errors.get("heldout_95")

    def _total(self, name: str) -> float:
        """An error over all records, each sample with the same weight."""
        sizes = np.array([p.time.size - p.warm_up for p in self.predictions], dtype=np.float64)
        squares = np.array([getattr(p, name) ** 2 for p in self.predictions])
        return float(np.sqrt(np.sum(sizes * squares) / np.sum(sizes)))


def predict_by_file(
    path: Path,
    records: Sequence[Record],
    input_column: str | int,
    output_column: str | int,
    request: PredictRequest,
    options: ReadOptions = ReadOptions(),
) -> Predictions:
    """Return the predictions of records by the model of a file.

    The options are for reading the records before, all rows of them.
    """
    file = read_model_file(path)
    both = input_column, output_column
    earlier = _earlier(request.after, both, options)
    predictions = predict_each(file.model, records, *both, earlier or request.after)
    return Predictions(
        request=request,
        file=file,
        path=str(path),
        predictions=tuple(predictions),
        notes=tuple(sorted({note for record in records for note in record.notes})),
    )


def predict(
    model: DriveModel,
    record: Record,
    input_column: str | int,
    output_column: str | int,
    *,
    after: After = "auto",
) -> Prediction:
    """Compare an unchanged model with a record.

    The memory of the hysteresis and the creep from motion before the record are unknown. The memory
    is erased when the input has reached both ends of its range; the samples before that are not
    counted. The start of the record is estimated from them: rest at the first command, or motion
    for a time since the low end of the range. After another record all samples count.

    Parameters
    ----------
    model : DriveModel
        The model.
    record : Record
        The record, in the units of the model.
    input_column : str or int
        The column that drives.
    output_column : str or int
        The column that follows.
    after : str, float, DriveState, Record or sequence of Record
        State before the record: "auto" estimates it; "rest" at the first command; motion for a time
        [s] since the low end of the range; or that at the end of records with the same columns.

    Returns
    -------
    Prediction
        The error as predicted, and with a free constant.

    Raises
    ------
    RecordError
        The record is unsuitable.
    """
    input_channel, output_channel = record.channel(input_column), record.channel(output_column)
    require_usable(record, input_channel, output_channel)
    dt, y = 1.0 / record.sample_rate_hz, output_channel.values
    notes: tuple[str, ...] = ()
    if earlier := _earlier(after, (input_column, output_column)):
        after, notes = _after_records(model, earlier, record, input_column, output_column)
    u, first, noise = _command(input_channel.values, y)
    moves = cycles(u[first:], dt, noise)
    if after == "auto" and np.isfinite(y).all():
        ends = RecordEnds.of(u, y)
        if ends.show_period:
            period = u[: ends.samples]
            after, notes = model.response(period, dt, model.before(math.inf))[1], (_ONE_PERIOD,)
    is_known, has_cycle = isinstance(after, DriveState), moves.bounds.size > 1
    begin = 0 if is_known else first + (warm_up(u[first:], moves) if has_cycle else 0)
    # a median, as the model does not include the first samples after a jump
    enough = int(np.isfinite(y[first:begin]).sum()) >= _FEWEST_SAMPLES
    warm_up_samples = slice(first, begin) if enough else slice(0)
    memory, starts, predicted, state = _possible_starts(model, u, y, dt, warm_up_samples, after)
    if not np.isfinite(y[begin:]).any():
        begin = 0  # a table has no measured samples before its branches
    if model.zero != "one":
        counted_rows = np.where(np.arange(y.size) < begin, np.nan, y - predicted)
        predicted = predicted + _baseline(counted_rows, drift=model.zero == "drift")
    stroke = float(np.nanmax(y[begin:]) - np.nanmin(y[begin:]))
    if stroke == 0.0:
        raise RecordError(
            f"column '{output_channel.name}' of {record.source or 'the record'} is constant after "
            f"the first {begin} samples, which are not counted: give a longer record"
        )
    section = RecordSection(
        u=u[first:],
        y=y[first:],
        dt=dt,
        cycles=moves,
        memory=memory,
        warm_up=begin - first,
        nuisance=np.ones((u.size - first, 1)),
        noise=noise,
        begin=first * dt,
    )
    early = "" if is_known or has_cycle else _NO_CYCLE
    if has_cycle and not is_known:
        early = unknown_history_warning([section])
    percent = 100.0 / stroke
    error = (y - predicted) * percent
    counted = error[begin:][np.isfinite(error[begin:])]
    return Prediction(
        source=record.source,
        time=(np.arange(u.size) * dt).astype(np.float64),
        command=u,
        measured=y,
        predicted=predicted,
        warm_up=begin,
        starts=starts,
        state=state,
        stroke=stroke,
        as_predicted_rms_percent=root_mean_square(counted),
        free_constant_rms_percent=float(np.std(counted)),
        constant_percent=float(np.mean(counted)),
        largest_percent=float(np.max(np.abs(counted))),
        cycles=_cycles(error, moves, first, begin, dt),
        notes=(
            *notes,
            *range_warnings(model, dt, command=u, reading=y[np.isfinite(y)]),
            *([early] if early else []),
            *((input_noise_warning(noise / float(np.ptp(u))),) if noise > 0.0 else ()),
        ),
    )


def predict_each(
    model: DriveModel,
    records: Sequence[Record],
    input_column: str | int,
    output_column: str | int,
    after: After = "auto",
) -> list[Prediction]:
    """Return the prediction of each record by a model, after checking their units.

    After earlier records, each of several records also follows those before it.
    """
    earlier = _earlier(after, (input_column, output_column))
    sides = (
        ("input", input_column, model.input_unit),
        ("output", output_column, model.output_unit),
    )
    for record in (*earlier, *records):
        for side, name, unit in sides:
            record_unit = record.channel(name).unit
            if record_unit != unit:
                raise ModelError(
                    f"the {side} of {record.source or 'the record'} is in "
                    f"{record_unit or 'an unknown unit'}, that of the model in {unit or 'none'}: "
                    f'give it after the column, such as --{side} "1 {unit or "um"}"'
                )
    return [
        predict(
            model, record, input_column, output_column,
            after=[*earlier, *records[:i]] if earlier else after,
        )
        for i, record in enumerate(records)
    ]  # fmt: skip


def _earlier(
    after: After, columns: tuple[str | int, str | int], options: ReadOptions = ReadOptions()
) -> list[Record]:
    """Return the records in a state before another one; none for other states."""
    if isinstance(after, Record):
        return [after]
    if isinstance(after, (str, float, int)):
        require_after(after, "auto", "rest")
    elif isinstance(after, Sequence):
        return list(after)
    return read_files(earlier_files(after), columns, options=replace(options, rows=None), even=True)


def _command(u: Array, y: Array) -> tuple[Array, int, float]:
    """Return the input without noise, as identified, its first motion, and its noise."""
    first = first_moving(u)
    if not np.isfinite(y).all():
        return u, first, 0.0
    smooth, noise = denoised(u[first:], y[first:])
    return np.concatenate((u[:first], smooth)), first, noise


def _after_records(
    model: DriveModel,
    earlier: Sequence[Record],
    following: Record,
    input_column: str | int,
    output_column: str | int,
) -> tuple[DriveState, tuple[str, ...]]:
    """Return the state at the end of records, and notes; all of the first shows its own start."""
    parts = []
    for record, later in zip(earlier, (*earlier[1:], following), strict=True):
        part = part_before(record, later)
        y = part.channel(output_column).values
        parts.append((part, _command(part.channel(input_column).values, y)[0], y))
    (first, u, y), *_ = parts
    dt = 1.0 / first.sample_rate_hz
    memory, (start, *_), *_ = _possible_starts(model, u, y, dt, slice(u.size), "auto")
    before = _before(model, memory, start, float(u[0]))
    return state_after(model, [part[:2] for part in parts], following, before)


def _possible_starts(
    model: DriveModel, u: Array, y: Array, dt: float, rows: slice, after: After
) -> tuple[str, tuple[Start, ...], Array, DriveState]:
    """Memory of the hysteresis, possible starts, the likeliest first, readings and last state.

    The first two are estimated from some of the rows.
    """
    if isinstance(after, DriveState):
        return USUAL_MEMORY, (), *model.response(u, dt, after)
    starts: tuple[Start, ...] = _STARTS if model.creep is not None else _STARTS[:1]
    if after != "auto":
        starts = (after if isinstance(after, (float, int)) else "rested",)
    first, memory = float(u[0]), USUAL_MEMORY
    if rows.stop == 0:
        return memory, starts, *model.response(u, dt, _before(model, memory, starts[0], first))

    def response(memory: str, start: Start) -> tuple[Array, DriveState]:
        return model.response(u, dt, _before(model, memory, start, first))

    def error(memory: str, start: Start, *, free: bool) -> float:
        left = (y - response(memory, start)[0])[rows]
        if model.zero == "drift":
            left = left - _baseline(left, drift=True)
        elif free:
            left = left - np.nanmedian(left)
        return float(np.nanmedian(np.abs(left)))

    def compared(memory: str) -> tuple[float, float]:
        # without the level, which depends on creep as well, and with it
        few: tuple[Start, ...] = (starts[0], *starts[-2:])
        scatter = min(error(memory, s, free=True) for s in dict.fromkeys(few))
        return scatter, min(error(memory, s, free=is_free) for s in starts)

    is_free = model.zero != "one"
    if model.validity is not None:
        pairs = {m: compared(m) for m in memories(model.validity.input_range, first)}
        scatter, total = pairs[memory]
        least = scatter / _EQUAL - _ROUNDING * float(np.nanmax(y) - np.nanmin(y))
        better = [m for m, pair in pairs.items() if pair[0] < least and pair[1] <= total]
        memory = min(better, key=lambda m: pairs[m], default=memory)
    errors = [error(memory, s, free=is_free) for s in starts]
    best = int(np.argmin(errors))
    others = (i for i, e in enumerate(errors) if i != best and e <= _EQUAL * errors[best])
    return memory, tuple(starts[i] for i in (best, *others)), *response(memory, starts[best])


def _baseline(values: Array, *, drift: bool) -> Array:
    """Constant, and drift on request, of the finite values."""
    at = np.flatnonzero(np.isfinite(values))
    line: Array = Polynomial.fit(at, values[at], int(drift))(np.arange(values.size))
    return line


def _before(model: DriveModel, memory: str, start: Start, first: float) -> DriveState:
    """State that motion before a record has set, whose first command is given."""
    before = model.before(start)
    if memory == USUAL_MEMORY or model.validity is None:
        return before
    inputs = memories(model.validity.input_range, first)[memory]
    return replace(before, hysteresis=model.hysteresis.simulate(inputs).state)


def _cycles(
    error: Array, moves: Cycles, first: int, begin: int, dt: float
) -> tuple[CycleError, ...]:
    cycle_errors = []
    for i in range(moves.swing.size):
        start, stop = first + int(moves.bounds[i]), first + int(moves.bounds[i + 1])
        if start < begin or stop - start < 2:
            continue
        part = error[start:stop]
        part = part[np.isfinite(part)]
        if part.size < 2:
            continue
        cycle_errors.append(
            CycleError(
                time=start * dt,
                rate_hz=float(moves.frequency_hz[i]),
                swing=float(moves.swing[i]),
                as_predicted_rms_percent=root_mean_square(part),
                free_constant_rms_percent=float(np.std(part)),
            )
        )
    return tuple(cycle_errors)
