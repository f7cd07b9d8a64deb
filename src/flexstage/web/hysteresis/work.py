"""Computations of the view Hysteresis in worker processes, as the commands do them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.hysteresis import (
    Feedforward,
    Identification,
    LogCreep,
    ModelFile,
    Prediction,
    Sensor,
    excitation,
    identify,
    model_text,
    read_model_file,
)
from flexstage.hysteresis.drive_model import DriveModel, requested_readings
from flexstage.hysteresis.identification.identify import identified_file
from flexstage.hysteresis.inversion import (
    after_commands,
    command_of_request,
    command_record,
    reading_in_proportion,
)
from flexstage.hysteresis.prediction import After, predict_each
from flexstage.hysteresis.requests import IdentifyRequest, rowwise
from flexstage.records import Channel, Record, write_record
from flexstage.records.contents import contents, is_time, likely_drive, moving_columns, read_whole
from flexstage.records.drives import read_drive
from flexstage.records.read import format_of, read_files
from flexstage.records.write import record_bytes
from flexstage.report.figures.identification import draw_drive_record, draw_prediction, draw_record
from flexstage.report.figures.tracking import draw_feedforward
from flexstage.virtual import virtual_stack
from flexstage.web.hysteresis.requests import DesiredMotion, FileSelection
from flexstage.web.pictures import inline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MAX_LIGHT = 4 * 2**20  # largest file that is read without a worker process [byte]
#: Default amplitude of a motion, relative to the range of the model [1].
_DEFAULT_AMPLITUDE = 0.4
_MAX_SAMPLES = 1_000_000  # of a command; controllers have less memory


# the record


@dataclass(frozen=True, slots=True)
class FilePreview:
    """Preview of files."""

    selection: FileSelection
    """The files, with the columns that are unambiguous."""
    contents: tuple[dict[str, Any], ...]
    """Contents of each file, as `flexstage records --json` prints them."""
    svg: str
    """Plot of the first file, for a page."""


def preview_files(selection: FileSelection, key: str) -> FilePreview:
    """Read files and plot the first; ids in the plot begin with `key`."""
    selection, file_contents, record = read_contents(selection)
    svg = inline(lambda: _plot(record, selection), key, f"Data of {Path(record.source).name}")
    return FilePreview(selection, file_contents, svg)


def read_contents(
    selection: FileSelection,
) -> tuple[FileSelection, tuple[dict[str, Any], ...], Record]:
    """Read files; return the completed selection, their contents, and the first record."""
    columns = selection.columns
    pairs = (columns.input, selection.input_unit), (columns.output, selection.output_unit)
    # several columns get their units in the reader
    units = {str(c[0]): unit for c, unit in pairs if unit and len(c) == 1}
    options_of_files = selection.options.of_each(len(selection.files))
    records = [
        read_whole(file, options, units=units)
        for file, options in zip(selection.files, options_of_files, strict=True)
    ]
    file_contents = tuple(contents(*record) for record in records)
    return _with_columns(selection, file_contents[0]), file_contents, records[0][0]


def _with_columns(selection: FileSelection, content: dict[str, Any]) -> FileSelection:
    """Return the selection with the likely columns, unless columns are selected.

    If units and names are ambiguous, the first varying columns are selected for the preview.
    """
    times = [c for c in content["columns"] if is_time(c)]
    columns, options = selection.columns, selection.options
    if content["over"] == "point" and times and options.time is None and not options.sample_rate:
        options = replace(options, time=times[0]["number"])
        selection = replace(selection, options=options)
    if columns.input or columns.output or columns.is_table:
        return selection
    varying = moving_columns(content)
    input_columns, output_columns = (some[:1] for some in likely_drive(varying))
    others = [c for c in varying if c not in (*input_columns, *output_columns)]
    input_columns, others = input_columns or others[:1], others if input_columns else others[1:]
    columns = replace(
        columns,
        input=tuple(c["number"] for c in input_columns),
        output=tuple(c["number"] for c in output_columns or others[:1]),
    )
    return replace(selection, columns=columns)


def _plot(record: Record, selection: FileSelection) -> "Figure":
    columns = [*selection.columns.input, *selection.columns.output]
    if len(columns) != 2 or not set(columns) <= set(range(len(record.channels))):
        return draw_record(record)
    return draw_drive_record(record, *map(str, columns))


def is_light(selection: FileSelection) -> bool:
    """Return whether all files are short text files, which are fast and safe to read."""
    paths = [Path(file) for file in selection.files]
    return all(p.stat().st_size < _MAX_LIGHT and format_of(p) == "text" for p in paths)


def read(selection: FileSelection) -> tuple[list[Record], str | int, str | int]:
    """Read command and measured position of a drive, as `flexstage identify` does."""
    return read_drive(
        [Path(file) for file in selection.files], selection.columns_with_units, selection.options
    )


# the model


@dataclass(frozen=True, slots=True)
class IdentifiedModel:
    """An identified model, and its display."""

    identification: Identification
    """Result of the identification."""
    file: ModelFile
    """Contents of its file."""
    text: str
    """Text of its file."""
    sample_rate_hz: float
    """Sample rate of the first record [Hz]."""
    notes: tuple[str, ...]
    """Notes on the records."""
    svg: str
    """Loop, fit and residual, for a page."""


def identify_drive(selection: FileSelection, request: IdentifyRequest, key: str) -> IdentifiedModel:
    """Identify a drive, as `flexstage identify` does."""
    records, input_column, output_column = read(selection)
    if selection.columns.is_table and not selection.options.sample_rate:
        request = rowwise(request)
    identification = identify(records, input_column, output_column, request)
    file = identified_file(identification, records)
    alt_text = f"Measured and modelled loop, and residual, of {', '.join(selection.names)}"
    return IdentifiedModel(
        identification=identification,
        file=file,
        text=model_text(file),
        sample_rate_hz=records[0].sample_rate_hz,
        notes=identification.notes,
        svg=inline(identification.plot, key, alt_text),
    )


def open_model_file(path: Path) -> tuple[ModelFile, str]:
    """Read a model file; return the model and the text."""
    return read_model_file(path), path.read_text(encoding="utf-8")


# the command


@dataclass(frozen=True, slots=True)
class CompensationResult:
    """A command, and its display."""

    motion: DesiredMotion
    """The desired motion."""
    feedforward: Feedforward
    """The command."""
    plain_rms: float
    """Error rms of an uncorrected, linear command by the same model [unit of the
    output].
    """
    notes: tuple[str, ...]
    """Notes for the user."""
    svg: str
    """The command, its loop and the predicted error, for a page."""


def compensate_motion(file: ModelFile, motion: DesiredMotion, key: str) -> CompensationResult:
    """Compute the command for a motion, and plot it."""
    feedforward, notes = command(file.model, motion)
    is_endless = motion.shape != "file" and motion.periods == 0
    plain = reading_in_proportion(file.model, feedforward, endless=is_endless)
    error = plain - feedforward.requested
    band = file.errors.get("heldout_95")
    alt_text = "The command and its predicted error"
    svg = inline(lambda: draw_feedforward(feedforward, file.model, band), key, alt_text)
    return CompensationResult(motion, feedforward, float(np.sqrt(np.mean(error**2))), notes, svg)


def command(drive: DriveModel, motion: DesiredMotion) -> tuple[Feedforward, tuple[str, ...]]:
    """Return the command for a motion, as `flexstage compensate` does, and notes."""
    notes: tuple[str, ...] = ()
    if motion.shape == "file":
        reference, dt, notes = _from_file(drive, motion)
        periods = None
    else:
        reference, dt, notes = _repeated(motion)
        periods = motion.periods
    after = None
    if motion.before.files and periods != 0:  # an endless repetition has its own memory
        earlier, column, _ = read(motion.before)
        follows = Record(channels=(), time=np.arange(2.0) * dt)
        after, earlier_notes = after_commands(drive, earlier, follows, column)
        notes = (*notes, *earlier_notes)
    feedforward = command_of_request(
        drive, reference, dt, motion.request, periods=periods, after=after
    )
    return feedforward, (*notes, *feedforward.notes)


def default_motion(
    motion: DesiredMotion, drive: DriveModel, sample_rate_hz: float | None
) -> DesiredMotion:
    """Return a motion with defaults from a model for its open parameters."""
    completed = motion
    if drive.validity is not None:
        low, high = drive.validity.output_range
        if completed.centre is None:
            completed = replace(completed, centre=0.5 * (low + high))
        if completed.amplitude is None:
            completed = replace(completed, amplitude=_DEFAULT_AMPLITUDE * (high - low))
        lowest_rate = drive.validity.rate_range_hz[0]
        if completed.rate_hz is None and lowest_rate > 0.0:
            completed = replace(completed, rate_hz=float(f"{lowest_rate:.3g}"))
    if completed.sample_rate_hz is None and sample_rate_hz is not None:
        completed = replace(completed, sample_rate_hz=float(f"{sample_rate_hz:.6g}"))
    return completed


def _repeated(motion: DesiredMotion) -> tuple[Array, float, tuple[str, ...]]:
    from flexstage.control.trajectory import sine, triangle

    shape = sine if motion.shape == "sine" else triangle
    values = (motion.centre, motion.amplitude, motion.rate_hz, motion.sample_rate_hz)
    if None in values:
        raise ModelError("a motion needs a centre, an amplitude, a frequency and a sample rate")
    centre, amplitude, rate, sample_rate = (float(v or 0.0) for v in values)
    if not amplitude > 0.0:
        raise ModelError("--amplitude must be positive")
    if rate > 0.0 and not sample_rate / rate * max(motion.periods, 1) <= _MAX_SAMPLES:
        raise ModelError(
            f"{max(motion.periods, 1)} periods at {rate:g} Hz and {sample_rate:g} samples a second "
            f"are more than {_MAX_SAMPLES} samples: lower --sample-rate or --periods"
        )
    path = shape("x", centre - amplitude, centre + amplitude, rate, sample_rate_hz=sample_rate)
    return path.positions["x"], 1.0 / path.sample_rate_hz, path.notes


def _from_file(drive: DriveModel, motion: DesiredMotion) -> tuple[Array, float, tuple[str, ...]]:
    selection = motion.file
    if len(selection.columns.output) != 1:
        raise RecordError("a desired motion has one column: choose it as Column")
    (column,) = selection.columns_with_units.output
    (record,) = read_files(
        [Path(selection.files[0])], [column], options=selection.options, even=True
    )
    channel, relative = record.channel(column), motion.request.relative
    values, notes = requested_readings(drive, channel, relative=relative)
    return values, 1.0 / record.sample_rate_hz, (*notes, *record.notes)


def waveform(feedforward: Feedforward, drive: DriveModel, format: str) -> bytes:
    """Return a command as a file, as `flexstage compensate --out` writes it."""
    return record_bytes(command_record(feedforward, drive), format)


# other records


@dataclass(frozen=True, slots=True)
class PredictionSet:
    """Predictions of other records by a model, and their display."""

    predictions: tuple[Prediction, ...]
    """Prediction of each record."""
    svg: str
    """Loop and error of the first one, for a page."""


def predict_files(
    file: ModelFile, selection: FileSelection, after: After | FileSelection, key: str
) -> PredictionSet:
    """Predict other records by a model, as `flexstage predict` does."""
    records, input_column, output_column = read(selection)
    if isinstance(after, FileSelection):
        after = read(replace(after, columns=selection.columns))[0]
    predictions = predict_each(file.model, records, input_column, output_column, after)
    band = file.errors.get("heldout_95")
    alt_text = f"Measured and predicted loop, and error, of {selection.names[0]}"
    svg = inline(lambda: draw_prediction(predictions[0], file.model, band), key, alt_text)
    return PredictionSet(tuple(predictions), svg)


_RATE_HZ = 400.0


def example_record(folder: Path) -> Path:
    """Write the record of a simulated piezo stack with the signal of `flexstage excite`."""
    drive = excitation(
        (0.0, 120.0),
        sample_rate=_RATE_HZ,
        duration=16.0,
        rates=(0.5, 5.0),
        frequency=640.0,
        multisine=False,
    )
    return _simulated(folder / "example.csv", drive.voltage, seed=4)


def validation_example(folder: Path) -> Path:
    """Write an independent record of the same stack: 2 Hz, with decreasing amplitude."""
    t = np.arange(round(12.0 * _RATE_HZ)) / _RATE_HZ
    envelope = np.interp(t, [0.0, 3.0, 12.0], [1.0, 1.0, 0.2])
    return _simulated(
        folder / "example-2-hz.csv", 60.0 - 60.0 * envelope * np.cos(4.0 * np.pi * t), seed=5
    )


def _simulated(path: Path, volts: Sequence[float] | Array, seed: int) -> Path:
    u = np.asarray(volts, dtype=np.float64)
    dt = 1.0 / _RATE_HZ
    free = virtual_stack((0.0, 120.0), 38e-6, 0.13).simulate(u).values
    moved = LogCreep(rate_per_decade=0.015).simulate(free, dt).values
    sensor = Sensor(bandwidth_hz=150.0, noise_rms=8e-9, offset=3.1e-6, seed=seed)
    channels = (
        Channel(name="voltage", values=u, unit="V"),
        Channel(name="position", values=sensor.simulate(moved, dt).values, unit="m"),
    )
    return write_record(
        Record(channels=channels, time=np.arange(u.size, dtype=np.float64) * dt), path
    )
