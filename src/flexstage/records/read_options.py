"""Options for reading measured files, and the selection of their columns."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

from flexstage.base.errors import FlexstageError, RecordError
from flexstage.files.ranges import POSITIVE, CountOrZero, Written
from flexstage.files.request import Request
from flexstage.quantities.units import parse

#: First sample of a part of a file, and the sample after its last.
RowRange = tuple[int | None, int | None]
_MEDIAN = "median"


def read_column(text: str) -> str | int:
    """Return the number or the name of a column.

    Examples
    --------
    >>> read_column("4"), read_column("position")
    (4, 'position')
    """
    plain = text.strip()
    return int(plain) if plain.isdecimal() else plain


def read_columns(text: str) -> tuple[str | int, ...]:
    """Return numbers or names of columns, separated by commas; a name with commas needs quotes.

    Examples
    --------
    >>> read_columns("4, position"), read_columns('"x, raw",2')
    ((4, 'position'), ('x, raw', 2))
    """
    try:
        (words,) = csv.reader([text], skipinitialspace=True)
    except (csv.Error, ValueError):
        raise RecordError(f"must be columns separated by commas, got {text[:60]!r}") from None
    return tuple(read_column(word) for word in words if word.strip())


def read_rows(text: str) -> RowRange:
    """Return a range of samples: the first, and the one after the last.

    Examples
    --------
    >>> read_rows("400:")
    (400, None)
    """
    words = [word.strip() for word in text.split(":")]
    if len(words) != 2 or not all(word == "" or word.isdecimal() for word in words):
        raise RecordError(f"must be a range of samples such as 400:7200, got '{text}'")
    start, stop = (int(word) if word else None for word in words)
    if start is not None and stop is not None and start >= stop:
        raise RecordError(f"must rise, got '{text}'")
    return start, stop


def write_rows(rows: RowRange) -> str:
    """Return the text of a range of samples."""
    return ":".join("" if end is None else str(end) for end in rows)


def _read_rates(text: str) -> tuple[float, ...]:
    return tuple(parse(word, "frequency", bare_unit="Hz") for word in text.split(","))


def _read_new_rates(text: str) -> tuple[float | None, ...]:
    return tuple(
        None if word.strip() == _MEDIAN else parse(word, "frequency", bare_unit="Hz")
        for word in text.split(",")
    )


def _write_rates(rates: Sequence[float | None]) -> str:
    return ",".join(_MEDIAN if rate is None else repr(rate).removesuffix(".0") for rate in rates)


def columns_text(columns: Sequence[str | int]) -> str:
    """Return the text of several columns."""
    texts = (str(column) for column in columns)
    quoted = (
        '"' + t.replace('"', '""') + '"' if "," in t or t.startswith('"') else t for t in texts
    )
    return ",".join(quoted)


#: Delimiters of columns by name; a shell passes a backslash and a letter.
_DELIMITERS = {"tab": "\t", "comma": ",", "semicolon": ";", "space": " ", "\\t": "\t"}


def _read_delimiter(text: str) -> str:
    return _DELIMITERS.get(text, text)


def _write_delimiter(sign: str) -> str:
    return {"\t": "tab", " ": "space"}.get(sign, sign)


#: Help on the unit of a selected column.
_UNIT_HELP = 'If the file does not state a unit, give it after the column: "2 um".'
#: Number or name of a column.
Column = Annotated[str | int, Written("COLUMN", read=read_column)]
#: Numbers or names of columns.
ColumnList = Annotated[
    tuple[str | int, ...],
    Written("COLUMNS", read=read_columns, write=columns_text, help=_UNIT_HELP),
]
#: Column option that accepts several columns only for curves in separate columns.
ONE_COLUMN = Written("COLUMN", read=read_columns, write=columns_text, help=_UNIT_HELP)
#: A range of samples.
Rows = Annotated[RowRange, Written("START:STOP", read=read_rows, write=write_rows)]
_Rate = Annotated[float, POSITIVE]
_Rates = Annotated[tuple[_Rate, ...], Written("RATE", read=_read_rates, write=_write_rates)]
_NewRates = Annotated[
    tuple[_Rate | None, ...],
    Written("RATE|median", read=_read_new_rates, write=_write_rates),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class TextLayout(Request):
    """Layout of the columns of a text file."""

    one_value: ClassVar[bool] = True
    refused_as: ClassVar[type[FlexstageError]] = RecordError

    skip: CountOrZero = 0
    """Lines to skip at the start."""
    delimiter: (
        Annotated[str, Written("SIGN", read=_read_delimiter, write=_write_delimiter)] | None
    ) = None
    """Delimiter of columns: a character such as ; or tab, comma, semicolon or space."""
    decimal: Literal[".", ","] | None = None
    """Decimal sign."""

    def __post_init__(self) -> None:
        super(TextLayout, self).__post_init__()
        if self.delimiter is not None:
            object.__setattr__(self, "delimiter", _read_delimiter(self.delimiter))


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions(Request):
    """Options for reading measured files, where a file does not state them itself."""

    heading: ClassVar[str] = "Reading files"
    refused_as: ClassVar[type[FlexstageError]] = RecordError

    sample_rate: _Rates = ()
    """Sample rate, such as "200" or "10 kHz"; one for each file if separated by commas."""
    time: Column | None = None
    """Number or name of the time column."""
    resample: _NewRates = ()
    """Resample non-uniform samples to uniform times: at a rate such as "10 Hz", at most that of the
    samples, or at that of the median step; one for each file if separated by commas.
    """
    rows: Rows | None = None
    """Samples to read, numbered from 0; either end may be omitted."""
    format: Annotated[str, Written("NAME")] | None = None
    """Format: text, matlab, hdf5, tdms, numpy, universal, gcs or cmm (default: by content and
    ending).
    """
    dataset: Annotated[str, Written("NAME")] | None = None
    """Group, variable, array, function or feature of a file that contains several; several
    separated by commas.
    """
    text: TextLayout = TextLayout()
    """Layout of a text file that is not recognised, such as "skip=3,delimiter=;,decimal=,"."""

    def __post_init__(self) -> None:
        for name in ("sample_rate", "resample"):
            if isinstance(rate := getattr(self, name), (int, float)):  # of one file
                object.__setattr__(self, name, (float(rate),))
        super(ReadOptions, self).__post_init__()

    @property
    def rate(self) -> float | None:
        """Sample rate of one file [Hz]; None if none is given."""
        return self.sample_rate[0] if self.sample_rate else None

    def of_each(self, files: int) -> "tuple[ReadOptions, ...]":
        """Return the options of each file, with its own rates."""
        for name in ("sample_rate", "resample"):
            if len(rates := getattr(self, name)) not in (0, 1, files):
                raise RecordError(
                    f"--{name.replace('_', '-')} needs one rate, or one for each of {files} files, "
                    f"got {len(rates)}"
                )
        return tuple(
            replace(
                self,
                sample_rate=self.sample_rate[k : k + 1] or self.sample_rate[:1],
                resample=self.resample[k : k + 1] or self.resample[:1],
            )
            for k in range(files)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveColumns(Request):
    """Columns of the command of a drive and of its response."""

    refused_as: ClassVar[type[FlexstageError]] = RecordError

    input: Annotated[ColumnList, ONE_COLUMN] = ()
    """Number or name of the input column (default: the column in V, by its unit or name)."""
    output: Annotated[ColumnList, ONE_COLUMN] = ()
    """Number or name of the output column (default: the column in a unit of length or angle, by its
    unit or name).
    """
    branches: Annotated[
        tuple[str | int, ...], Written("UP,DOWN", read=read_columns, write=columns_text)
    ] = ()
    """Instead of --output: columns of the rising and the falling branch, in a table without times
    and with one row for each input.
    """
    curve: Annotated[str, Written("COLUMN|files|columns")] | None = None
    """First-order reversal curves, measured on the way back to saturation: the column of their
    numbers or reversal points; "files" if each file is one curve; "columns" if --output lists one
    column for each curve.
    """

    @property
    def is_table(self) -> bool:
        """Whether the files are tables of branches or curves, without times."""
        return bool(self.branches or self.curve)
