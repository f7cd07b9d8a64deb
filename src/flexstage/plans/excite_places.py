"""Commands that go from place to place and rest there, and blows."""

from dataclasses import dataclass
from typing import ClassVar

from flexstage.errors import PlanError
from flexstage.plans.excite_base import TINY, Excite
from flexstage.units import Length, Time, Voltage


@dataclass(frozen=True, slots=True, kw_only=True)
class Staircase(Excite):
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
    """Ends, as shares of the range [1]."""
    high: float = 1.0
    """Ends, as shares of the range [1]."""

    def __post_init__(self) -> None:
        self._require(dwell=(TINY, 1e6), travel=(TINY, 1e6))
        self._require_whole(rounds=2)
        self._require_span()
        if self.axes[0] == self.axes[1]:
            raise PlanError(f"corners need two axes, got '{self.axes[0]}' twice")


@dataclass(frozen=True, slots=True, kw_only=True)
class Positioning(Excite):
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
    """First and last target, as shares of the range [1]."""
    high: float = 0.95
    """First and last target, as shares of the range [1]."""

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
