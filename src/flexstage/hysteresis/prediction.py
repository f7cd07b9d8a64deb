"""An identified drive beside a record that it was not made from."""

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
from flexstage.hysteresis.drive_model import DriveModel, start_data, unsuited
from flexstage.hysteresis.identification.cycles import (
    Cycles,
    by_rate,
    cycles,
    first_moving,
    unknown_history_warning,
    warm_up,
)
from flexstage.hysteresis.identification.faults import denoised, input_noise_warning
from flexstage.hysteresis.identification.measurement import require_usable
from flexstage.hysteresis.identification.residuals import root_mean_square
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.model_file import ModelFile, read_model_file
from flexstage.hysteresis.requests import PredictRequest
from flexstage.records import Record

#: What a drive can have done before a record: to have moved for long, for some seconds since it
#: left the low end of its range, or to have rested at the first command.
_STARTS: tuple[Start, ...] = (math.inf, *np.geomspace(1000.0, 1.0, 19).tolist(), 0.0, "rested")
#: A start is as likely as the best where it leaves no more than this many times as much.
_ALIKE = 1.01
#: Samples of a warm-up that can tell what a drive did before.
_ENOUGH = 20
#: The errors that are given over all records.
_ERRORS = "as_predicted_rms_percent", "free_constant_rms_percent"


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleError:
    """How far a model is off over one cycle of a record."""

    time: float
    """When the cycle begins [s]."""
    rate_hz: float
    """Its rate [Hz]."""
    swing: float
    """Range of the input that it moves over, as a share of that of the record [1]."""
    as_predicted_rms_percent: float
    """Root mean square error over the stroke of the record [%]."""
    free_constant_rms_percent: float
    """The same less its mean over the cycle [%]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """A model on a record: nothing of it was fitted to the samples that are counted."""

    source: str
    """The record."""
    time: Array
    """Times from the first sample on [s], shape (n,)."""
    command: Array
    """What drives, without noise that the output does not follow, shape (n,)."""
    measured: Array
    """What was measured, shape (n,)."""
    predicted: Array
    """What the model says, shape (n,)."""
    warm_up: int
    """Number of first samples that still know what was before the record; they are not counted."""
    starts: tuple[Start, ...]
    """What the drive may have done before the record, by the samples that are not counted: first
    what it is taken to have done. One alone where it was given.
    """
    stroke: float
    """Range of what was measured after the warm-up, in its unit."""
    as_predicted_rms_percent: float
    """Root mean square of measured less predicted, over the stroke [%]."""
    free_constant_rms_percent: float
    """The same less its mean: what would be left with another constant [%]."""
    constant_percent: float
    """That mean [%]."""
    largest_percent: float
    """Largest absolute error as predicted [%]."""
    cycles: tuple[CycleError, ...]
    """The whole cycles after the warm-up."""
    notes: tuple[str, ...]
    """What a reader should know of the record and the model."""

    def data(self) -> dict[str, Any]:
        """Return it as plain data."""
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
        """What the drive is taken to have done before the record."""
        return self.starts[0]

    @property
    def rates(self) -> tuple[tuple[float, int, float, float], ...]:
        """Rate [Hz], number of cycles, and both errors [%] over all cycles of that rate."""
        made = []
        groups = by_rate(
            np.array([c.rate_hz for c in self.cycles]), np.array([c.swing for c in self.cycles])
        )
        for rate, own in sorted(groups, key=lambda group: group[0]):
            every = [self.cycles[i] for i in own]
            squares = [
                (c.as_predicted_rms_percent**2, c.free_constant_rms_percent**2) for c in every
            ]
            both = np.sqrt(np.mean(squares, axis=0))
            made.append((rate, len(every), float(both[0]), float(both[1])))
        return tuple(made)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Predictions(Result):
    """A model of a file on several records."""

    table_key: ClassVar[str] = "records"

    file: ModelFile
    """The model, with what was found where it was identified."""
    path: str
    """Name of its file."""
    found: tuple[Prediction, ...]
    """The model on each record."""
    notes: tuple[str, ...]
    """What was understood of the records."""

    def data(self) -> dict[str, Any]:
        return {
            **picked(self, "model=file.model.hysteresis.kind", "file=path"),
            **picked(self, "output_unit=file.model.output_unit"),
            **picked(self, "errors_percent_of_stroke=file.errors"),
            **{name: self._total(name) for name in _ERRORS},
            "records": [one.data() for one in self.found],
            **picked(self, "warnings=file.warnings", "notes"),
        }

    @property
    def first(self) -> Prediction:
        """The model on the first record."""
        return self.found[0]

    @property
    def band(self) -> float | None:
        """Half the width of the band of 95 % of the held-out errors, over the stroke [%]."""
        return self.file.errors.get("heldout_95")

    def _total(self, name: str) -> float:
        """An error over all records, each sample with the same weight."""
        sizes = np.array([p.time.size - p.warm_up for p in self.found], dtype=np.float64)
        squares = np.array([getattr(p, name) ** 2 for p in self.found])
        return float(np.sqrt(np.sum(sizes * squares) / np.sum(sizes)))


def predict_by_file(
    path: Path,
    records: Sequence[Record],
    input_column: str | int,
    output_column: str | int,
    request: PredictRequest,
) -> Predictions:
    """Return how the model of a file predicts records."""
    file = read_model_file(path)
    found = predict_each(file.model, records, input_column, output_column, request.known_start)
    return Predictions(
        request=request,
        file=file,
        path=str(path),
        found=tuple(found),
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
    """Compare a model as it stands with a record.

    The memory of the hysteresis and the creep of what was before the record are not known. The
    memory is wiped out where the input has reached both ends of its range, and the samples before
    that are not counted. From them it is estimated what the drive did before, as the start state of
    any prediction is: it rested at the first command, or had moved for so long since it left the
    low end of its range.

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
        What the drive did before the record; found as said above where not given.

    Returns
    -------
    Prediction
        The error as predicted, and with a free constant.

    Raises
    ------
    RecordError
        The record cannot serve.
    """
    given, read = record.channel(input_column), record.channel(output_column)
    require_usable(record, given, read)
    dt = 1.0 / record.sample_rate_hz
    u, y = given.values, read.values
    first = first_moving(u)
    noise = 0.0
    if np.isfinite(y).all():  # as where the model was identified
        smooth, noise = denoised(u[first:], y[first:])
        u = np.concatenate((u[:first], smooth))
    moves = cycles(u[first:], dt, noise)
    whole = moves.bounds.size > 1
    begin = first + (warm_up(u[first:], moves) if whole else 0)
    # a median, as the first samples after a jump are none of the model
    enough = int(np.isfinite(y[first:begin]).sum()) >= _ENOUGH
    before = slice(first, begin) if enough else slice(0)
    starts, predicted = _started(model, u, y, dt, before, start)
    if not np.isfinite(y[begin:]).any():
        begin = 0  # of a table, what comes before was not measured
    stroke = float(np.nanmax(y[begin:]) - np.nanmin(y[begin:]))
    if stroke == 0.0:
        raise RecordError(
            f"column '{read.name}' of {record.source or 'the record'} stands still after the first "
            f"{begin} samples, which are not counted: give a record that moves on"
        )
    early = unknown_history_warning(
        [(u[first:], moves, dt, begin - first, first * dt)] if whole else []
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
            *_notes(model, u, y[np.isfinite(y)], dt, moves),
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
    """Return how a model predicts each of some records, after checking their units.

    What the drive did before is found where `start` is None.
    """
    sides = (
        ("input", input_column, model.input_unit),
        ("output", output_column, model.output_unit),
    )
    for record in records:
        for side, name, unit in sides:
            own = record.channel(name).unit
            if own != unit:
                raise ModelError(
                    f"the {side} of {record.source or 'the record'} is in "
                    f"{own or 'no unit that is said'}, that of the model in {unit or 'none'}: say "
                    f'it behind the column, such as --{side} "1 {unit or "um"}"'
                )
    return [predict(model, r, input_column, output_column, start=start) for r in records]


def _started(
    model: DriveModel, u: Array, y: Array, dt: float, before: slice, start: Start | None
) -> tuple[tuple[Start, ...], Array]:
    """What the drive did before, the likeliest first, and the readings after that.

    It is told by the samples that are not counted.
    """
    starts = (start,) if start is not None else _STARTS if model.creep is not None else _STARTS[:1]
    made: list[tuple[Start, Array]] = [(s, model.simulate(u, dt, start=s)) for s in starts]
    if before.stop == 0:
        return starts, made[0][1]
    off = [float(np.nanmedian(np.abs(y - m[1])[before])) for m in made]
    best = int(np.argmin(off))
    alike = tuple(i for i in range(len(off)) if i != best and off[i] <= _ALIKE * off[best])
    return tuple(starts[i] for i in (best, *alike)), made[best][1]


def _cycles(
    error: Array, moves: Cycles, first: int, begin: int, dt: float
) -> tuple[CycleError, ...]:
    made = []
    for i in range(moves.swing.size):
        start, stop = first + int(moves.bounds[i]), first + int(moves.bounds[i + 1])
        if start < begin or stop - start < 2:
            continue
        own = error[start:stop]
        own = own[np.isfinite(own)]
        if own.size < 2:
            continue
        made.append(
            CycleError(
                time=start * dt,
                rate_hz=float(moves.frequency_hz[i]),
                swing=float(moves.swing[i]),
                as_predicted_rms_percent=root_mean_square(own),
                free_constant_rms_percent=float(np.std(own)),
            )
        )
    return tuple(made)


def _notes(model: DriveModel, u: Array, y: Array, dt: float, moves: Cycles) -> tuple[str, ...]:
    said = list(unsuited(model, dt, command=u, reading=y))
    if moves.bounds.size < 2:
        said.append(
            "the record makes no whole cycle: the memory of what was before it is taken to be that "
            "of cycles over the whole range, and every sample is counted"
        )
    return tuple(said)
