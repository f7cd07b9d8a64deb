"""The record that identifies a drive, as the room of hysteresis designs it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

from flexstage.errors import FlexstageError, ModelError, PlanError, StageError
from flexstage.experiments.axis_limits import AxisSetting, lowest_frequency
from flexstage.experiments.command import CommandWaveform
from flexstage.experiments.verbs.excite import NONE_OR_SOME, SOME, Excite, command_of, require_stack
from flexstage.files.ranges import Seed
from flexstage.hysteresis.excitations.design import excitation
from flexstage.hysteresis.excitations.excitation import Excitation
from flexstage.hysteresis.requests import ExciteRequest
from flexstage.stage import PiezoStack, Stage
from flexstage.units import Frequency, Time


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


def excitation_of(stage: Stage, request: ExciteRequest, axis: str | None = None) -> Excitation:
    """Design the record that identifies an axis of a stage, the first where none is named."""
    name, asked = of_stage(request, stage, axis)
    return replace(
        excitation(request=asked),
        request=request,
        stage=stage.name,
        axis=name,
        natural_frequency_hz=None if request.frequency else asked.frequency,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Designed(Excite):
    """The drive record that identifies hysteresis, lag and creep: of `hysteresis.excitation`."""

    kind: ClassVar[str] = "designed"
    needs_frequency: ClassVar[bool] = True

    axis: str
    """The axis, of a piezo stack."""
    rates: tuple[Annotated[Frequency, SOME], ...] = (0.5, 5.0)
    """How often a major loop repeats, one rate or more [Hz]."""
    duration: Annotated[Time, SOME] | None = None
    """Longest time that it may take [s]."""
    hold: Annotated[Time, NONE_OR_SOME] | None = None
    """Time of its step and hold [s]."""
    multisine: bool = False
    """Whether it ends with a multisine about the lowest resonance."""
    seed: Seed = 0
    """Seed of the phases of that multisine."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        if not self.rates:
            raise PlanError("designed needs one rate at least, got none")

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        del base
        s = settings[0]
        require_stack(s, "a designed record is")
        try:
            made = excitation(
                (s.low, s.high),
                sample_rate=fs,
                duration=self.duration,
                rates=self.rates,
                slew=s.largest_rate,
                frequency=s.natural_frequency_hz,
                multisine=self.multisine and s.natural_frequency_hz is not None,
                hold_time=self.hold,
                seed=self.seed,
            )
        except FlexstageError as error:
            raise PlanError(str(error)) from error
        return command_of(s, made.voltage, fs, notes=made.warnings)
