"""The record that identifies a drive, as the room of hysteresis designs it."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import ClassVar

from flexstage.errors import FlexstageError, ModelError, PlanError, StageError
from flexstage.experiments.axis_limits import AxisSetting, lowest_frequency
from flexstage.experiments.command import CommandWaveform
from flexstage.experiments.verbs.excite import Excite, command_of, require_stack, whole_part
from flexstage.files.request import require_fields
from flexstage.hysteresis.requests import ExciteRequest
from flexstage.stage import PiezoStack, Stage


def of_stage(
    request: ExciteRequest, stage: Stage, axis: str | None = None
) -> tuple[str, ExciteRequest]:
    """Return the axis, the first where none is named, and the request with what its stack says."""
    if not stage.axes:
        raise StageError(f"{stage.name} has no axis: give it one, or leave STAGE out")
    name = stage.axis(axis).name if axis is not None else stage.axes[0].name
    drive = stage.drive_of(name)
    if not isinstance(drive, PiezoStack):
        raise StageError(
            f"axis '{name}' of {stage.name} is driven by a {drive.kind}, and a piezo stack is "
            "needed: choose another axis, or leave STAGE out"
        )
    ends, allowed = request.voltage or drive.voltage_range, drive.voltage_range
    if ends and allowed and not allowed[0] <= ends[0] < ends[1] <= allowed[1]:
        raise ModelError(
            f"--voltage must be within {allowed[0]:g} V to {allowed[1]:g} V, which the stack of "
            f"axis '{name}' of {stage.name} allows, got {ends[0]:g} V to {ends[1]:g} V"
        )
    return name, replace(
        request,
        voltage=ends,
        capacitance=request.capacitance or drive.capacitance,
        frequency=request.frequency or lowest_frequency(stage),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Designed(Excite, ExciteRequest):
    """The drive record that identifies hysteresis, lag and creep: of `hysteresis.excitation`.

    What is not given is as the stage, its instrument and the plan have it.
    """

    kind: ClassVar[str] = "designed"
    needs_frequency: ClassVar[bool] = True

    axis: str
    """The axis, of a piezo stack."""

    def __post_init__(self) -> None:
        require_fields(self, ExciteRequest, PlanError, " of designed")

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        from flexstage.hysteresis import excitation

        s = settings[0]
        require_stack(s, "a designed record is")
        asked = {f.name: getattr(self, f.name) for f in fields(ExciteRequest)}
        low, high = self.voltage or (s.low, s.high)
        if not s.low <= low < high <= s.high:
            raise PlanError(
                f"the voltage of designed must be within {s.low:g} V to {s.high:g} V, which axis "
                f"'{s.axis}' allows, got {low:g} V to {high:g} V"
            )
        fs = whole_part(self.sample_rate, base) if self.sample_rate else fs
        frequency = self.frequency or s.natural_frequency_hz
        asked |= {
            "voltage": (low, high),
            "sample_rate": fs,
            "slew": min((r for r in (self.slew, s.largest_rate) if r), default=None),
            "capacitance": self.capacitance or s.capacitance,
            "frequency": frequency,
            "multisine": self.multisine and frequency is not None,
        }
        try:
            made = excitation(request=ExciteRequest(**asked))
        except FlexstageError as error:
            raise PlanError(str(error)) from error
        return command_of(s, made.voltage, fs, notes=made.warnings)
