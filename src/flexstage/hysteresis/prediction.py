"""Prediction of a record by an identified drive."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from flexstage.base.errors import ModelError, RecordError
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.hysteresis.chain.creep import Start
from flexstage.hysteresis.drive_model import DriveModel, range_warnings, start_data
from flexstage.hysteresis.identification.cycles import (
    Cycles,
    by_rate,
    cycles,
    first_moving,
    unknown_history_warning,
    warm_up,
)
from flexstage.hysteresis.identification.faults import denoised, input_noise_warning
from flexstage.hysteresis.identification.measurement import RecordEnds, require_usable
from flexstage.hysteresis.identification.residuals import root_mean_square
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.model_file import ModelFile, read_model_file
from flexstage.hysteresis.requests import PredictRequest
from flexstage.records import Record

#: Possible starts of a record: motion for long, motion for a time [s] since the low end of the
#: range, and rest at the first command.
_STARTS: tuple[Start, ...] = (math.inf, *np.geomspace(1000.0, 1.0, 19).tolist(), 0.0, "rested")
#: Largest ratio of the error of a start to that of the best for equal likelihood.
_EQUAL = 1.01
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
    """Predicted output, shape (n,)."""
    warm_up: int
    """Number of first samples that depend on motion before the record; they are not counted."""
    starts: tuple[Start, ...]
    """Possible starts of the record, by the samples that are not counted: first the one in use.
    Only one if it was given.
    """
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
            "start": start_data(self.start),
            "samples_not_counted": self.warm_up,
            "rates": [dict(zip(rate, row, strict=True)) for row in self.rates],
            **picked(self, "cycles", "notes"),
        }

    @property
    def start(self) -> Start:
        """The start of the record in use."""
        return self.starts[0]

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
) -> Predictions:
    """Return the predictions of records by the model of a file."""
    file = read_model_file(path)
    predictions = predict_each(
        file.model, records, input_column, output_column, request.known_start
    )
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
    start: Start | None = None,
) -> Prediction:
    """Compare an unchanged model with a record.

    The memory of the hysteresis and the creep from motion before the record are unknown. The memory
    is erased when the input has reached both ends of its range; the samples before that are not
    counted. The start of the record is estimated from them: rest at the first command, or motion
    for a time since the low end of the range.

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
    start : "rested" or float, optional
        Motion of the drive before the record; estimated where not given.

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
    dt = 1.0 / record.sample_rate_hz
    u, y = input_channel.values, output_channel.values
    first = first_moving(u)
    noise = 0.0
    complete = bool(np.isfinite(y).all())
    if complete:  # as where the model was identified
        smooth, noise = denoised(u[first:], y[first:])
        u = np.concatenate((u[:first], smooth))
    moves = cycles(u[first:], dt, noise)
    has_cycle = moves.bounds.size > 1
    history = np.zeros(0)
    if complete and (ends := RecordEnds.of(u, y)).show_period:
        history, has_cycle = u[: ends.samples], False
        start = math.inf if start is None else start
    begin = first + (warm_up(u[first:], moves) if has_cycle else 0)
    # a median, as the model does not include the first samples after a jump
    enough = int(np.isfinite(y[first:begin]).sum()) >= _FEWEST_SAMPLES
    warm_up_samples = slice(first, begin) if enough else slice(0)
    starts, predicted = _possible_starts(model, u, y, dt, warm_up_samples, start, history)
    if not np.isfinite(y[begin:]).any():
        begin = 0  # a table has no measured samples before its branches
    stroke = float(np.nanmax(y[begin:]) - np.nanmin(y[begin:]))
    if stroke == 0.0:
        raise RecordError(
            f"column '{output_channel.name}' of {record.source or 'the record'} is constant after "
            f"the first {begin} samples, which are not counted: give a longer record"
        )
    early = unknown_history_warning(
        [(u[first:], moves, dt, begin - first, first * dt)] if has_cycle else []
    )
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
        stroke=stroke,
        as_predicted_rms_percent=root_mean_square(counted),
        free_constant_rms_percent=float(np.std(counted)),
        constant_percent=float(np.mean(counted)),
        largest_percent=float(np.max(np.abs(counted))),
        cycles=_cycles(error, moves, first, begin, dt),
        notes=(
            *range_warnings(model, dt, command=u, reading=y[np.isfinite(y)]),
            *([] if has_cycle else [_ONE_PERIOD if history.size else _NO_CYCLE]),
            *([early] if early else []),
            *((input_noise_warning(noise / float(np.ptp(u))),) if noise > 0.0 else ()),
        ),
    )


def predict_each(
    model: DriveModel,
    records: Sequence[Record],
    input_column: str | int,
    output_column: str | int,
    start: Start | None = None,
) -> list[Prediction]:
    """Return the prediction of each record by a model, after checking their units.

    The start of each record is estimated if `start` is None.
    """
    sides = (
        ("input", input_column, model.input_unit),
        ("output", output_column, model.output_unit),
    )
    for record in records:
        for side, name, unit in sides:
            record_unit = record.channel(name).unit
            if record_unit != unit:
                raise ModelError(
                    f"the {side} of {record.source or 'the record'} is in "
                    f"{record_unit or 'an unknown unit'}, that of the model in {unit or 'none'}: "
                    f'give it after the column, such as --{side} "1 {unit or "um"}"'
                )
    return [predict(model, r, input_column, output_column, start=start) for r in records]


def _possible_starts(
    model: DriveModel,
    u: Array,
    y: Array,
    dt: float,
    before: slice,
    start: Start | None,
    history: Array,
) -> tuple[tuple[Start, ...], Array]:
    """Possible starts, the likeliest first, and the readings after that one.

    They are estimated from the samples that are not counted; the history is a period before.
    """
    starts = (start,) if start is not None else _STARTS if model.creep is not None else _STARTS[:1]
    driven = np.concatenate((history, u))
    simulations: list[tuple[Start, Array]] = [
        (s, model.simulate(driven, dt, start=s)[history.size :]) for s in starts
    ]
    if before.stop == 0:
        return starts, simulations[0][1]
    errors = [float(np.nanmedian(np.abs(y - m[1])[before])) for m in simulations]
    best = int(np.argmin(errors))
    others = tuple(
        i for i in range(len(errors)) if i != best and errors[i] <= _EQUAL * errors[best]
    )
    return tuple(starts[i] for i in (best, *others)), simulations[best][1]


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
