"""Targets along an axis, as ISO 230-2 asks for."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from flexstage.errors import PlanError
from flexstage.experiments.axis_limits import AxisSetting
from flexstage.experiments.command import CommandWaveform, require_size
from flexstage.experiments.excitations.staircase import rests
from flexstage.experiments.verbs.excite import OF_RATE, SOME, Excite, command_of, require_span
from flexstage.files.ranges import Range
from flexstage.units import Time

#: A rest lasts so much longer than the way to it, at least.
_REST_OVER_WAY = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class BidirectionalTargets(Excite):
    """Targets that are gone to from both sides."""

    kind: ClassVar[str] = "positioning"
    closed_loop: ClassVar[bool] = True

    axis: str
    """The axis, of a screw, or of a piezo stack with position control."""
    targets: Annotated[int, Range(low=3, high=1e6)] = 11
    """How many."""
    rounds: Annotated[int, Range(low=2, high=1e6)] = 3
    """How often there and back."""
    dwell: Annotated[Time, SOME] = 0.2
    """Time on each [s]; longer where the way from one to the next takes long."""
    low: float = 0.05
    """First target, as a share of the range [1]."""
    high: float = 0.95
    """Last target, as a share of the range [1]."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        require_span(self.kind, self.low, self.high)

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        del base
        s = settings[0]
        if s.quantity != "position":
            raise PlanError(f"targets are positions, and axis '{s.axis}' is commanded by voltage")
        rise = np.linspace(s.place(self.low), s.place(self.high), self.targets)
        # one level beyond each end, so that the end targets too are gone to from both sides
        beyond = 0.5 * min(self.low, 1.0 - self.high, 0.1) * (s.high - s.low)
        first, last = rise[0] - beyond, rise[-1] + beyond
        once = np.concatenate(([first], rise, [last], rise[::-1]))
        dwell = self.dwell
        if s.largest_rate is not None:
            # it is told from a ramp by resting for most of the time
            dwell = max(dwell, _REST_OVER_WAY * (rise[1] - rise[0]) / (OF_RATE * s.largest_rate))
        require_size(once.size * self.rounds * dwell * fs, self.kind)
        samples, _ = rests(self.kind, s, np.append(np.tile(once, self.rounds), first), dwell, fs)
        return command_of(s, samples, fs)
