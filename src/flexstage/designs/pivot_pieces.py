"""What pivots on leaves have in common: dimensions, the leaves, the base with its drive."""

import math
from dataclasses import dataclass, field
from typing import Annotated

from flexstage.designs.pieces import (
    WIRE,
    Pair,
    PlateParameters,
    bolt_holes,
    cut_apart,
    fine_screw,
    plate,
    pushing,
    two_sided,
)
from flexstage.files.ranges import Range, Size
from flexstage.hinges import CornerFilleted, Profile
from flexstage.stage import Body, Hinge, Loop, Probe, Stage
from flexstage.stage.drive import AnyActuator
from flexstage.units import Angle


@dataclass(frozen=True, slots=True, kw_only=True)
class PivotParameters(PlateParameters):
    """The dimensions of a pivot on leaves whose lines meet in its centre."""

    leaf: Profile = field(
        default_factory=lambda: CornerFilleted(
            neck_thickness=0.35e-3, notch_length=14e-3, fillet_radius=0.7e-3
        )
    )
    """Its leaves, all alike."""
    half_angle: Annotated[Angle, Range(low=0.3, high=1.15)] = 0.25 * math.pi
    """Angle of the leaves against the line of symmetry [rad]."""
    centre_distance: Size = 3e-3
    """Distance of the near ends of the leaves from the centre [m]."""
    overhang: Size = 3e-3
    """How far bodies reach beyond their leaves [m]."""
    wall: Size = 10e-3
    """Thickness of base and arm behind their leaves [m]."""
    column_width: Size = 10e-3
    """Width of the column of the base that holds the drive [m]."""
    actuator: AnyActuator = field(default_factory=lambda: fine_screw(500e-6))
    """What turns the pivot."""
    actuator_length: Size = 2e-3
    """Distance between column and arm [m]."""

    def __post_init__(self) -> None:
        PlateParameters.__post_init__(self)
        two_sided(self.leaf, "a pivot")
        self._below("mounting_hole_diameter", "wall")
        cut_apart(self, "actuator_length")
        sine, cosine = math.sin(self.half_angle), math.cos(self.half_angle)
        room = 0.5 * (self.leaf.root_height * cosine + WIRE) / sine
        self._at_least("centre_distance", room, "for two leaves side by side")
        near = faces(self, self.radius)[1][0] + self.actuator_length
        room = 0.5 * self.wall + self.mounting_hole_diameter - near
        self._at_least("column_width", room, "so that two bolts have room")

    @property
    def reach(self) -> float:
        """Half of the width of the faces from which the leaves grow [m]."""
        return 0.5 * self.leaf.root_height + self.overhang

    @property
    def radius(self) -> float:
        """Distance of the far ends of the leaves from the centre [m]."""
        return self.centre_distance + self.leaf.length


def faces(p: PivotParameters, radius: float) -> tuple[Pair, Pair]:
    """Return the lower tip between two faces across the leaves, and the right one's upper end.

    The leaves go down from the centre, in the origin; the faces are at a distance `radius` from it.
    """
    s, c = math.sin(p.half_angle), math.cos(p.half_angle)
    return (0.0, -radius / c), (radius * s + p.reach * c, -radius * c + p.reach * s)


def base(p: PivotParameters, top: float) -> Body:
    """Return the base under a pivot with a column on the right, which reaches up to `top`."""
    tip, (x, y) = faces(p, p.radius)
    near, bottom = x + p.actuator_length, tip[1] - p.wall
    far = near + p.column_width
    outline = [tip, (x, y), (near, y), (near, top), (far, top), (far, bottom)]
    outline += [(-far, bottom), (-far, y), (-x, y)]
    inset = 0.5 * p.wall
    holes = bolt_holes(
        ((sx, bottom + inset) for sx in (inset - far, far - inset)),
        p.mounting_hole_diameter,
    )
    return Body(name="base", outline=Loop(tuple(outline)), mounting_holes=holes, fixed=True)


def leaf(p: PivotParameters, name: str, bodies: tuple[str, str], side: float) -> Hinge:
    """Return a leaf that goes down from its first body, to the right where `side` is 1."""
    distance = p.centre_distance + 0.5 * p.leaf.length
    angle = side * p.half_angle
    return Hinge(
        name=name,
        bodies=bodies,
        at=(distance * math.sin(angle), -distance * math.cos(angle)),
        direction=angle - 0.5 * math.pi,
        profile=p.leaf,
    )


def pivot(
    p: PivotParameters, arm: Body, others: tuple[Body, ...], leaves: tuple[Hinge, ...]
) -> Stage:
    """Return a pivot whose drive pushes the right side of its ``arm``, to turn it to the left."""
    right = max(x for x, _ in arm.outline.points)
    top = max(y for _, y in arm.outline.points)
    bottom = min(y for x, y in arm.outline.points if x == right)
    height = 0.5 * (max(bottom, 0.0) + top)
    drive = pushing(
        p, "theta", arm.name, ((right, height), (right + p.actuator_length, height)), math.pi
    )
    return plate(
        p,
        "pivot",
        "",
        bodies=(base(p, top), *others, arm),
        hinges=leaves,
        drives=(drive,),
        probes=(Probe(name="theta", body=arm.name, at=(0.8 * right, height), reads="rotation"),),
    )
