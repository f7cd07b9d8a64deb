"""Stepwise excitations: levels, targets of ISO 230-2, one position, corners of two axes."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import PlanError
from flexstage.experiments.axis_limits import AxisSetting
from flexstage.experiments.command import CommandWaveform, require_size
from flexstage.experiments.verbs.excite import (
    NONE_OR_SOME,
    OF_RATE,
    SOME,
    TINY,
    Excite,
    command_of,
    require_span,
)
from flexstage.files.ranges import Range, Share
from flexstage.instruments.protocol import Waveform
from flexstage.quantities.units import Length, Time, Voltage


@dataclass(frozen=True, slots=True, kw_only=True)
class RisingSteps(Excite):
    """Small equal upward steps, with a dwell on each level."""

    kind: ClassVar[str] = "staircase"

    axis: str
    """The axis."""
    step: Annotated[Voltage, SOME] | None = None
    """Height of a step of a piezo stack [V]."""
    advance: Annotated[Length, Range(low=TINY, high=1.0)] | None = None
    """Height of a step of a screw, or of a position under control [m] (default: the smallest step
    of the screw).
    """
    levels: Annotated[int, Range(low=3, high=1e6)] = 20
    """Number of levels."""
    dwell: Annotated[Time, SOME] = 0.2
    """Time on each level [s]."""
    at: Share = 0.5
    """First level, as a fraction of the range [1]."""
    settle: Annotated[Time, NONE_OR_SOME] = 2.0
    """Settling time before the record, for creep [s]."""
    closed_loop: bool = False
    """Command positions under control instead of voltages."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        if self.step is not None and self.advance is not None:
            raise PlanError("staircase needs a step in volts or an advance in metres, got both")

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        del base
        s = settings[0]
        height = self.advance if s.quantity == "position" else self.step
        if height is None and s.quantity == "position":
            height = s.smallest_step
        if height is None:
            what = "'step' in volts" if s.quantity == "voltage" else "'advance' in metres"
            raise PlanError(f"the staircase of axis '{s.axis}' needs its {what}")
        top = s.place(self.at) + height * (self.levels - 1)
        if top > s.high * (1.0 + 1e-12):
            raise PlanError(
                f"the staircase of axis '{s.axis}' would end at {_text(top, s)}, and its range "
                f"ends at {_text(s.high, s)}: start lower, or use smaller or fewer steps"
            )
        levels = s.place(self.at) + height * np.arange(self.levels, dtype=np.float64)
        samples, wait = dwells(self.kind, s, levels, self.dwell, fs, self.settle)
        return command_of(s, samples, fs, first=wait)


def dwells(
    kind: str, s: AxisSetting, levels: Array, dwell: float, fs: float, settle: float = 0.0
) -> tuple[Array, int]:
    """Return samples of dwells with linear moves between them, and the number that settle."""
    # duration of a step between levels, longer where the limits require it [s]
    step_time = 5e-3
    rest = max(round(dwell * fs), 4)
    wait = round(settle * fs)
    largest = float(np.max(np.abs(np.diff(levels)), initial=0.0))
    way = round(step_time * fs)
    if s.largest_rate is not None:
        way = max(way, math.ceil(largest / (OF_RATE * s.largest_rate) * fs))
    way = max(way, 1)
    require_size(wait + levels.size * (rest + way), kind)
    parts = [np.full(wait + rest, levels[0])]
    for a, b in itertools.pairwise(levels):
        parts.append(a + (b - a) * np.arange(1, way) / way)
        parts.append(np.full(rest, b))
    return np.concatenate(parts), wait


def _text(value: float, s: AxisSetting) -> str:
    return f"{value:g} V" if s.quantity == "voltage" else f"{1e6 * value:g} um"


