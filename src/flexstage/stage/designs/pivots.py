"""Pivots on leaves: the Cartwheel, whose leaves meet in a hub, and the trapezoidal one."""

import math
from dataclasses import dataclass, field, replace
from typing import Annotated

from flexstage.base.errors import StageError
from flexstage.files.ranges import Range, Size
from flexstage.hinges import CornerFilleted, Profile
from flexstage.quantities.units import Angle
from flexstage.stage import Body, Hinge, Loop, PlaneMotion, Probe, Stage, moved
from flexstage.stage.designs.parameters import Topology
from flexstage.stage.designs.pieces import (
    WIRE,
    Pair,
    PlateParameters,
    at_least,
    bolt_holes,
    cut_apart,
    fine_screw,
    plate,
    pushing,
    two_sided,
)
from flexstage.stage.drive import AnyActuator
from flexstage.stage.model import millimetres


@dataclass(frozen=True, slots=True, kw_only=True)
class PivotParameters(PlateParameters):
    """The dimensions of a pivot on leaves whose lines meet in its centre."""

    leaf: Profile = field(
        default_factory=lambda: CornerFilleted(
            neck_thickness=0.35e-3, notch_length=14e-3, fillet_radius=0.7e-3
        )
    )
    """Equal leaves."""
    half_angle: Annotated[Angle, Range(low=0.3, high=1.15)] = 0.25 * math.pi
    """Angle of the leaves against the line of symmetry [rad]."""
    centre_distance: Size = 3e-3
    """Distance of the near ends of the leaves from the centre [m]."""
    overhang: Size = 3e-3
    """Overhang of bodies beyond their leaves [m]."""
    wall: Size = 10e-3
    """Thickness of base and arm behind their leaves [m]."""
    column_width: Size = 10e-3
    """Width of the column of the base that holds the drive [m]."""
    actuator: AnyActuator = field(default_factory=lambda: fine_screw(500e-6))
    """Actuator of the pivot."""
    actuator_length: Size = 2e-3
    """Distance between column and arm [m]."""

    def __post_init__(self) -> None:
        PlateParameters.__post_init__(self)
        two_sided(self.leaf, "a pivot")
        self._holes_within("wall")
        cut_apart(self, "actuator_length")
        sine, cosine = math.sin(self.half_angle), math.cos(self.half_angle)
        room = 0.5 * (self.leaf.root_height * cosine + WIRE) / sine
        self._at_least("centre_distance", room, "for two leaves side by side")
        near = faces(self, self.radius)[1][0] + self.actuator_length
        room = 0.5 * self.wall + self.mounting_hole_diameter - near
        self._at_least("column_width", room, "so that two bolts have room")

    @property
    def reach(self) -> float:
        """Half of the width of the faces to which the leaves are attached [m]."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class CartwheelParameters(PivotParameters):
    """The dimensions of a Cartwheel pivot; the near ends of its leaves are on the hub."""

    def __post_init__(self) -> None:
        PivotParameters.__post_init__(self)
        sine, cosine = math.sin(self.half_angle), math.cos(self.half_angle)
        room = 0.5 * (self.leaf.root_height * sine + WIRE) / cosine
        self._at_least("centre_distance", room, "for two leaves one over the other")
        column = faces(self, self.radius)[1][0] + self.actuator_length
        room = (column - WIRE) * sine
        self._at_most("centre_distance", room, "between the hub and the column")
        gap = -2.0 * faces(self, self.radius)[1][1]
        if gap < self.actuator_length:
            raise StageError(
                f"base and arm must be an actuator_length of {millimetres(self.actuator_length)} "
                f"apart, got {millimetres(gap)}: make half_angle smaller or the leaf longer"
            )


def cartwheel(p: CartwheelParameters) -> Stage:
    r"""Build a Cartwheel pivot.

    Two leaves go from the base to a hub in the middle, and two, their mirror images, from there to
    the arm. The lines of all leaves meet in the centre, about which hub and arm turn, the hub half
    as far. It replaces a cross-spring pivot in a single plate, where two crossing leaves cannot be
    cut: they are joined at the crossing.

    Of leaves of length L with an end at a distance h = p L from the centre the stiffness is

    .. math:: K = \frac{4 E I}{L} (1 + 3 p + 3 p^2)

    four times that of a cross-spring pivot whose leaves are twice as long, 2 E I/(2 L) for p = 0
    (J. A. Haringx, The cross-spring pivot as a constructional element, Appl. Sci. Res. A1 (1949)
    313, has E I/L for each of two leaves that cross in their middles). The centre moves by

    .. math:: s = L \vartheta^2 \frac{1 + 9 p + 9 p^2}{30 \cos\alpha}

    towards the base, to second order of the rotation :math:`\vartheta`, with leaves at an angle
    :math:`\alpha` against the line of symmetry: two leaves turn the hub by half of it and draw it
    by L (theta/2)^2 (1 + 9 p + 9 p^2)/(15 cos(alpha)), and so do the other two (the second-order
    coefficients of a leaf are those of S. Awtar, A. H. Slocum, E. Sevincer, J. Mech. Des. 129
    (2007) 625; the polynomial is W. H. Wittrick's, Aeronaut. Quart. 2 (1951) 272).

    Its bodies are ``base`` (fixed), ``hub`` and ``arm``; its hinges ``lower-left``,
    ``lower-right``, ``upper-left`` and ``upper-right``; its drive, probe (a rotation) and axis
    ``theta``. The centre is the origin.

    Examples
    --------
    >>> stage = cartwheel(CartwheelParameters())
    >>> [h.name for h in stage.hinges]
    ['lower-left', 'lower-right', 'upper-left', 'upper-right']
    """
    lower = tuple(
        leaf(p, f"lower-{side}", ("hub", "base"), sign)
        for side, sign in (("left", -1.0), ("right", 1.0))
    )
    mirror = PlaneMotion.reflection(0.0)
    above = {"base": "arm", "lower-left": "upper-left", "lower-right": "upper-right"}
    tip, (x, y) = faces(p, p.radius)
    arm = Body(
        name="base",
        outline=Loop((tip, (x, y), (x, tip[1] - p.wall), (-x, tip[1] - p.wall), (-x, y))),
    )
    h, s, c = p.centre_distance, math.sin(p.half_angle), math.cos(p.half_angle)
    hub = Body(name="hub", outline=Loop(((h / s, 0.0), (0.0, h / c), (-h / s, 0.0), (0.0, -h / c))))
    upper = tuple(moved(hinge, mirror, above) for hinge in lower)
    return replace(
        pivot(p, moved(arm, mirror, above), (hub,), (*lower, *upper)),
        name="cartwheel",
        title="Cartwheel pivot",
    )


CARTWHEEL = Topology(
    name="cartwheel",
    title="Cartwheel pivot: four leaves meet in a hub",
    source="X. Pei, J. Yu, G. Zong, S. Bi, H. Su, The modeling of cartwheel flexural hinges, Mech. "
    "Mach. Theory 44 (2009) 1900; S. T. Smith, Flexures, Gordon and Breach, 2000",
    parameters=CartwheelParameters,
    construct=cartwheel,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrapezoidalPivotParameters(PivotParameters):
    """The dimensions of a trapezoidal pivot; the near ends of its leaves are on the arm."""

    centre_distance: Size = 10e-3
    """Distance of the near ends of the leaves from the centre [m]."""
    actuator: AnyActuator = field(default_factory=lambda: fine_screw(200e-6))
    """Actuator of the pivot."""
    arm_height: Size = 22e-3
    """Height of the arm over its leaves [m]."""

    def __post_init__(self) -> None:
        PivotParameters.__post_init__(self)
        under = -faces(self, self.centre_distance)[1][1]
        room = under + 4.0 * self.force_patch_half_width
        self._at_least("arm_height", room, "so that the drive acts off the centre")
        slot = self.leaf.length * math.cos(self.half_angle)
        at_least("leaf.length * cos(half_angle)", slot, WIRE, "between arm and base")


def trapezoidal_pivot(p: TrapezoidalPivotParameters) -> Stage:
    r"""Build a trapezoidal pivot.

    Two inclined leaves carry the arm on the base; the arm turns about the point where their lines
    cross, which lies beyond them. It is a cross-spring pivot whose crossing is not between the ends
    of its leaves, so that it can be cut from one plate.

    Of leaves of length L whose near ends are r = p L from the crossing the stiffness is

    .. math:: K = \frac{8 E I}{L} (1 + 3 p + 3 p^2)

    and the centre moves by

    .. math:: s = L \vartheta^2 \frac{1 + 9 p + 9 p^2}{15 \cos\alpha}

    towards the base, to second order of the rotation :math:`\vartheta`, with leaves at an angle
    :math:`\alpha` against the line of symmetry (W. H. Wittrick, The properties of crossed flexure
    pivots, and the influence of the point at which the strips cross, Aeronaut. Quart. 2 (1951) 272,
    for leaves that cross at a part :math:`\lambda = -p` of their length; p = -1/2 gives the 2 E I/L
    of the symmetric cross-spring pivot).

    Its bodies are ``base`` (fixed) and ``arm``; its hinges ``left`` and ``right``; its drive, probe
    (a rotation) and axis ``theta``. The centre is the origin.

    Examples
    --------
    >>> stage = trapezoidal_pivot(TrapezoidalPivotParameters())
    >>> [h.name for h in stage.hinges]
    ['left', 'right']
    """
    leaves = (leaf(p, "left", ("arm", "base"), -1.0), leaf(p, "right", ("arm", "base"), 1.0))
    tip, (x, y) = faces(p, p.centre_distance)
    side, top = faces(p, p.radius)[1][0], y + p.arm_height
    right = [tip, (x, y), (side, y), (side, top)]
    arm = Body(name="arm", outline=Loop((*right, *((-u, v) for u, v in right[:0:-1]))))
    return replace(pivot(p, arm, (), leaves), name="trapezoidal-pivot", title="Trapezoidal pivot")


TRAPEZOIDAL_PIVOT = Topology(
    name="trapezoidal-pivot",
    title="trapezoidal pivot of two leaves: rotation about a remote centre",
    source="X. Pei, J. Yu, G. Zong, S. Bi, Z. Yu, Analysis of rotational precision for an "
    "isosceles-trapezoidal flexural pivot, J. Mech. Des. 130 (2008) 052302",
    parameters=TrapezoidalPivotParameters,
    construct=trapezoidal_pivot,
)
