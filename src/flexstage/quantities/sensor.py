"""What a sensor is, and how it stands to what it reads."""

import math
from dataclasses import dataclass, fields
from typing import Annotated

from flexstage.base.errors import ModelError
from flexstage.quantities.units import DIMENSIONS, Length

#: What has a sign.
_SIGNED = frozenset(("abbe_offset", "expansion"))


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorSpecification:
    """A sensor and how it stands to what it reads: what is known of its errors.

    Raises
    ------
    ModelError
        A figure is negative or not finite, but for the offset and the expansion, which have a sign.

    Examples
    --------
    >>> SensorSpecification(calibration=3e-4, alignment=5e-3).alignment
    0.005
    """

    name: str = ""
    """Its name, where it is one of several."""
    calibration: float = 0.0
    """Relative standard uncertainty of its gain [1]."""
    nonlinearity: float = 0.0
    """Half-width of its deviation from a straight line, relative to the range in use [1]."""
    alignment: Annotated[float, DIMENSIONS["angle"]] = 0.0
    """Standard uncertainty of the angle between it and the axis [rad]."""
    abbe_offset: Length = 0.0
    """Distance from its line to the point whose motion is wanted, positive where a positive pitch
    adds to the reading [m].
    """
    abbe_uncertainty: Length = 0.0
    """Standard uncertainty of that distance [m]."""
    temperature_uncertainty: float = 0.0
    """Standard uncertainty of the change of temperature within a record [K]."""
    expansion: Annotated[float, DIMENSIONS["expansion"]] = 0.0
    """Coefficient of expansion of what holds it [1/K]."""
    length_of_loop: Length = 0.0
    """Length of the path from it to what it reads [m]."""
    drift: float = 0.0
    """Standard uncertainty of the rate of drift that is left [m/s], or [rad/s]."""
    resolution_step: Length = 0.0
    """Step of its reading [m], or [rad] of a sensor of angle."""
    time_base: float = 0.0
    """Relative standard uncertainty of the clock that samples it [1]."""

    def __post_init__(self) -> None:
        whose = f"instrument '{self.name}': " if self.name else ""
        for f in fields(SensorSpecification):
            if f.name == "name":
                continue
            value = getattr(self, f.name)
            least = -math.inf if f.name in _SIGNED else 0.0
            if not (math.isfinite(value) and value >= least):
                raise ModelError(
                    f"{whose}{f.name} of a sensor must be 0 or more and finite, got {value!r}"
                )
        if not self.alignment < 0.5:
            raise ModelError(
                f"{whose}alignment is an angle in rad and small, got {self.alignment!r}: below 0.5 "
                "is allowed"
            )