@dataclass(frozen=True, slots=True, kw_only=True)
class BidirectionalTargets(Excite):
    """Targets that are approached from both sides."""

    kind: ClassVar[str] = "positioning"
    closed_loop: ClassVar[bool] = True

    axis: str
    """The axis, of a screw, or of a piezo stack with position control."""
    targets: Annotated[int, Range(low=3, high=1e6)] = 11
    """Number of targets."""
    rounds: Annotated[int, Range(low=2, high=1e6)] = 3
    """Number of cycles, forwards and back."""
    dwell: Annotated[Time, SOME] = 0.2
    """Time on each target [s]; longer where the move between targets takes long."""
    low: float = 0.05
    """First target, as a fraction of the range [1]."""
    high: float = 0.95
    """Last target, as a fraction of the range [1]."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        require_span(self.kind, self.low, self.high)

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        # smallest ratio of a dwell to the move before it
        dwell_over_move = 1.5
        del base
        s = settings[0]
        if s.quantity != "position":
            raise PlanError(f"targets are positions, and axis '{s.axis}' is commanded by voltage")
        rise = np.linspace(s.place(self.low), s.place(self.high), self.targets)
        # one level beyond each end, so that the end targets are approached from both sides too
        beyond = 0.5 * min(self.low, 1.0 - self.high, 0.1) * (s.high - s.low)
        first, last = rise[0] - beyond, rise[-1] + beyond
        once = np.concatenate(([first], rise, [last], rise[::-1]))
        dwell = self.dwell
        if s.largest_rate is not None:
            # dwells for most of the time distinguish the command from a ramp
            dwell = max(dwell, dwell_over_move * (rise[1] - rise[0]) / (OF_RATE * s.largest_rate))
        require_size(once.size * self.rounds * dwell * fs, self.kind)
        samples, _ = dwells(self.kind, s, np.append(np.tile(once, self.rounds), first), dwell, fs)
        return command_of(s, samples, fs)


@dataclass(frozen=True, slots=True, kw_only=True)
class Dwell(Excite):
    """Dwell at one position."""

    kind: ClassVar[str] = "dwell"

    axis: str
    """The axis."""
    at: Share = 0.5
    """Position, as a fraction of the range [1]."""
    duration: Annotated[Time, SOME] = 4.0
    """Duration of the record [s]."""
    settle: Annotated[Time, NONE_OR_SOME] = 2.0
    """Settling time before the record, for creep [s]."""
    closed_loop: bool = False
    """Hold the position under control instead of a voltage."""

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        del base
        wait, n = round(self.settle * fs), max(round(self.duration * fs), 2)
        require_size(wait + n, self.kind)
        s = settings[0]
        return command_of(s, np.full(wait + n, s.place(self.at)), fs, first=wait)


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspaceCorners(Excite):
    """The four corners of the workspace, anticlockwise from low and low, repeatedly."""

    kind: ClassVar[str] = "workspace-corners"
    visits_corners: ClassVar[bool] = True

    axes: tuple[str, str] = ("x", "y")
    """The two axes."""
    rounds: Annotated[int, Range(low=2, high=1e6)] = 4
    """Number of rounds, after one conditioning round."""
    dwell: Annotated[Time, SOME] = 0.2
    """Time at each corner, of which the last half is averaged [s]."""
    travel: Annotated[Time, SOME] = 0.2
    """Time from one corner to the next [s]."""
    low: float = 0.0
    """Low end, as a fraction of the range [1]."""
    high: float = 1.0
    """High end, as a fraction of the range [1]."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        require_span(self.kind, self.low, self.high)
        if self.axes[0] == self.axes[1]:
            raise PlanError(f"{self.kind} needs two axes, got '{self.axes[0]}' twice")

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        del base
        if len({s.quantity for s in settings}) > 1:
            raise PlanError(f"{self.kind} needs two axes with the same commanded quantity")
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
        # the first round conditions the hysteresis of both axes
        first = 4 * (rest + way)
        return CommandWaveform(
            waveform=waveform, first=first, reference={}, corner=np.concatenate(number)
        )
