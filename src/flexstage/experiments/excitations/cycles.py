"""Cycles of an axis: equal ones, ones of falling range, and those that identify a drive."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from flexstage.base.errors import FlexstageError, ModelError, PlanError, StageError
from flexstage.experiments.axis_limits import AxisSetting, lowest_frequency
from flexstage.experiments.command import CommandWaveform, require_size
from flexstage.experiments.verbs.excite import (
    SAMPLES_PER_CYCLE,
    SOME,
    Excite,
    command_of,
    require_span,
    require_stack,
    whole_part,
)
from flexstage.files.ranges import Count, CountOrZero, Range
from flexstage.files.request import require_fields
from flexstage.hysteresis.excitations.design import excitation
from flexstage.hysteresis.excitations.excitation import Excitation
from flexstage.hysteresis.requests import ExciteRequest
from flexstage.quantities.units import Frequency
from flexstage.stage import PiezoStack, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class EqualCycles(Excite):
    """Equal cycles, begun and ended at their low end."""

    kind: ClassVar[str] = "cycles"

    axis: str
    """The axis."""
    rate: Annotated[Frequency, SOME]
    """Cycles in a second [Hz]."""
    cycles: Count = 3
    """How many."""
    condition: CountOrZero = 1
    """How many more of them before, that are not evaluated."""
    shape: Literal["triangle", "cosine"] = "triangle"
    """How each runs."""
    low: float = 0.0
    """Low end, as a share of the range [1]."""
    high: float = 1.0
    """High end, as a share of the range [1]."""
    closed_loop: bool = False
    """Whether positions are commanded under control, and not voltages."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        require_span(self.kind, self.low, self.high)

    @property
    def motion_cycles(self) -> int | None:
        return self.cycles

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        del base
        s = settings[0]
        n = samples_of_cycle(self.kind, self.rate, fs, self.cycles + self.condition)
        k = np.arange(int((self.cycles + self.condition) * n) + 1)
        phase = k / n
        if self.shape == "cosine":
            share = 0.5 - 0.5 * np.cos(2.0 * np.pi * phase)
        else:
            share = 1.0 - np.abs(2.0 * (phase % 1.0) - 1.0)
        low, high = s.place(self.low), s.place(self.high)
        return command_of(s, low + (high - low) * share, fs, first=self.condition * n, period=n)


def samples_of_cycle(kind: str, rate_hz: float, sample_rate_hz: float, cycles: float) -> int:
    """Return the samples of one of some cycles, which must be enough, and not too many."""
    n = round(sample_rate_hz / rate_hz)
    if n < SAMPLES_PER_CYCLE:
        raise PlanError(
            f"cycles of {rate_hz:g} Hz need commands of {SAMPLES_PER_CYCLE * rate_hz:g} samples a "
            f"second, got {sample_rate_hz:g}: raise command_rate"
        )
    require_size(n * cycles, kind)
    return n


@dataclass(frozen=True, slots=True, kw_only=True)
class Falling(Excite):
    """Full cosine cycles, then cycles of falling range about the middle."""

    kind: ClassVar[str] = "falling"

    axis: str
    """The axis."""
    rate: Annotated[Frequency, SOME]
    """Cycles in a second [Hz]."""
    full: Count = 4
    """Full cycles."""
    falling: Count = 6
    """Cycles over which the range falls."""
    smallest: Annotated[float, Range(low=0.001, high=0.999)] = 0.1
    """Range of the last one, as a share of the whole [1]."""
    condition: CountOrZero = 2
    """How many full ones before them, that are not evaluated."""

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        del base
        s = settings[0]
        before, whole = self.condition, self.full + self.falling
        n = samples_of_cycle(self.kind, self.rate, fs, before + whole)
        cycle = np.arange(int((before + whole) * n) + 1) / n - before
        swing = np.interp(cycle, [0.0, self.full, whole], [1.0, 1.0, self.smallest])
        share = 0.5 - 0.5 * swing * np.cos(2.0 * np.pi * cycle)
        values = s.low + (s.high - s.low) * share
        return command_of(s, values, fs, first=int(before) * n, period=n)


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
        amplifier=replace(
            request.amplifier, capacitance=request.amplifier.capacitance or drive.capacitance
        ),
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
class Designed(Excite, ExciteRequest):
    """The drive record that identifies hysteresis, lag and creep: of `hysteresis.excitation`.

    What is not given is as the stage, its instrument and the plan have it.
    """

    kind: ClassVar[str] = "designed"
    needs_frequency: ClassVar[bool] = True

    axis: str
    """The axis, of a piezo stack."""
    multisine: bool = False
    """Add a small multisine at the natural frequency."""

    def __post_init__(self) -> None:
        require_fields(self, ExciteRequest, PlanError, " of designed")

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
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
            "amplifier": replace(
                self.amplifier,
                slew=min((r for r in (self.amplifier.slew, s.largest_rate) if r), default=None),
                capacitance=self.amplifier.capacitance or s.capacitance,
            ),
            "frequency": frequency,
            "multisine": self.multisine and frequency is not None,
        }
        try:
            made = excitation(request=ExciteRequest(**asked))
        except FlexstageError as error:
            raise PlanError(str(error)) from error
        return command_of(s, made.voltage, fs, notes=made.warnings)
