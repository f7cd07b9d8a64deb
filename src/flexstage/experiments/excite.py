"""Commands that a plan asks for, each by its kind: what moves how, and for how long."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from flexstage.errors import PlanError
from flexstage.files.ranges import Count, Range, Seed, Share, Whole, require_ranges
from flexstage.units import DIMENSIONS, Frequency, Length, Time, Voltage

Band = Annotated[tuple[float, float], DIMENSIONS["frequency"]]

#: What stands for above nothing.
_TINY = 1e-12
_SOME = Range(low=_TINY, high=1e6)
_NONE_OR_SOME = Range(low=0.0, high=1e6)


@dataclass(frozen=True, slots=True, kw_only=True)
class Excite:
    """A command of one axis or two.

    Ends and places are shares of what the axis may do, from 0 at its low end to 1 at its high end:
    of the voltage of a piezo stack, of the travel of a screw, and under position control of the
    positions that the axis reaches.
    """

    kind: ClassVar[str] = ""

    @property
    def moved(self) -> tuple[str, ...]:
        """The axes that it moves."""
        own = getattr(self, "axis", None)
        return (own,) if own is not None else tuple(getattr(self, "axes", ()))

    def __post_init__(self) -> None:
        require_ranges(self, PlanError, self.kind)

    def _require_span(self) -> None:
        low, high = getattr(self, "low"), getattr(self, "high")  # noqa: B009
        if not 0.0 <= low < high <= 1.0:
            raise PlanError(
                f"{self.kind} must run from a low to a high share between 0 and 1, got {low:g} to "
                f"{high:g}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class EqualCycles(Excite):
    """Equal cycles, begun and ended at their low end."""

    kind: ClassVar[str] = "cycles"

    axis: str
    """The axis."""
    rate: Annotated[Frequency, _SOME]
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
        self._require_span()


@dataclass(frozen=True, slots=True, kw_only=True)
class Falling(Excite):
    """Full cosine cycles, then cycles of falling range about the middle."""

    kind: ClassVar[str] = "falling"

    axis: str
    """The axis."""
    rate: Annotated[Frequency, _SOME]
    """Cycles in a second [Hz]."""
    full: Count = 4
    """Full cycles."""
    falling: Count = 6
    """Cycles over which the range falls."""
    smallest: Annotated[float, Range(low=0.001, high=0.999)] = 0.1
    """Range of the last one, as a share of the whole [1]."""
    condition: Whole = 2
    """How many full ones before them, that are not evaluated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Designed(Excite):
    """The drive record that identifies hysteresis, lag and creep: of `hysteresis.excitation`."""

    kind: ClassVar[str] = "designed"

    axis: str
    """The axis, of a piezo stack."""
    rates: tuple[Annotated[Frequency, _SOME], ...] = (0.5, 5.0)
    """How often a major loop repeats, one rate or more [Hz]."""
    duration: Annotated[Time, _SOME] | None = None
    """Longest time that it may take [s]."""
    hold: Annotated[Time, _NONE_OR_SOME] | None = None
    """Time of its step and hold [s]."""
    resonance: bool = False
    """Whether it ends with a multisine about the lowest resonance."""
    seed: Seed = 0
    """Seed of the phases of that multisine."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        if not self.rates:
            raise PlanError("designed needs one rate at least, got none")


@dataclass(frozen=True, slots=True, kw_only=True)
class Multisine(Excite):
    """A small sum of sines with all lines of a band, repeated."""

    kind: ClassVar[str] = "multisine"

    axis: str
    """The axis, of a piezo stack."""
    band: Band
    """Ends of the band [Hz]."""
    amplitude: Annotated[Voltage, _SOME]
    """Largest voltage from the mean [V]."""
    period: Annotated[Time, _SOME] = 1.0
    """Time of a period, whose inverse is the distance of the lines [s]."""
    periods: Annotated[int, Range(low=2, high=1e6)] = 5
    """How many; one more runs before them, to settle."""
    at: Share = 0.5
    """Where in the range, as a share [1]."""
    seed: Seed = 0
    """Seed of the phases."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        _require_band(self.kind, self.band)
        if self.band[1] - self.band[0] < 1.0 / self.period:
            raise PlanError(
                f"a period of {self.period:g} s has no line between {self.band[0]:g} and "
                f"{self.band[1]:g} Hz: make it longer"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Chirp(Excite):
    """A small sine whose frequency rises over a band, repeated."""

    kind: ClassVar[str] = "chirp"

    axis: str
    """The axis, of a piezo stack."""
    band: Band
    """Ends of the band [Hz]."""
    amplitude: Annotated[Voltage, _SOME]
    """Its amplitude [V]."""
    period: Annotated[Time, _SOME] = 1.0
    """Time of one sweep [s]."""
    periods: Annotated[int, Range(low=2, high=1e6)] = 5
    """How many; one more runs before them, to settle."""
    at: Share = 0.5
    """Where in the range, as a share [1]."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        _require_band(self.kind, self.band)


def _require_band(kind: str, band: tuple[float, float]) -> None:
    if not 0.0 < band[0] < band[1] < math.inf:
        raise PlanError(
            f"the band of a {kind} must rise from above 0 Hz, got {band[0]:g} to {band[1]:g} Hz"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RisingSteps(Excite):
    """Small equal steps upwards, with a rest on each level."""

    kind: ClassVar[str] = "staircase"

    axis: str
    """The axis."""
    step: Annotated[Voltage, _SOME] | None = None
    """Height of a step of a piezo stack [V]."""
    advance: Annotated[Length, Range(low=_TINY, high=1.0)] | None = None
    """Height of a step of a screw, or of a position under control [m]; the smallest step of the
    screw where not given.
    """
    levels: Annotated[int, Range(low=3, high=1e6)] = 20
    """How many levels."""
    dwell: Annotated[Time, _SOME] = 0.2
    """Time on each [s]."""
    at: Share = 0.5
    """Where in the range it begins, as a share [1]."""
    settle: Annotated[Time, _NONE_OR_SOME] = 2.0
    """Time at its beginning before it is recorded, while creep fades [s]."""
    closed_loop: bool = False
    """Whether positions are commanded under control, and not voltages."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        if self.step is not None and self.advance is not None:
            raise PlanError("staircase has a step in volts or an advance in metres, got both")


@dataclass(frozen=True, slots=True, kw_only=True)
class Corners(Excite):
    """The four corners of the workspace, anticlockwise from low and low, again and again."""

    kind: ClassVar[str] = "corners"

    axes: tuple[str, str] = ("x", "y")
    """The two axes."""
    rounds: Annotated[int, Range(low=2, high=1e6)] = 4
    """How often they are gone round."""
    dwell: Annotated[Time, _SOME] = 0.2
    """Time at each, the last half of which is averaged [s]."""
    travel: Annotated[Time, _SOME] = 0.2
    """Time from one corner to the next [s]."""
    low: float = 0.0
    """Low end, as a share of the range [1]."""
    high: float = 1.0
    """High end, as a share of the range [1]."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        self._require_span()
        if self.axes[0] == self.axes[1]:
            raise PlanError(f"corners need two axes, got '{self.axes[0]}' twice")


@dataclass(frozen=True, slots=True, kw_only=True)
class BidirectionalTargets(Excite):
    """Targets that are gone to from both sides."""

    kind: ClassVar[str] = "positioning"

    axis: str
    """The axis, of a screw, or of a piezo stack with position control."""
    targets: Annotated[int, Range(low=3, high=1e6)] = 11
    """How many."""
    rounds: Annotated[int, Range(low=2, high=1e6)] = 3
    """How often there and back."""
    dwell: Annotated[Time, _SOME] = 0.2
    """Time on each [s]; longer where the way from one to the next takes long."""
    low: float = 0.05
    """First target, as a share of the range [1]."""
    high: float = 0.95
    """Last target, as a share of the range [1]."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        self._require_span()


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold(Excite):
    """Rest in one place."""

    kind: ClassVar[str] = "hold"

    axis: str
    """The axis."""
    at: Share = 0.5
    """Where in the range, as a share [1]."""
    duration: Annotated[Time, _SOME] = 4.0
    """How long it is recorded [s]."""
    settle: Annotated[Time, _NONE_OR_SOME] = 2.0
    """Time before, while creep fades [s]."""
    closed_loop: bool = False
    """Whether it is held under position control."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Blows(Excite):
    """Blows of a hammer along an axis, its drives taken out."""

    kind: ClassVar[str] = "blows"

    axis: str
    """The axis."""
    hits: Count = 5
    """How many."""


#: Commands by their kind.
EXCITATIONS: dict[str, type[Excite]] = {
    made.kind: made
    for made in (
        EqualCycles, Falling, Designed, Multisine, Chirp, RisingSteps, Corners,
        BidirectionalTargets, Hold, Blows,
    )
}  # fmt: skip
