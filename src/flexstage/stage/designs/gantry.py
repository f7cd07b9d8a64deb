"""An XY gantry whose platform does not turn: four carriages drive it from its four sides."""

import math
from dataclasses import dataclass, field

from flexstage.files.ranges import Size
from flexstage.stage import Axis, Body, Drive, Hinge, Loop, PlaneMotion, Probe, Stage, moved
from flexstage.stage.designs.parameters import Topology
from flexstage.stage.designs.pieces import (
    WIRE,
    Leg,
    PlateParameters,
    at_least,
    block,
    bolt_holes,
    box,
    cut_apart,
    fine_screw,
    legs,
    plate,
    pushing,
    round_leaf,
)
from flexstage.stage.drive import AnyActuator

# of what stands on the right, turned to the left by quarter turns
_SIDES = ("right", "top", "left", "bottom")
_QUARTER = math.pi / 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GantryParameters(PlateParameters):
    """The dimensions of an XY gantry."""

    leg: Leg = field(default_factory=lambda: round_leaf(25e-3, 0.4e-3, 0.8e-3))
    """Equal legs; each is a leaf, or a bar between two notches."""
    platform_leg_spacing: Size = 20e-3
    """Distance between the two legs that go from the platform to a carriage [m]."""
    carriage_leg_spacing: Size = 10e-3
    """Distance between the two legs that guide a carriage [m]."""
    overhang: Size = 4e-3
    """Overhang of bodies beyond their legs [m]."""
    wall: Size = 8e-3
    """Thickness of the frame [m]."""
    actuator: AnyActuator = field(default_factory=lambda: fine_screw(400e-6))
    """Actuator of an axis."""
    actuator_length: Size = 3e-3
    """Distance between carriage and frame [m]."""
    opposed: bool = False
    """True if a second drive pulls at the opposite carriage, as voice coils can."""

    def __post_init__(self) -> None:
        PlateParameters.__post_init__(self)
        cut_apart(self, "actuator_length")
        slot = self.leg.width + WIRE
        for name in ("platform_leg_spacing", "carriage_leg_spacing"):
            at_least(name, getattr(self, name), slot, "so that a slot is between the legs")
        corner = self.far + self.actuator_length - self.near
        self._at_most(
            "mounting_hole_diameter",
            0.5 * (corner + self.wall),
            "so that a bolt fits in a corner of the frame",
        )

    @property
    def half_platform(self) -> float:
        """Half of the length of the platform and of the carriages [m]."""
        return 0.5 * (self.platform_leg_spacing + self.leg.width) + self.overhang

    @property
    def near(self) -> float:
        """Distance of the inner faces of carriages and corners from the middle [m]."""
        return self.half_platform + self.leg.length

    @property
    def far(self) -> float:
        """Distance of the outer faces of the carriages from the middle [m]."""
        return self.near + self.carriage_leg_spacing + self.leg.width + 2.0 * self.overhang


