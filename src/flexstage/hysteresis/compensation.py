"""The command by which the drive of a model file follows a reference."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.hysteresis.drive_model import DriveModel, in_unit_of_model, lowest_reading
from flexstage.hysteresis.inversion import Feedforward, command_of_request, command_record
from flexstage.hysteresis.model_file import ModelFile
from flexstage.hysteresis.requests import CompensateRequest
from flexstage.records import Record

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompensationCommand(Result):
    """A command, with the model that it is by."""

    file: ModelFile
    """The model, with what was found where it was identified."""
    made: Feedforward
    """The command."""
    notes: tuple[str, ...]
    """What a user should know."""

    @property
    def band(self) -> float | None:
        """Half the width of the band of 95 % of the held-out errors, over the stroke [%]."""
        return self.file.errors.get("heldout_95")

    @property
    def drive(self) -> DriveModel:
        """The model."""
        return self.file.model

    def data(self) -> dict[str, Any]:
        command = self.made.command
        return {
            **picked(self, "model=drive.hysteresis.kind", "samples=made.time.size"),
            "command_range": [float(command.min()), float(command.max())],
            **picked(self, "input_unit=drive.input_unit", "output_unit=drive.output_unit"),
            **picked(self.made, "predicted_rms_error=rms_error"),
            **picked(self.made, "predicted_max_error=largest_error"),
            **picked(self.made, "smoothing", "limited_samples=limited"),
            "notes": list(self.notes),
        }

    def to_frame(self) -> "pandas.DataFrame":
        return command_record(self.made, self.drive).to_frame()


def compensate(
    file: ModelFile,
    reference: Record,
    column: str | int,
    request: CompensateRequest,
) -> CompensationCommand:
    """Return the command by which a drive follows a column of a record."""
    drive, channel = file.model, reference.channel(column)
    values, converted = in_unit_of_model(
        channel.values, channel.unit, drive.output_unit, "reference"
    )
    if request.relative:
        values = values + lowest_reading(drive)
    made = command_of_request(drive, values, 1.0 / reference.sample_rate_hz, request)
    said = (*file.notes, *filter(None, [converted]), *made.notes, *reference.notes)
    return CompensationCommand(request=request, file=file, made=made, notes=said)
