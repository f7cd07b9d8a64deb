"""A nested, decoupled XY stage with symmetric levers, as a family of stages."""

import math
from dataclasses import dataclass, field
from typing import Annotated

from flexstage.base.errors import StageError
from flexstage.files.ranges import INNER_SHARE, Range, Size, require_ranges
from flexstage.quantities.material import CATALOGUE, Material
from flexstage.quantities.units import Length
from flexstage.stage import Axis, Body, Circle, Drive, Loop, Probe, Stage
from flexstage.stage.designs.nested_xy_axis import AxisLayout, AxisParameters, Placement
from flexstage.stage.designs.parameters import Topology
from flexstage.stage.designs.pieces import ROUNDING, at_least, at_most
from flexstage.stage.drive import placed
from flexstage.stage.model import millimetres


@dataclass(frozen=True, slots=True, kw_only=True)
class NestedXYParameters:
    """The dimensions of a nested XY stage, see `nested_xy`."""

    x: AxisParameters
    """The outer axis."""
    y: AxisParameters
    """The inner axis; it lies inside the platform of the x axis."""
    platform_length: Size
    """Length of the y platform, along y [m]."""
    platform_height: Size
    """Height of the y platform across its motion, along x [m]."""
    aperture_diameter: Size | None = None
    """Diameter of the central aperture of the y platform [m]; no aperture where None."""
    aperture_offset: Annotated[Length, Range()] = 0.0
    """Distance of the aperture, and of the probes, from the middle of the y platform, along y [m].
    """
    platform_wall: Size
    """Thickness of the x platform around the window of the y axis: above and to the right [m]."""
    platform_wall_below: Size
    """The same on the side of the y drive [m]."""
    platform_wall_at_recess: Size
    """The same on the left, from the bottom of the recesses of the x links [m]."""
    frame_wall: Size
    """Thickness of the frame around its window [m]."""
    mounting_hole_diameter: Size = 5.5e-3
    """Diameter of the nine holes by which the frame is bolted down [m]."""
    mounting_hole_station: Annotated[float, INNER_SHARE] = 0.42
    """Distance of the two holes in the left wall from the middle, over half of the frame's height
    [1].
    """
    slot: Size = 1e-3
    """Width of the slots between bodies [m]."""
    force_patch_half_width: Size = 3e-3
    """Half of the width over which the drives spread their force [m]."""
    thickness: Size = 10e-3
    """Thickness of the plate [m]."""
    material: Material = field(default_factory=lambda: CATALOGUE["Al 7075-T6"])
    """Material of the plate."""

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "a nested XY stage")
        if not self.mounting_hole_diameter < self.frame_wall:
            raise StageError(
                f"mounting_hole_diameter must be under the frame_wall of "
                f"{self.frame_wall * 1e3:.6g} mm, got {self.mounting_hole_diameter * 1e3:.6g} mm"
            )


