"""A double parallelogram whose levers hold the secondary stage at half of the platform's motion."""

import math
from dataclasses import dataclass, field, replace

from flexstage.designs.double_parallelogram import (
    DoubleParallelogramParameters,
    double_parallelogram,
)
from flexstage.designs.parameters import Topology
from flexstage.designs.pieces import Leg, Pair, at_least, block, legs, round_leaf, two_sided
from flexstage.files.ranges import Size
from flexstage.hinges import CornerFilleted, Profile
from flexstage.stage import Body, Hinge, Loop, PlaneMotion, Stage, moved


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkedParallelogramParameters(DoubleParallelogramParameters):
    """The dimensions of a double parallelogram with two levers."""

    leg: Leg = field(default_factory=lambda: round_leaf(40e-3, 0.5e-3, 0.8e-3))
    """Its legs, all alike; each is a leaf, or a bar between two notches."""
    overhang: Size = 8e-3
    """How far bodies reach beyond their legs; on the platform there is room for a post [m]."""
    secondary_height: Size = 16e-3
    """Height of the secondary stage, on which the legs turn back [m]."""
    link: Leg = field(default_factory=lambda: round_leaf(12e-3, 0.3e-3, 0.6e-3))
    """What joins a lever with the platform and with the secondary stage, along the motion."""
    pivot: Profile = field(
        default_factory=lambda: CornerFilleted(
            neck_thickness=0.3e-3, notch_length=6e-3, fillet_radius=0.6e-3
        )
    )
    """The notch by which a lever stands on the base."""
    lever_width: Size = 5e-3
    """Width of a lever [m]."""
    post_width: Size = 5e-3
    """Width of the posts of platform and secondary stage, from which the links go [m]."""

    def __post_init__(self) -> None:
        DoubleParallelogramParameters.__post_init__(self)
        two_sided(self.pivot, "a lever")
        room = self.post_width + self.clearance
        self._at_least("overhang", room, "for a post beside a leg")
        self._at_least("lever_width", self.pivot.root_height, "the root of its pivot")
        reach = self.actuator_length + 0.5 * self.pivot.root_height
        at_least("link.length", self.link.length + 0.5 * self.lever_width, reach, "up to the base")
        at_least("leg.length", self.leg.length, self._shortest_leg, "for the lever beside it")

    @property
    def _shortest_leg(self) -> float:
        """Length of a leg beside which the post of the secondary stage ends above the base [m]."""
        return 1.5 * self.pivot.length + 5.0 * self.link.width + 3.0 * self.clearance

    @property
    def outer(self) -> float:
        """Distance of the legs on the base from the middle [m]."""
        beside = self.post_width + self.clearance + 0.5 * self.leg.width
        return self.half_platform + 2.0 * self.link.length + self.lever_width + beside

    @property
    def link_heights(self) -> Pair:
        """Heights of the links to the secondary stage and to the platform over the base [m]."""
        pivot, top = 0.5 * self.pivot.length, self.leg.length - self.clearance - self.link.width
        return 0.5 * (pivot + top), top


