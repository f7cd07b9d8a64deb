"""Commands that a plan asks for, each by its kind: what moves how, and for how long."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from flexstage.errors import PlanError
from flexstage.units import DIMENSIONS

__all__ = [
    "EXCITATIONS",
    "Blows",
    "Chirp",
    "Corners",
    "Cycles",
    "Designed",
    "Excite",
    "Falling",
    "Hold",
    "Multisine",
    "Positioning",
    "Staircase",
]

Frequency = Annotated[float, DIMENSIONS["frequency"]]
Time = Annotated[float, DIMENSIONS["time"]]
Voltage = Annotated[float, DIMENSIONS["voltage"]]
Length = Annotated[float, DIMENSIONS["length"]]
Band = Annotated[tuple[float, float], DIMENSIONS["frequency"]]

_SHAPES = ("triangle", "cosine")


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


_TINY = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycles(Excite):
    """Equal cycles, begun and ended at their low end.

    Parameters
    ----------
    axis : str
        The axis.
    rate : float
        Cycles in a second [Hz].
    cycles : float
        How many.
    condition : float
        How many more of them before, that are not evaluated.
    shape : str
        ``triangle`` or ``cosine``.
    low, high : float
        Ends, as shares of the range [1].
    closed_loop : bool
        Whether positions are commanded under control, and not voltages.
    """

    kind: ClassVar[str] = "cycles"

    axis: str
    rate: Frequency
    cycles: float = 3.0
    condition: float = 1.0
    shape: str = "triangle"
    low: float = 0.0
    high: float = 1.0
    closed_loop: bool = False

    def __post_init__(self) -> None:
        self._require(rate=(_TINY, 1e6))
        self._require_whole(cycles=1, condition=0)
        self._require_span()
        if self.shape not in _SHAPES:
            raise PlanError(f"the shape of cycles is {' or '.join(_SHAPES)}, got '{self.shape}'")


@dataclass(frozen=True, slots=True, kw_only=True)
class Falling(Excite):
    """Full cosine cycles, then cycles of falling range about the middle.

    Parameters
    ----------
    axis : str
        The axis.
    rate : float
        Cycles in a second [Hz].
    full : float
        Full cycles.
    falling : float
        Cycles over which the range falls.
    smallest : float
        Range of the last one, as a share of the whole [1].
    condition : float
        How many full ones before them, that are not evaluated.
    """

    kind: ClassVar[str] = "falling"

    axis: str
    rate: Frequency
    full: float = 4.0
    falling: float = 6.0
    smallest: float = 0.1
    condition: float = 2.0

    def __post_init__(self) -> None:
        self._require(rate=(_TINY, 1e6), smallest=(0.001, 0.999))
        self._require_whole(full=1, falling=1, condition=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Designed(Excite):
    """The drive record that identifies hysteresis, lag and creep: of `hysteresis.excitation`.

    Parameters
    ----------
    axis : str
        The axis, of a piezo stack.
    rates : tuple of float
        How often a major loop repeats, one rate or more [Hz].
    duration : float, optional
        Longest time that it may take [s].
    hold : float, optional
        Time of its step and hold [s].
    resonance : bool
        Whether it ends with a multisine about the lowest resonance.
    seed : int
        Seed of the phases of that multisine.
    """

    kind: ClassVar[str] = "designed"

    axis: str
    rates: tuple[Frequency, ...] = (0.5, 5.0)
    duration: Time | None = None
    hold: Time | None = None
    resonance: bool = False
    seed: float = 0.0

    def __post_init__(self) -> None:
        self._require(rates=(_TINY, 1e6), duration=(_TINY, 1e6), hold=(0.0, 1e6))
        self._require_whole(seed=0)
        if not self.rates:
            raise PlanError("designed needs one rate at least, got none")


@dataclass(frozen=True, slots=True, kw_only=True)
class Multisine(Excite):
    """A small sum of sines with all lines of a band, repeated.

    Parameters
    ----------
    axis : str
        The axis, of a piezo stack.
    band : tuple of float
        Ends of the band [Hz].
    amplitude : float
        Largest voltage from the mean [V].
    period : float
        Time of a period, whose inverse is the distance of the lines [s].
    periods : float
        How many; one more runs before them, to settle.
    at : float
        Where in the range, as a share [1].
    seed : int
        Seed of the phases.
    """

    kind: ClassVar[str] = "multisine"

    axis: str
    band: Band
    amplitude: Voltage
    period: Time = 1.0
    periods: float = 5.0
    at: float = 0.5
    seed: float = 0.0

    def __post_init__(self) -> None:
        self._require(amplitude=(_TINY, 1e6), period=(_TINY, 1e6), at=(0.0, 1.0))
        self._require_whole(periods=2, seed=0)
        _require_band(self.kind, self.band)
        if self.band[1] - self.band[0] < 1.0 / self.period:
            raise PlanError(
                f"a period of {self.period:g} s has no line between {self.band[0]:g} and "
                f"{self.band[1]:g} Hz: make it longer"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Chirp(Excite):
    """A small sine whose frequency rises over a band, repeated.

    Parameters
    ----------
    axis : str
        The axis, of a piezo stack.
    band : tuple of float
        Ends of the band [Hz].
    amplitude : float
        Its amplitude [V].
    period : float
        Time of one sweep [s].
    periods : float
        How many; one more runs before them, to settle.
    at : float
        Where in the range, as a share [1].
    """

    kind: ClassVar[str] = "chirp"

    axis: str
    band: Band
    amplitude: Voltage
    period: Time = 1.0
    periods: float = 5.0
    at: float = 0.5

    def __post_init__(self) -> None:
        self._require(amplitude=(_TINY, 1e6), period=(_TINY, 1e6), at=(0.0, 1.0))
        self._require_whole(periods=2)
        _require_band(self.kind, self.band)


@dataclass(frozen=True, slots=True, kw_only=True)
class Staircase(Excite):
    """Small equal steps upwards, with a rest on each level.

    Parameters
    ----------
    axis : str
        The axis.
    step : float, optional
        Height of a step of a piezo stack [V].
    advance : float, optional
        Height of a step of a screw, or of a position under control [m]; the smallest step of the
        screw where not given.
    levels : float
        How many levels.
    dwell : float
        Time on each [s].
    at : float
        Where in the range it begins, as a share [1].
    settle : float
        Time at its beginning before it is recorded, while creep fades [s].
    closed_loop : bool
        Whether positions are commanded under control, and not voltages.
    """

    kind: ClassVar[str] = "staircase"

    axis: str
    step: Voltage | None = None
    advance: Length | None = None
    levels: float = 20.0
    dwell: Time = 0.2
    at: float = 0.5
    settle: Time = 2.0
    closed_loop: bool = False

    def __post_init__(self) -> None:
        self._require(
            step=(_TINY, 1e6), advance=(_TINY, 1.0), dwell=(_TINY, 1e6), at=(0.0, 1.0),
            settle=(0.0, 1e6),
        )  # fmt: skip
        self._require_whole(levels=3)
        if self.step is not None and self.advance is not None:
            raise PlanError("staircase has a step in volts or an advance in metres, got both")


@dataclass(frozen=True, slots=True, kw_only=True)
class Corners(Excite):
    """The four corners of the workspace, anticlockwise from low and low, again and again.

    Parameters
    ----------
    axes : tuple of str
        The two axes.
    rounds : float
        How often they are gone round.
    dwell : float
        Time at each, the last half of which is averaged [s].
    travel : float
        Time from one corner to the next [s].
    low, high : float
        Ends, as shares of the range [1].
    """

    kind: ClassVar[str] = "corners"

    axes: tuple[str, str] = ("x", "y")
    rounds: float = 4.0
    dwell: Time = 0.2
    travel: Time = 0.2
    low: float = 0.0
    high: float = 1.0

    def __post_init__(self) -> None:
        self._require(dwell=(_TINY, 1e6), travel=(_TINY, 1e6))
        self._require_whole(rounds=2)
        self._require_span()
        if self.axes[0] == self.axes[1]:
            raise PlanError(f"corners need two axes, got '{self.axes[0]}' twice")


@dataclass(frozen=True, slots=True, kw_only=True)
class Positioning(Excite):
    """Targets that are gone to from both sides.

    Parameters
    ----------
    axis : str
        The axis, of a screw, or of a piezo stack with position control.
    targets : float
        How many.
    rounds : float
        How often there and back.
    dwell : float
        Time on each [s]; longer where the way from one to the next takes long.
    low, high : float
        First and last target, as shares of the range [1].
    """

    kind: ClassVar[str] = "positioning"

    axis: str
    targets: float = 11.0
    rounds: float = 3.0
    dwell: Time = 0.2
    low: float = 0.05
    high: float = 0.95

    def __post_init__(self) -> None:
        self._require(dwell=(_TINY, 1e6))
        self._require_whole(targets=3, rounds=2)
        self._require_span()


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold(Excite):
    """Rest in one place.

    Parameters
    ----------
    axis : str
        The axis.
    at : float
        Where in the range, as a share [1].
    duration : float
        How long it is recorded [s].
    settle : float
        Time before, while creep fades [s].
    closed_loop : bool
        Whether it is held under position control.
    """

    kind: ClassVar[str] = "hold"

    axis: str
    at: float = 0.5
    duration: Time = 4.0
    settle: Time = 2.0
    closed_loop: bool = False

    def __post_init__(self) -> None:
        self._require(duration=(_TINY, 1e6), settle=(0.0, 1e6), at=(0.0, 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Blows(Excite):
    """Blows of a hammer along an axis, its drives taken out.

    Parameters
    ----------
    axis : str
        The axis.
    hits : float
        How many.
    """

    kind: ClassVar[str] = "blows"

    axis: str
    hits: float = 5.0

    def __post_init__(self) -> None:
        self._require_whole(hits=1)


def _require_band(kind: str, band: tuple[float, float]) -> None:
    if not 0.0 < band[0] < band[1] < math.inf:
        raise PlanError(
            f"the band of a {kind} must rise from above 0 Hz, got {band[0]:g} to {band[1]:g} Hz"
        )


#: Commands by their kind.
EXCITATIONS: dict[str, type[Excite]] = {
    made.kind: made
    for made in (
        Cycles, Falling, Designed, Multisine, Chirp, Staircase, Corners, Positioning, Hold, Blows,
    )
}  # fmt: skip
