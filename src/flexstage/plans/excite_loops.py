"""Commands over the whole range: cycles, and the record that is designed to identify."""

from dataclasses import dataclass
from typing import ClassVar

from flexstage.errors import PlanError
from flexstage.plans.excite_base import TINY, Excite
from flexstage.units import Frequency, Time

_SHAPES = ("triangle", "cosine")


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycles(Excite):
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
    """Ends, as shares of the range [1]."""
    high: float = 1.0
    """Ends, as shares of the range [1]."""
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
