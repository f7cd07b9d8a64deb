"""What is asked for in the view Hysteresis: of files, of models, and of a motion."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from flexstage.files.request import RequestField, request_fields
from flexstage.hysteresis.requests import CompensateRequest
from flexstage.records.read_options import DriveColumns, ReadOptions

#: Fields of units, and what they are.
UNITS = {
    "input_unit": 'Unit of the input, such as "V" or "N", where the file does not say it.',
    "output_unit": 'Unit of the output, such as "um", where the file does not say it.',
}


def _in_unit(columns: tuple[str | int, ...], unit: str) -> tuple[str | int, ...]:
    return tuple(f"{column} {unit}" for column in columns) if unit else columns


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Files, and how they are read."""

    files: tuple[str, ...] = ()
    """The files."""
    columns: DriveColumns = DriveColumns()
    """Which columns they are about."""
    input_unit: str = ""
    """Unit of the input, where they do not say it."""
    output_unit: str = ""
    """Unit of the output, where they do not say it."""
    how: ReadOptions = ReadOptions()
    """How they are read."""

    @property
    def asked(self) -> DriveColumns:
        """The columns, with the units behind them."""
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
    def unusual(self) -> bool:
        """Whether anything is said that most files do not need."""
        plain = replace(self.how, sample_rate=(), time=None)
        return self.columns.is_table or plain != ReadOptions()

    def text(self, name: str) -> str:
        """Return the text of a field of the columns or options; empty where it is as usual."""
        if name in UNITS:
            return getattr(self, name)
        part, field = self._part(name)
        value = getattr(part, name)
        return "" if value == field.default else ",".join(field.texts(value))

    def changed(self, name: str, text: str) -> "Reading":
        """Return it with another text of a field.

        Raises
        ------
        RecordError, UnitError
            The text is no value of the field.
        """
        if name in UNITS:
            return replace(self, **{name: text.strip()})
        part, field = self._part(name)
        part = replace(part, **{name: field.read(text) if text.strip() else field.default})
        return replace(self, **{"how" if isinstance(part, ReadOptions) else "columns": part})

    def _part(self, name: str) -> tuple[DriveColumns | ReadOptions, RequestField]:
        part = self.how if name in request_fields(ReadOptions) else self.columns
        return part, request_fields(type(part))[name]


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedMotion:
    """What a drive shall follow; lengths in the unit of the model."""

    shape: Literal["sine", "triangle", "file"] = "sine"
    """What it is."""
    centre: float | None = None
    """Middle of a sine or triangle; that of the range of the model where None."""
    amplitude: float | None = None
    """Half of its range; two fifths of the range of the model where None."""
    rate_hz: float | None = None
    """Its rate [Hz]; the slowest that the model was identified at where None."""
    sample_rate_hz: float | None = None
    """Samples in a second [Hz]; those of the record where None."""
    periods: int = 4
    """How often it is repeated; 0 for one period that repeats without end."""
    file: Reading = Reading()
    """The file, for a reference out of one: its column is the output."""
    asked: CompensateRequest = CompensateRequest()
    """Within which limits, and from which state of the drive; voltages in the unit of the input."""
