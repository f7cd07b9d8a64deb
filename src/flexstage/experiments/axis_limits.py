"""Limits of the commands of an axis."""

from dataclasses import dataclass

from flexstage.base.choose import has_no
from flexstage.base.errors import PlanError
from flexstage.instruments.protocol import Quantity
from flexstage.stage import PiezoStack, Screw, Stage
from flexstage.stage.limits import AxisLimits, stage_limits
from flexstage.virtual.as_built import platform_stroke


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisSetting:
    """Limits of the commands of an axis."""

    axis: str
    """The axis."""
    quantity: Quantity
    """Commanded quantity."""
    low: float
    """Low end of the range [V or m]."""
    high: float
    """High end of the range [V or m]."""
    largest_rate: float | None = None
    """Largest slew or speed [V/s or m/s]."""
    smallest_step: float | None = None
    """Smallest step of a screw [m]."""
    capacitance: float | None = None
    """Capacitance of a stack [F]."""
    natural_frequency_hz: float | None = None
    """Lowest natural frequency with the drives in place [Hz]."""
    estimated: bool = False
    """Whether the range is only estimated, without an instrument."""

    def place(self, share: float) -> float:
        """Return the value at a fraction of the range."""
        # both ends are exact
        return self.high if share == 1.0 else self.low + share * (self.high - self.low)


def axis_setting(
    stage: Stage,
    axis: str,
    *,
    closed_loop: bool = False,
    limits: AxisLimits | None = None,
    natural_frequency_hz: float | None = None,
) -> AxisSetting:
    """Return the limits of an axis: those of an instrument, or else those of the stage.

    A piezo axis in closed loop is commanded by position, and a screw always.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> setting = axis_setting(design("vgtu-mechanical"), "x")
    >>> setting.quantity, f"{1e6 * setting.high:.0f} um"
    ('position', '350 um')
    """
    # clearance of commands at each end of an estimated stroke, over the stroke
    clearance = 0.03
    names = [a.name for a in stage.axes]
    if axis not in names:
        raise PlanError(has_no(f"the stage {stage.name}", "axis", axis, names))
    drive = stage.drive_of(axis)
    allowed = limits if limits is not None else stage_limits(stage, axis)
    screw = isinstance(drive, Screw)
    if screw or closed_loop:
        bounds, rate, estimated = allowed.position, allowed.speed, False
        if bounds is None:
            stroke = estimated_stroke(stage, axis)
            bounds, estimated = (clearance * stroke, (1.0 - clearance) * stroke), True
        quantity: Quantity = "position"
    else:
        bounds, rate, quantity, estimated = allowed.voltage, allowed.slew, "voltage", False
    if bounds is None:
        raise PlanError(
            f"axis '{axis}' of {stage.name} is driven by a {drive.kind} whose range is unknown: "
            "give it in the stage file"
        )
    return AxisSetting(
        axis=axis,
        quantity=quantity,
        low=bounds[0],
        high=bounds[1],
        largest_rate=rate,
        smallest_step=drive.smallest_step if isinstance(drive, Screw) else None,
        capacitance=drive.capacitance if isinstance(drive, PiezoStack) else None,
        natural_frequency_hz=natural_frequency_hz,
        estimated=estimated,
    )


def estimated_stroke(stage: Stage, axis: str) -> float:
    """Return the stroke of an axis at the platform: published, or else of the lumped model.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> print(f"{1e6 * estimated_stroke(design('vgtu-piezo'), 'x'):.2f} um")
    63.12 um
    """
    stroke = platform_stroke(stage, axis)
    if stroke is None:
        raise PlanError(f"the drive of axis '{axis}' of {stage.name} has no stroke: give one")
    return stroke


def lowest_frequency(stage: Stage) -> float | None:
    """Return the lowest natural frequency with the drives in place, of the lumped model."""
    from flexstage.lumped import lumped_system
    from flexstage.system import modes

    lowest = float(modes(lumped_system(stage), drives="in place", count=1).frequency_hz[0])
    return lowest if lowest > 0.0 else None
