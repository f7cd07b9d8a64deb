"""What commands that read measured files share: options, and how they are understood."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import typer

from flexstage.cli.options import quantity
from flexstage.errors import ModelError, RecordError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexstage.records import Record

_SUCH = {
    "time": "samples with their times or their rate",
    "point": "a report of a measuring machine, or a table of positions",
    "frequency": "a universal file of frequency responses or spectra",
}
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
        NAME: text, matlab, hdf5, tdms, numpy, universal, gcs, touchstone or cmm (default: by
        content and ending).
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


def column(text: str) -> str | int:
    """Return what names a column: its number, or its name.

    Examples
    --------
    >>> column("4"), column("position")
    (4, 'position')
    """
    plain = text.strip()
    return int(plain) if plain.isdecimal() else plain


def column_list(text: str | None) -> list[str | int]:
    """Return what names several columns, with commas between.

    Examples
    --------
    >>> column_list("4, position"), column_list(None)
    ([4, 'position'], [])
    """
    return [column(word) for word in (text or "").split(",") if word.strip()]


def read_records(
    files: "Sequence[Path]",
    columns: "Sequence[str | int] | None",
    *,
    units: "Sequence[str | None]",
    sample_rate: str | None,
    time: str | None,
    format: str | None,
    dataset: str | None,
    rows: str | None,
    skip_lines: int,
    delimiter: str | None,
    decimal: str | None,
    over: Literal["time", "point", "frequency", "any", "table"] = "time",
    resample: str | None = None,
    even: bool = False,
    labels: str | int | None = None,
    partial: "Sequence[str | int]" = (),
) -> "list[Record]":
    """Read the files that a command was given, one record for each.

    `units` are those of `columns` (all, where None), then of `partial`: further columns, which may
    be incomplete. `over` is what the samples must follow one another by: with point, rows of a text
    need no times; with table, times are not looked at. `resample` is a rate of even times, or
    median; with `even`, uneven times are refused. `labels` is the column that labels the rows, with
    numbers or texts.
    """
    from flexstage.records import evened, read_record
    from flexstage.records.sampling import (
        LARGEST_STEP,
        LARGEST_UNEVEN_STEP,
        require_uniform,
        row_range,
    )

    rates = file_rates(sample_rate, "--sample-rate", len(files))
    new_rates = file_rates(resample, "--resample", len(files))
    all_used = (*(columns or ()), *partial)
    named = {str(c): u for c, u in zip(all_used, units, strict=True) if u is not None}
    read = [
        read_record(
            file,
            format=format,
            sample_rate_hz=rate,
            time=None if time is None else column(time),
            units=named,
            dataset=dataset,
            columns=columns,
            rows=row_range(rows, "--rows"),
            skip_lines=skip_lines,
            delimiter=_spelled(delimiter),
            decimal=decimal,
            over="point" if over in ("point", "table") else "time",
            largest_step=LARGEST_STEP if resample is None else LARGEST_UNEVEN_STEP,
            labels=labels,
        )
        for file, rate in zip(files, rates, strict=True)
    ]
    for file, record in zip(files, read, strict=True):
        if over not in ("any", "table", record.over):
            raise RecordError(
                f"'{file}' is over {record.over}, and a record over {over} is needed: give "
                f"{_SUCH[over]}"
            )
    if resample is not None:
        for record in read:
            if record.over != "time":
                raise RecordError(
                    f"'{record.source}' is over {record.over}, and --resample is for samples over "
                    "time: leave it out"
                )
        read = [evened(record, rate) for record, rate in zip(read, new_rates, strict=True)]
    if even:
        for record in read:
            require_uniform(record)
    return read


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


def _spelled(delimiter: str | None) -> str | None:
    # a shell passes a backslash and a letter where a tab is meant
    return None if delimiter is None else delimiter.replace("\\t", "\t")


def file_rates(text: str | None, option: str, files: int) -> "Sequence[float | None]":
    """Return a rate for each file [Hz], of one or one for each; None where none is given.

    That of --resample may be median, which is None as well.
    """
    if text is None:
        return [None] * files
    given = [
        None
        if option == "--resample" and word.strip() == "median"
        else quantity(word, "frequency", bare_unit="Hz")
        for word in text.split(",")
    ]
    if len(given) not in (1, files):
        raise RecordError(
            f"{option} needs one rate, or one for each of {files} files, got {len(given)}"
        )
    return given * files if len(given) == 1 else given
