"""Parallelogram guides: one, two in a row, two that face each other, and with levers."""

import math
from dataclasses import dataclass, field, replace

from flexstage.files.ranges import Size
from flexstage.hinges import CornerFilleted, Profile, RightCircular
from flexstage.stage import Body, Drive, Hinge, Loop, PlaneMotion, Probe, Stage, moved
from flexstage.stage.designs.parameters import Topology
from flexstage.stage.designs.pieces import (
    WIRE,
    Leg,
    Pair,
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
    two_sided,
)
from flexstage.stage.drive import AnyActuator


@dataclass(frozen=True, slots=True, kw_only=True)
class ParallelogramParameters(PlateParameters):
    """The dimensions of a parallelogram guide."""

    leg_spacing: Size = 40e-3
    """Distance between the two legs [m]."""
    leg: Leg = field(
        default_factory=lambda: Leg(
            notch=RightCircular(neck_thickness=0.5e-3, radius=2e-3), bar_length=26e-3
        )
    )
    """The two legs; each is a bar between two notches, or a leaf."""
    platform_overhang: Size = 4e-3
    """Overhang of the platform beyond the legs, on both sides [m]."""
    platform_height: Size = 12e-3
    """Height of the platform across its motion [m]."""
    base_height: Size = 15e-3
    """Height of the base under the legs [m]."""
    column_width: Size = 12e-3
    """Width of the column of the base that holds the drive [m]."""
    actuator_length: Size = 2e-3
    """Distance between column and platform [m]."""
    actuator: AnyActuator = field(default_factory=lambda: fine_screw(200e-6))
    """Actuator of the guide."""

    def __post_init__(self) -> None:
        PlateParameters.__post_init__(self)
        cut_apart(self, "actuator_length")
        slot = self.leg.width + WIRE
        self._at_least("leg_spacing", slot, "so that a slot is between the legs")
        bolts = 2.0 * self.mounting_hole_diameter
        material = self.leg.width + 2.0 * (self.platform_overhang + self.actuator_length)
        why = "so that the base encloses it"
        self._at_most("mounting_hole_diameter", material - WIRE, why)
        self._at_least("leg_spacing", bolts, "for the bolts under the legs")
        self._holes_within("base_height")


def parallelogram(p: ParallelogramParameters) -> Stage:
    """Build a parallelogram guide.

    A platform stands on two legs; each leg has a notch at either end, so that the platform moves
    along x, and by about d^2/(2 l) towards the base when it has moved by d on legs whose necks are
    l apart. The base carries a column, against which the drive pushes the platform. y = 0 is the
    top of the base, x = 0 the middle of the platform.

    A leaf takes the place of a leg without a bar. Leaves of length L that bend into an S take the
    platform towards the base by 3/5 d^2/L, and are 12 E I/L^3 stiff, each: S. Awtar, A. H. Slocum
    and E. Sevincer, Characteristics of beam-based flexure modules, J. Mech. Des. 129 (2007) 625.
    A leg of two notches is a link of two springs k of its necks: 2 k/l^2 each.

    Its bodies are ``base`` (fixed), ``left-leg``, ``right-leg`` (where they have bars) and
    ``platform``; its hinges ``left-lower``, ``left-upper``, ``right-lower`` and ``right-upper``, or
    ``left`` and ``right``; its drive, probe and axis ``x``.

    Examples
    --------
    >>> stage = parallelogram(ParallelogramParameters())
    >>> stage.hinge("left-upper").at
    (-0.02, 0.032)
    """
    platform_bottom = p.leg.length
    platform_top = platform_bottom + p.platform_height
    half_leg = 0.5 * p.leg.width
    half_platform = 0.5 * p.leg_spacing + half_leg + p.platform_overhang
    face = -half_platform - p.actuator_length
    left = face - p.column_width
    # as far on the other side, so that the two legs stand on equal ground
    right = -face
    base = Body(
        name="base",
        outline=Loop(
            (
                (left, -p.base_height),
                (right, -p.base_height),
                (right, 0.0),
                (face, 0.0),
                (face, platform_top),
                (left, platform_top),
            )
        ),
        mounting_holes=bolt_holes(
            ((sign * 0.5 * p.leg_spacing, -0.5 * p.base_height) for sign in (-1.0, 1.0)),
            p.mounting_hole_diameter,
        ),
        fixed=True,
    )
    legs, hinges = [], []
    for name, x in (("left", -0.5 * p.leg_spacing), ("right", 0.5 * p.leg_spacing)):
        bars, notches = p.leg.between(
            name, ("base", "platform"), (x, 0.0), math.pi / 2.0, ends=("lower", "upper")
        )
        legs += bars
        hinges += notches
    middle = 0.5 * (platform_bottom + platform_top)
    drive = pushing(p, "x", "platform", ((-half_platform, middle), (face, middle)), 0.0)
    return plate(
        p,
        "parallelogram",
        "Parallelogram guide",
        bodies=(
            base,
            *legs,
            block("platform", (-half_platform, platform_bottom), (half_platform, platform_top)),
        ),
        hinges=hinges,
        drives=(drive,),
        probes=(Probe(name="x", body="platform", at=(0.0, middle), direction=0.0),),
    )