def nested_xy(parameters: NestedXYParameters) -> Stage:
    """Build a nested XY stage: every outline, notch, drive, probe and axis.

    Each axis is the same mechanism. A drive pushes the *input block*; two *levers*, mirror images
    of each other, turn about their *fulcrums* on the ground and push the *platform* through two
    *links*; four *guide legs* let the platform move along the axis only. The ground of the x axis
    is the frame, and that of the y axis is the platform of the x axis: the axes are nested, so
    neither drive works against the guide of the other. One half of an axis, u along the motion::

          ground
          | fulcrum )( lever  |                   ||  leg_bar_length  ||
          |            |      |                   ||                  ||
          | a          |      | b                 ||    guide leg     ||
          |            |      |                _ _)(_ _ _ _ _ _ _ _ _ )(_ _
          |            |      )( link )( recess|       platform            |
        drive > input )(      |                |                           |
         - - -  block  - - - - - - - - - - - - | - - - - - - - - - - - - - | - - v = 0

    The lever ratio is about b/a: a stage with b < a reduces, one with b > a amplifies. A link has
    two notches because the end of the lever moves sideways too. All rules are continuous in the
    dimensions, so a search may vary every one of them. Slots are `slot` wide everywhere. The x
    platform is as large as the y axis and the walls about it need, the frame as large as the x
    axis and its wall need.

    Bodies are ``G`` (frame, fixed), ``PX`` and ``PY`` (platforms) and, for each axis, ``in`` (input
    block), ``L`` (levers), ``K`` (links), ``G0`` and ``G1`` (guide legs), u or d by the half in
    which they lie: ``xLu``, ``yG1d``.

    The stage has drives, probes and axes ``x`` and ``y``; both probes read the y platform at the
    centre of its aperture.

    Notes
    -----
    Validity: geometrically possible are dimensions for which the fulcrum lies beyond the input
    block (lever_arm_input at least notch height + lever_edge + slot), both levers and both recesses
    keep apart at the line of symmetry, the links meet the left edge of the platform, a lever keeps
    a slot from it (link_length at least link_recess - 4 lever_notch_radius + slot), the guide legs
    stand on the platform with slots apart, and the aperture clears the recesses. The models and the
    check of the stage evaluate its performance, and whether its necks can be machined.

    Examples
    --------
    >>> from flexstage.stage.designs.vgtu import PIEZO
    >>> stage = nested_xy(PIEZO.parameters)
    >>> len(stage.bodies), len(stage.hinges)
    (21, 32)
    """
    p = parameters
    y = AxisLayout(
        name="y", parameters=p.y, length=p.platform_length, height=p.platform_height, slot=p.slot
    )
    check_axis(y)
    check_aperture(p, y)
    x = _outer_axis(p, y)
    check_axis(x)
    at_x = Placement()
    # the window of the y axis begins at the wall next to the recesses, and one wall from below
    at_y = Placement(
        origin=(
            p.x.link_recess + p.platform_wall_at_recess + y.half_window,
            p.platform_wall_below - x.height / 2.0 - y.reaction_face,
        ),
        turned=True,
    )
    centre = at_y.to_plane((y.length / 2.0 + p.aperture_offset, 0.0))
    aperture = () if p.aperture_diameter is None else (Circle(centre, p.aperture_diameter / 2.0),)
    x_platform = Body(
        name="PX", outline=x.platform_outline(), holes=(y.window().mapped(at_y.to_plane),)
    )
    y_platform = Body(name="PY", outline=y.platform_outline().mapped(at_y.to_plane), holes=aperture)
    return Stage(
        name="nested-xy",
        title="Nested decoupled XY stage with symmetric levers",
        thickness=p.thickness,
        material=p.material,
        bodies=(*x.bodies(at_x), *y.bodies(at_y), x_platform, y_platform, _frame(p, x)),
        hinges=(*x.hinges(at_x, "PX", "G"), *y.hinges(at_y, "PY", "PX")),
        drives=(_drive(p, x, at_x, "G"), _drive(p, y, at_y, "PX")),
        probes=tuple(
            Probe(name=axis.name, body="PY", at=centre, direction=place.angle)
            for axis, place in ((x, at_x), (y, at_y))
        ),
        axes=tuple(Axis(name=name, drive=name, probe=name) for name in ("x", "y")),
    )


def _outer_axis(p: NestedXYParameters, y: AxisLayout) -> AxisLayout:
    """Return the x axis, its platform as large as the y axis needs."""
    window_length = y.length + p.slot - y.reaction_face
    return AxisLayout(
        name="x",
        parameters=p.x,
        length=(
            p.x.link_recess + p.platform_wall_at_recess + 2.0 * y.half_window + p.platform_wall
        ),
        height=p.platform_wall_below + window_length + p.platform_wall,
        slot=p.slot,
    )


def _frame(p: NestedXYParameters, x: AxisLayout) -> Body:
    left, right = x.reaction_face - p.frame_wall, x.length + p.slot + p.frame_wall
    top, inset = x.half_window + p.frame_wall, p.frame_wall / 2.0
    corner, station = top - inset, p.mounting_hole_station * top
    centres = [
        *(
            (u, v)
            for u in (left + inset, (left + right) / 2.0, right - inset)
            for v in (-corner, corner)
        ),
        (right - inset, 0.0),
        (left + inset, -station),
        (left + inset, station),
    ]
    return Body(
        name="G",
        outline=Loop(((left, -top), (right, -top), (right, top), (left, top))),
        holes=(x.window(),),
        mounting_holes=tuple(Circle(c, p.mounting_hole_diameter / 2.0) for c in centres),
        fixed=True,
    )


