"""`flexstage compensate`: the command that makes a drive follow a reference."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import (
    JsonOption,
    from_docstring,
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
from flexstage.cli.reading import record_format
from flexstage.hysteresis.requests import CompensateRequest
from flexstage.records.read_options import ReadOptions, read_column

if TYPE_CHECKING:
    from flexstage.hysteresis.drive_model import DriveModel
    from flexstage.hysteresis.inversion import Feedforward


@from_docstring
def compensate(
    model: Annotated[Path, typer.Argument()],
    reference: Path,
    *,
    column_: str | None = None,
    request: CompensateRequest,
    how: ReadOptions,
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
        angle, or called position, output...), with its unit behind where the file does not say it,
        such as "1 um".
    out
        Write time, command, reference and prediction (.csv, .npz, .h5 or .mat).
    figure
        Draw command, loop and what is left. (.svg, .png or .pdf)
    """
    from flexstage.hysteresis.drive_model import in_unit_of_model, lowest_reading
    from flexstage.hysteresis.inversion import command_as_asked, command_record
    from flexstage.hysteresis.model_file import read_model_file
    from flexstage.records.files import read_files
    from flexstage.records.likely_columns import taken_drive
    from flexstage.records.write import record_bytes
    from flexstage.report.figures.tracking import draw_feedforward

    kind = record_format(out)
    file = read_model_file(model)
    drive = file.model
    if column_ is None:
        _, (wanted,), _ = taken_drive(reference, (("none",), ()), how, options=("input", "column"))
    else:
        wanted = read_column(column_)
    (record,) = read_files([reference], [wanted], options=how, even=True)
    channel = record.channel(wanted)
    values, converted = in_unit_of_model(
        channel.values, channel.unit, drive.output_unit, "reference"
    )
    if request.relative:
        values = values + lowest_reading(drive)
    made = command_as_asked(drive, values, 1.0 / record.sample_rate_hz, request)
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
