"""A parallelogram guide with four circular hinges, as a family of stages."""

import math
from dataclasses import dataclass, field

from flexstage.errors import StageError
from flexstage.files.ranges import Size, require_ranges
from flexstage.hinges import RightCircular
from flexstage.material import CATALOGUE, Material
from flexstage.stage import Axis, Body, Circle, Hinge, Loop, Probe, Stage
from flexstage.stage.drive import AnyActuator, ScrewActuator, placed


@dataclass(frozen=True, slots=True, kw_only=True)
class ParallelogramParameters:
    """The dimensions of a parallelogram guide."""

    leg_spacing: Size = 40e-3
    """Distance between the two legs [m]."""
    leg_bar_length: Size = 26e-3
    """Length of the bar between the two notches of a leg [m]."""
    notch_radius: Size = 2e-3
    """Radius of the notches [m]."""
    neck_thickness: Size = 0.5e-3
    """Neck thickness of the notches [m]."""
    platform_overhang: Size = 4e-3
    """How far the platform reaches beyond the legs, on both sides [m]."""
    platform_height: Size = 12e-3
    """Height of the platform across its motion [m]."""
    base_height: Size = 15e-3
    """Height of the base under the legs [m]."""
    column_width: Size = 12e-3
    """Width of the column of the base that holds the drive [m]."""
    actuator_length: Size = 2e-3
    """Distance between column and platform [m]."""
    mounting_hole_diameter: Size = 5.5e-3
    """Diameter of the two holes by which the base is bolted down [m]."""
    actuator: AnyActuator = field(
        default_factory=lambda: ScrewActuator(pitch=0.25e-3, smallest_step=0.5e-6, travel=200e-6)
    )
    """What drives the guide."""
    force_patch_half_width: Size = 2e-3
    """Half of the width over which the drive spreads its force [m]."""
    thickness: Size = 8e-3
    """Thickness of the plate [m]."""
    material: Material = field(default_factory=lambda: CATALOGUE["Al 7075-T6"])
    """What it is cut from."""

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "a parallelogram")
        leg_width = 2.0 * self.notch_radius + self.neck_thickness
        if not self.leg_spacing > leg_width:
            raise StageError(
                f"leg_spacing must be over the width of a leg, {leg_width * 1e3:.6g} mm, "
                f"got {self.leg_spacing * 1e3:.6g} mm"
            )
        if not self.mounting_hole_diameter < self.base_height:
            raise StageError(
                f"mounting_hole_diameter must be under the base_height of "
                f"{self.base_height * 1e3:.6g} mm, got {self.mounting_hole_diameter * 1e3:.6g} mm"
            )


def parallelogram(parameters: ParallelogramParameters | None = None) -> Stage:
    """Build a parallelogram guide.

    A platform stands on two legs; each leg has a notch at either end, so that the platform moves
    along x, and by about d^2/(2 l) towards the base when it has moved by d on legs whose necks are
    l apart. The base carries a column, against which the drive pushes the platform. y = 0 is the
    top of the base, x = 0 the middle of the platform.

    Its bodies are ``base`` (fixed), ``left-leg``, ``right-leg`` and ``platform``; its hinges
    ``left-lower``, ``left-upper``, ``right-lower`` and ``right-upper``; its drive, probe and axis
    ``x``.

    Examples
    --------
    >>> stage = parallelogram()
    >>> stage.hinge("left-upper").at
    (-0.02, 0.032)
    """
    p = parameters or ParallelogramParameters()
    r = p.notch_radius
    leg_bottom, leg_top = 2.0 * r, 2.0 * r + p.leg_bar_length
    platform_bottom = leg_top + 2.0 * r
    platform_top = platform_bottom + p.platform_height
    half_leg = r + 0.5 * p.neck_thickness
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
        mounting_holes=tuple(
            Circle(
                (sign * 0.5 * p.leg_spacing, -0.5 * p.base_height), 0.5 * p.mounting_hole_diameter
            )
            for sign in (-1.0, 1.0)
        ),
        fixed=True,
    )
    notch = RightCircular(neck_thickness=p.neck_thickness, radius=r)
    legs, hinges = [], []
    for name, x in (("left", -0.5 * p.leg_spacing), ("right", 0.5 * p.leg_spacing)):
        leg = _rectangle(f"{name}-leg", (x - half_leg, leg_bottom), (x + half_leg, leg_top))
        legs.append(leg)
        ends = (("lower", "base", leg.name, r), ("upper", leg.name, "platform", leg_top + r))
        for end, below, above, y in ends:
            hinges.append(
                Hinge(
                    name=f"{name}-{end}",
                    bodies=(below, above),
                    at=(x, y),
                    direction=math.pi / 2.0,
                    profile=notch,
                )
            )
    middle = 0.5 * (platform_bottom + platform_top)
    drive = placed(
        p.actuator,
        name="x",
        pushes="platform",
        reacts="base",
        at=((-half_platform, middle), (face, middle)),
        direction=0.0,
        patch_half_width=p.force_patch_half_width,
    )
    return Stage(
        name="parallelogram",
        title="Parallelogram guide with four circular hinges",
        thickness=p.thickness,
        material=p.material,
        bodies=(
            base,
            *legs,
            _rectangle(
                "platform", (-half_platform, platform_bottom), (half_platform, platform_top)
            ),
        ),
        hinges=tuple(hinges),
        drives=(drive,),
        probes=(Probe(name="x", body="platform", at=(0.0, middle), direction=0.0),),
        axes=(Axis(name="x", drive="x", probe="x"),),
    )


def _rectangle(name: str, low: tuple[float, float], high: tuple[float, float]) -> Body:
    return Body(name=name, outline=Loop((low, (high[0], low[1]), high, (low[0], high[1]))))
