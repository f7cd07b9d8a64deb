"""`flexstage compensate`: the drive signal by which a stage follows a reference."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexstage.base.errors import ModelError, RecordError
from flexstage.cli.options import (
    JsonOption,
    from_docstring,
    refuse,
)
from flexstage.cli.output import (
    FigureFile,
    OutputFile,
    console,
    print_json,
    print_notes,
    record_format,
    write_file,
    write_picture,
)
from flexstage.hysteresis.requests import CompensateRequest
from flexstage.records.read_options import ReadOptions, read_column, read_columns

if TYPE_CHECKING:
    from flexstage.hysteresis.coupled_drives.inverse import CoupledCommand
    from flexstage.hysteresis.inversion import CompensationCommand
    from flexstage.records import Record


@from_docstring
def compensate(
    model: Annotated[Path, typer.Argument()],
    reference: Path,
    *,
    column_: str | None = None,
    request: CompensateRequest,
    read_options: ReadOptions,
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
        FILE: Record of the desired position over time.
    column_
        --column COLUMN: Number or name of its column (default: the only column in a unit of length
        or angle, or named position, output...). Append the unit if the file does not state it, such
        as "1 um". Coupled drives: a column for each output, separated by commas (default: those
        with the names of the outputs).
    out
        Write time, command, reference and prediction (.csv, .npz, .h5 or .mat).
    figure
        Draw command, hysteresis loop and residual error (.svg, .png or .pdf).
    """
    from flexstage.hysteresis.coupled_drives.model_file import is_coupled_model
    from flexstage.hysteresis.oscillator.model_file import is_oscillator
    from flexstage.records.write import record_bytes

    kind = record_format(out)
    refuse(is_oscillator(model), "an oscillator has no inverse: predict reads its file", ModelError)
    if is_coupled_model(model):
        result, record, lines = _coupled_drives(model, reference, column_, request, read_options)
    else:
        result, record, lines = _one_drive(model, reference, column_, request, read_options)
    if out is not None:
        write_file(out, record_bytes(record, kind))
    pictures = write_picture(figure, result.plot)
    if json:
        print_json(result.to_dict() | {"file": None if out is None else str(out)})
        return
    for line in lines:
        console().print(line)
    files = ([] if out is None else [out]) + pictures
    print_notes(console(), result.notes, files, style="yellow")


def _one_drive(
    model: Path,
    reference: Path,
    column_: str | None,
    request: CompensateRequest,
    read_options: ReadOptions,
) -> "tuple[CompensationCommand, Record, list[str]]":
    """Return the command of one drive, its record, and sentences on it."""
    from flexstage.hysteresis.inversion import command_record
    from flexstage.hysteresis.inversion import compensate as run
    from flexstage.hysteresis.model_file import read_model_file
    from flexstage.records.contents import default_drive_columns
    from flexstage.records.read import read_files
    from flexstage.report.identification import command_in_words

    file = read_model_file(model)
    if column_ is None:
        _, (column,), _ = default_drive_columns(
            reference, (("none",), ()), read_options, options=("input", "column")
        )
    else:
        column = read_column(column_)
    (record,) = read_files([reference], [column], options=read_options, even=True)
    result = run(file, record, column, request, read_options)
    lines = command_in_words(result.feedforward, result.drive)
    return result, command_record(result.feedforward, result.drive), lines


def _coupled_drives(
    model: Path,
    reference: Path,
    column_: str | None,
    request: CompensateRequest,
    read_options: ReadOptions,
) -> "tuple[CoupledCommand, Record, list[str]]":
    """Return the commands of coupled drives, their record, and sentences on them."""
    from flexstage.hysteresis.coupled_drives.inverse import compensate_record
    from flexstage.hysteresis.coupled_drives.model_file import read_coupled_model
    from flexstage.records.read import read_files
    from flexstage.report.coupled_drives import coupled_command_in_words

    other = request.relative or request.after != "conditioned"
    refuse(other, "coupled drives start at rest at zero: omit --relative and --after", RecordError)
    names = read_coupled_model(model).outputs if column_ is None else read_columns(column_)
    (record,) = read_files([reference], names, options=read_options, even=True)
    result = compensate_record(model, record, names, request)
    return result, result.record(), coupled_command_in_words(result)
