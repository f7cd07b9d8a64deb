"""A model of coupled drives on records that it was not identified from."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.hysteresis.coupled_drives.model import LEVEL_TIME_CONSTANT, CoupledDriveModel
from flexstage.hysteresis.coupled_drives.model_file import read_coupled_model
from flexstage.hysteresis.drive_model import in_unit_of_model
from flexstage.records.read import read_files
from flexstage.records.record import SIMULATED, Channel, Record


class PredictedModel(Protocol):
    """A model whose prediction can be drawn."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of its outputs."""
        ...

    @property
    def output_unit(self) -> str:
        """Their unit."""
        ...


#: Time constants of the level until the state before a record is forgotten.
_WARM_UP = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoupledPrediction:
    """A model on one record; less the means of coupled drives, or the offset of an oscillator."""

    source: str
    """The record."""
    time: Array
    """Times of the counted samples [s], shape (n,)."""
    measured: Array
    """Measured outputs, shape (n, p)."""
    predicted: Array
    """Predicted outputs, shape (n, p)."""
    warm_up: int
    """Number of first samples that are not counted."""
    notes: tuple[str, ...] = ()
    """Assumptions."""

    @property
    def output_rms(self) -> float:
        """Rms of the measured outputs about their means."""
        return float(np.sqrt(np.mean(np.var(self.measured, axis=0))))

    @property
    def error(self) -> float:
        """Rms error over the outputs."""
        return float(np.sqrt(np.mean((self.measured - self.predicted) ** 2)))

    @property
    def largest(self) -> float:
        """Largest absolute error."""
        return float(np.max(np.abs(self.measured - self.predicted)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoupledPredictions(Result):
    """A model of coupled drives, or of an oscillator, on several records."""

    table_key: ClassVar[str] = "records"

    model: PredictedModel
    """The model."""
    predictions: tuple[CoupledPrediction, ...]
    """The model on each record."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Assumptions on the records."""
        return tuple(note for p in self.predictions for note in p.notes)

    def data(self) -> dict[str, Any]:
        """Return the errors on each record as plain data."""
        errors = "record=source output_rms error largest_error=largest samples_not_counted=warm_up"
        return {
            "output_unit": self.model.output_unit,
            "records": [picked(p, *errors.split()) for p in self.predictions],
        }


def predict_coupled_drives(
    path: Path, records: Sequence[Record], inputs: Sequence[str | int], outputs: Sequence[str | int]
) -> CoupledPredictions:
    """Return what the model of a file predicts of records, each begun at rest.

    Samples until the slow levels have settled are not counted: three time constants, or a third of
    a shorter record.
    """
    model = read_coupled_model(path)
    for record in records:
        require_columns(model, record, "inputs", inputs)
        require_columns(model, record, "outputs", outputs)
    return CoupledPredictions(
        model=model,
        predictions=tuple(_predict(model, record, inputs, outputs) for record in records),
    )


def require_columns(
    model: CoupledDriveModel,
    record: Record,
    role: Literal["inputs", "outputs"],
    selected: Sequence[str | int],
) -> None:
    """Refuse columns of another number, or a record of another sample rate, than a model has."""
    names = getattr(model, role)
    if len(names) != len(selected):
        raise RecordError(
            f"the model has {len(names)} {role}, {', '.join(names)}; got {len(selected)} columns"
        )
    if abs(record.sample_rate_hz / model.sample_rate_hz - 1.0) > 1e-6:
        raise RecordError(
            f"{Path(record.source).name or 'the record'} has {record.sample_rate_hz:g} Hz and the "
            f"model {model.sample_rate_hz:g} Hz: resample the record"
        )


def played_record(path: Path, file: Path) -> Record:
    """Return voltages of a file and what the model of coupled drives reads, from rest."""
    model = read_coupled_model(path)
    (record,) = read_files([file], model.inputs, even=True)
    require_columns(model, record, "inputs", model.inputs)
    voltages = _in_model_units(model, record, "input", model.inputs)
    readings, _ = model.simulate(voltages)
    names = (*model.inputs, *model.outputs)
    units = [model.input_unit] * len(model.inputs) + [model.output_unit] * len(model.outputs)
    return Record(
        channels=tuple(
            Channel(name=name, values=np.ascontiguousarray(values), unit=unit)
            for name, values, unit in zip(names, (*voltages.T, *readings.T), units, strict=True)
        ),
        time=record.time,
        source=f"simulated by {path.name}",
        attributes={SIMULATED: f"model {path.name}"},
    )


def _predict(
    model: CoupledDriveModel,
    record: Record,
    inputs: Sequence[str | int],
    outputs: Sequence[str | int],
) -> CoupledPrediction:
    voltages = _in_model_units(model, record, "input", inputs)
    measured = _in_model_units(model, record, "output", outputs)
    # the mean is the operating point
    predicted, _ = model.simulate(voltages - voltages.mean(0))
    settling = round(_WARM_UP * LEVEL_TIME_CONSTANT * model.sample_rate_hz)
    counted = slice(min(settling, record.size // 3), None)
    measured, predicted = measured[counted], predicted[counted]
    return CoupledPrediction(
        source=Path(record.source).name or "record",
        time=record.time[counted],
        measured=measured - measured.mean(0),
        predicted=predicted - predicted.mean(0),
        warm_up=int(counted.start),
        notes=record.notes,
    )


def _in_model_units(
    model: CoupledDriveModel, record: Record, side: str, selected: Sequence[str | int]
) -> Array:
    """Return columns of a record in the unit of the inputs or the outputs of a model."""
    unit = model.input_unit if side == "input" else model.output_unit
    channels = [record.channel(column) for column in selected]
    return np.column_stack([in_unit_of_model(c.values, c.unit, unit, side)[0] for c in channels])
