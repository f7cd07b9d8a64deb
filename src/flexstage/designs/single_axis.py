"""A guide for one axis, as a part of stages of two: which one, and its dimensions."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from flexstage.designs.double_parallelogram import (
    DoubleParallelogramParameters,
    double_parallelogram,
)
from flexstage.designs.parallelogram import ParallelogramParameters, parallelogram
from flexstage.designs.pieces import Leg, PlateParameters, fine_screw
from flexstage.errors import StageError
from flexstage.files.ranges import Size, require_ranges
from flexstage.hinges import RightCircular
from flexstage.stage import Body, Stage
from flexstage.stage.drive import AnyActuator


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleAxisParameters:
    """The dimensions of a guide for one axis, whose drive pushes its platform itself.

    Raises
    ------
    StageError
        A dimension is not positive and finite.
    """

    guide: Literal["parallelogram", "double-parallelogram"] = "parallelogram"
    """Which guide it is."""
    leg: Leg = field(
        default_factory=lambda: Leg(
            notch=RightCircular(neck_thickness=0.5e-3, radius=2e-3), bar_length=26e-3
        )
    )
    """Its legs; each is a bar between two notches, or a leaf."""
    leg_spacing: Size = 40e-3
    """Distance between legs [m]."""
    platform_height: Size = 40e-3
    """Height of the platform across its motion [m]."""
    actuator_length: Size = 2e-3
    """Distance between the platform and what the drive stands on [m]."""
    actuator: AnyActuator = field(default_factory=lambda: fine_screw(200e-6))
    """What drives the axis."""

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "a guide")

    def build(self, plate: PlateParameters) -> Stage:
        """Build the guide alone, as a part of a plate: its axis is x, its platform ``platform``."""
        given: dict[str, Any] = {
            **{f.name: getattr(plate, f.name) for f in fields(PlateParameters)},
            **{f.name: getattr(self, f.name) for f in fields(self) if f.name != "guide"},
        }
        if self.guide == "parallelogram":
            return parallelogram(ParallelogramParameters(**given))
        return double_parallelogram(DoubleParallelogramParameters(**given))


def names_of_axis(guide: Stage, axis: str, bodies: Mapping[str, str]) -> dict[str, str]:
    """Return new names for all that a guide of the axis x consists of.

    Its drive, probe and axis are called by the axis, as ``y``; what is left of its bodies and its
    hinges has it before its name, as ``y-left-leg``.
    """
    parts = [part.name for part in (*guide.bodies, *guide.hinges)]
    return {**{name: f"{axis}-{name}" for name in parts}, "x": axis, **bodies}


def base_of(guide: Stage) -> Body:
    """Return the body of a guide that is held."""
    return next(body for body in guide.bodies if body.fixed)


def extent(guide: Stage) -> tuple[float, float, float, float]:
    """Return the smallest and the largest x and y of the outlines of a stage [m]."""
    x0, y0, x1, y1 = zip(*(body.outline.bounds() for body in guide.bodies), strict=True)
    return min(x0), min(y0), max(x1), max(y1)
