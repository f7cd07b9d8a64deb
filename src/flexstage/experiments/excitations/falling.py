"""Cycles of falling range, from which the memory of a drive is read."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from flexstage.experiments.axis_limits import AxisSetting
from flexstage.experiments.command import CommandWaveform
from flexstage.experiments.excitations.cycles import samples_of_cycle
from flexstage.experiments.verbs.excite import SOME, Excite, command_of
from flexstage.files.ranges import Count, Range, Whole
from flexstage.units import Frequency


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
