"""`flexstage compensate`: the drive signal by which a stage follows a reference."""

from pathlib import Path
from typing import Annotated

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
    record_format,
    write_file,
    write_picture,
)
from flexstage.hysteresis.requests import CompensateRequest
from flexstage.records.read_options import ReadOptions, read_column


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
        as "1 um".
    out
        Write time, command, reference and prediction (.csv, .npz, .h5 or .mat).
    figure
        Draw command, hysteresis loop and residual error (.svg, .png or .pdf).
    """
    from flexstage.hysteresis.inversion import command_record
    from flexstage.hysteresis.inversion import compensate as run
    from flexstage.hysteresis.model_file import read_model_file
    from flexstage.records.contents import default_drive_columns
    from flexstage.records.read import read_files
    from flexstage.records.write import record_bytes
    from flexstage.report.identification import command_in_words

    kind = record_format(out)
    file = read_model_file(model)
    if column_ is None:
        _, (column,), _ = default_drive_columns(
            reference, (("none",), ()), read_options, options=("input", "column")
        )
    else:
        column = read_column(column_)
    (record,) = read_files([reference], [column], options=read_options, even=True)
    result = run(file, record, column, request, read_options)
    if out is not None:
        write_file(out, record_bytes(command_record(result.feedforward, result.drive), kind))
    pictures = write_picture(figure, result.plot)
    if json:
        print_json(result.to_dict() | {"file": None if out is None else str(out)})
        return
    for line in command_in_words(result.feedforward, result.drive):
        console().print(line)
    files = ([] if out is None else [out]) + pictures
    print_notes(console(), result.notes, files, style="yellow")