PARALLELOGRAM = Topology(
    name="parallelogram",
    title="parallelogram guide on two legs of notches or leaves",
    source="S. T. Smith, Flexures: Elements of Elastic Mechanisms, Gordon and Breach, 2000; "
    "S. Awtar, A. H. Slocum, E. Sevincer, J. Mech. Des. 129 (2007) 625",
    parameters=ParallelogramParameters,
    construct=parallelogram,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class DoubleParallelogramParameters(PlateParameters):
    """The dimensions of a double parallelogram."""

    leg: Leg = field(default_factory=lambda: round_leaf(30e-3, 0.4e-3, 0.8e-3))
    """Equal legs; each is a leaf, or a bar between two notches."""
    leg_spacing: Size = 24e-3
    """Distance between the two legs that carry the platform [m]."""
    overhang: Size = 4e-3
    """Overhang of bodies beyond their legs [m]."""
    platform_height: Size = 14e-3
    """Height of the platform across its motion [m]."""
    secondary_height: Size = 8e-3
    """Height of the secondary stage, on which the legs turn back [m]."""
    clearance: Size = 1.5e-3
    """Width of the slots along the moving parts [m]."""
    wall: Size = 12e-3
    """Thickness of the base beyond the slots [m]."""
    actuator: AnyActuator = field(default_factory=lambda: fine_screw(1e-3))
    """Actuator of the guide."""
    actuator_length: Size = 3e-3
    """Distance between the base and the platform along the motion, on both sides [m]."""

    def __post_init__(self) -> None:
        PlateParameters.__post_init__(self)
        self._holes_within("wall")
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
    """Return the platform below y = 0, its drive, and the probe in its middle."""
    platform = block("platform", (-p.half_platform, -p.platform_height), (p.half_platform, 0.0))
    middle = -0.5 * p.platform_height
    drive = pushing(p, "x", "platform", ((-p.half_platform, middle), (-p.face, middle)), 0.0)
    return platform, drive, Probe(name="x", body="platform", at=(0.0, middle), direction=0.0)


def double_parallelogram(p: DoubleParallelogramParameters) -> Stage:
    r"""Build a double parallelogram guide.

    Two outer legs carry a secondary stage on the base, and two inner legs go back from there to
    the platform. Both parallelograms shorten equally as they move, so the platform, which moves
    twice as far as the secondary stage, moves straight::

         |          secondary           |
         ||        ||        ||        ||   leg.length
        base | actuator > platform |  base      - - y = 0
         |_____________________________|

    Leaves of length L with L/t of tens: the stiffness is 12 E I/L^3, of one leaf. Normalised by L,
    E I/L^2 and E I/L, with a = 12, e = 1.2, i = -0.6, r = 1/700 and d = 12 (L/t)^2, a load p across
    the motion gives the way across

    .. math:: x = p\,[1/d + y^2(r/4 - e\,i/(2a))] = p\,(1/d + 0.0304\,y^2),

    none without a load, and much where the platform has moved by a displacement y: the secondary
    stage, which nothing holds at half of y, is compliant (S. Awtar, A. H. Slocum, E. Sevincer,
    Characteristics of beam-based flexure modules, J. Mech. Des. 129 (2007) 625). With legs of two
    notches k whose necks are l apart, a = 2, e = 1, i = -1/2, r = 0 by l, k/l and k: x = p (1/d +
    y^2/8), and the stiffness is 2 k/l^2.

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


DOUBLE_PARALLELOGRAM = Topology(
    name="double-parallelogram",
    title="double parallelogram guide (folded beam) for straight motion, of notches or leaves",
    source="S. Awtar, A. H. Slocum, E. Sevincer, Characteristics of beam-based flexure modules, "
    "J. Mech. Des. 129 (2007) 625",
    parameters=DoubleParallelogramParameters,
    construct=double_parallelogram,
)


def compound_parallelogram(p: DoubleParallelogramParameters) -> Stage:
    r"""Build a compound guide.

    The platform is in the middle of a frame; a double parallelogram above it and its mirror image
    below it guide it. Loads across the motion and moments are shared by both, and their lateral
    deviations are opposite; the two secondary stages are each as free as in a single double
    parallelogram.

    Leaves: the stiffness is 24 E I/L^3 of one leaf, and the way across under a load p (normalised
    as in `flexstage.stage.designs.parallelogram.double_parallelogram`) half of that of one double
    parallelogram to first order: S. Awtar, A. H. Slocum, E. Sevincer, Characteristics of beam-based
    flexure modules, J. Mech. Des. 129 (2007) 625.

    Its bodies are ``base`` (fixed), ``platform``, ``upper-secondary``, ``lower-secondary`` and the
    bars of the legs, such as ``upper-outer-left``; its drive, probe and axis ``x``. x = 0 and
    y = -platform_height/2 are its lines of symmetry.

    Examples
    --------
    >>> stage = compound_parallelogram(DoubleParallelogramParameters())
    >>> len(stage.bodies), len(stage.hinges)
    (4, 8)
    """
    platform, drive, probe = driven_platform(p)
    bodies, hinges = fold(p, "upper-")
    mirror = PlaneMotion.reflection(0.0, through=(0.0, -0.5 * p.platform_height))
    lower = [moved(part, mirror, _lower) for part in (*bodies, *hinges)]
    high = p.leg.length + p.secondary_height + p.clearance
    low, half = -p.platform_height - high, p.half_secondary + p.clearance
    # two ledges reach from the frame to the platform; the outer legs stand on both sides of them
    upper_right = [(half, 0.0), (half, high), (-half, high), (-half, 0.0)]
    window = [
        *upper_right,
        (-p.face, 0.0),
        (-p.face, -p.platform_height),
        (-half, -p.platform_height),
        (-half, low),
        (half, low),
        (half, -p.platform_height),
        (p.face, -p.platform_height),
        (p.face, 0.0),
    ]
    x, inset = half + p.wall, 0.5 * p.wall
    base = Body(
        name="base",
        outline=box((-x, low - p.wall), (x, high + p.wall)),
        holes=(Loop(tuple(window)),),
        mounting_holes=bolt_holes(
            ((sx, sy) for sx in (inset - x, x - inset) for sy in (low - inset, high + inset)),
            p.mounting_hole_diameter,
        ),
        fixed=True,
    )
    return plate(
        p,
        "compound-parallelogram",
        "Compound guide of two double parallelograms",
        bodies=(base, platform, *bodies, *(part for part in lower if isinstance(part, Body))),
        hinges=(*hinges, *(part for part in lower if not isinstance(part, Body))),
        drives=(drive,),
        probes=(probe,),
    )


def _lower(name: str) -> str:
    return name.replace("upper-", "lower-")


COMPOUND_PARALLELOGRAM = Topology(
    name="compound-parallelogram",
    title="compound guide of two opposed double parallelograms",
    source="S. Awtar, A. H. Slocum, E. Sevincer, Characteristics of beam-based flexure modules, "
    "J. Mech. Des. 129 (2007) 625",
    parameters=DoubleParallelogramParameters,
    construct=compound_parallelogram,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkedParallelogramParameters(DoubleParallelogramParameters):
    """The dimensions of a double parallelogram with two levers."""

    leg: Leg = field(default_factory=lambda: round_leaf(40e-3, 0.5e-3, 0.8e-3))
    """Equal legs; each is a leaf, or a bar between two notches."""
    overhang: Size = 8e-3
    """Overhang of bodies beyond their legs; on the platform there is room for a post [m]."""
    secondary_height: Size = 16e-3
    """Height of the secondary stage, on which the legs turn back [m]."""
    link: Leg = field(default_factory=lambda: round_leaf(12e-3, 0.3e-3, 0.6e-3))
    """The link of a lever with the platform and with the secondary stage, along the motion."""
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
        self._at_least("overhang", room, "for a post next to a leg")
        self._at_least("lever_width", self.pivot.root_height, "the root of its pivot")
        reach = self.actuator_length + 0.5 * self.pivot.root_height
        at_least("link.length", self.link.length + 0.5 * self.lever_width, reach, "up to the base")
        at_least("leg.length", self.leg.length, self._shortest_leg, "for the lever next to it")

    @property
    def _shortest_leg(self) -> float:
        """Length of a leg with which the post of the secondary stage ends above the base [m]."""
        return 1.5 * self.pivot.length + 5.0 * self.link.width + 3.0 * self.clearance

    @property
    def outer(self) -> float:
        """Distance of the legs on the base from the middle [m]."""
        post = self.post_width + self.clearance + 0.5 * self.leg.width
        return self.half_platform + 2.0 * self.link.length + self.lever_width + post

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

    The secondary stage then moves by half as much as the platform under any load, so that the
    stiffness across the motion does not decrease with the displacement. Of the way across, x = p
    (1/d + y^2 [r/4 - e i/(2a)]), the second term in brackets goes (the names are those of
    `flexstage.stage.designs.parallelogram.double_parallelogram`), and so does the low mode of the
    secondary stage with the platform held. The notches of the levers add to the stiffness along the
    motion.

    That the secondary stage of a double parallelogram is not constrained, and that a linkage which
    halves the platform's motion constrains it, is from R. M. Panas and J. B. Hopkins, Eliminating
    underconstraint in double parallelogram flexure mechanisms, J. Mech. Des. 137 (2015) 092301. The
    linkage here is cut with the plate, and differs from theirs.

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


LINKED_PARALLELOGRAM = Topology(
    name="linked-parallelogram",
    title="double parallelogram guide with levers that move the secondary stage by half",
    source="R. M. Panas, J. B. Hopkins, Eliminating underconstraint in double parallelogram "
    "flexure mechanisms, J. Mech. Des. 137 (2015) 092301; with a different linkage",
    parameters=LinkedParallelogramParameters,
    construct=linked_parallelogram,
)
