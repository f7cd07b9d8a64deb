"""A parallelogram guide: a platform on two legs of notches or leaves, as a family of stages."""

import math
from dataclasses import dataclass, field

from flexstage.designs.parameters import Topology
from flexstage.designs.pieces import (
    WIRE,
    Leg,
    PlateParameters,
    at_most,
    block,
    bolt_holes,
    cut_apart,
    fine_screw,
    plate,
    pushing,
)
from flexstage.files.ranges import Size
from flexstage.hinges import RightCircular
from flexstage.stage import Body, Loop, Probe, Stage
from flexstage.stage.drive import AnyActuator


@dataclass(frozen=True, slots=True, kw_only=True)
class ParallelogramParameters(PlateParameters):
    """The dimensions of a parallelogram guide."""

    leg_spacing: Size = 40e-3
    """Distance between the two legs [m]."""
    leg: Leg = field(
        default_factory=lambda: Leg(
            notch=RightCircular(neck_thickness=0.5e-3, radius=2e-3), bar_length=26e-3
        )
    )
    """The two legs; each is a bar between two notches, or a leaf."""
    platform_overhang: Size = 4e-3
    """How far the platform reaches beyond the legs, on both sides [m]."""
    platform_height: Size = 12e-3
    """Height of the platform across its motion [m]."""
    base_height: Size = 15e-3
    """Height of the base under the legs [m]."""
    column_width: Size = 12e-3
    """Width of the column of the base that holds the drive [m]."""
    actuator_length: Size = 2e-3
    """Distance between column and platform [m]."""
    actuator: AnyActuator = field(default_factory=lambda: fine_screw(200e-6))
    """What drives the guide."""

    def __post_init__(self) -> None:
        PlateParameters.__post_init__(self)
        cut_apart(self, "actuator_length")
        slot = self.leg.width + WIRE
        self._at_least("leg_spacing", slot, "so that a slot is between the legs")
        bolts = 2.0 * self.mounting_hole_diameter
        beside = self.leg.width + 2.0 * (self.platform_overhang + self.actuator_length)
        hole = self.mounting_hole_diameter
        at_most("mounting_hole_diameter", hole, beside - WIRE, "so that the base reaches round it")
        self._at_least("leg_spacing", bolts, "for the bolts under the legs")
        self._below("mounting_hole_diameter", "base_height")


def parallelogram(p: ParallelogramParameters) -> Stage:
    """Build a parallelogram guide.

    A platform stands on two legs; each leg has a notch at either end, so that the platform moves
    along x, and by about d^2/(2 l) towards the base when it has moved by d on legs whose necks are
    l apart. The base carries a column, against which the drive pushes the platform. y = 0 is the
    top of the base, x = 0 the middle of the platform.

    A leaf takes the place of a leg without a bar. Leaves of length L that bend into an S take the
    platform towards the base by 3/5 d^2/L, and are 12 E I/L^3 stiff, each: S. Awtar, A. H. Slocum
    and E. Sevincer, Characteristics of beam-based flexure modules, J. Mech. Des. 129 (2007) 625.
    A leg of two notches is a link of two springs k of its necks: 2 k/l^2 each.

    Its bodies are ``base`` (fixed), ``left-leg``, ``right-leg`` (where they have bars) and
    ``platform``; its hinges ``left-lower``, ``left-upper``, ``right-lower`` and ``right-upper``, or
    ``left`` and ``right``; its drive, probe and axis ``x``.

    Examples
    --------
    >>> stage = parallelogram(ParallelogramParameters())
    >>> stage.hinge("left-upper").at
    (-0.02, 0.032)
    """
    platform_bottom = p.leg.length
    platform_top = platform_bottom + p.platform_height
    half_leg = 0.5 * p.leg.width
    half_platform = 0.5 * p.leg_spacing + half_leg + p.platform_overhang
    face = -half_platform - p.actuator_length
    left = face - p.column_width
    # as far on the other side, so that the two legs stand on equal ground
    right = -face
    base = Body(
        name="base",
        outline=Loop(
            (
                (left, -p.base_height),
                (right, -p.base_height),
                (right, 0.0),
                (face, 0.0),
                (face, platform_top),
                (left, platform_top),
            )
        ),
        mounting_holes=bolt_holes(
            ((sign * 0.5 * p.leg_spacing, -0.5 * p.base_height) for sign in (-1.0, 1.0)),
            p.mounting_hole_diameter,
        ),
        fixed=True,
    )
    legs, hinges = [], []
    for name, x in (("left", -0.5 * p.leg_spacing), ("right", 0.5 * p.leg_spacing)):
        bars, notches = p.leg.between(
            name, ("base", "platform"), (x, 0.0), math.pi / 2.0, ends=("lower", "upper")
        )
        legs += bars
        hinges += notches
    middle = 0.5 * (platform_bottom + platform_top)
    drive = pushing(p, "x", "platform", ((-half_platform, middle), (face, middle)), 0.0)
    return plate(
        p,
        "parallelogram",
        "Parallelogram guide",
        bodies=(
            base,
            *legs,
            block("platform", (-half_platform, platform_bottom), (half_platform, platform_top)),
        ),
        hinges=hinges,
        drives=(drive,),
        probes=(Probe(name="x", body="platform", at=(0.0, middle), direction=0.0),),
    )


PARALLELOGRAM = Topology(
    name="parallelogram",
    title="parallelogram guide on two legs of notches or leaves",
    source="S. T. Smith, Flexures: Elements of Elastic Mechanisms, Gordon and Breach, 2000; "
    "S. Awtar, A. H. Slocum, E. Sevincer, J. Mech. Des. 129 (2007) 625",
    parameters=ParallelogramParameters,
    construct=parallelogram,
)
