"""Limits of the commands to an axis, from the description of the stage."""

import math
from dataclasses import dataclass

from flexstage.base.errors import ModelError
from flexstage.stage.drive import PiezoStack, Screw
from flexstage.stage.model import Stage

Range = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisLimits:
    """Limits of the commands to one axis."""

    position: Range | None = None
    """Lowest and highest position [m]; not checked where not given."""
    voltage: Range | None = None
    """Lowest and highest voltage [V]; None for a drive without voltage."""
    speed: float | None = None
    """Largest speed [m/s]."""
    slew: float | None = None
    """Largest rate of the voltage [V/s]."""
    safe_voltage: float = 0.0
    """Voltage to which a ramp leads when motion ends [V]."""

    def __post_init__(self) -> None:
        for name in ("position", "voltage"):
            bounds = getattr(self, name)
            if bounds is not None and not bounds[0] < bounds[1]:
                raise ModelError(f"the {name} range of an axis must rise, got {bounds!r}")
        for name in ("speed", "slew"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise ModelError(f"the largest {name} must be positive and finite, got {value!r}")

    def within(self, other: "AxisLimits") -> "AxisLimits":
        """Return the narrower of two limits, with the safe voltage of these within the range."""
        voltage = _common(self.voltage, other.voltage, "voltage")
        safe = self.safe_voltage
        if voltage is not None:
            safe = min(max(safe, voltage[0]), voltage[1])
        return AxisLimits(
            position=_common(self.position, other.position, "position"),
            voltage=voltage,
            speed=_smaller(self.speed, other.speed),
            slew=_smaller(self.slew, other.slew),
            safe_voltage=safe,
        )


def stage_limits(stage: Stage, axis: str) -> AxisLimits:
    """Return the limits of one axis by the description of its stage.

    Voltage range and slew of a stack, travel and speed of a screw. The position of a piezo stage is
    measured at its platform, and not limited by the data of its drive.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> stage_limits(design("vgtu-piezo"), "x").voltage
    (0.0, 120.0)
    """
    drive = stage.drive_of(axis)
    if isinstance(drive, PiezoStack):
        low, high = drive.voltage_range or (0.0, 0.0)
        safe = min(max(0.0, low), high)
        return AxisLimits(voltage=drive.voltage_range, slew=drive.largest_slew, safe_voltage=safe)
    if isinstance(drive, Screw):
        return AxisLimits(position=(0.0, drive.travel), speed=drive.largest_speed)
    return AxisLimits()


def _common(a: Range | None, b: Range | None, what: str) -> Range | None:
    if a is None or b is None:
        return a or b
    low, high = max(a[0], b[0]), min(a[1], b[1])
    if not low < high:
        raise ModelError(
            f"the stage allows a {what} of {a[0]:g} to {a[1]:g}, the controller {b[0]:g} to "
            f"{b[1]:g}: the ranges do not overlap, so one of them describes another stage"
        )
    return low, high


def _smaller(a: float | None, b: float | None) -> float | None:
    limits = [v for v in (a, b) if v is not None]
    return min(limits) if limits else None
