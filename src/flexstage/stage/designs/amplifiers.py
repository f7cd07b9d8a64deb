"""Bridge and rhombus amplifiers: two blocks pushed apart, four limbs, a guided output.

The drive lies along x about the origin. The amplifier is symmetric left to right and, except for
guide and frame, top to bottom: the limb at the upper left determines the others.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated

from flexstage.files.ranges import Range, Size
from flexstage.hinges import CornerFilleted, Profile, RightCircular
from flexstage.quantities.units import Angle
from flexstage.stage import Body, Drive, Hinge, Loop, PlaneMotion, Probe, Stage, moved
from flexstage.stage.designs.parameters import Topology
from flexstage.stage.designs.pieces import (
    GuidedPlateParameters,
    Leg,
    Pair,
    at_least,
    at_most,
    bolt_holes,
    legs,
    plate,
    pushing,
    round_leaf,
    round_stack,
    two_sided,
)
from flexstage.stage.drive import AnyActuator

#: Mirrors left to right, and top to bottom.
ACROSS, ALONG = PlaneMotion.reflection(0.5 * math.pi), PlaneMotion.reflection(0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class AmplifierParameters(GuidedPlateParameters):
    """The dimensions of an amplifier that do not depend on its limbs."""

    actuator: AnyActuator = field(default_factory=lambda: round_stack(36e-3))
    """Actuator."""
    actuator_length: Size = 36e-3
    """Distance between the two faces that the drive pushes apart [m]."""
    actuator_width: Size = 8e-3
    """Height of the room for the drive between upper and lower limbs [m]."""
    input_block_length: Size = 6e-3
    """Length of the two blocks that the drive pushes apart, along it [m]."""
    guide: Leg = field(default_factory=lambda: round_leaf(21e-3))
    """The four legs or leaves that guide the output, two on a side."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limb:
    """The limb at the upper left, from the block ``left`` to the block ``output``."""

    bodies: tuple[Body, ...]
    """Bodies between its hinges."""
    hinges: tuple[Hinge, ...]
    """Hinges."""
    input_corner: tuple[Pair, ...]
    """Edge of the block ``left``, from its right face upwards to its highest point [m]."""
    output_side: tuple[Pair, ...]
    """Left edge of the block ``output``, from below to where its guide begins [m]."""
    top: float
    """Highest point [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AmplifierFrame:
    """An amplifier of four equal limbs, and its layout.

    Raises
    ------
    StageError
        The guide is too short to pass the driven blocks.
    """

    parameters: AmplifierParameters
    """Dimensions."""
    limb: Limb
    """Limb at the upper left."""

    def __post_init__(self) -> None:
        least = self._outer + self.parameters.slot + self.side
        why = "so that the columns keep a slot from the blocks that the drive pushes apart"
        at_least("the length of guide", self.parameters.guide.length, least, why)

    @property
    def _outer(self) -> float:
        return 0.5 * self.parameters.actuator_length + self.parameters.input_block_length

    @property
    def side(self) -> float:
        """Position of the left side of the output, where its guide begins [m]."""
        return self.limb.output_side[-1][0]

    @property
    def column(self) -> float:
        """Distance of the inner faces of the columns from the middle [m]."""
        return self.parameters.guide.length - self.side

    @property
    def shoulder(self) -> float:
        """Height at which the room of the limbs ends and that of the guide begins [m]."""
        return max(self.limb.top, self.limb.input_corner[-1][1]) + self.parameters.slot

    @property
    def top(self) -> float:
        """Upper end of the output [m]."""
        p = self.parameters
        return self.shoulder + p.guide.width + p.guide_spacing + p.edge

    def room(self) -> list[Pair]:
        """Return the left half of the edge of the base about the limbs, from the foot on [m]."""
        foot = [ALONG.point(point) for point in self.limb.output_side]
        return [*foot, (self.side, -self.shoulder), (-self.column, -self.shoulder)]

    def guided(self, block: str) -> tuple[list[Body], list[Hinge]]:
        """Return the guide of a block of the width and position of the output."""
        p = self.parameters
        low, ends = self.shoulder + 0.5 * p.guide.width, ("base", block)
        rows = (("inner", low), ("outer", low + p.guide_spacing))
        # each next to its image on the right
        return legs(
            p.guide,
            (
                (f"guide-{side}-{name}", ends, (x, height), direction)
                for name, height in rows
                for side, x, direction in (
                    ("left", -self.column, 0.0),
                    ("right", self.column, math.pi),
                )
            ),
        )

    def parts(self) -> tuple[list[Body], list[Hinge], Drive]:
        """Return the moving parts, its blocks ``left``, ``right`` and ``output``, and the drive."""
        p, corner = self.parameters, self.limb.input_corner
        left = Body(name="left", outline=mirrored([*corner, (-self._outer, corner[-1][1])], ALONG))
        output = mirrored([*self.limb.output_side, (self.side, self.top)], ACROSS)
        bars, notches = self.guided("output")
        bodies = [left, moved(left, ACROSS, _right), Body(name="output", outline=output), *bars]
        hinges = notches
        for part in self._limbs():
            (bodies if isinstance(part, Body) else hinges).append(part)  # type: ignore[arg-type]
        half = 0.5 * p.actuator_length
        drive = pushing(p, "y", "right", ((half, 0.0), (-half, 0.0)), 0.0, reacts="left")
        return bodies, hinges, drive

    def _limbs(self) -> Iterator[Body | Hinge]:
        for part in (*self.limb.bodies, *self.limb.hinges):
            for upper in (part, moved(part, ACROSS, _right)):
                yield upper
                yield moved(upper, ALONG, _lower)

    def stage(self, name: str, title: str) -> Stage:
        """Return the amplifier on a base of its own, a bar with two columns.

        Drive, probe and axis are called ``y``; the probe reads the motion towards the drive, to
        which a growing drive moves the output.
        """
        p, wall = self.parameters, self.parameters.frame_wall
        bodies, hinges, drive = self.parts()
        outer, floor = self.column + wall, -self.shoulder - wall
        half = [*self.room(), (-self.column, self.top), (-outer, self.top), (-outer, floor)]
        base = Body(
            name="base",
            outline=mirrored(half, ACROSS),
            mounting_holes=bolt_holes(
                (
                    (sign * (outer - 0.5 * wall), y)
                    for y in (floor + 0.5 * wall, self.top - 0.5 * wall)
                    for sign in (-1.0, 1.0)
                ),
                p.mounting_hole_diameter,
            ),
            fixed=True,
        )
        towards = Probe(name="y", body="output", at=(0.0, self.top), direction=-0.5 * math.pi)
        return plate(
            p,
            name,
            title,
            bodies=(base, *bodies),
            hinges=hinges,
            drives=(drive,),
            probes=(towards,),
        )


def mirrored(half: list[Pair], motion: PlaneMotion) -> Loop:
    """Close half of an outline by its image."""
    return Loop((*half, *(motion.point(point) for point in reversed(half))))


def _right(name: str) -> str:
    return name.replace("left", "right")


def _lower(name: str) -> str:
    return name.replace("upper", "lower").replace("output", "base")


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeParameters(AmplifierParameters):
    """The dimensions of a bridge amplifier."""

    link_length: Size = 12e-3
    """Distance of the two necks of a link along the drive [m]."""
    link_offset: Size = 2e-3
    """Distance of the two necks of a link across the drive [m]."""
    notch: Profile = field(
        default_factory=lambda: RightCircular(neck_thickness=0.4e-3, radius=1e-3)
    )
    """The notches of the links."""

    def __post_init__(self) -> None:
        AmplifierParameters.__post_init__(self)
        two_sided(self.notch, "a link")
        self._at_least(
            "link_length",
            self.notch.length + self.slot,
            "so that a link has a bar",
        )
        self._at_most(
            "link_length",
            0.5 * (self.actuator_length - self.slot) - self.notch.length,
            "so that the output is at least a slot wide",
        )


def bridge(p: BridgeParameters) -> Stage:
    r"""Build a bridge amplifier.

    A stack pushes two blocks apart. Four links, each with a notch at either end, join them to the
    foot of the base and to the output, which comes down as the links flatten::

                  base ]=======|  output |=======[ base      guide: four leaves
                               |         |
                     left   __  \_)_____(_/  __   right
                    |     |_)__/           \__(_|     |
                    |     |  < - - drive - - >  |     |      y = 0
                    |     |_)___           ___(_|     |
                              \__)_____(__/
                               |  base   |

    Bodies, drive, probe and axis are those of `flexstage.stage.designs.amplifiers.AmplifierFrame`;
    the links are called after their corner, their hinges end in ``-in`` and ``-out``.

    Notes
    -----
    With pins for necks the ratio is :math:`l_x/l_y`, ``link_length`` over ``link_offset``
    (J. Pokines, E. Garcia, Smart Materials and Structures 7 (1998) 105). Necks that resist turning
    by :math:`k_\theta` and stretching by :math:`k_u`, each, leave for a free output

    .. math:: R = \frac{l_x l_y}{l_y^2 + 4 k_\theta/k_u},

    which follows from the moment of the force F in a link, :math:`F l_y = 2 k_\theta\varphi`, and
    its stretching, 2 F/k_u; M. Ling et al. (Mech. Syst. Signal Process. 119 (2019)) quote it.
    A load of stiffness k at the output, its guide for one, leaves of it
    :math:`k_o/(k_o + k)`, where :math:`k_o` is the stiffness of the output with the drive held.

    Validity: rigid bodies, small motion; no shear of the necks.

    Examples
    --------
    >>> stage = bridge(BridgeParameters())
    >>> neck, head = stage.hinge("upper-left-in").at, stage.hinge("upper-left-out").at
    >>> round((head[0] - neck[0]) / (head[1] - neck[1]), 6)
    6.0
    """
    return bridge_amplifier(p).stage("bridge", "Bridge amplifier with a guided output")


def bridge_amplifier(p: BridgeParameters) -> AmplifierFrame:
    """Return a bridge without a base."""
    return AmplifierFrame(parameters=p, limb=_bridge_limb(p))


def _bridge_limb(p: BridgeParameters) -> Limb:
    r, low = 0.5 * p.notch.length, 0.5 * p.actuator_width
    height = p.notch.root_height
    face = -0.5 * p.actuator_length
    near, far = face + r, face + r + p.link_length
    side, high = far + r, low + height + p.link_offset
    left, right = near + r, far - r
    link = Loop(((left, low), (right, low), (right, high), (left, high)))
    rows = (
        ("in", ("left", "upper-left"), (near, low + 0.5 * height)),
        ("out", ("upper-left", "output"), (far, high - 0.5 * height)),
    )
    return Limb(
        bodies=(Body(name="upper-left", outline=link),),
        hinges=tuple(
            Hinge(name=f"upper-left-{end}", bodies=bodies, at=at, direction=0.0, profile=p.notch)
            for end, bodies, at in rows
        ),
        input_corner=((face, low + height + p.edge),),
        output_side=((side, low), (side, high)),
        top=high,
    )


BRIDGE = Topology(
    name="bridge",
    title="bridge amplifier with a guided output",
    source="J. Pokines, E. Garcia, Smart Materials and Structures 7 (1998) 105; N. Lobontiu, "
    "E. Garcia, Comput. Struct. 81 (2003) 2797",
    parameters=BridgeParameters,
    construct=bridge,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class RhombusParameters(AmplifierParameters):
    """The dimensions of a rhombus amplifier."""

    beam: Profile = field(
        default_factory=lambda: CornerFilleted(
            neck_thickness=0.5e-3, notch_length=14e-3, fillet_radius=0.5e-3
        )
    )
    """The beams; any profile of hinges, as long as a beam."""
    beam_angle: Annotated[Angle, Range(low=0.0, high=0.25 * math.pi, above=True)] = 0.14
    """Angle between a beam and the drive [rad]."""

    def __post_init__(self) -> None:
        AmplifierParameters.__post_init__(self)
        two_sided(self.beam, "a rhombus")
        at_most(
            "the length of beam",
            self.beam.length,
            0.5 * (self.actuator_length - self.slot) / math.cos(self.beam_angle),
            "so that the output is at least a slot wide between the beams",
        )


def rhombus(p: RhombusParameters) -> Stage:
    r"""Build a rhombus amplifier.

    It is a bridge amplifier (see `flexstage.stage.designs.amplifiers.bridge`) each of whose limbs
    is one slanted beam, which bends over its whole length; the shape of most commercial amplified
    actuators. Its four beams are hinges, called after their corner.

    Notes
    -----
    With pins at the ends of its beams the ratio is :math:`\cot\alpha`, of ``beam_angle``. Beams of
    length l and thickness t that are built in at both ends leave, by their energy of stretching and
    bending, for a free output

    .. math::
        R = \frac{(k_l - k_b)\sin\alpha\cos\alpha}{k_l\sin^2\alpha + k_b\cos^2\alpha},\quad
        k_l = \frac{E b t}{l},\ k_b = \frac{E b t^3}{l^3},

    which is the form of M. Ling, J. Cao, M. Zeng, J. Lin, D. J. Inman (Smart Materials and
    Structures 25 (2016) 075022) but for :math:`k_b` in the numerator, which they leave out.

    Validity: rigid blocks, small motion; beams without shear and without fillets, which shorten
    what bends.

    Examples
    --------
    >>> stage = rhombus(RhombusParameters())
    >>> stage.hinge("upper-left").direction
    0.14
    """
    return AmplifierFrame(parameters=p, limb=_beam_limb(p)).stage(
        "rhombus", "Rhombus amplifier with a guided output"
    )


def _beam_limb(p: RhombusParameters) -> Limb:
    c, s, height = math.cos(p.beam_angle), math.sin(p.beam_angle), p.beam.root_height
    # the two ends of the root on the left block, and those on the output
    x, y = -0.5 * p.actuator_length, 0.5 * p.actuator_width
    foot = ((x, y), (x - s * height, y + c * height))
    head = tuple((u + c * p.beam.length, v + s * p.beam.length) for u, v in foot)
    middle = (0.5 * (foot[0][0] + head[1][0]), 0.5 * (foot[0][1] + head[1][1]))
    return Limb(
        bodies=(),
        hinges=(
            Hinge(
                name="upper-left",
                bodies=("left", "output"),
                at=middle,
                direction=p.beam_angle,
                profile=p.beam,
            ),
        ),
        input_corner=foot,
        output_side=head,
        top=head[1][1],
    )


RHOMBUS = Topology(
    name="rhombus",
    title="rhombus amplifier of slanted beams with a guided output",
    source="M. Ling, J. Cao, M. Zeng, J. Lin, D. J. Inman, Smart Materials and Structures 25 "
    "(2016) 075022",
    parameters=RhombusParameters,
    construct=rhombus,
)
