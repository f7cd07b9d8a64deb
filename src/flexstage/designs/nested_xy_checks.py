"""Which combinations of dimensions give a possible nested XY stage."""

import math

from flexstage.designs.nested_xy_axis import AxisLayout
from flexstage.designs.nested_xy_parameters import NestedXYParameters
from flexstage.errors import StageError

# Rounding of sums of dimensions, far below what can be cut.
_ROUNDING = 1e-10


def check_axis(layout: AxisLayout) -> None:
    """Refuse an axis whose bodies would overlap, touch, or be cut through.

    Solid ribs that stay between two openings must be at least one slot wide.
    """
    p, g = layout.parameters, layout.slot
    root, leg = layout.notch_height / 2.0, layout.leg_width / 2.0
    inner_end = g / 2.0 + root
    taller = layout.lever_span[1] + g > layout.height / 2.0 + g
    room_for_slots = layout.lever_right + 3.0 * g if taller else 0.0

    _at_least(
        layout,
        "lever_arm_input",
        p.lever_arm_input,
        2.0 * root + p.lever_edge + g,
        "so that the ground reaches the fulcrum past the input block",
    )
    _at_least(
        layout,
        "input_position",
        p.input_position,
        inner_end + p.lever_edge / 2.0,
        "so that the two levers keep a slot between them",
    )
    _at_most(
        layout,
        "lever_arm_output",
        p.lever_arm_output,
        layout.fulcrum - max(inner_end + p.lever_edge, root + 1.5 * g),
        "so that levers and recesses of the two halves stay apart",
    )
    _at_least(
        layout,
        "link_length",
        p.link_length,
        p.link_recess - 4.0 * p.lever_notch_radius + g,
        "so that the lever keeps a slot from the platform",
    )
    _at_most(
        layout,
        "input_position + lever_arm_input - lever_arm_output",
        layout.output,
        layout.height / 2.0 - root - 2.0 * g,
        "so that the links meet the left edge of the platform",
    )
    _at_most(
        layout,
        "link_recess",
        p.link_recess,
        layout.length - g,
        "so that it does not cut the platform through",
    )
    _at_least(
        layout,
        "leg_position",
        p.leg_position,
        leg + max(0.0, room_for_slots),
        "so that the guide leg stands on the platform, clear of the levers",
    )
    _at_most(
        layout,
        "leg_position",
        p.leg_position,
        layout.length / 2.0 - leg - 1.5 * g,
        "so that the slots of the two guide legs do not merge",
    )
    _at_least(
        layout,
        "actuator_pocket_length",
        p.actuator_pocket_length,
        g,
        "the slot before the input block",
    )
    _at_most(
        layout,
        "actuator_pocket_width",
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
            f"aperture_offset must keep the centre of the aperture in the solid part of the y "
            f"platform, {_mm(layout.length)} long, got {_mm(parameters.aperture_offset)} from its "
            f"middle: take it nearer to 0"
        )
    if diameter is not None and diameter / 2.0 > room - layout.slot + _ROUNDING:
        raise StageError(
            f"aperture_diameter must be at most {_mm(2.0 * (room - layout.slot))}, so that the "
            f"aperture stays inside the y platform, got {_mm(diameter)}"
        )


def _at_least(axis: AxisLayout, name: str, value: float, limit: float, why: str) -> None:
    if value < limit - _ROUNDING:
        raise StageError(
            f"axis '{axis.name}': {name} must be at least {_mm(limit)}, {why}, got {_mm(value)}"
        )


def _at_most(axis: AxisLayout, name: str, value: float, limit: float, why: str) -> None:
    if value > limit + _ROUNDING:
        raise StageError(
            f"axis '{axis.name}': {name} must be at most {_mm(limit)}, {why}, got {_mm(value)}"
        )


def _mm(value: float) -> str:
    return f"{value * 1e3:.6g} mm"
