"""One axis of a nested XY stage, in its own coordinates.

u runs along the motion and is 0 at the left edge of the platform, on whose left side the levers
lie; v runs across, and the axis is symmetric in v. `flexstage.stage.designs.nested_xy.nested_xy`
has a sketch.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from flexstage.base.errors import StageError
from flexstage.files.ranges import Size, require_ranges
from flexstage.hinges import RightCircular
from flexstage.stage import Body, Hinge, Loop
from flexstage.stage.designs.pieces import box
from flexstage.stage.drive import AnyActuator

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisParameters:
    """The dimensions of one axis; both halves of an axis are equal."""

    lever_arm_input: Size
    """Distance a from the fulcrum to the input notch, along the lever [m]."""
    lever_arm_output: Size
    """Distance b from the fulcrum to the link, along the lever [m]."""
    input_position: Size
    """Distance of the input notches from the line of symmetry [m]."""
    lever_width: Size
    """Width of the lever, across its length [m]."""
    lever_edge: Size = 1e-3
    """Overhang of levers and input block beyond the roots of their outermost notches [m]; half of
    it at the input notch if that is the innermost one of the lever.
    """
    lever_notch_radius: Size
    """Radius r of the notches of lever and link [m]."""
    lever_neck: Size
    """Neck thickness of the notches of lever and link [m]."""
    link_length: Size
    """Length of the bar between the two notches of a link [m]."""
    link_recess: Size
    """Depth of the recess of the platform in which a link ends [m]."""
    leg_position: Size
    """Distance of the guide legs from the left and the right edge of the platform [m]."""
    leg_bar_length: Size
    """Length of the bar between the two notches of a guide leg [m]."""
    leg_notch_radius: Size
    """Radius of the notches of the guide legs [m]."""
    leg_neck: Size
    """Neck thickness of the notches of the guide legs [m]."""
    input_block_length: Size
    """Length of the input block along the motion [m]."""
    actuator_pocket_length: Size
    """Distance between the two faces on which the drive acts [m]; equal to the slot for a
    screw that comes through the wall, the length of the stack for a stack.
    """
    actuator_pocket_width: Size = 9e-3
    """Width of the pocket [m]."""
    actuator: AnyActuator
    """Actuator of the axis."""

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "an axis")


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """Placement of the coordinates (u, v) of an axis in the plane of the stage."""

    origin: Pair = (0.0, 0.0)
    """The point u = v = 0 [m]."""
    turned: bool = False
    """True if u runs along y instead of x."""

    @property
    def angle(self) -> float:
        """Direction of u, from the x axis to the left [rad]."""
        return math.pi / 2.0 if self.turned else 0.0

    def to_plane(self, point: Pair) -> Pair:
        """Map a point."""
        u, v = point
        x, y = (-v, u) if self.turned else (u, v)
        return (self.origin[0] + x, self.origin[1] + y)


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisLayout:
    """Layout of one axis."""

    name: str
    """Name of the axis, with which the names of its bodies and hinges begin."""
    parameters: AxisParameters
    """Dimensions."""
    length: float
    """Length of its platform along u [m]."""
    height: float
    """Height of its platform along v [m]."""
    slot: float
    """Width of the slots [m]."""

    # -------------------------------------------------------------- levels along the motion, u

    @property
    def lever_right(self) -> float:
        """Side of the levers to which the links are joined [m]."""
        p = self.parameters
        return p.link_recess - 4.0 * p.lever_notch_radius - p.link_length

    @property
    def lever_left(self) -> float:
        """Side of the levers with fulcrum and input notch [m]."""
        return self.lever_right - self.parameters.lever_width

    @property
    def ground_face(self) -> float:
        """Face of the ground at the fulcrum, and right end of the input block [m]."""
        return self.lever_left - 2.0 * self.parameters.lever_notch_radius

    @property
    def block_left(self) -> float:
        """Face of the input block that the drive pushes [m]."""
        return self.ground_face - self.parameters.input_block_length

    @property
    def reaction_face(self) -> float:
        """Face of the ground on which the drive reacts: the left end of the window [m]."""
        return self.block_left - self.parameters.actuator_pocket_length

    @property
    def leg_stations(self) -> tuple[float, float]:
        """Positions of the left and the right guide legs [m]."""
        return (self.parameters.leg_position, self.length - self.parameters.leg_position)

    # -------------------------------------------------------------- levels across the motion, v

    @property
    def notch_height(self) -> float:
        """Height of the lever notches at their roots; also the width of a link [m]."""
        return 2.0 * self.parameters.lever_notch_radius + self.parameters.lever_neck

    @property
    def leg_width(self) -> float:
        """Width of a guide leg: the height of its notches at their roots [m]."""
        return 2.0 * self.parameters.leg_notch_radius + self.parameters.leg_neck

    @property
    def fulcrum(self) -> float:
        """Position of the fulcrum [m]."""
        return self.parameters.input_position + self.parameters.lever_arm_input

    @property
    def output(self) -> float:
        """Position of the link [m]."""
        return self.fulcrum - self.parameters.lever_arm_output

    @property
    def lever_span(self) -> Pair:
        """Inner and outer end of a lever [m]."""
        p, root = self.parameters, self.notch_height / 2.0
        inner = min(
            p.input_position - root - p.lever_edge / 2.0,
            self.output - root - p.lever_edge,
        )
        return (inner, self.fulcrum + root + p.lever_edge)

    @property
    def block_half_height(self) -> float:
        """Half of the height of the input block [m]."""
        p = self.parameters
        return p.input_position + self.notch_height / 2.0 + p.lever_edge

    @property
    def leg_span(self) -> Pair:
        """Inner and outer end of the bar of a guide leg [m]."""
        start = self.height / 2.0 + 2.0 * self.parameters.leg_notch_radius
        return (start, start + self.parameters.leg_bar_length)

    @property
    def leg_root(self) -> float:
        """Position at which the guide legs are joined to the ground [m]."""
        return self.leg_span[1] + 2.0 * self.parameters.leg_notch_radius

    @property
    def half_window(self) -> float:
        """Half of the height of the window in which the axis lies [m]."""
        return max(self.leg_root, self.lever_span[1] + self.slot)

    # ----------------------------------------------------------------------------- outlines

    def platform_outline(self) -> Loop:
        """Return the outline of the platform with the links' recesses, counter-clockwise [m]."""
        p, half = self.parameters, self.notch_height / 2.0 + self.slot
        low, high = self.output - half, self.output + half
        recess = [(0.0, high), (p.link_recess, high), (p.link_recess, low), (0.0, low)]
        mirrored = [(u, -v) for u, v in reversed(recess)]
        right, top = self.length, self.height / 2.0
        return Loop(((0.0, -top), (right, -top), (right, top), (0.0, top), *recess, *mirrored))

    def window(self) -> Loop:
        """Return the opening of the ground in which the axis lies [m]."""
        g, edge = self.slot, self.height / 2.0 + self.slot
        lever, block = self.lever_span[1] + g, self.block_half_height + g
        pocket = self.parameters.actuator_pocket_width / 2.0
        half_slot = self.leg_width / 2.0 + g
        # The window narrows, or widens, from platform to levers at the edge of the taller of the
        # two, so that the step vanishes where they are equally tall.
        step = -g if lever <= edge else self.lever_right + g
        upper = [(self.length + g, edge)]
        for station in reversed(self.leg_stations):
            right, left = station + half_slot, station - half_slot
            upper += [(right, edge), (right, self.leg_root), (left, self.leg_root), (left, edge)]
        upper += [
            (step, edge),
            (step, lever),
            (self.ground_face, lever),
            (self.ground_face, block),
            (self.block_left - g, block),
            (self.block_left - g, pocket),
            (self.reaction_face, pocket),
        ]
        return Loop(_corners([*upper, *((u, -v) for u, v in reversed(upper))]))

    # ------------------------------------------------------------------- bodies and hinges

    def bodies(self, place: Placement) -> Iterator[Body]:
        """Return levers, links, guide legs and input block.

        u and d in a name denote the half with positive and negative v.
        """
        p, half = self.parameters, self.notch_height / 2.0
        leg = self.leg_width / 2.0
        link_right = p.link_recess - 2.0 * p.lever_notch_radius
        spans = {
            "L": ((self.lever_left, self.lever_right), self.lever_span),
            "K": (
                (link_right - p.link_length, link_right),
                (self.output - half, self.output + half),
            ),
        }
        for i, station in enumerate(self.leg_stations):
            spans[f"G{i}"] = ((station - leg, station + leg), self.leg_span)
        for side, sign in (("u", 1.0), ("d", -1.0)):
            for part, (u, (v0, v1)) in spans.items():
                v_low, v_high = sorted((sign * v0, sign * v1))
                outline = box((u[0], v_low), (u[1], v_high))
                yield Body(name=f"{self.name}{part}{side}", outline=outline.mapped(place.to_plane))
        block = self.block_half_height
        outline = box((self.block_left, -block), (self.ground_face, block))
        yield Body(name=f"{self.name}in", outline=outline.mapped(place.to_plane))

    def hinges(self, place: Placement, platform: str, ground: str) -> Iterator[Hinge]:
        """Return the notches of lever, link and guide legs, on both sides.

        ``ful`` is a fulcrum, ``inp`` an input notch, ``lko`` from lever to link, ``lkp`` from link
        to platform, ``gp`` from platform to guide leg, ``gg`` from guide leg to ground; `platform`
        and `ground` name the body that the axis moves and that against which it moves.
        """
        p, r = self.parameters, self.parameters.lever_notch_radius
        lever_notch = RightCircular(neck_thickness=p.lever_neck, radius=r)
        leg_notch = RightCircular(neck_thickness=p.leg_neck, radius=p.leg_notch_radius)
        inner = self.height / 2.0 + p.leg_notch_radius
        outer = self.leg_root - p.leg_notch_radius
        fulcrum = self.ground_face + r
        for side, sign in (("u", 1.0), ("d", -1.0)):
            lever, link = f"{self.name}L{side}", f"{self.name}K{side}"
            rows = [
                ("ful", ground, lever, fulcrum, self.fulcrum, lever_notch),
                ("inp", f"{self.name}in", lever, fulcrum, p.input_position, lever_notch),
                ("lko", lever, link, self.lever_right + r, self.output, lever_notch),
                ("lkp", link, platform, p.link_recess - r, self.output, lever_notch),
            ]
            for i, station in enumerate(self.leg_stations):
                leg = f"{self.name}G{i}{side}"
                rows.append((f"gp{i}", platform, leg, station, inner, leg_notch))
                rows.append((f"gg{i}", leg, ground, station, outer, leg_notch))
            for tag, a, b, u, v, notch in rows:
                across = sign * math.pi / 2.0 if notch is leg_notch else 0.0
                yield Hinge(
                    name=f"{self.name}{tag}-{side}",
                    bodies=(a, b),
                    at=place.to_plane((u, sign * v)),
                    direction=place.angle + across,
                    profile=notch,
                )


def _corners(points: list[Pair]) -> tuple[Pair, ...]:
    """Return the corners of an axis-parallel line."""
    corners: list[Pair] = []
    for point in points:
        if corners and math.dist(corners[-1], point) < 1e-12:
            continue
        corners.append(point)
    n = len(corners)

    def turns(i: int) -> bool:
        before, here, after = corners[i - 1], corners[i], corners[(i + 1) % n]
        return all(max(abs(here[k] - before[k]), abs(after[k] - here[k])) > 1e-12 for k in (0, 1))

    return tuple(corners[i] for i in range(n) if turns(i))
