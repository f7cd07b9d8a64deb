"""An XY stage whose platform is pulled by two bridge amplifiers, as a family of stages."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from flexstage.files.ranges import Size
from flexstage.stage import Body, Drive, Hinge, Loop, PlaneMotion, Probe, Stage, moved
from flexstage.stage.designs.amplifiers import (
    ACROSS,
    AmplifierFrame,
    BridgeParameters,
    bridge_amplifier,
)
from flexstage.stage.designs.parameters import Topology
from flexstage.stage.designs.pieces import (
    Leg,
    Pair,
    at_least,
    block,
    bolt_holes,
    box,
    legs,
    plate,
    round_leaf,
)

#: Names of the sides: the two axes, on the right and on top, and the two that only guide.
_SIDES = ("x", "y", "left", "bottom")


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeXYParameters(BridgeParameters):
    """The dimensions of a bridge-driven XY stage: those of its bridges, and of its platform."""

    platform_size: Size = 24e-3
    """Length of the sides of the platform [m]."""
    coupling: Leg = field(default_factory=lambda: round_leaf(20e-3))
    """The legs or leaves between the platform and the four blocks about it, two to each."""
    coupling_spacing: Size = 5e-3
    """Distance between the two legs that go to one block [m]."""

    def __post_init__(self) -> None:
        BridgeParameters.__post_init__(self)
        cell = bridge_amplifier(self)
        self._at_least(
            "coupling_spacing",
            self.coupling.width + self.slot,
            "so that the two legs to a block keep a slot between them",
        )
        self._at_most(
            "coupling_spacing",
            -2.0 * cell.side - self.coupling.width,
            "so that both legs stand on the output of the bridge",
        )
        self._at_most(
            "platform_size",
            2.0 * (cell.column - self.slot),
            "so that the platform keeps a slot from the frame",
        )
        at_least(
            "the length of coupling",
            self.coupling.length,
            cell.column - 0.5 * self.platform_size,
            "so that the bridges do not touch",
        )


def bridge_xy(p: BridgeXYParameters) -> Stage:
    r"""Build a bridge-driven XY stage.

    A square platform hangs between four blocks, on two leaves to each: stiff along the leaves, soft
    across. Each block is guided along its leaves. The blocks on the right and on top are the
    outputs of bridge amplifiers (`flexstage.stage.designs.amplifiers.bridge`), which pull them away
    from the platform as the drive grows; those on the left and below only guide, and make the
    guides of the platform the same on opposite sides.

    Bodies are ``base`` (the frame, fixed), ``platform``, those of the bridges with ``x-`` and
    ``y-`` before their names, and ``left`` and ``bottom``; drives, probes and axes are ``x`` and
    ``y``.

    Notes
    -----
    The leaves to the other axis transmit only the force that bends them: with k for that
    stiffness and K for that of the other block with its bridge, about k/K of the motion, so that
    neither axis moves the other (Y. Li, Q. Xu, IEEE Trans. Robot. 25 (2009) 645). The ratio
    is that of a bridge whose output works against all leaves that bend with it: the eight of two
    guides and the four to the other axis, 12 E I/l^3 each.

    Examples
    --------
    >>> stage = bridge_xy(BridgeXYParameters())
    >>> len(stage.bodies), len(stage.hinges)
    (18, 40)
    """
    cell = bridge_amplifier(p)
    reach = 0.5 * p.platform_size + p.coupling.length + cell.top
    bodies: list[Body] = []
    hinges: list[Hinge] = []
    drives: list[Drive] = []
    window: list[Pair] = []
    for k, side in enumerate(_SIDES):
        parts, notches, drive = cell.parts() if k < 2 else _guided_block(cell)
        bars, joints = _coupling(p, cell, "output" if k < 2 else "block")
        motion = _side(k, reach)
        bodies += (moved(part, motion, _names(side)) for part in (*parts, *bars))
        hinges += (moved(notch, motion, _names(side)) for notch in (*notches, *joints))
        drives += [] if drive is None else [moved(drive, motion, _names(side))]
        window += map(motion.point, _room(cell, driven=k < 2, corner=reach - cell.column))
    half = 0.5 * p.platform_size
    return plate(
        p,
        "bridge-xy",
        "XY stage with bridge amplifiers",
        bodies=(
            _frame(p, window),
            block("platform", (-half, -half), (half, half)),
            *bodies,
        ),
        hinges=hinges,
        drives=drives,
        probes=tuple(
            Probe(name=axis, body="platform", at=(0.0, 0.0), direction=0.5 * math.pi * k)
            for k, axis in enumerate("xy")
        ),
    )


def _side(k: int, reach: float) -> PlaneMotion:
    """Move the parts about a bridge to the k-th side of the platform, right, top and so on."""
    shift = ((reach, 0.0), (0.0, reach), (-reach, 0.0), (0.0, -reach))[k]
    return PlaneMotion(angle=0.5 * math.pi * (k + 1), shift=shift)


def _names(side: str) -> Callable[[str], str]:
    """Prefix names with the side; a block that only guides is named after it."""
    fixed_names = {"base": "base", "platform": "platform", "y": side, "block": side}
    return lambda name: fixed_names.get(name, f"{side}-{name}")


def _guided_block(cell: AmplifierFrame) -> tuple[list[Body], list[Hinge], None]:
    """Return a block in place of the output of a bridge, and its guide."""
    bars, notches = cell.guided("block")
    guided_block = block("block", (cell.side, cell.shoulder), (-cell.side, cell.top))
    return [guided_block, *bars], notches, None


def _coupling(
    p: BridgeXYParameters, cell: AmplifierFrame, block: str
) -> tuple[list[Body], list[Hinge]]:
    """Return the two legs from a block to the platform."""
    aside, up = 0.5 * p.coupling_spacing, 0.5 * math.pi
    return legs(
        p.coupling,
        (
            (f"coupling-{name}", (block, "platform"), (x, cell.top), up)
            for name, x in (("left", -aside), ("right", aside))
        ),
    )


def _room(cell: AmplifierFrame, *, driven: bool, corner: float) -> list[Pair]:
    """Return the edge of the frame about a side, from the corner before it on [m]."""
    behind = (-cell.column, cell.shoulder - cell.parameters.slot)
    half = cell.room()[::-1] if driven else [behind]
    return [(-cell.column, corner), *half, *(ACROSS.point(point) for point in reversed(half))]


def _frame(p: BridgeXYParameters, window: list[Pair]) -> Body:
    low = min(x for x, _ in window) - p.frame_wall
    high = max(x for x, _ in window) + p.frame_wall
    column = bridge_amplifier(p).column
    places = (0.5 * (low - column), 0.5 * (high + column))
    return Body(
        name="base",
        outline=box((low, low), (high, high)),
        holes=(Loop(tuple(window)),),
        mounting_holes=bolt_holes(
            ((x, y) for x in places for y in places), p.mounting_hole_diameter
        ),
        fixed=True,
    )


BRIDGE_XY = Topology(
    name="bridge-xy",
    title="XY stage with bridge amplifiers",
    source="Y. Li, Q. Xu, IEEE Trans. Robot. 25 (2009) 645",
    parameters=BridgeXYParameters,
    construct=bridge_xy,
)
