"""The corners of the workspace."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import PlanError
from flexstage.experiments.axis_limits import AxisSetting
from flexstage.experiments.command import CommandWaveform, require_size
from flexstage.experiments.verbs.excite import OF_RATE, SOME, Excite, require_span
from flexstage.files.ranges import Range
from flexstage.instruments.waveform import Waveform
from flexstage.units import Time


@dataclass(frozen=True, slots=True, kw_only=True)
class Corners(Excite):
    """The four corners of the workspace, anticlockwise from low and low, again and again."""

    kind: ClassVar[str] = "corners"
    corners: ClassVar[bool] = True

    axes: tuple[str, str] = ("x", "y")
    """The two axes."""
    rounds: Annotated[int, Range(low=2, high=1e6)] = 4
    """How often they are gone round."""
    dwell: Annotated[Time, SOME] = 0.2
    """Time at each, the last half of which is averaged [s]."""
    travel: Annotated[Time, SOME] = 0.2
    """Time from one corner to the next [s]."""
    low: float = 0.0
    """Low end, as a share of the range [1]."""
    high: float = 1.0
    """High end, as a share of the range [1]."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        require_span(self.kind, self.low, self.high)
        if self.axes[0] == self.axes[1]:
            raise PlanError(f"corners need two axes, got '{self.axes[0]}' twice")

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        del base
        if len({s.quantity for s in settings}) > 1:
            raise PlanError("corners need two axes that are commanded in the same way")
        rest, way = max(round(self.dwell * fs), 4), max(round(self.travel * fs), 1)
        for s in settings:
            span = s.place(self.high) - s.place(self.low)
            if s.largest_rate is not None:
                way = max(way, math.ceil(span / (OF_RATE * s.largest_rate) * fs))
        visits = 4 * (self.rounds + 1)
        require_size(visits * (rest + way), self.kind)
        shares = ((0, 1, 1, 0), (0, 0, 1, 1))
        number: list[Array] = []
        samples: tuple[list[Array], list[Array]] = ([], [])
        for v in range(visits):
            for axis, s in enumerate(settings):
                ends = (self.low, self.high)
                a, b = (s.place(ends[shares[axis][(v + j) % 4]]) for j in (0, 1))
                samples[axis].append(np.full(rest, a))
                samples[axis].append(a + (b - a) * np.arange(1, way + 1) / way)
            counted = np.full(rest + way, -1.0)
            counted[rest // 2 : rest] = v % 4
            number.append(counted)
        waveform = Waveform(
            values={s.axis: np.concatenate(v) for s, v in zip(settings, samples, strict=True)},
            sample_rate_hz=fs,
            quantity=settings[0].quantity,
        )
        # the first round brings both axes into the memory that all later ones share
        first = 4 * (rest + way)
        return CommandWaveform(
            waveform=waveform, first=first, reference={}, corner=np.concatenate(number)
        )
