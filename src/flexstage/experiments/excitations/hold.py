"""An axis at rest."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from flexstage.experiments.axis_limits import AxisSetting
from flexstage.experiments.command import CommandWaveform, require_size
from flexstage.experiments.verbs.excite import NONE_OR_SOME, SOME, Excite, command_of
from flexstage.files.ranges import Share
from flexstage.units import Time


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold(Excite):
    """Rest in one place."""

    kind: ClassVar[str] = "hold"

    axis: str
    """The axis."""
    at: Share = 0.5
    """Where in the range, as a share [1]."""
    duration: Annotated[Time, SOME] = 4.0
    """How long it is recorded [s]."""
    settle: Annotated[Time, NONE_OR_SOME] = 2.0
    """Time before, while creep fades [s]."""
    closed_loop: bool = False
    """Whether it is held under position control."""

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        del base
        wait, n = round(self.settle * fs), max(round(self.duration * fs), 2)
        require_size(wait + n, self.kind)
        s = settings[0]
        return command_of(s, np.full(wait + n, s.place(self.at)), fs, first=wait)
