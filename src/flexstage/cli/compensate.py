"""`flexstage compensate`: the command that makes a drive follow a reference."""

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
    write_file,
    write_picture,
)
from flexstage.cli.reading import record_format
from flexstage.hysteresis.requests import CompensateRequest
from flexstage.records.read_options import ReadOptions, read_column


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
    from flexstage.hysteresis.inversion import command_record
    from flexstage.hysteresis.inversion import compensate as run
    from flexstage.hysteresis.model_file import read_model_file
    from flexstage.records.likely_columns import taken_drive
    from flexstage.records.read import read_files
    from flexstage.records.write import record_bytes
    from flexstage.report.identification import command_in_words

    kind = record_format(out)
    file = read_model_file(model)
    if column_ is None:
        _, (wanted,), _ = taken_drive(reference, (("none",), ()), how, options=("input", "column"))
    else:
        wanted = read_column(column_)
    (record,) = read_files([reference], [wanted], options=how, even=True)
    found = run(file, record, wanted, request)
    if out is not None:
        write_file(out, record_bytes(command_record(found.feedforward, found.drive), kind))
    drawn = write_picture(figure, found.plot)
    if json:
        print_json(found.to_dict() | {"file": None if out is None else str(out)})
        return
    for line in command_in_words(found.feedforward, found.drive):
        console().print(line)
    written = ([] if out is None else [out]) + drawn
    print_notes(console(), found.notes, written, style="yellow")
