"""What bridge and rhombus amplifiers share: two blocks pushed apart, four limbs, a guided output.

The drive lies along x about the origin. The amplifier is its own image, left to right and, but for
guide and frame, top to bottom: the limb at the upper left says what the others are.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from flexstage.designs.pieces import (
    GuidedPlateParameters,
    Leg,
    Pair,
    at_least,
    bolt_holes,
    legs,
    plate,
    pushing,
    round_leaf,
    round_stack,
)
from flexstage.files.ranges import Size
from flexstage.stage import Body, Drive, Hinge, Loop, PlaneMotion, Probe, Stage, moved
from flexstage.stage.drive import AnyActuator

#: Mirrors left to right, and top to bottom.
ACROSS, ALONG = PlaneMotion.reflection(0.5 * math.pi), PlaneMotion.reflection(0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class AmplifierParameters(GuidedPlateParameters):
    """The dimensions of an amplifier that do not depend on its limbs."""

    actuator: AnyActuator = field(default_factory=lambda: round_stack(36e-3))
    """What drives it."""
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
    """Its bodies between its hinges."""
    hinges: tuple[Hinge, ...]
    """Its hinges."""
    input_corner: tuple[Pair, ...]
    """Edge of the block ``left``, from its right face upwards to its highest point [m]."""
    output_side: tuple[Pair, ...]
    """Left edge of the block ``output``, from below to where its guide begins [m]."""
    top: float
    """Its highest point [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AmplifierFrame:
    """An amplifier of four equal limbs, and where everything of it lies.

    Raises
    ------
    StageError
        The guide is too short to pass the driven blocks.
    """

    parameters: AmplifierParameters
    """Its dimensions."""
    limb: Limb
    """Its limb at the upper left."""

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
        """Return what guides a block that is as wide as the output and lies where it does."""
        p = self.parameters
        low, ends = self.shoulder + 0.5 * p.guide.width, ("base", block)
        rows = (("inner", low), ("outer", low + p.guide_spacing))
        # each beside its image on the right
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
        """Return all that moves, its blocks ``left``, ``right`` and ``output``, and the drive."""
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
        """Return it on a base of its own, a bar with two columns.

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
