"""Dimensions that designs have in which a drive lies in a pocket of the plate."""

from dataclasses import dataclass, field

from flexstage.designs.pieces import Leg, PlateParameters, at_least
from flexstage.files.ranges import Size
from flexstage.hinges import CornerFilleted
from flexstage.stage.drive import AnyActuator, StackActuator

# what the data sheets of co-fired stacks come to: 0.1 % of the length, and 900 N when held on 5 mm
# by 5 mm, which is a modulus of 36 GPa
_STRAIN = 1e-3
_BLOCKING_FORCE = 900.0


def round_stack(length: float) -> StackActuator:
    """Return a piezoelectric stack of 5 mm by 5 mm and a length [m], in round figures.

    Examples
    --------
    >>> stack = round_stack(36e-3)
    >>> round(stack.free_stroke * 1e6, 6), round(stack.stiffness / 1e6, 6)
    (36.0, 25.0)
    """
    stroke = _STRAIN * length
    return StackActuator(
        free_stroke=stroke,
        stiffness=_BLOCKING_FORCE / stroke,
        blocking_force=_BLOCKING_FORCE,
        voltage_range=(0.0, 120.0),
    )


def round_leaf(length: float) -> Leg:
    """Return a leaf of a length [m], 0.4 mm thick, with fillets of 0.5 mm."""
    return Leg(
        notch=CornerFilleted(neck_thickness=0.4e-3, notch_length=length, fillet_radius=0.5e-3)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DrivenPlateParameters(PlateParameters):
    """The dimensions of a plate with a drive in a pocket."""

    actuator: AnyActuator = field(default_factory=lambda: round_stack(20e-3))
    """What drives it, each axis or leg by one."""
    actuator_length: Size = 20e-3
    """Distance between the two faces that a drive pushes apart [m]."""
    actuator_width: Size = 7e-3
    """Width of the room for a drive [m]."""
    edge: Size = 1e-3
    """How far bodies reach beyond the roots of their outermost hinges [m]."""
    slot: Size = 1e-3
    """Width of the slots between bodies [m]."""
    frame_wall: Size = 10e-3
    """Thickness of the base around what moves [m]."""

    def __post_init__(self) -> None:
        PlateParameters.__post_init__(self)
        self._below("mounting_hole_diameter", "frame_wall")


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedPlateParameters(DrivenPlateParameters):
    """The dimensions of a driven plate with a block that legs guide on two of its sides."""

    guide: Leg = field(default_factory=lambda: round_leaf(16e-3))
    """The four legs or leaves that guide the block, two on a side."""
    guide_spacing: Size = 6e-3
    """Distance between the two legs on a side of the block [m]."""

    def __post_init__(self) -> None:
        DrivenPlateParameters.__post_init__(self)
        at_least(
            "guide_spacing",
            self.guide_spacing,
            self.guide.width + self.slot,
            "so that the two legs on a side keep a slot between them",
        )
