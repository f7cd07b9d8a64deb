"""Inputs of the view Hysteresis: selected files, and the desired motion."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from flexstage.files.request import RequestField, request_fields
from flexstage.hysteresis.requests import CompensateRequest
from flexstage.records.read_options import DriveColumns, ReadOptions

#: Fields of units, with their help.
UNITS = {
    "input_unit": 'Unit of the input, such as "V" or "N", if the file has none.',
    "output_unit": 'Unit of the output, such as "um", if the file has none.',
}


def _in_unit(columns: tuple[str | int, ...], unit: str) -> tuple[str | int, ...]:
    return tuple(f"{column} {unit}" for column in columns) if unit else columns


@dataclass(frozen=True, slots=True, kw_only=True)
class FileSelection:
    """Selected files, and the options of reading them."""

    files: tuple[str, ...] = ()
    """The files."""
    columns: DriveColumns = DriveColumns()
    """Columns of input and output."""
    input_unit: str = ""
    """Unit of the input, if the files have none."""
    output_unit: str = ""
    """Unit of the output, if the files have none."""
    options: ReadOptions = ReadOptions()
    """Options of reading the files."""

    @property
    def columns_with_units(self) -> DriveColumns:
        """Columns with their units."""
        columns = self.columns
        return replace(
            columns,
            input=_in_unit(columns.input, self.input_unit),
            output=_in_unit(columns.output, self.output_unit),
            branches=_in_unit(columns.branches, self.output_unit),
        )

    @property
    def names(self) -> list[str]:
        """Names of the files."""
        return [Path(file).name for file in self.files]

    @property
    def has_special_options(self) -> bool:
        """An option is set that most files do not need."""
        plain = replace(self.options, sample_rate=(), time=None)
        return self.columns.is_table or plain != ReadOptions()

    def text(self, name: str) -> str:
        """Return the text of a field of the columns or options; empty for the default."""
        if name in UNITS:
            return getattr(self, name)
        part, field = self._part(name)
        value = getattr(part, name)
        return "" if value == field.default else ",".join(field.texts(value))

    def changed(self, name: str, text: str) -> "FileSelection":
        """Return the selection with a new text of a field.

        Raises
        ------
        RecordError, UnitError
            The text is not a valid value of the field.
        """
        if name in UNITS:
            return replace(self, **{name: text.strip()})
        part, field = self._part(name)
        part = replace(part, **{name: field.read(text) if text.strip() else field.default})
        return replace(self, **{"options" if isinstance(part, ReadOptions) else "columns": part})

    def _part(self, name: str) -> tuple[DriveColumns | ReadOptions, RequestField]:
        part = self.options if name in request_fields(ReadOptions) else self.columns
        return part, request_fields(type(part))[name]


@dataclass(frozen=True, slots=True, kw_only=True)
class DesiredMotion:
    """Motion that the drive must follow; lengths in the unit of the model."""

    shape: Literal["sine", "triangle", "file"] = "sine"
    """Shape of the motion."""
    centre: float | None = None
    """Centre of a sine or triangle; by default that of the range of the model."""
    amplitude: float | None = None
    """Amplitude; by default two fifths of the range of the model."""
    rate_hz: float | None = None
    """Frequency [Hz]; by default the lowest of the identification."""
    sample_rate_hz: float | None = None
    """Sample rate [Hz]; by default that of the record."""
    periods: int = 4
    """Number of periods; 0 for one endlessly repeated period."""
    file: FileSelection = FileSelection()
    """File of the motion; its column is the output."""
    before: FileSelection = FileSelection()
    """Record of the drive that ends just before; no file for other states."""
    request: CompensateRequest = CompensateRequest()
    """Limits and initial state of the drive; voltages in the unit of the input."""
