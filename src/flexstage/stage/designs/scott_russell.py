"""A Scott-Russell linkage of notches, as a family of stages."""

import math
from dataclasses import dataclass, field
from typing import Annotated

from flexstage.files.ranges import Range, Size
from flexstage.hinges import Profile, RightCircular
from flexstage.quantities.units import Angle
from flexstage.stage import Body, Hinge, Loop, Probe, Stage
from flexstage.stage.designs.parameters import Topology
from flexstage.stage.designs.pieces import (
    GuidedPlateParameters,
    Leg,
    at_least,
    block,
    bolt_holes,
    legs,
    plate,
    pushing,
    round_leaf,
    two_sided,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScottRussellParameters(GuidedPlateParameters):
    """The dimensions of a Scott-Russell linkage."""

    crank_length: Size = 15e-3
    """Distance between the two necks of the crank, half that of the ends of the link [m]."""
    link_angle: Annotated[Angle, Range(low=0.0, high=0.25 * math.pi, above=True)] = 0.35
    """Angle between the link and the drive [rad]."""
    arm_width: Size = 7e-3
    """Width of the part of the link that carries the output [m]."""
    notch: Profile = field(
        default_factory=lambda: RightCircular(neck_thickness=0.4e-3, radius=1e-3)
    )
    """The notches of crank and link."""
    input_block_length: Size = 10e-3
    """Length of the block that the drive pushes, along it [m]."""
    input_block_height: Size = 8e-3
    """Height [m]."""
    guide: Leg = field(default_factory=lambda: round_leaf(12e-3))
    """The four legs or leaves that guide it, two above and two below."""
    guide_spacing: Size = 7e-3
    """Distance between the two legs on a side of the block [m]."""

    def __post_init__(self) -> None:
        GuidedPlateParameters.__post_init__(self)
        two_sided(self.notch, "a link")
        root = self.notch.root_height
        rise = self.crank_length * math.sin(self.link_angle)
        self._at_least(
            "crank_length",
            (self.notch.length + max(self.slot, self.arm_width)) / math.cos(self.link_angle),
            "so that the arm of the link is next to its knee",
        )
        at_least(
            "crank_length * sin(link_angle)",
            rise,
            0.5 * root + self.slot,
            "so that the arm of the link keeps a slot from the crank",
        )
        self._at_least(
            "input_block_height",
            root + 2.0 * self.edge,
            "so that the link's notch grows from it",
        )
        self._at_least(
            "input_block_length",
            self.guide_spacing + self.guide.width,
            "so that both legs stand on it",
        )
        self._at_most(
            "actuator_width",
            self.input_block_height + 2.0 * self.guide.length,
            "so that the pocket of the drive stays between floor and roof",
        )


def scott_russell(p: ScottRussellParameters) -> Stage:
    r"""Build a Scott-Russell linkage.

    One end A of a link slides along x; a crank half as long as the link holds its middle C at a
    fixed distance from a point O on the path of A. The other end B then moves along a straight line
    through O, across that path. O is the origin; leaves guide A; the link is bent about the crank,
    so that its neck C lies between its ends::

              B  _________________
               ._|______  link    |         | | guide
                        |  )(     \        ____
                   crank  C   \    \      |    |
           base )( ______/      \___\_)( | input| < - drive
              O                       A   |____|
                                            | |

    Its bodies are ``base`` (fixed), ``crank``, ``link`` and ``input``; its hinges ``O``, ``A``,
    ``C`` and those of the guide; drive and axis are called ``y``. The probe ``y`` reads B along its
    line, the probe ``x`` across it.

    Notes
    -----
    With pins for necks :math:`x_A = 2 l\cos\theta`, :math:`y_B = 2 l\sin\theta`. The ratio is
    :math:`\cot\theta`, of ``link_angle``, and B moves straight over any stroke (Y. Tian,
    B. Shirinzadeh, D. Zhang, G. Alici, Mech. Syst. Signal Process. 23 (2009) 957).

    Validity: necks that turn freely and do not stretch; these take one percent of the ratio.

    Examples
    --------
    >>> stage = scott_russell(ScottRussellParameters())
    >>> o, a, c = (stage.hinge(name).at for name in "OAC")
    >>> round((2.0 * c[0] - a[0]) / c[0], 12)
    0.0
    """
    r, half = 0.5 * p.notch.length, 0.5 * p.notch.root_height
    x = p.crank_length * math.cos(p.link_angle)
    y = p.crank_length * math.sin(p.link_angle)
    low = max(y + half + p.slot, 2.0 * y - 0.5 * p.arm_width)
    high = low + p.arm_width
    crank = Loop(((r, -half), (x - r, y - half), (x - r, y + half), (r, half)))
    link = Loop(
        (
            (2.0 * x - r, -half),
            (2.0 * x - r, half),
            (x + r + p.arm_width, high),
            (-0.5 * p.arm_width, high),
            (-0.5 * p.arm_width, low),
            (x + r, low),
            (x + r, y - half),
        )
    )
    near, far = 2.0 * x + r, 2.0 * x + r + p.input_block_length
    tall = 0.5 * p.input_block_height
    necks = (
        ("O", ("base", "crank"), (0.0, 0.0)),
        ("C", ("crank", "link"), (x, y)),
        ("A", ("link", "input"), (2.0 * x, 0.0)),
    )
    bars, guides = legs(
        p.guide,
        (
            (
                f"guide-{side}-{end}",
                ("input", "base"),
                (0.5 * (near + far) + shift * p.guide_spacing, sign * tall),
                sign * 0.5 * math.pi,
            )
            for side, sign in (("upper", 1.0), ("lower", -1.0))
            for end, shift in (("left", -0.5), ("right", 0.5))
        ),
    )
    return plate(
        p,
        "scott-russell",
        "Scott-Russell linkage",
        bodies=(
            _base(p, near, far),
            Body(name="crank", outline=crank),
            Body(name="link", outline=link),
            block("input", (near, -tall), (far, tall)),
            *bars,
        ),
        hinges=(
            *(
                Hinge(name=name, bodies=bodies, at=at, direction=0.0, profile=p.notch)
                for name, bodies, at in necks
            ),
            *guides,
        ),
        drives=(pushing(p, "y", "input", ((far, 0.0), (far + p.actuator_length, 0.0)), math.pi),),
        probes=tuple(
            Probe(name=name, body="link", at=(0.0, 2.0 * y), direction=direction)
            for name, direction in (("y", 0.5 * math.pi), ("x", 0.0))
        ),
    )


def _base(p: ScottRussellParameters, near: float, far: float) -> Body:
    """Return the base, with the pocket of the drive on the right."""
    r, wall, gap = 0.5 * p.notch.length, p.frame_wall, p.slot
    half, pocket = 0.5 * p.notch.root_height, 0.5 * p.actuator_width
    roof, end = 0.5 * p.input_block_height + p.guide.length, far + p.actuator_length
    left, right, top, bottom = -r - wall, end + wall, roof + wall, -roof - wall
    inner = (
        (-r, half + p.edge),
        (-r, -half - gap),
        (near - gap, -half - gap),
        (near - gap, -roof),
        (far + gap, -roof),
        (far + gap, -pocket),
        (end, -pocket),
        (end, pocket),
        (far + gap, pocket),
        (far + gap, roof),
        (near - gap, roof),
    )
    outer = (
        (near - gap, top),
        (right, top),
        (right, bottom),
        (left, bottom),
        (left, half + p.edge),
    )
    bolts = (
        (left + 0.5 * wall, bottom + 0.5 * wall),
        (right - 0.5 * wall, bottom + 0.5 * wall),
        (right - 0.5 * wall, top - 0.5 * wall),
    )
    return Body(
        name="base",
        outline=Loop((*inner, *outer)),
        mounting_holes=bolt_holes(bolts, p.mounting_hole_diameter),
        fixed=True,
    )


SCOTT_RUSSELL = Topology(
    name="scott-russell",
    title="Scott-Russell linkage",
    source="Y. Tian, B. Shirinzadeh, D. Zhang, G. Alici, Mech. Syst. Signal Process. 23 (2009) "
    "957; J.-L. Ha, Y.-S. Kung, S.-C. Hu, R.-F. Fung, Sens. Actuators A 125 (2006) 565",
    parameters=ScottRussellParameters,
    construct=scott_russell,
)
