"""A small stage with awkward numbers for the tests of finite elements: a chain of two bars."""

import math

from flexstage.hinges import CornerFilleted, RightCircular
from flexstage.quantities.material import Material
from flexstage.stage import (
    Axis,
    Body,
    Circle,
    ExtraMass,
    Hinge,
    Loop,
    PiezoStack,
    Probe,
    Stage,
)

MATERIAL = Material(
    name="bronze",
    youngs_modulus=117.3e9,
    poissons_ratio=0.341,
    density=8610.0,
    thermal_expansion=17.1e-6,
)
R1, T1 = 1.0e-3, 0.46e-3
T2, LENGTH2, FILLET2 = 0.71e-3, 2.2e-3, 0.6e-3


def _box(x0: float, x1: float, y0: float, y1: float) -> Loop:
    return Loop(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def hinged_bars(*, extra: bool = True, material: Material = MATERIAL) -> Stage:
    """A bolted block, a bar that lies and a bar that stands on it, with unequal notches.

    The drive stands on the block beside its own line, one probe reads a point, another the second
    bar against the first where that has no material.
    """
    second = CornerFilleted(neck_thickness=T2, notch_length=LENGTH2, fillet_radius=FILLET2)
    half = 0.5 * second.length
    neck = (16.2e-3, 2.5e-3 + half)
    bodies = (
        Body(
            name="block",
            outline=_box(-14e-3, -R1, -5e-3, 7e-3),
            mounting_holes=(Circle((-8e-3, 1.1e-3), 2e-3),),
            fixed=True,
        ),
        Body(name="lying", outline=_box(R1, 19e-3, -2e-3, 2.5e-3)),
        Body(
            name="standing",
            outline=_box(13.4e-3, 18.3e-3, neck[1] + half, neck[1] + half + 11e-3),
            holes=(Circle((15.5e-3, 10.3e-3), 0.9e-3),),
            extra_masses=(ExtraMass(mass=7e-3, at=(15.1e-3, 13e-3), inertia=8e-8),) * extra,
        ),
    )
    return Stage(
        name="hinged bars",
        thickness=6e-3,
        material=material,
        bodies=bodies,
        hinges=(
            Hinge(
                name="first",
                bodies=("block", "lying"),
                at=(0.0, 0.0),
                direction=0.0,
                profile=RightCircular(radius=R1, neck_thickness=T1),
            ),
            # from the second body to the first one, so that either half comes first somewhere
            Hinge(
                name="second",
                bodies=("standing", "lying"),
                at=neck,
                direction=-math.pi / 2,
                profile=second,
            ),
        ),
        drives=(
            PiezoStack(
                name="push",
                pushes="lying",
                reacts="block",
                at=((6e-3, -2e-3), (-3e-3, -5e-3)),
                direction=math.pi / 2,
                patch_half_width=1.1e-3,
                free_stroke=9e-6,
                stiffness=1.3e7,
            ),
        ),
        probes=(
            Probe(name="tip", body="standing", at=(14.2e-3, 14.1e-3), direction=0.3),
            Probe(
                name="between",
                body="standing",
                at=(16.4e-3, 8.2e-3),
                direction=2.0,
                relative_to="lying",
            ),
        ),
        axes=(Axis(name="a", drive="push", probe="tip"),),
    )
