"""The record that identifies a drive, as the room of hysteresis designs it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

from flexstage.errors import FlexstageError, PlanError
from flexstage.experiments.axis_limits import AxisSetting
from flexstage.experiments.command import CommandWaveform
from flexstage.experiments.verbs.excite import NONE_OR_SOME, SOME, Excite, command_of, require_stack
from flexstage.files.ranges import Seed
from flexstage.units import Frequency, Time


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
    resonance: bool = False
    """Whether it ends with a multisine about the lowest resonance."""
    seed: Seed = 0
    """Seed of the phases of that multisine."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        if not self.rates:
            raise PlanError("designed needs one rate at least, got none")

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        from flexstage.hysteresis import excitation

        del base
        s = settings[0]
        require_stack(s, "a designed record is")
        try:
            made = excitation(
                (s.low, s.high),
                sample_rate_hz=fs,
                duration=self.duration,
                rates_hz=self.rates,
                slope_limit=s.largest_rate,
                natural_frequency_hz=s.natural_frequency_hz,
                resonance=self.resonance and s.natural_frequency_hz is not None,
                hold=self.hold,
                seed=self.seed,
            )
        except FlexstageError as error:
            raise PlanError(str(error)) from error
        return command_of(s, made.voltage, fs, notes=made.warnings)