def gantry(p: GantryParameters) -> Stage:
    r"""Build an XY gantry.

    The platform hangs between four carriages, from each by two legs along its motion; each carriage
    is guided on the frame by two legs across it. The left and right carriage move along x alone,
    the upper and lower one along y alone, and every leg that bends leaves the platform parallel to
    itself: it does not turn, and no drive carries the other one. It consists of the right quarter
    and three copies rotated to the left.

    To move the platform, four legs of the platform and four of the carriages bend. Of leaves of
    length L the stiffness is :math:`96 E I/L^3` of one leaf, in both directions: S. Awtar,
    A. H. Slocum, Constraint-based design of parallel kinematic XY flexure mechanisms, J. Mech. Des.
    129 (2007) 816. A carriage that has moved by d has gone aside by 3/5 d^2/L, which the legs to
    the platform take up.

    Its bodies are ``base`` (fixed), ``platform`` and, for ``right``, ``top``, ``left`` and
    ``bottom``, the carriage and the bars of the legs ``right-upper``, ``right-lower`` (to the
    platform; named as on the right), ``right-inner`` and ``right-outer`` (to the frame). Drives,
    axes and the probes ``x`` and ``y``; the probe ``yaw`` reads the rotation of the platform.

    Examples
    --------
    >>> stage = gantry(GantryParameters())
    >>> len(stage.bodies), len(stage.hinges), [d.pushes for d in stage.drives]
    (6, 16, ['left', 'bottom'])
    """
    a, near, far = p.half_platform, p.near, p.far
    bodies, hinges = _quarter(p)
    turns = [PlaneMotion.rotation(k * _QUARTER) for k in range(4)]
    sides = [
        (turn, {part.name: part.name.replace("right", side) for part in (*bodies, *hinges)})
        for side, turn in zip(_SIDES, turns, strict=True)
    ]
    inside = far + p.actuator_length
    corner = [(inside, near), (near, near), (near, inside)]
    half, station = inside + p.wall, 0.5 * (near + inside + p.wall)
    base = Body(
        name="base",
        outline=box((-half, -half), (half, half)),
        holes=(Loop(tuple(turn.point(q) for turn in turns for q in corner)),),
        mounting_holes=bolt_holes(
            (turn.point((station, station)) for turn in turns), p.mounting_hole_diameter
        ),
        fixed=True,
    )
    drives, axes = [], []
    for axis, turn in (("x", turns[0]), ("y", turns[1])):
        drives.append(_drive(p, axis, turn, opposite=False))
        if p.opposed:
            drives.append(_drive(p, axis, turn, opposite=True))
        names = tuple(d.name for d in drives if d.name.startswith(axis))
        axes.append(Axis(name=axis, drives=names, probe=axis))
    return plate(
        p,
        "gantry",
        "XY gantry of four carriages",
        bodies=(
            base,
            block("platform", (-a, -a), (a, a)),
            *(moved(body, *side) for side in sides for body in bodies),
        ),
        hinges=tuple(moved(hinge, *side) for side in sides for hinge in hinges),
        drives=drives,
        probes=(
            Probe(name="x", body="platform", at=(0.0, 0.0), direction=0.0),
            Probe(name="y", body="platform", at=(0.0, 0.0), direction=_QUARTER),
            Probe(name="yaw", body="platform", at=(0.0, 0.0), reads="rotation"),
        ),
        axes=axes,
    )


def _quarter(p: GantryParameters) -> tuple[list[Body], list[Hinge]]:
    """Return the right carriage with its legs."""
    a, carriage = p.half_platform, "right"
    middle = 0.5 * (p.near + p.far)
    aside, apart = 0.5 * p.platform_leg_spacing, 0.5 * p.carriage_leg_spacing
    bars, hinges = legs(
        p.leg,
        (
            ("right-upper", ("platform", carriage), (a, aside), 0.0),
            ("right-lower", ("platform", carriage), (a, -aside), 0.0),
            ("right-inner", (carriage, "base"), (middle - apart, a), _QUARTER),
            ("right-outer", (carriage, "base"), (middle + apart, a), _QUARTER),
        ),
    )
    return [block(carriage, (p.near, -a), (p.far, a)), *bars], hinges


def _drive(p: GantryParameters, axis: str, turn: PlaneMotion, *, opposite: bool) -> Drive:
    """Return the drive of an axis, that of x rotated, or the one that pulls on the other side."""
    side, face, name = (-1.0, "left", axis) if not opposite else (1.0, "right", f"{axis}-opposed")
    drive = pushing(
        p, name, f"{face}", ((side * p.far, 0.0), (side * (p.far + p.actuator_length), 0.0)), 0.0
    )
    turned = {"left": "bottom", "right": "top"}
    return moved(drive, turn, turned if axis == "y" else None)


GANTRY = Topology(
    name="gantry",
    title="XY gantry: a platform without rotation between four carriages, drives on the frame",
    source="S. Awtar, A. H. Slocum, Constraint-based design of parallel kinematic XY flexure "
    "mechanisms, J. Mech. Des. 129 (2007) 816",
    parameters=GantryParameters,
    construct=gantry,
)
