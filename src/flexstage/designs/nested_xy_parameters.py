"""The dimensions of a nested, decoupled XY stage with symmetric levers."""

from dataclasses import dataclass, field
from typing import Annotated

from flexstage.errors import StageError
from flexstage.files.ranges import INNER_SHARE, Range, Size, require_ranges
from flexstage.material import CATALOGUE, Material
from flexstage.stage.drive import AnyActuator
from flexstage.units import Length


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisParameters:
    """The dimensions of one axis; both halves of an axis are alike."""

    lever_arm_input: Size
    """Distance a from the fulcrum to the input notch, along the lever [m]."""
    lever_arm_output: Size
    """Distance b from the fulcrum to the link, along the lever [m]."""
    input_position: Size
    """Distance of the input notches from the line of symmetry [m]."""
    lever_width: Size
    """Width of the lever, across its length [m]."""
    lever_edge: Size = 1e-3
    """How far levers and input block reach beyond the roots of their outermost notches [m]; half of
    it at the input notch if that is the innermost one of the lever.
    """
    lever_notch_radius: Size
    """Radius r of the notches of lever and link [m]."""
    lever_neck: Size
    """Neck thickness of the notches of lever and link [m]."""
    link_length: Size
    """Length of the bar between the two notches of a link [m]."""
    link_recess: Size
    """Depth of the recess of the platform in which a link ends [m]."""
    leg_position: Size
    """Distance of the guide legs from the left and the right edge of the platform [m]."""
    leg_bar_length: Size
    """Length of the bar between the two notches of a guide leg [m]."""
    leg_notch_radius: Size
    """Radius of the notches of the guide legs [m]."""
    leg_neck: Size
    """Neck thickness of the notches of the guide legs [m]."""
    input_block_length: Size
    """Length of the input block along the motion [m]."""
    actuator_pocket_length: Size
    """Distance between the faces that the drive pushes and stands on [m]; equal to the slot for a
    screw that comes through the wall, the length of the stack for a stack.
    """
    actuator_pocket_width: Size = 9e-3
    """Width of the pocket [m]."""
    actuator: AnyActuator
    """What drives the axis."""

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "an axis")


@dataclass(frozen=True, slots=True, kw_only=True)
class NestedXYParameters:
    """The dimensions of a nested XY stage, see `flexstage.designs.nested_xy.nested_xy`."""

    x: AxisParameters
    """The outer axis."""
    y: AxisParameters
    """The inner axis; it lies inside the platform of the x axis."""
    platform_length: Size
    """Length of the y platform, along y [m]."""
    platform_height: Size
    """Height of the y platform across its motion, along x [m]."""
    aperture_diameter: Size | None = None
    """Diameter of the central aperture of the y platform [m]; no aperture where None."""
    aperture_offset: Annotated[Length, Range()] = 0.0
    """Distance of the aperture, and of the probes, from the middle of the y platform, along y [m].
    """
    platform_wall: Size
    """Thickness of the x platform around the window of the y axis: above and to the right [m]."""
    platform_wall_below: Size
    """The same on the side where the y drive stands [m]."""
    platform_wall_at_recess: Size
    """The same on the left, from the bottom of the recesses of the x links [m]."""
    frame_wall: Size
    """Thickness of the frame around its window [m]."""
    mounting_hole_diameter: Size = 5.5e-3
    """Diameter of the nine holes by which the frame is bolted down [m]."""
    mounting_hole_station: Annotated[float, INNER_SHARE] = 0.42
    """Distance of the two holes in the left wall from the middle, over half of the frame's height
    [1].
    """
    slot: Size = 1e-3
    """Width of the slots between bodies [m]."""
    force_patch_half_width: Size = 3e-3
    """Half of the width over which the drives spread their force [m]."""
    thickness: Size = 10e-3
    """Thickness of the plate [m]."""
    material: Material = field(default_factory=lambda: CATALOGUE["Al 7075-T6"])
    """What it is cut from."""

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "a nested XY stage")
        if not self.mounting_hole_diameter < self.frame_wall:
            raise StageError(
                f"mounting_hole_diameter must be under the frame_wall of "
                f"{self.frame_wall * 1e3:.6g} mm, got {self.mounting_hole_diameter * 1e3:.6g} mm"
            )
