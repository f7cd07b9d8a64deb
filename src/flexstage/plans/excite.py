"""Commands that a plan asks for, each by its kind: what moves how, and for how long."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from flexstage.errors import PlanError
from flexstage.units import DIMENSIONS, Frequency, Length, Time, Voltage

Band = Annotated[tuple[float, float], DIMENSIONS["frequency"]]

#: What stands for above nothing.
TINY = 1e-12


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

    def _require(self, **bounds: tuple[float, float]) -> None:
        """Refuse numbers outside their bounds, both of which are allowed."""
        for name, (low, high) in bounds.items():
            value = getattr(self, name)
            for v in value if isinstance(value, tuple) else (value,):
                if v is not None and not (low <= v <= high and math.isfinite(v)):
                    between = f"{low:g} to {high:g}" if math.isfinite(high) else f"{low:g} or more"
                    raise PlanError(f"{name} of {self.kind} must be {between}, got {v:g}")

    def _require_whole(self, **least: int) -> None:
        """Refuse numbers of things that are no whole numbers, or too small."""
        for name, low in least.items():
            value = getattr(self, name)
            if not (value >= low and value == int(value) and value <= 1e6):
                raise PlanError(
                    f"{name} of {self.kind} must be a whole number from {low}, got {value:g}"
                )

    def _require_span(self) -> None:
        low, high = getattr(self, "low"), getattr(self, "high")  # noqa: B009
        if not 0.0 <= low < high <= 1.0:
            raise PlanError(
                f"{self.kind} must run from a low to a high share between 0 and 1, got {low:g} to "
                f"{high:g}"
            )


_SHAPES = ("triangle", "cosine")


@dataclass(frozen=True, slots=True, kw_only=True)
class EqualCycles(Excite):
    """Equal cycles, begun and ended at their low end."""

    kind: ClassVar[str] = "cycles"

    axis: str
    """The axis."""
    rate: Frequency
    """Cycles in a second [Hz]."""
    cycles: float = 3.0
    """How many."""
    condition: float = 1.0
    """How many more of them before, that are not evaluated."""
    shape: str = "triangle"
    """``triangle`` or ``cosine``."""
    low: float = 0.0
    """Low end, as a share of the range [1]."""
    high: float = 1.0
    """High end, as a share of the range [1]."""
    closed_loop: bool = False
    """Whether positions are commanded under control, and not voltages."""

    def __post_init__(self) -> None:
        self._require(rate=(TINY, 1e6))
        self._require_whole(cycles=1, condition=0)
        self._require_span()
        if self.shape not in _SHAPES:
            raise PlanError(f"the shape of cycles is {' or '.join(_SHAPES)}, got '{self.shape}'")


@dataclass(frozen=True, slots=True, kw_only=True)
class Falling(Excite):
    """Full cosine cycles, then cycles of falling range about the middle."""

    kind: ClassVar[str] = "falling"

    axis: str
    """The axis."""
    rate: Frequency
    """Cycles in a second [Hz]."""
    full: float = 4.0
    """Full cycles."""
    falling: float = 6.0
    """Cycles over which the range falls."""
    smallest: float = 0.1
    """Range of the last one, as a share of the whole [1]."""
    condition: float = 2.0
    """How many full ones before them, that are not evaluated."""

    def __post_init__(self) -> None:
        self._require(rate=(TINY, 1e6), smallest=(0.001, 0.999))
        self._require_whole(full=1, falling=1, condition=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Designed(Excite):
    """The drive record that identifies hysteresis, lag and creep: of `hysteresis.excitation`."""

    kind: ClassVar[str] = "designed"

    axis: str
    """The axis, of a piezo stack."""
    rates: tuple[Frequency, ...] = (0.5, 5.0)
    """How often a major loop repeats, one rate or more [Hz]."""
    duration: Time | None = None
    """Longest time that it may take [s]."""
    hold: Time | None = None
    """Time of its step and hold [s]."""
    resonance: bool = False
    """Whether it ends with a multisine about the lowest resonance."""
    seed: float = 0.0
    """Seed of the phases of that multisine."""

    def __post_init__(self) -> None:
        self._require(rates=(TINY, 1e6), duration=(TINY, 1e6), hold=(0.0, 1e6))
        self._require_whole(seed=0)
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
    amplitude: Voltage
    """Largest voltage from the mean [V]."""
    period: Time = 1.0
    """Time of a period, whose inverse is the distance of the lines [s]."""
    periods: float = 5.0
    """How many; one more runs before them, to settle."""
    at: float = 0.5
    """Where in the range, as a share [1]."""
    seed: float = 0.0
    """Seed of the phases."""

    def __post_init__(self) -> None:
        self._require(amplitude=(TINY, 1e6), period=(TINY, 1e6), at=(0.0, 1.0))
        self._require_whole(periods=2, seed=0)
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
    amplitude: Voltage
    """Its amplitude [V]."""
    period: Time = 1.0
    """Time of one sweep [s]."""
    periods: float = 5.0
    """How many; one more runs before them, to settle."""
    at: float = 0.5
    """Where in the range, as a share [1]."""

    def __post_init__(self) -> None:
        self._require(amplitude=(TINY, 1e6), period=(TINY, 1e6), at=(0.0, 1.0))
        self._require_whole(periods=2)
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
    step: Voltage | None = None
    """Height of a step of a piezo stack [V]."""
    advance: Length | None = None
    """Height of a step of a screw, or of a position under control [m]; the smallest step of the
    screw where not given.
    """
    levels: float = 20.0
    """How many levels."""
    dwell: Time = 0.2
    """Time on each [s]."""
    at: float = 0.5
    """Where in the range it begins, as a share [1]."""
    settle: Time = 2.0
    """Time at its beginning before it is recorded, while creep fades [s]."""
    closed_loop: bool = False
    """Whether positions are commanded under control, and not voltages."""

    def __post_init__(self) -> None:
        self._require(
            step=(TINY, 1e6), advance=(TINY, 1.0), dwell=(TINY, 1e6), at=(0.0, 1.0),
            settle=(0.0, 1e6),
        )  # fmt: skip
        self._require_whole(levels=3)
        if self.step is not None and self.advance is not None:
            raise PlanError("staircase has a step in volts or an advance in metres, got both")


@dataclass(frozen=True, slots=True, kw_only=True)
class Corners(Excite):
    """The four corners of the workspace, anticlockwise from low and low, again and again."""

    kind: ClassVar[str] = "corners"

    axes: tuple[str, str] = ("x", "y")
    """The two axes."""
    rounds: float = 4.0
    """How often they are gone round."""
    dwell: Time = 0.2
    """Time at each, the last half of which is averaged [s]."""
    travel: Time = 0.2
    """Time from one corner to the next [s]."""
    low: float = 0.0
    """Low end, as a share of the range [1]."""
    high: float = 1.0
    """High end, as a share of the range [1]."""

    def __post_init__(self) -> None:
        self._require(dwell=(TINY, 1e6), travel=(TINY, 1e6))
        self._require_whole(rounds=2)
        self._require_span()
        if self.axes[0] == self.axes[1]:
            raise PlanError(f"corners need two axes, got '{self.axes[0]}' twice")


@dataclass(frozen=True, slots=True, kw_only=True)
class BidirectionalTargets(Excite):
    """Targets that are gone to from both sides."""

    kind: ClassVar[str] = "positioning"

    axis: str
    """The axis, of a screw, or of a piezo stack with position control."""
    targets: float = 11.0
    """How many."""
    rounds: float = 3.0
    """How often there and back."""
    dwell: Time = 0.2
    """Time on each [s]; longer where the way from one to the next takes long."""
    low: float = 0.05
    """First target, as a share of the range [1]."""
    high: float = 0.95
    """Last target, as a share of the range [1]."""

    def __post_init__(self) -> None:
        self._require(dwell=(TINY, 1e6))
        self._require_whole(targets=3, rounds=2)
        self._require_span()


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold(Excite):
    """Rest in one place."""

    kind: ClassVar[str] = "hold"

    axis: str
    """The axis."""
    at: float = 0.5
    """Where in the range, as a share [1]."""
    duration: Time = 4.0
    """How long it is recorded [s]."""
    settle: Time = 2.0
    """Time before, while creep fades [s]."""
    closed_loop: bool = False
    """Whether it is held under position control."""

    def __post_init__(self) -> None:
        self._require(duration=(TINY, 1e6), settle=(0.0, 1e6), at=(0.0, 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Blows(Excite):
    """Blows of a hammer along an axis, its drives taken out."""

    kind: ClassVar[str] = "blows"

    axis: str
    """The axis."""
    hits: float = 5.0
    """How many."""

    def __post_init__(self) -> None:
        self._require_whole(hits=1)


#: Commands by their kind.
EXCITATIONS: dict[str, type[Excite]] = {
    made.kind: made
    for made in (
        EqualCycles, Falling, Designed, Multisine, Chirp, RisingSteps, Corners,
        BidirectionalTargets, Hold, Blows,
    )
}  # fmt: skip
