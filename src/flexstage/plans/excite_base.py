"""What all commands of a plan share: the axes that they move, and checks of their numbers."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from flexstage.errors import PlanError
from flexstage.units import DIMENSIONS

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
