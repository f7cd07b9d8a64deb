"""Levers in a row, each pushed by the one before it, and a guided output, as a family of stages."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

from flexstage.base.errors import StageError
from flexstage.files.ranges import Size
from flexstage.hinges import Profile, RightCircular
from flexstage.stage import Body, Hinge, Loop, Probe, Stage
from flexstage.stage.designs.parameters import Topology
from flexstage.stage.designs.pieces import (
    GuidedPlateParameters,
    Leg,
    Pair,
    at_least,
    block,
    bolt_holes,
    legs,
    plate,
    pushing,
    two_sided,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lever:
    """The arms of a lever, both from its fulcrum."""

    input_arm: Size
    """Distance to its input [m]."""
    output_arm: Size
    """Distance to its output [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeverChainParameters(GuidedPlateParameters):
    """The dimensions of a chain of levers."""

    levers: tuple[Lever, ...] = (
        Lever(input_arm=6e-3, output_arm=18e-3),
        Lever(input_arm=7e-3, output_arm=17.5e-3),
    )
    """The levers, from the drive to the output; one at least."""
    lever_height: Size = 8e-3
    """Height of a lever, across its length [m]."""
    notch: Profile = field(
        default_factory=lambda: RightCircular(neck_thickness=0.5e-3, radius=1e-3)
    )
    """The notches of fulcrums and links."""
    link_bar_length: Size = 6e-3
    """Length of the bars of the links, each between two notches [m]."""
    output_width: Size = 8e-3
    """Width of the output [m]."""

    def __post_init__(self) -> None:
        GuidedPlateParameters.__post_init__(self)
        two_sided(self.notch, "a lever")
        if not self.levers:
            raise StageError("levers must name one lever at least, got none")
        root = self.notch.root_height
        for k, lever in enumerate(self.levers, 1):
            at_least(
                f"output_arm of lever {k}",
                lever.output_arm,
                root + self.edge + self.slot,
                "so that its link keeps a slot from its fulcrum",
            )
        self._at_least(
            "link_bar_length",
            2.0 * self.slot,
            "so that the ground at a fulcrum has room between two levers",
        )
        self._at_least("output_width", root, "so that the last link ends in it")


class LeverChainLayout:
    """Layout of a chain of levers."""

    def __init__(self, p: LeverChainParameters) -> None:
        self.p = p
        #: Half the width of a root and the edge next to it.
        self.margin = 0.5 * self.p.notch.root_height + p.edge
        self.fulcrums: list[float] = []
        self.inputs: list[float] = []
        self.outputs: list[float] = []
        pushed = p.levers[0].input_arm
        for k, lever in enumerate(p.levers):
            self.inputs.append(pushed)
            self.fulcrums.append(pushed - self.side(k) * lever.input_arm)
            pushed = self.fulcrums[-1] + self.side(k) * lever.output_arm
            self.outputs.append(pushed)

    def side(self, k: int) -> float:
        """Return 1 where the fulcrum is on the left, -1 where it is on the right."""
        return -1.0 if k % 2 else 1.0

    @property
    def step(self) -> float:
        """Distance from one lever to the next [m]."""
        p = self.p
        return p.lever_height + p.link_bar_length + 2.0 * self.p.notch.length

    def height(self, k: int) -> float:
        """Return the lower side of a lever [m]."""
        return k * self.step

    def span(self, k: int) -> Pair:
        """Return left and right end of a lever [m]."""
        p = self.p
        places = (self.fulcrums[k], self.outputs[k])
        pushed = self.inputs[k] + self.side(k) * max(0.0, p.force_patch_half_width - self.margin)
        return (min(*places, pushed) - self.margin, max(*places, pushed) + self.margin)

    @cached_property
    def walls(self) -> Pair:
        """Inner faces of the two columns [m]."""
        spans = [self.span(k) for k in range(len(self.p.levers))]
        slot = self.p.slot
        return (min(a for a, _ in spans) - slot, max(b for _, b in spans) + slot)

    @property
    def low(self) -> float:
        """Lower side of the output [m]."""
        return self.height(len(self.p.levers))

    @property
    def top(self) -> float:
        """Upper side of the output and of the columns [m]."""
        p = self.p
        return self.low + p.guide.width + p.guide_spacing + 2.0 * p.edge

    @property
    def faces(self) -> Pair:
        """Faces of the columns that the guide stands on [m]."""
        reach = 0.5 * self.p.output_width + self.p.guide.length
        return (self.outputs[-1] - reach, self.outputs[-1] + reach)

    def output(self) -> tuple[list[Body], list[Hinge]]:
        """Return the output and its guide."""
        p, x, half = self.p, self.outputs[-1], 0.5 * self.p.output_width
        first = self.low + p.edge + 0.5 * p.guide.width
        sides = (("left", x - half, math.pi), ("right", x + half, 0.0))
        bars, hinges = legs(
            p.guide,
            (
                (f"guide-{side}-{end}", ("output", "base"), (edge, y), direction)
                for end, y in (("inner", first), ("outer", first + p.guide_spacing))
                for side, edge, direction in sides
            ),
        )
        return [block("output", (x - half, self.low), (x + half, self.top)), *bars], hinges

    def base(self) -> Body:
        """Return the base: a bar with the pocket of the drive, and two columns with fulcrums."""
        p, (left, right) = self.p, self.walls
        pocket = (self.inputs[0] - 0.5 * p.actuator_width, self.inputs[0] + 0.5 * p.actuator_width)
        floor = -p.actuator_length
        inner = [
            *reversed(self._column(1.0, left)),
            (left, -p.slot),
            (pocket[0], -p.slot),
            (pocket[0], floor),
            (pocket[1], floor),
            (pocket[1], -p.slot),
            (right, -p.slot),
            *self._column(-1.0, right),
        ]
        a = min(left, self.faces[0]) - p.frame_wall
        b = max(right, self.faces[1]) + p.frame_wall
        bottom, half = floor - p.frame_wall, 0.5 * p.frame_wall
        return Body(
            name="base",
            outline=Loop((*inner, (b, self.top), (b, bottom), (a, bottom), (a, self.top))),
            mounting_holes=bolt_holes(
                ((x, y) for x in (a + half, b - half) for y in (bottom + half, self.top - half)),
                p.mounting_hole_diameter,
            ),
            fixed=True,
        )

    def _column(self, side: float, wall: float) -> list[Pair]:
        """Return the inner edge of a column, from below, with its fulcrums [m]."""
        p, ceiling = self.p, self.low - self.p.slot
        points: list[Pair] = []
        for k, x in enumerate(self.fulcrums):
            if self.side(k) == side:
                tip = x + side * self.margin
                root = self.height(k) + p.lever_height + self.p.notch.length
                roof = self.height(k + 1) - p.slot
                points += [(wall, root), (tip, root), (tip, roof), (wall, roof)]
        face = self.faces[0 if side > 0.0 else 1]
        if points and points[-1][1] == ceiling:
            points.pop()
        else:
            points.append((wall, ceiling))
        return [*points, (face, ceiling), (face, self.top)]


def lever_chain(p: LeverChainParameters) -> Stage:
    r"""Build a chain of levers.

    The levers lie above one another, their fulcrums in turn on the left and on the right. The
    drive pushes the first from below, each pushes the next through a *link* with two notches, and
    the last the *output*, which four leaves guide along y. y = 0 is the lower side of the first
    lever, x = 0 its fulcrum::

           =====|   output   |=====         guide
                      )(
                      ||      link-2      __ base
                     _)(_________________)(__
                    |        lever-2         |
                            base  )(
                           ___    ||   link-1
                       ____)(_____)(__
                      |    lever-1    |
                              ^ drive

    Its bodies are ``base`` (fixed), ``lever-1``, ``link-1-leg`` and so on, and ``output``; drive,
    probe and axis are called ``y``.

    Notes
    -----
    With pins for necks the ratio is the product of the ratios of the arms, :math:`\prod b_k/a_k`.
    Necks stretch under the forces that bend them and the guide. With :math:`k_{k+1}` for
    the stiffness against which lever k pushes, and :math:`K_k` for that of its output with its
    input held, the remaining ratio is

    .. math:: R = \prod_k \frac{b_k/a_k}{1 + k_{k+1}/K_k}

    (M. Ling, J. Cao, Z. Jiang, J. Lin, Sens. Actuators A 249 (2016) 15; the losses of one lever are
    those of M. Y. Jouaneh, R. Yang, Precis. Eng. 27 (2003) 407).

    Validity: small motion, rigid bodies; levers that bend, and ground that gives at the fulcrums,
    take more than the necks where arms are as short as the bodies are high.

    Examples
    --------
    >>> stage = lever_chain(LeverChainParameters())
    >>> len(stage.bodies), len(stage.hinges)
    (6, 10)
    """
    places = LeverChainLayout(p)
    bodies: list[Body] = []
    hinges: list[Hinge] = []
    names = [f"lever-{k}" for k in range(1, len(p.levers) + 1)]
    link = Leg(notch=p.notch, bar_length=p.link_bar_length)
    for k, (name, target) in enumerate(pairwise([*names, "output"])):
        low, (left, right) = places.height(k), places.span(k)
        bodies.append(block(name, (left, low), (right, low + p.lever_height)))
        head = low + p.lever_height
        hinges.append(
            Hinge(
                name=f"fulcrum-{k + 1}",
                bodies=(name, "base"),
                at=(places.fulcrums[k], head + 0.5 * p.notch.length),
                direction=0.5 * math.pi,
                profile=p.notch,
            )
        )
        bars, notches = link.between(
            f"link-{k + 1}",
            (name, target),
            (places.outputs[k], head),
            0.5 * math.pi,
            ends=("in", "out"),
        )
        bodies += bars
        hinges += notches
    output, guides = places.output()
    top = (places.outputs[-1], places.top)
    return plate(
        p,
        "lever-chain",
        "Chain of levers with a guided output",
        bodies=(places.base(), *bodies, *output),
        hinges=(*hinges, *guides),
        drives=(
            pushing(
                p,
                "y",
                "lever-1",
                ((places.inputs[0], 0.0), (places.inputs[0], -p.actuator_length)),
                0.5 * math.pi,
            ),
        ),
        probes=(Probe(name="y", body="output", at=top, direction=0.5 * math.pi),),
    )


LEVER_CHAIN = Topology(
    name="lever-chain",
    title="levers in a row with a guided output",
    source="M. Y. Jouaneh, R. Yang, Precis. Eng. 27 (2003) 407",
    parameters=LeverChainParameters,
    construct=lever_chain,
)
