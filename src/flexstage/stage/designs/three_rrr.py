"""A 3-RRR stage for x, y and rotation, driven by three actuators, as a family of stages."""

import math
from dataclasses import dataclass, field

from flexstage.files.ranges import Size
from flexstage.hinges import Profile, RightCircular
from flexstage.stage import Axis, Body, Circle, Drive, Hinge, Loop, PlaneMotion, Probe, Stage, moved
from flexstage.stage.designs.parameters import Topology
from flexstage.stage.designs.pieces import (
    DrivenPlateParameters,
    Pair,
    block,
    bolt_holes,
    plate,
    pushing,
    two_sided,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreeRRRParameters(DrivenPlateParameters):
    """The dimensions of a 3-RRR stage; its three legs are equal."""

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
        self._at_least("link_length", 2.0 * r + slot, "so that a link has a bar")
        self._at_least("lever_width", root, "so that the fulcrum grows from its end")
        self._at_least(
            "input_arm",
            0.5 * width - r,
            "so that the drive keeps off the ring at the fulcrum",
        )
        self._at_least(
            "lever_length",
            self.input_arm + 0.5 * (width + root) + self.edge + slot,
            "so that the drive passes below the tab of the platform",
        )
        self._at_least(
            "link_distance",
            0.5 * root + slot - math.sqrt(3.0) * tab,
            "so that the tabs stand on the sides of the platform",
        )
        self._at_most(
            "link_distance",
            math.sqrt(3.0) * (self.lever_side - slot) + 0.5 * root + slot,
            "so that the corners of the platform keep a slot from the levers",
        )
        # the wall that a drive stands on ends where it meets the slot along the platform
        covers = 2.0 * (self.apothem + slot) + self.input_arm - self.lever_length
        covers += self.force_patch_half_width - self.link_distance
        self._at_least(
            "actuator_length",
            self.lever_side + max(slot - tab, covers / math.sqrt(3.0)),
            "so that the ring keeps a slot from the tab next to it, and reaches up to the drive",
        )
        self._at_most(
            "actuator_length",
            self.lever_side + (self.apothem + slot) * math.sqrt(0.75),
            "so that the ring reaches between the drive and the next leg",
        )

    @property
    def apothem(self) -> float:
        """Distance of the sides of the platform from its centre [m]."""
        return self.link_distance - 0.5 * self.notch.root_height - self.slot

    @property
    def lever_side(self) -> float:
        """Position of the side of a lever with drive and link [m]."""
        return self.link_position + self.link_length + 0.5 * self.notch.length


def three_rrr(p: ThreeRRRParameters) -> Stage:
    r"""Build a 3-RRR stage.

    Three legs, equal under a rotation by 120 deg, hold a platform; each is a *lever* with its
    fulcrum on the ring and a *link* to a tab of the platform. A drive pushes each lever between
    fulcrum and link. The first leg, seen from the centre of the platform::

            platform   |__________________________
              | tab |                         |   |
              |     |)( === link === )(        |  |   y = -link_distance
              |_____|                  lever   |  |
          ring |                         |     |  |
               | > - - - - drive - - - > |     |  | input_arm
               |__________________________)__(_|  |   fulcrum

    Its bodies are ``base`` (the ring, fixed), ``platform``, ``lever-1`` to ``lever-3`` and
    ``link-1`` to ``link-3``; its drives ``1`` to ``3``, its axes ``x``, ``y`` and ``theta``.

    Notes
    -----
    With pins for necks (B.-J. Yi, G. B. Chung, H. Y. Na, W. K. Kim, I. H. Suh, IEEE Trans. Robot.
    Autom. 19 (2003) 604; Y. K. Yong, T.-F. Lu, Mech. Mach. Theory 44 (2009) 1156) a link only
    keeps its length. With the fulcrum of leg i at :math:`A_i`, the necks of its link at :math:`B_i`
    and :math:`C_i` from the centre of the platform, and :math:`n_i = C_i - B_i`, a displacement p
    and a rotation :math:`\varphi` of the platform about its centre need the drives

    .. math::
        u_i = a\,\frac{n_i\cdot p + \varphi\, n_i\cdot(z\times C_i)}
                     {n_i\cdot(z\times(A_i - B_i))},

    with a the ``input_arm``.

    Validity: small motion; necks that turn freely. Those of the usual dimensions take 3 to 5 % of
    the motion.

    Examples
    --------
    >>> stage = three_rrr(ThreeRRRParameters())
    >>> len(stage.bodies), len(stage.hinges), len(stage.drives)
    (8, 9, 3)
    """
    turns = [PlaneMotion.rotation(2.0 * math.pi * k / 3.0) for k in range(3)]
    bodies: list[Body] = []
    hinges: list[Hinge] = []
    drives: list[Drive] = []
    for k, turn in enumerate(turns, 1):
        names = {name: f"{name}-{k}" for name in ("lever", "link", "fulcrum", "knee", "tab")}
        bodies += (moved(body, turn, names) for body in _leg_bodies(p))
        hinges += (moved(hinge, turn, names) for hinge in _leg_hinges(p))
        drives.append(moved(_drive(p), turn, names | {"drive": str(k)}))
    middle = (0.0, 0.0)
    return plate(
        p,
        "three-rrr",
        "3-RRR stage with three drives",
        bodies=(
            _ring(p, turns),
            Body(name="platform", outline=_around(_platform_side(p), turns)),
            *bodies,
        ),
        hinges=hinges,
        drives=drives,
        probes=(
            Probe(name="x", body="platform", at=middle, direction=0.0),
            Probe(name="y", body="platform", at=middle, direction=0.5 * math.pi),
            Probe(name="theta", body="platform", at=middle, reads="rotation"),
        ),
        axes=tuple(
            Axis(name=name, drives=tuple(d.name for d in drives), probe=name)
            for name in ("x", "y", "theta")
        ),
    )


def _leg_bodies(p: ThreeRRRParameters) -> tuple[Body, Body]:
    r, half, line = 0.5 * p.notch.length, 0.5 * p.notch.root_height, -p.link_distance
    low = line - p.lever_length + r
    return (
        block(
            "lever",
            (p.lever_side, low),
            (p.lever_side + p.lever_width, line + half + p.edge),
        ),
        block(
            "link",
            (p.link_position + r, line - half),
            (p.link_position + p.link_length - r, line + half),
        ),
    )


def _leg_hinges(p: ThreeRRRParameters) -> tuple[Hinge, ...]:
    line, start = -p.link_distance, p.link_position
    foot = (p.lever_side + 0.5 * p.lever_width, line - p.lever_length)
    rows = (
        ("fulcrum", ("base", "lever"), foot, 0.5 * math.pi),
        ("knee", ("link", "lever"), (start + p.link_length, line), 0.0),
        ("tab", ("platform", "link"), (start, line), 0.0),
    )
    return tuple(
        Hinge(name=name, bodies=bodies, at=at, direction=direction, profile=p.notch)
        for name, bodies, at, direction in rows
    )


def _drive(p: ThreeRRRParameters) -> Drive:
    y = p.input_arm - p.lever_length - p.link_distance
    return pushing(
        p, "drive", "lever", ((p.lever_side, y), (p.lever_side - p.actuator_length, y)), 0.0
    )


def _platform_side(p: ThreeRRRParameters) -> list[Pair]:
    """Return a third of the outline of the platform: a side with its tab and the next corner."""
    side, right = -p.apothem, p.link_position - 0.5 * p.notch.length
    left, low = right - p.tab_width, -p.link_distance - 0.5 * p.notch.root_height - p.edge
    corner = (p.apothem / math.sqrt(3.0), side)
    return [(-corner[0], side), (left, side), (left, low), (right, low), (right, side), corner]


def _ring(p: ThreeRRRParameters, turns: list[PlaneMotion]) -> Body:
    wall, right = p.lever_side - p.actuator_length, p.lever_side + p.lever_width + p.slot
    floor = -p.link_distance - p.lever_length - 0.5 * p.notch.length
    top = -p.link_distance + 0.5 * p.notch.root_height + p.edge + p.slot
    # where the wall behind the drive meets the slot along the next side of the platform
    start = (wall, -2.0 * (p.apothem + p.slot) - math.sqrt(3.0) * wall)
    window = [start, (wall, floor), (right, floor), (right, top)]
    radius = math.hypot(right, floor) + p.frame_wall
    # in the wall behind the drive, as far out as the ring is wide there
    corner = (wall - p.frame_wall, floor)
    share = (radius - 0.5 * p.frame_wall) / math.hypot(*corner)
    bolt = (share * corner[0], share * corner[1])
    return Body(
        name="base",
        outline=Circle((0.0, 0.0), radius).loop(),
        holes=(_around(window, turns),),
        mounting_holes=bolt_holes((turn.point(bolt) for turn in turns), p.mounting_hole_diameter),
        fixed=True,
    )


def _around(third: list[Pair], turns: list[PlaneMotion]) -> Loop:
    return Loop(tuple(turn.point(point) for turn in turns for point in third))


THREE_RRR = Topology(
    name="three-rrr",
    title="3-RRR stage with three drives",
    source="B.-J. Yi, G. B. Chung, H. Y. Na, W. K. Kim, I. H. Suh, IEEE Trans. Robot. Autom. 19 "
    "(2003) 604; Y. K. Yong, T.-F. Lu, Mech. Mach. Theory 44 (2009) 1156",
    parameters=ThreeRRRParameters,
    construct=three_rrr,
)