def _drive(p: NestedXYParameters, axis: AxisLayout, place: Placement, ground: str) -> Drive:
    faces = ((axis.block_left, 0.0), (axis.reaction_face, 0.0))
    return placed(
        axis.parameters.actuator,
        name=axis.name,
        pushes=f"{axis.name}in",
        reacts=ground,
        at=(place.to_plane(faces[0]), place.to_plane(faces[1])),
        direction=place.angle,
        patch_half_width=p.force_patch_half_width,
    )


def check_axis(layout: AxisLayout) -> None:
    """Refuse an axis whose bodies would overlap, touch, or be cut through.

    Solid ribs that stay between two openings must be at least one slot wide.
    """
    p, g = layout.parameters, layout.slot
    of = f"axis '{layout.name}': "
    root, leg = layout.notch_height / 2.0, layout.leg_width / 2.0
    inner_end = g / 2.0 + root
    taller = layout.lever_span[1] + g > layout.height / 2.0 + g
    room_for_slots = layout.lever_right + 3.0 * g if taller else 0.0

    at_least(
        of + "lever_arm_input",
        p.lever_arm_input,
        2.0 * root + p.lever_edge + g,
        "so that the ground reaches the fulcrum past the input block",
    )
    at_least(
        of + "input_position",
        p.input_position,
        inner_end + p.lever_edge / 2.0,
        "so that the two levers keep a slot between them",
    )
    at_most(
        of + "lever_arm_output",
        p.lever_arm_output,
        layout.fulcrum - max(inner_end + p.lever_edge, root + 1.5 * g),
        "so that levers and recesses of the two halves stay apart",
    )
    at_least(
        of + "link_length",
        p.link_length,
        p.link_recess - 4.0 * p.lever_notch_radius + g,
        "so that the lever keeps a slot from the platform",
    )
    at_most(
        of + "input_position + lever_arm_input - lever_arm_output",
        layout.output,
        layout.height / 2.0 - root - 2.0 * g,
        "so that the links meet the left edge of the platform",
    )
    at_most(
        of + "link_recess",
        p.link_recess,
        layout.length - g,
        "so that it does not cut the platform through",
    )
    at_least(
        of + "leg_position",
        p.leg_position,
        leg + max(0.0, room_for_slots),
        "so that the guide leg stands on the platform, clear of the levers",
    )
    at_most(
        of + "leg_position",
        p.leg_position,
        layout.length / 2.0 - leg - 1.5 * g,
        "so that the slots of the two guide legs do not merge",
    )
    at_least(
        of + "actuator_pocket_length",
        p.actuator_pocket_length,
        g,
        "the slot before the input block",
    )
    at_most(
        of + "actuator_pocket_width",
        p.actuator_pocket_width,
        2.0 * (layout.block_half_height + g),
        "the height of the window of the input block",
    )


def check_aperture(parameters: NestedXYParameters, layout: AxisLayout) -> None:
    """Refuse an aperture that cuts the edge of the y platform or a recess in it."""
    centre = layout.length / 2.0 + parameters.aperture_offset
    half = layout.notch_height / 2.0 + layout.slot
    # to the nearest point of a recess, which lies at v = output, from u = 0 to its depth
    along = max(0.0, centre - layout.parameters.link_recess)
    to_recess = math.hypot(along, max(0.0, layout.output - half))
    room = min(centre, layout.length - centre, layout.height / 2.0, to_recess)
    diameter = parameters.aperture_diameter
    if not room > 0.0:
        raise StageError(
            "aperture_offset must keep the centre of the aperture in the solid part of the y "
            f"platform, {millimetres(layout.length)} long, got "
            f"{millimetres(parameters.aperture_offset)} from its middle: choose a value nearer to "
            "0"
        )
    if diameter is not None and diameter / 2.0 > room - layout.slot + ROUNDING:
        raise StageError(
            f"aperture_diameter must be at most {millimetres(2.0 * (room - layout.slot))}, so that "
            f"the aperture stays inside the y platform, got {millimetres(diameter)}"
        )


NESTED_XY = Topology(
    name="nested-xy",
    title="nested, decoupled XY stage with symmetric levers",
    source="the two stages of the study with which flexstage is compared; their geometry is a "
    "reconstruction",
    parameters=NestedXYParameters,
    construct=nested_xy,
)
