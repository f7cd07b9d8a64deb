"""Cycles of an axis: equal ones, and ones of falling range from which its memory is read."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from flexstage.errors import PlanError
from flexstage.experiments.axis_limits import AxisSetting
from flexstage.experiments.command import CommandWaveform, require_size
from flexstage.experiments.verbs.excite import (
    SAMPLES_PER_CYCLE,
    SOME,
    Excite,
    command_of,
    require_span,
)
from flexstage.files.ranges import Count, Range, Whole
from flexstage.units import Frequency


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
    condition: Whole = 1
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
    condition: Whole = 2
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
