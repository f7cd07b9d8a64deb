"""A double parallelogram guide, or folded beam: two parallelograms in a row."""

import math
from dataclasses import dataclass, field

from flexstage.designs.parameters import Topology
from flexstage.designs.pieces import (
    WIRE,
    Leg,
    PlateParameters,
    block,
    bolt_holes,
    cut_apart,
    fine_screw,
    legs,
    plate,
    pushing,
    round_leaf,
)
from flexstage.files.ranges import Size
from flexstage.stage import Body, Drive, Hinge, Loop, Probe, Stage
from flexstage.stage.drive import AnyActuator


@dataclass(frozen=True, slots=True, kw_only=True)
class DoubleParallelogramParameters(PlateParameters):
    """The dimensions of a double parallelogram."""

    leg: Leg = field(default_factory=lambda: round_leaf(30e-3, 0.4e-3, 0.8e-3))
    """Its legs, all alike; each is a leaf, or a bar between two notches."""
    leg_spacing: Size = 24e-3
    """Distance between the two legs that carry the platform [m]."""
    overhang: Size = 4e-3
    """How far bodies reach beyond their legs [m]."""
    platform_height: Size = 14e-3
    """Height of the platform across its motion [m]."""
    secondary_height: Size = 8e-3
    """Height of the secondary stage, on which the legs turn back [m]."""
    clearance: Size = 1.5e-3
    """Width of the slots along what moves [m]."""
    wall: Size = 12e-3
    """Thickness of the base beyond the slots [m]."""
    actuator: AnyActuator = field(default_factory=lambda: fine_screw(1e-3))
    """What drives the guide."""
    actuator_length: Size = 3e-3
    """Distance between the base and the platform along the motion, on both sides [m]."""

    def __post_init__(self) -> None:
        PlateParameters.__post_init__(self)
        self._below("mounting_hole_diameter", "wall")
        cut_apart(self, "clearance", "actuator_length")
        slot = self.leg.width + WIRE
        self._at_least("leg_spacing", slot, "so that a slot is between the legs")

    @property
    def half_platform(self) -> float:
        """Half of the length of the platform [m]."""
        return 0.5 * (self.leg_spacing + self.leg.width) + self.overhang

    @property
    def face(self) -> float:
        """Distance of the base's two inner faces from the middle [m]."""
        return self.half_platform + self.actuator_length

    @property
    def outer(self) -> float:
        """Distance of the legs on the base from the middle [m]."""
        return self.face + self.overhang + 0.5 * self.leg.width

    @property
    def half_secondary(self) -> float:
        """Half of the length of the secondary stage [m]."""
        return self.outer + 0.5 * self.leg.width + self.overhang


def fold(p: DoubleParallelogramParameters, prefix: str = "") -> tuple[list[Body], list[Hinge]]:
    """Return a secondary stage and its four legs, which stand on y = 0.

    Their names begin with a `prefix`; the outer legs come from ``base``, the inner ones go to
    ``platform``.
    """
    secondary, top = f"{prefix}secondary", p.leg.length
    half = p.half_secondary
    rows = (("outer", p.outer, "base"), ("inner", 0.5 * p.leg_spacing, "platform"))
    bars, hinges = legs(
        p.leg,
        (
            (f"{prefix}{row}-{side}", (foot, secondary), (sign * x, 0.0), math.pi / 2.0)
            for row, x, foot in rows
            for side, sign in (("left", -1.0), ("right", 1.0))
        ),
    )
    return [block(secondary, (-half, top), (half, top + p.secondary_height)), *bars], hinges


def driven_platform(p: DoubleParallelogramParameters) -> tuple[Body, Drive, Probe]:
    """Return the platform below y = 0, what pushes it, and what reads it in its middle."""
    platform = block("platform", (-p.half_platform, -p.platform_height), (p.half_platform, 0.0))
    middle = -0.5 * p.platform_height
    drive = pushing(p, "x", "platform", ((-p.half_platform, middle), (-p.face, middle)), 0.0)
    return platform, drive, Probe(name="x", body="platform", at=(0.0, middle), direction=0.0)


def double_parallelogram(p: DoubleParallelogramParameters) -> Stage:
    r"""Build a double parallelogram guide.

    Two outer legs carry a secondary stage on the base, and two inner legs go back from there to
    the platform. Both parallelograms shorten alike as they move, so the platform, which moves twice
    as far as the secondary stage, goes straight::

         |          secondary           |
         ||        ||        ||        ||   leg.length
        base | actuator > platform |  base      - - y = 0
         |_____________________________|

    Leaves of length L with L/t of tens: the stiffness is 12 E I/L^3, of one leaf. Normalised by L,
    E I/L^2 and E I/L, with a = 12, e = 1.2, i = -0.6, r = 1/700 and d = 12 (L/t)^2, a load p across
    the motion gives the way across

    .. math:: x = p\,[1/d + y^2(r/4 - e\,i/(2a))] = p\,(1/d + 0.0304\,y^2),

    none without a load, and much where the platform has moved by a displacement y: the secondary
    stage, which nothing holds at half of y, gives way (S. Awtar, A. H. Slocum, E. Sevincer,
    Characteristics of beam-based flexure modules, J. Mech. Des. 129 (2007) 625). With legs of two
    notches k whose necks are l apart, a = 2, e = 1, i = -1/2, r = 0 by l, k/l and k:
    x = p (1/d + y^2/8), and the stiffness is 2 k/l^2.

    Its bodies are ``base`` (fixed), ``secondary``, ``platform`` and the bars of its legs
    ``outer-left``, ``outer-right``, ``inner-left`` and ``inner-right``; its drive, probe and axis
    ``x``. y = 0 is the top of base and platform, x = 0 the middle.

    Examples
    --------
    >>> stage = double_parallelogram(DoubleParallelogramParameters())
    >>> [h.name for h in stage.hinges]
    ['outer-left', 'outer-right', 'inner-left', 'inner-right']
    """
    bodies, hinges = fold(p)
    platform, drive, probe = driven_platform(p)
    half, floor = p.half_secondary, -p.platform_height - p.clearance
    bottom = floor - p.wall
    outline = Loop(
        (
            (-half, bottom),
            (half, bottom),
            (half, 0.0),
            (p.face, 0.0),
            (p.face, floor),
            (-p.face, floor),
            (-p.face, 0.0),
            (-half, 0.0),
        )
    )
    station = half - 0.5 * p.wall
    holes = bolt_holes(
        ((x, bottom + 0.5 * p.wall) for x in (-station, 0.0, station)), p.mounting_hole_diameter
    )
    base = Body(name="base", outline=outline, mounting_holes=holes, fixed=True)
    return plate(
        p,
        "double-parallelogram",
        "Double parallelogram guide",
        bodies=(base, *bodies, platform),
        hinges=hinges,
        drives=(drive,),
        probes=(probe,),
    )


TOPOLOGY = Topology(
    name="double-parallelogram",
    title="double parallelogram guide (folded beam): goes straight, on notches or leaves",
    source="S. Awtar, A. H. Slocum, E. Sevincer, Characteristics of beam-based flexure modules, "
    "J. Mech. Des. 129 (2007) 625",
    parameters=DoubleParallelogramParameters,
    construct=double_parallelogram,
)
