"""`flexstage compensate`: the command that makes a drive follow a reference."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import (
    CurrentOption,
    JsonOption,
    SlewOption,
    from_docstring,
    optional,
    quantity,
    refuse,
    voltage_range,
)
from flexstage.cli.output import (
    FigureFile,
    OutputFile,
    console,
    print_json,
    print_notes,
    write_file,
    write_picture,
)
from flexstage.cli.predict import moved_for
from flexstage.cli.reading import (
    AS_EVEN,
    WHOLE_FILE,
    EvenTimeOptions,
    FileOptions,
    record_format,
)
from flexstage.errors import ModelError
from flexstage.records.reading_options import column

if TYPE_CHECKING:
    from flexstage.hysteresis.drive_model import DriveModel
    from flexstage.hysteresis.inversion import Feedforward


@from_docstring
def compensate(
    model: Annotated[Path, typer.Argument()],
    reference: Path,
    column_: str | None = None,
    timing: EvenTimeOptions = AS_EVEN,
    reference_unit: str | None = None,
    relative: bool = False,
    voltage: str | None = None,
    slew: SlewOption = None,
    current: CurrentOption = None,
    capacitance: str | None = None,
    reference_bandwidth: str | None = None,
    start: str = "conditioned",
    how: FileOptions = WHOLE_FILE,
    out: OutputFile = None,
    figure: FigureFile = None,
    json: JsonOption = False,
) -> None:
    """Compute the drive signal that follows a reference.

    The inverse of an identified model compensates its hysteresis, lag and creep.

    Parameters
    ----------
    model
        MODEL: A model file written by `flexstage identify --out`.
    reference
        FILE: Record of the wanted readings over time.
    column_
        --column COLUMN: Number or name of its column (default: the only one in a unit of length or
        angle, or called position, output...).
    reference_unit
        UNIT: Unit of the reference, such as "um".
    relative
        --relative/--absolute: Count the reference from the lowest reading that the drive reaches,
        or from the zero of the sensor.
    voltage
        LOW:HIGH: Voltage range of the command, such as "0:120" (default: the range on which the
        model was identified).
    capacitance
        CAPACITANCE: Capacitance of the stack, such as "6.4 uF": limits the slope with --current.
    reference_bandwidth
        FREQUENCY: Bandwidth to which the reference is smoothed (default: a quarter of the resonance
        of the model).
    start
        conditioned|rest|TIME: State before the start: conditioned by cycles over the whole range
        that end at its low end, with creep as before the record of the model; rest: unused; or a
        time, such as "30 s" or inf: conditioned, and then in motion as in the reference for that
        time.
    out
        Write time, command, reference and prediction (.csv, .npz, .h5 or .mat).
    figure
        Draw command, loop and what is left. (.svg, .png or .pdf)
    """
    from flexstage.hysteresis.drive_model import in_unit_of_model, lowest_reading
    from flexstage.hysteresis.inversion import command_record, feedforward
    from flexstage.hysteresis.model_file import read_model_file
    from flexstage.records.files import read_files
    from flexstage.records.likely_columns import taken_drive
    from flexstage.records.reading_options import understood
    from flexstage.records.write import record_bytes
    from flexstage.report.figures.tracking import draw_feedforward

    kind = record_format(out)
    file = read_model_file(model)
    drive = file.model
    given = understood(1, **vars(timing), **vars(how))
    names = ("input", "column")
    wanted = column(column_ or taken_drive(reference, ("none", None), options=names, **given)[1])
    (record,) = read_files([reference], [wanted], units=[reference_unit], even=True, **given)
    channel = record.channel(wanted)
    values, converted = in_unit_of_model(
        channel.values, channel.unit, drive.output_unit, "reference"
    )
    word = start.strip().lower()
    named = word in ("conditioned", "rest")
    bounds = None if voltage is None else voltage_range(voltage)
    made = feedforward(
        drive,
        values + (lowest_reading(drive) if relative else 0.0),
        1.0 / record.sample_rate_hz,
        limits=bounds,
        largest_rate=_largest_rate(slew, current, capacitance),
        state=drive.hysteresis.initial_state() if word == "rest" else None,
        start=None if named else moved_for(start, "conditioned, rest"),
        band_hz=optional(reference_bandwidth, "frequency", bare_unit="Hz"),
    )
    if out is not None:
        write_file(out, record_bytes(command_record(made, drive), kind))
    band = file.errors.get("heldout_95")
    drawn = write_picture(figure, lambda: draw_feedforward(made, drive, band))
    notes = (
        *file.notes,
        *((converted,) if converted else ()),
        *made.notes,
        *record.notes,
    )
    result = _result(made, drive, notes, out)
    if json:
        print_json(result)
        return
    from flexstage.report.identification import command_in_words

    for line in command_in_words(made, drive):
        console().print(line)
    written = ([] if out is None else [out]) + drawn
    print_notes(console(), result["notes"], written, style="yellow")


def _largest_rate(slew: str | None, current: str | None, capacitance: str | None) -> float | None:
    """Rate that the amplifier can follow: its own, and its current over the capacitance."""
    rates = [] if slew is None else [quantity(slew, "slew rate", bare_unit="V/s")]
    if current is not None:
        if capacitance is None:
            raise ModelError("--current needs --capacitance: a current charges the stack")
        farads = quantity(capacitance, "capacitance")
        refuse(not farads > 0.0, f"--capacitance must be positive, got '{capacitance}'")
        rates.append(quantity(current, "current") / farads)
    else:
        sentence = "--capacitance needs --current: both together limit the slope"
        refuse(capacitance is not None, sentence)
    return min(rates) if rates else None


def _result(
    made: "Feedforward", drive: "DriveModel", notes: tuple[str, ...], out: Path | None
) -> dict[str, Any]:
    return {
        "model": drive.hysteresis.kind,
        "samples": int(made.time.size),
        "command_range": [float(made.command.min()), float(made.command.max())],
        "input_unit": drive.input_unit,
        "output_unit": drive.output_unit,
        "predicted_rms_error": made.rms_error,
        "predicted_max_error": made.largest_error,
        "smoothing": made.smoothing,
        "limited_samples": made.limited,
        "notes": list(notes),
        "file": None if out is None else str(out),
    }
