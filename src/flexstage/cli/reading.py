"""What commands that read measured files share: options, and how they are understood."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import typer

from flexstage.cli.options import option
from flexstage.errors import ModelError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexstage.records import Record

_FORMATS = {".csv": "csv", ".npz": "npz", ".h5": "hdf5", ".hdf5": "hdf5", ".mat": "mat"}

_SECTION = "Reading files"


@dataclass(frozen=True, kw_only=True)
class TimeOptions:
    """How the times of samples are found.

    Parameters
    ----------
    sample_rate
        RATE: Sample rate, such as "200" or "10 kHz"; one for each file if separated by commas.
    time
        COLUMN: Number or name of the time column.
    """

    panel: ClassVar[str] = _SECTION
    sample_rate: str | None = None
    time: str | None = None


@dataclass(frozen=True, kw_only=True)
class EvenTimeOptions(TimeOptions):
    """How samples with even times are found.

    Parameters
    ----------
    resample
        RATE|median: Resample unevenly timed samples to even times: at a rate such as "10 Hz", not
        finer than the samples, or at that of the median step; one for each file if separated by
        commas.
    """

    resample: str | None = None


@dataclass(frozen=True, kw_only=True)
class FileOptions:
    """What is read of a file, and how.

    Parameters
    ----------
    rows
        START:STOP: Samples to read, numbered from 0; either end may be omitted.
    format
        NAME: text, matlab, hdf5, tdms, numpy, universal, gcs or cmm (default: by content and
        ending).
    dataset
        NAME: Group, variable, array, function or feature of a file that contains several; several
        separated by commas.
    skip_lines
        NUMBER: Lines to skip at the start of a text file.
    delimiter
        TEXT: Column separator of a text file.
    decimal
        .|,: Decimal sign of a text file.
    """

    panel: ClassVar[str] = _SECTION
    rows: str | None = None
    format: str | None = None
    dataset: str | None = None
    skip_lines: Annotated[int, typer.Option(min=0)] = 0
    delimiter: str | None = None
    decimal: str | None = None


#: None of them given.
AS_TIMED, AS_EVEN, WHOLE_FILE = TimeOptions(), EvenTimeOptions(), FileOptions()


def read_records(
    files: "Sequence[Path]",
    columns: "Sequence[str | int] | None",
    *,
    units: "Sequence[str | None]",
    over: Literal["time", "point", "frequency", "any", "table"] = "time",
    even: bool = False,
    **given: Any,
) -> "list[Record]":
    """Read the files that a command was given, one record for each.

    `units` are those of `columns` (all, where None). `over` is what the samples must follow one
    another by; with `even`, uneven times are refused. `given` are the fields of the options above.
    """
    from flexstage.records.files import read_files
    from flexstage.records.reading_options import understood

    return read_files(
        files, columns, units=units, over=over, even=even, **understood(len(files), **given)
    )


def record_format(out: Path | None) -> str:
    """Return the format that the suffix of a path says; CSV where nothing is written.

    Examples
    --------
    >>> record_format(Path("drive.h5"))
    'hdf5'
    """
    if out is None:
        return "csv"
    if out.suffix.lower() not in _FORMATS:
        raise ModelError(
            f"--out must end in one of {', '.join(_FORMATS)}, got '{out.name}': the suffix says "
            "the format"
        )
    return _FORMATS[out.suffix.lower()]


BranchesOption = Annotated[
    str | None,
    option(
        "UP,DOWN",
        "Instead of --output: columns of the rising and the falling branch, in a table with "
        "one row for each input and no times.",
    ),
]
CurveOption = Annotated[
    str | None,
    option(
        "COLUMN|files|columns",
        "First-order reversal curves, measured on the way back to saturation: the column of "
        'their numbers or reversal points; "files" if each file is one curve, "columns" if '
        "--output lists one column for each.",
    ),
]


def read_drive(
    files: "Sequence[Path]",
    input: str | None,
    output: str | None,
    *,
    branches: str | None,
    curve: str | None,
    units: tuple[str | None, str | None],
    **given: Any,
) -> "tuple[list[Record], str | int, str | int]":
    """Read what a drive was told and what followed, as `records.drives` does.

    `given` are the fields of the options on reading files.
    """
    from flexstage.records.drives import read_drive as run
    from flexstage.records.reading_options import understood

    how = understood(len(files), **given)
    return run(files, input, output, branches=branches, curve=curve, units=units, **how)
