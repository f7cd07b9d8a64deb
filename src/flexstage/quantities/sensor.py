"""Specification of a sensor and its position relative to the axis."""

import math
from dataclasses import dataclass, fields
from typing import Annotated

from flexstage.base.errors import ModelError
from flexstage.quantities.units import DIMENSIONS, Length

#: Fields that may be negative.
_SIGNED = frozenset(("abbe_offset", "expansion"))


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorSpecification:
    """Specification of a sensor, its position and its errors.

    Raises
    ------
    ModelError
        A value is negative or not finite; offset and expansion may be negative.

    Examples
    --------
    >>> SensorSpecification(calibration=3e-4, alignment=5e-3).alignment
    0.005
    """

    name: str = ""
    """Name, if there are several sensors."""
    calibration: float = 0.0
    """Relative standard uncertainty of its gain [1]."""
    nonlinearity: float = 0.0
    """Half-width of its deviation from a straight line, relative to the range in use [1]."""
    alignment: Annotated[float, DIMENSIONS["angle"]] = 0.0
    """Standard uncertainty of the angle between sensor and axis [rad]."""
    abbe_offset: Length = 0.0
    """Abbe offset: distance from the sensor line to the point of interest, positive where a
    positive pitch adds to the reading [m].
    """
    abbe_uncertainty: Length = 0.0
    """Standard uncertainty of the Abbe offset [m]."""
    temperature_uncertainty: float = 0.0
    """Standard uncertainty of the change of temperature within a record [K]."""
    expansion: Annotated[float, DIMENSIONS["expansion"]] = 0.0
    """Coefficient of thermal expansion of the sensor mount [1/K]."""
    length_of_loop: Length = 0.0
    """Length of the metrology loop from sensor to target [m]."""
    drift: float = 0.0
    """Standard uncertainty of the residual drift rate [m/s], or [rad/s]."""
    resolution_step: Length = 0.0
    """Resolution of the reading [m], or [rad] for an angle sensor."""
    time_base: float = 0.0
    """Relative standard uncertainty of the sampling clock [1]."""

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
                f"{whose}alignment is an angle in rad and must be below 0.5, got {self.alignment!r}"
            )
