"""A compound guide: two double parallelograms that face each other carry one platform."""

from flexstage.designs.double_parallelogram import (
    DoubleParallelogramParameters,
    driven_platform,
    fold,
)
from flexstage.designs.parameters import Topology
from flexstage.designs.pieces import bolt_holes, box, plate
from flexstage.stage import Body, Loop, PlaneMotion, Stage, moved


def compound_parallelogram(p: DoubleParallelogramParameters) -> Stage:
    r"""Build a compound guide.

    The platform is in the middle of a frame; a double parallelogram above it and its mirror image
    below it guide it. Loads across the motion and moments are shared by both, and of what one
    deviates to its side, the other deviates to the opposite one; the two secondary stages are each
    as free as in a single double parallelogram.

    Leaves: the stiffness is 24 E I/L^3 of one leaf, and the way across under a load p (normalised
    as in `flexstage.designs.double_parallelogram.double_parallelogram`) half of that of one double
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


TOPOLOGY = Topology(
    name="compound-parallelogram",
    title="compound guide: two double parallelograms that face each other",
    source="S. Awtar, A. H. Slocum, E. Sevincer, Characteristics of beam-based flexure modules, "
    "J. Mech. Des. 129 (2007) 625",
    parameters=DoubleParallelogramParameters,
    construct=compound_parallelogram,
)
