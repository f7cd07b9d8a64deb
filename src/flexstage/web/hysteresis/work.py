"""What is computed for the view Hysteresis, in processes: as the commands do it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.hysteresis import (
    Feedforward,
    Identification,
    ModelFile,
    Prediction,
    identify,
    model_text,
    read_model_file,
)
from flexstage.hysteresis.drive_model import DriveModel, Start, in_unit_of_model, lowest_reading
from flexstage.hysteresis.identification.identify import identified_file
from flexstage.hysteresis.inversion import (
    command_as_asked,
    command_record,
    reading_in_proportion,
)
from flexstage.hysteresis.prediction import predict_each
from flexstage.hysteresis.requests import IdentifyRequest, rowwise
from flexstage.records import Record
from flexstage.records.contents import contents, read_whole
from flexstage.records.detect import format_of
from flexstage.records.drives import read_drive
from flexstage.records.likely_columns import is_time, likely_drive, moving_columns
from flexstage.records.read import read_files
from flexstage.records.write import record_bytes
from flexstage.report.figures.identification import draw_drive_record, draw_prediction, draw_record
from flexstage.report.figures.tracking import draw_feedforward
from flexstage.web.hysteresis.requests import Reading, WantedMotion
from flexstage.web.pictures import inline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LIGHT = 4 * 2**20  # byte
#: Share of the range of a model that a motion has as amplitude, unless another one is asked for.
_USUAL_AMPLITUDE = 0.4
_MOST_SAMPLES = 1_000_000  # of a command; controllers hold less


# the record


@dataclass(frozen=True, slots=True)
class Looked:
    """What is in files, before anything is asked of them."""

    reading: Reading
    """How they are read, with columns where the files leave no doubt."""
    contents: tuple[dict[str, Any], ...]
    """What is in each, as `flexstage records --json` prints it."""
    svg: str
    """A drawing of the first one, for a page."""


def looked_at(reading: Reading, key: str) -> Looked:
    """Look into files and draw the first; `key` makes the ids of that its own in a page."""
    reading, found, record = whole(reading)
    svg = inline(lambda: _drawn(record, reading), key, f"What is in {Path(record.source).name}")
    return Looked(reading, found, svg)


def whole(reading: Reading) -> tuple[Reading, tuple[dict[str, Any], ...], Record]:
    """Read all of files; return how, what is in them, and the first one."""
    columns = reading.columns
    pairs = (columns.input, reading.input_unit), (columns.output, reading.output_unit)
    # several columns have their units when they are read
    units = {str(c[0]): unit for c, unit in pairs if unit and len(c) == 1}
    each = reading.how.of_each(len(reading.files))
    read = [
        read_whole(file, how, units=units) for file, how in zip(reading.files, each, strict=True)
    ]
    found = tuple(contents(*one) for one in read)
    return _with_columns(reading, found[0]), found, read[0][0]


def _with_columns(reading: Reading, found: dict[str, Any]) -> Reading:
    """Return how a file is read, with the columns that are likely where none are chosen.

    Where units and names leave a choice, the first columns that move are taken, to be seen.
    """
    times = [c for c in found["columns"] if is_time(c)]
    columns, how = reading.columns, reading.how
    if found["over"] == "point" and times and how.time is None and not how.sample_rate:
        how = replace(how, time=times[0]["number"])
        reading = replace(reading, how=how)
    if columns.input or columns.output or columns.is_table:
        return reading
    moving = moving_columns(found)
    driven, follows = (some[:1] for some in likely_drive(moving))
    rest = [c for c in moving if c not in (*driven, *follows)]
    driven, rest = driven or rest[:1], rest if driven else rest[1:]
    columns = replace(
        columns,
        input=tuple(c["number"] for c in driven),
        output=tuple(c["number"] for c in follows or rest[:1]),
    )
    return replace(reading, columns=columns)


def _drawn(record: Record, reading: Reading) -> "Figure":
    pair = [*reading.columns.input, *reading.columns.output]
    if len(pair) != 2 or not set(pair) <= set(range(len(record.channels))):
        return draw_record(record)
    return draw_drive_record(record, *map(str, pair))


def is_light(reading: Reading) -> bool:
    """Say whether files are short texts, which are read at once and can do no harm."""
    paths = [Path(file) for file in reading.files]
    return all(p.stat().st_size < _LIGHT and format_of(p) == "text" for p in paths)


def read(reading: Reading) -> tuple[list[Record], str | int, str | int]:
    """Read what a drive was told and what followed, as `flexstage identify` does."""
    return read_drive([Path(file) for file in reading.files], reading.asked, reading.how)


# the model


@dataclass(frozen=True, slots=True)
class Identified:
    """A model, and what is shown of it."""

    found: Identification
    """What was found."""
    file: ModelFile
    """What its file holds."""
    text: str
    """Its file."""
    sample_rate_hz: float
    """Samples in a second of the first record [Hz]."""
    notes: tuple[str, ...]
    """What was understood of the records."""
    svg: str
    """Loop, fit and residual, for a page."""


def identified(reading: Reading, request: IdentifyRequest, key: str) -> Identified:
    """Identify a drive, as `flexstage identify` does."""
    records, driven, follows = read(reading)
    if reading.columns.is_table and not reading.how.sample_rate:
        request = rowwise(request)
    found = identify(records, driven, follows, request)
    file = identified_file(found, records)
    says = f"Measured and modelled loop, and residual, of {', '.join(reading.names)}"
    return Identified(
        found=found,
        file=file,
        text=model_text(file),
        sample_rate_hz=records[0].sample_rate_hz,
        notes=found.notes,
        svg=inline(found.plot, key, says),
    )


def opened(path: Path) -> tuple[ModelFile, str]:
    """Read a model file; return it, and its text."""
    return read_model_file(path), path.read_text(encoding="utf-8")


# the command


@dataclass(frozen=True, slots=True)
class Compensated:
    """A command, and what is shown of it."""

    motion: WantedMotion
    """What it is for."""
    made: Feedforward
    """The command."""
    plain_rms: float
    """Root mean square that a command in proportion to the reference would leave, by the same
    model [unit of the output].
    """
    notes: tuple[str, ...]
    """What a user should know."""
    svg: str
    """The command, its loop and what is left, for a page."""


def compensated(file: ModelFile, motion: WantedMotion, key: str) -> Compensated:
    """Compute the command for a motion, and draw it."""
    made, notes = command(file.model, motion)
    endless = motion.shape != "file" and motion.periods == 0
    before = motion.asked.start
    start = {"conditioned": None, "rest": "rested"}[before] if isinstance(before, str) else before
    left = reading_in_proportion(file.model, made, endless=endless, start=start) - made.wanted
    band = file.errors.get("heldout_95")
    says = "The command and what it leaves"
    svg = inline(lambda: draw_feedforward(made, file.model, band), key, says)
    return Compensated(motion, made, float(np.sqrt(np.mean(left**2))), notes, svg)


def command(drive: DriveModel, motion: WantedMotion) -> tuple[Feedforward, tuple[str, ...]]:
    """Return the command for a motion, as `flexstage compensate` does, and what should be known."""
    notes: tuple[str, ...] = ()
    if motion.shape == "file":
        reference, dt, notes = _from_file(drive, motion)
        periods = None
    else:
        reference, dt, notes = _repeated(motion)
        periods = motion.periods
    made = command_as_asked(drive, reference, dt, motion.asked, periods=periods)
    return made, (*notes, *made.notes)


def usual_motion(
    motion: WantedMotion, drive: DriveModel, sample_rate_hz: float | None
) -> WantedMotion:
    """Return a motion with what was left open, as a model suggests it."""
    made = motion
    if drive.validity is not None:
        low, high = drive.validity.output_range
        if made.centre is None:
            made = replace(made, centre=0.5 * (low + high))
        if made.amplitude is None:
            made = replace(made, amplitude=_USUAL_AMPLITUDE * (high - low))
        slowest = drive.validity.rate_range_hz[0]
        if made.rate_hz is None and slowest > 0.0:
            made = replace(made, rate_hz=float(f"{slowest:.3g}"))
    if made.sample_rate_hz is None and sample_rate_hz is not None:
        made = replace(made, sample_rate_hz=float(f"{sample_rate_hz:.6g}"))
    return made


def _repeated(motion: WantedMotion) -> tuple[Array, float, tuple[str, ...]]:
    from flexstage.control.trajectory import sine, triangle

    make = sine if motion.shape == "sine" else triangle
    values = (motion.centre, motion.amplitude, motion.rate_hz, motion.sample_rate_hz)
    if None in values:
        raise ModelError(
            "a motion needs a centre, an amplitude, a frequency and a sample rate: give all four"
        )
    centre, amplitude, rate, sample_rate = (float(v or 0.0) for v in values)
    if not amplitude > 0.0:
        raise ModelError("--amplitude must be positive")
    if rate > 0.0 and not sample_rate / rate * max(motion.periods, 1) <= _MOST_SAMPLES:
        raise ModelError(
            f"{max(motion.periods, 1)} periods at {rate:g} Hz and {sample_rate:g} samples a second "
            f"are more than {_MOST_SAMPLES} samples: lower --sample-rate or --periods"
        )
    path = make("x", centre - amplitude, centre + amplitude, rate, sample_rate_hz=sample_rate)
    return path.positions["x"], 1.0 / path.sample_rate_hz, path.notes


def _from_file(drive: DriveModel, motion: WantedMotion) -> tuple[Array, float, tuple[str, ...]]:
    reading = motion.file
    if len(reading.columns.output) != 1:
        raise RecordError("a reference has one column: choose one as Column")
    (wanted,) = reading.asked.output
    (record,) = read_files([Path(reading.files[0])], [wanted], options=reading.how, even=True)
    channel = record.channel(wanted)
    values, converted = in_unit_of_model(
        channel.values, channel.unit, drive.output_unit, "reference"
    )
    zero = lowest_reading(drive) if motion.asked.relative else 0.0
    notes = (*((converted,) if converted else ()), *record.notes)
    return values + zero, 1.0 / record.sample_rate_hz, notes


def waveform(made: Feedforward, drive: DriveModel, format: str) -> bytes:
    """Return a command as a file, as `flexstage compensate --out` writes it."""
    return record_bytes(command_record(made, drive), format)


# other records


@dataclass(frozen=True, slots=True)
class Predicted:
    """A model on other records, and what is shown of it."""

    found: tuple[Prediction, ...]
    """One for each record."""
    svg: str
    """Loop and error of the first one, for a page."""


def predicted(file: ModelFile, reading: Reading, start: Start | None, key: str) -> Predicted:
    """Try a model on other records, as `flexstage predict` does."""
    records, driven, follows = read(reading)
    found = predict_each(file.model, records, driven, follows, start)
    band = file.errors.get("heldout_95")
    says = f"Measured and predicted loop, and error, of {reading.names[0]}"
    svg = inline(lambda: draw_prediction(found[0], file.model, band), key, says)
    return Predicted(tuple(found), svg)
