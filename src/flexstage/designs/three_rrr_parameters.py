"""The dimensions of a 3-RRR stage."""

import math
from dataclasses import dataclass, field

from flexstage.designs.driven_plate import DrivenPlateParameters
from flexstage.designs.pieces import at_least, at_most, two_sided
from flexstage.files.ranges import Size
from flexstage.hinges import Profile, RightCircular


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreeRRRParameters(DrivenPlateParameters):
    """The dimensions of a 3-RRR stage; its three legs are alike."""

    link_distance: Size = 16e-3
    """Distance of the links' lines from the centre of the platform [m]."""
    link_position: Size = 2e-3
    """Distance of a link's neck at the platform from the foot of the perpendicular on its line, in
    the direction of the link [m].
    """
    link_length: Size = 10e-3
    """Distance between the two necks of a link [m]."""
    lever_length: Size = 14e-3
    """Distance of the fulcrum from the line of the link [m]."""
    lever_width: Size = 7e-3
    """Width of a lever [m]."""
    input_arm: Size = 5e-3
    """Distance of the fulcrum from the line of the drive [m]."""
    tab_width: Size = 6e-3
    """Width of the tabs of the platform that the links pull at [m]."""
    notch: Profile = field(
        default_factory=lambda: RightCircular(neck_thickness=0.4e-3, radius=1e-3)
    )
    """The notches."""

    def __post_init__(self) -> None:
        DrivenPlateParameters.__post_init__(self)
        two_sided(self.notch, "a leg")
        r, root = 0.5 * self.notch.length, self.notch.root_height
        tab = self.link_position - r - self.tab_width
        width, slot = self.actuator_width, self.slot
        at_least("link_length", self.link_length, 2.0 * r + slot, "so that a link has a bar")
        at_least("lever_width", self.lever_width, root, "so that the fulcrum grows from its end")
        at_least(
            "input_arm",
            self.input_arm,
            0.5 * width - r,
            "so that the drive keeps off the ring at the fulcrum",
        )
        at_least(
            "lever_length",
            self.lever_length,
            self.input_arm + 0.5 * (width + root) + self.edge + slot,
            "so that the drive passes below the tab of the platform",
        )
        at_least(
            "link_distance",
            self.link_distance,
            0.5 * root + slot - math.sqrt(3.0) * tab,
            "so that the tabs stand on the sides of the platform",
        )
        at_most(
            "link_distance",
            self.link_distance,
            math.sqrt(3.0) * (self.lever_side - slot) + 0.5 * root + slot,
            "so that the corners of the platform keep a slot from the levers",
        )
        # the wall that a drive stands on ends where it meets the slot along the platform
        covers = 2.0 * (self.apothem + slot) + self.input_arm - self.lever_length
        covers += self.force_patch_half_width - self.link_distance
        at_least(
            "actuator_length",
            self.actuator_length,
            self.lever_side + max(slot - tab, covers / math.sqrt(3.0)),
            "so that the ring keeps a slot from the tab beside it, and reaches up to the drive",
        )
        at_most(
            "actuator_length",
            self.actuator_length,
            self.lever_side + (self.apothem + slot) * math.sqrt(0.75),
            "so that the ring reaches between the drive and the next leg",
        )

    @property
    def apothem(self) -> float:
        """Distance of the sides of the platform from its centre [m]."""
        return self.link_distance - 0.5 * self.notch.root_height - self.slot

    @property
    def lever_side(self) -> float:
        """Position of the side of a lever that drive and link lie on [m]."""
        return self.link_position + self.link_length + 0.5 * self.notch.length
