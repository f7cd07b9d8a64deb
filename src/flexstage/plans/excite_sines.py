"""Small sines about a place of the range."""

import math
from dataclasses import dataclass
from typing import ClassVar

from flexstage.errors import PlanError
from flexstage.plans.excite_base import TINY, Band, Excite
from flexstage.units import Time, Voltage


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