def linked_parallelogram(p: LinkedParallelogramParameters) -> Stage:
    r"""Build a double parallelogram with levers that hold its secondary stage.

    On both sides a lever stands on the base by a notch. The platform drives its upper end, and
    half way up it takes the secondary stage along::

         ||  secondary  _____________  ||
         ||                 |  post |  ||
         ||  post |- link -|lever|  |  ||
         ||       |        |     |--|  ||
         platform |        |_ _ _|     base
         _________|         ) (  _________

    The secondary stage then moves by half as much as the platform, whatever load acts: what a
    double parallelogram loses of its stiffness across when it has moved, it keeps here. Of the way
    across, x = p (1/d + y^2 [r/4 - e i/(2a)]), the second term in brackets goes (the names are
    those of `flexstage.designs.double_parallelogram.double_parallelogram`), and so does the low
    mode of the secondary stage with the platform held. The notches of the levers add to the
    stiffness along the motion.

    That the secondary stage of a double parallelogram is not constrained, and that a linkage which
    halves the platform's motion mends it, is from R. M. Panas and J. B. Hopkins, Eliminating
    underconstraint in double parallelogram flexure mechanisms, J. Mech. Des. 137 (2015) 092301. The
    form of the linkage here is one that is cut with the plate, and not theirs.

    Bodies and hinges are those of the double parallelogram and, ``left`` and ``right``, the body
    ``left-lever`` and the hinges ``left-pivot``, ``left-platform-link`` and
    ``left-secondary-link``; a link with a bar has a body ``left-platform-link-leg``.

    Examples
    --------
    >>> p = LinkedParallelogramParameters()
    >>> stage = linked_parallelogram(p)
    >>> pivot, half, whole = (stage.hinge(f"right-{n}").at[1]
    ...                       for n in ("pivot", "secondary-link", "platform-link"))
    >>> round((whole - pivot) / (half - pivot), 9)
    2.0
    """
    plain = double_parallelogram(p)
    bodies, hinges = _lever(p)
    mirror = PlaneMotion.reflection(math.pi / 2.0)
    left = {part.name: part.name.replace("right", "left") for part in (*bodies, *hinges)}
    bodies += [moved(body, mirror, left) for body in bodies]
    hinges += [moved(hinge, mirror, left) for hinge in hinges]
    posts = {"platform": _platform(p), "secondary": _secondary(p)}
    return replace(
        plain,
        name="linked-parallelogram",
        title="Double parallelogram guide with levers on its secondary stage",
        bodies=(
            *(replace(b, outline=posts.get(b.name, b.outline)) for b in plain.bodies),
            *bodies,
        ),
        hinges=(*plain.hinges, *hinges),
    )


def _lever(p: LinkedParallelogramParameters) -> tuple[list[Body], list[Hinge]]:
    """Return the right lever with its pivot and links."""
    half, top = p.link_heights
    near = p.half_platform + p.link.length
    far = near + p.lever_width
    lever = block("right-lever", (near, p.pivot.length), (far, top + p.link.width))
    pivot = Hinge(
        name="right-pivot",
        bodies=("base", lever.name),
        at=(0.5 * (near + far), 0.5 * p.pivot.length),
        direction=math.pi / 2.0,
        profile=p.pivot,
    )
    bars, notches = legs(
        p.link,
        (
            ("right-platform-link", ("platform", lever.name), (p.half_platform, top), 0.0),
            ("right-secondary-link", (lever.name, "secondary"), (far, half), 0.0),
        ),
    )
    return [lever, *bars], [pivot, *notches]


def _platform(p: LinkedParallelogramParameters) -> Loop:
    """Return the outline of the platform with its two posts."""
    x, top = p.half_platform, p.link_heights[1] + p.link.width
    inner = x - p.post_width
    right = [(x, -p.platform_height), (x, top), (inner, top), (inner, 0.0)]
    return _symmetric(right)


def _secondary(p: LinkedParallelogramParameters) -> Loop:
    """Return the outline of the secondary stage with its two posts."""
    bottom, top = p.leg.length, p.leg.length + p.secondary_height
    inner = p.half_platform + 2.0 * p.link.length + p.lever_width
    outer, end = inner + p.post_width, p.link_heights[0] - p.link.width
    right = [(inner, bottom), (inner, end), (outer, end), (outer, bottom)]
    return _symmetric([*right, (p.half_secondary, bottom), (p.half_secondary, top)])


def _symmetric(right: list[Pair]) -> Loop:
    return Loop((*right, *((-x, y) for x, y in reversed(right))))


TOPOLOGY = Topology(
    name="linked-parallelogram",
    title="double parallelogram guide whose secondary stage is held at half by levers",
    source="R. M. Panas, J. B. Hopkins, Eliminating underconstraint in double parallelogram "
    "flexure mechanisms, J. Mech. Des. 137 (2015) 092301; the linkage is another one",
    parameters=LinkedParallelogramParameters,
    construct=linked_parallelogram,
)
