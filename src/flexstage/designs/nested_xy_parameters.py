"""The dimensions of a nested, decoupled XY stage with symmetric levers."""

from dataclasses import dataclass, field
from typing import Annotated

from flexstage.designs.actuator import ScrewActuator, StackActuator, VoiceCoil
from flexstage.errors import StageError
from flexstage.material import CATALOGUE, Material
from flexstage.units import DIMENSIONS

__all__ = ["AxisParameters", "NestedXYParameters"]

Length = Annotated[float, DIMENSIONS["length"]]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisParameters:
    """The dimensions of one axis; both halves of an axis are alike.

    Parameters
    ----------
    lever_arm_input : float
        Distance a from the fulcrum to the input notch, along the lever [m].
    lever_arm_output : float
        Distance b from the fulcrum to the link, along the lever [m].
    input_position : float
        Distance of the input notches from the line of symmetry [m].
    lever_width : float
        Width of the lever, across its length [m].
    lever_edge : float
        How far levers and input block reach beyond the roots of their outermost notches [m]; half
        of it at the input notch if that is the innermost one of the lever.
    lever_notch_radius : float
        Radius r of the notches of lever and link [m].
    lever_neck : float
        Neck thickness of the notches of lever and link [m].
    link_length : float
        Length of the bar between the two notches of a link [m].
    link_recess : float
        Depth of the recess of the platform in which a link ends [m].
    leg_position : float
        Distance of the guide legs from the left and the right edge of the platform [m].
    leg_bar_length : float
        Length of the bar between the two notches of a guide leg [m].
    leg_notch_radius : float
        Radius of the notches of the guide legs [m].
    leg_neck : float
        Neck thickness of the notches of the guide legs [m].
    input_block_length : float
        Length of the input block along the motion [m].
    actuator_pocket_length : float
        Distance between the faces that the drive pushes and stands on [m]; equal to the slot for a
        screw that comes through the wall, the length of the stack for a stack.
    actuator_pocket_width : float
        Width of the pocket [m].
    actuator : ScrewActuator or StackActuator or VoiceCoil
        What drives the axis.

    Raises
    ------
    StageError
        A dimension is not positive and finite.
    """

    lever_arm_input: Length
    lever_arm_output: Length
    input_position: Length
    lever_width: Length
    lever_edge: Length = 1e-3
    lever_notch_radius: Length
    lever_neck: Length
    link_length: Length
    link_recess: Length
    leg_position: Length
    leg_bar_length: Length
    leg_notch_radius: Length
    leg_neck: Length
    input_block_length: Length
    actuator_pocket_length: Length
    actuator_pocket_width: Length = 9e-3
    actuator: ScrewActuator | StackActuator | VoiceCoil

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if name != "actuator":
                require_positive(name, getattr(self, name))


@dataclass(frozen=True, slots=True, kw_only=True)
class NestedXYParameters:
    """The dimensions of a nested XY stage, see `flexstage.designs.nested_xy.nested_xy`.

    Parameters
    ----------
    x, y : AxisParameters
        The axes; the y axis lies inside the platform of the x axis.
    platform_length : float
        Length of the y platform, along y [m].
    platform_height : float
        Height of the y platform across its motion, along x [m].
    aperture_diameter : float, optional
        Diameter of the central aperture of the y platform [m]; no aperture where None.
    aperture_offset : float
        Distance of the aperture, and of the probes, from the middle of the y platform, along y [m].
    platform_wall : float
        Thickness of the x platform around the window of the y axis: above and to the right [m].
    platform_wall_below : float
        The same on the side where the y drive stands [m].
    platform_wall_at_recess : float
        The same on the left, from the bottom of the recesses of the x links [m].
    frame_wall : float
        Thickness of the frame around its window [m].
    mounting_hole_diameter : float
        Diameter of the nine holes by which the frame is bolted down [m].
    mounting_hole_station : float
        Distance of the two holes in the left wall from the middle, over half of the frame's
        height [1].
    slot : float
        Width of the slots between bodies [m].
    force_patch_half_width : float
        Half of the width over which the drives spread their force [m].
    thickness : float
        Thickness of the plate [m].
    material : Material
        What it is cut from.

    Raises
    ------
    StageError
        A dimension is not positive and finite, or the holes do not fit into the frame.
    """

    x: AxisParameters
    y: AxisParameters
    platform_length: Length
    platform_height: Length
    aperture_diameter: Length | None = None
    aperture_offset: Length = 0.0
    platform_wall: Length
    platform_wall_below: Length
    platform_wall_at_recess: Length
    frame_wall: Length
    mounting_hole_diameter: Length = 5.5e-3
    mounting_hole_station: float = 0.42
    slot: Length = 1e-3
    force_patch_half_width: Length = 3e-3
    thickness: Length = 10e-3
    material: Material = field(default_factory=lambda: CATALOGUE["Al 7075-T6"])

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if name not in {"x", "y", "material", "aperture_offset"} and value is not None:
                require_positive(name, value)
        if not abs(self.aperture_offset) < float("inf"):
            raise StageError(f"aperture_offset must be finite, got {self.aperture_offset!r} m")
        if not self.mounting_hole_station < 1.0:
            raise StageError(
                f"mounting_hole_station must be under 1, got {self.mounting_hole_station!r}"
            )
        if not self.mounting_hole_diameter < self.frame_wall:
            raise StageError(
                f"mounting_hole_diameter must be under the frame_wall of "
                f"{self.frame_wall * 1e3:.6g} mm, got {self.mounting_hole_diameter * 1e3:.6g} mm"
            )


def require_positive(name: str, value: float) -> None:
    """Refuse a dimension that is not positive and finite.

    Parameters
    ----------
    name : str
        Name of the parameter.
    value : float
        Its value [SI].

    Raises
    ------
    StageError
        It is not.
    """
    if not 0.0 < value < float("inf"):
        raise StageError(f"{name} must be positive and finite, got {value!r}")
