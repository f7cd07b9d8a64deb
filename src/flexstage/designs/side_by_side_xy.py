"""Two guides for one axis each, side by side in one plate, as a family of stages."""

import math
from dataclasses import dataclass, field, replace

from flexstage.designs.parameters import Topology
from flexstage.designs.pieces import PlateParameters, box, plate
from flexstage.designs.single_axis import (
    SingleAxisParameters,
    base_of,
    extent,
    names_of_axis,
)
from flexstage.errors import StageError
from flexstage.files.ranges import Size
from flexstage.stage import Body, Loop, PlaneMotion, Probe, Stage, moved


@dataclass(frozen=True, slots=True, kw_only=True)
class SideBySideXYParameters(PlateParameters):
    """The dimensions of two guides side by side."""

    x: SingleAxisParameters = field(default_factory=SingleAxisParameters)
    """The guide that stands on the base, a parallelogram."""
    y: SingleAxisParameters = field(default_factory=SingleAxisParameters)
    """The guide beside it, which its platform carries."""
    gap: Size = 2e-3
    """Distance between the guides [m]."""

    def __post_init__(self) -> None:
        PlateParameters.__post_init__(self)
        if self.x.guide != "parallelogram":
            raise StageError(
                f"the guide of x must be a parallelogram, got '{self.x.guide}': its base encloses "
                "its platform, which cannot reach out to a guide beside it"
            )


def side_by_side_xy(p: SideBySideXYParameters) -> Stage:
    """Build an XY stage of two guides side by side in one plane.

    The guide of x stands on the base. Its platform reaches out beside it and is the base of the
    guide of y, turned by a quarter: a chain of two, in one plate, driven directly, where a nested
    stage has the second guide inside the first. The middle of the platform of y lies on the line
    of the drive of x, and as far from its guide as one is long: a yaw of x moves it across by
    that arm.

    Bodies are ``base`` (fixed), ``carriage`` (the platform of x and the base of y in one),
    ``platform`` (of y), and the others of each guide with its axis before the name, ``x-left-leg``.
    Drives, probes and axes are ``x`` and ``y``; both probes read the middle of ``platform``.

    Examples
    --------
    >>> stage = side_by_side_xy(SideBySideXYParameters())
    >>> stage.drive("y").reacts, stage.probe("x").body
    ('carriage', 'platform')
    """
    first, second = p.x.build(p), p.y.build(p)
    inner = moved(
        first,
        PlaneMotion(),
        names_of_axis(first, "x", {"base": "base", "platform": "carriage"}),
    )
    # mirrored at the diagonal, so that y runs upwards and its base faces the first guide
    mirror = PlaneMotion.reflection(math.pi / 4.0)
    left = extent(moved(second, mirror))[0]
    right, middle = extent(first)[2] + p.gap, first.probe("x").at[1]
    height = mirror.point(second.probe("x").at)[1]
    outer = moved(
        second,
        replace(mirror, shift=(right - left, middle - height)),
        names_of_axis(second, "y", {"base": "carriage", "platform": "platform"}),
    )
    near, far = first.body("platform").outline, base_of(outer).outline
    low, high = (f(y for _, y in near.points) for f in (min, max))
    edge = max(x for x, _ in near.points)
    carriage = Body(name="carriage", outline=joined(near, box((edge, low), (right, high)), far))
    centre = outer.probe("y").at
    return plate(
        p,
        "side-by-side-xy",
        "XY stage of two guides side by side",
        bodies=(
            *(body for body in inner.bodies if body.name != "carriage"),
            carriage,
            *(body for body in outer.bodies if body.name != "carriage"),
        ),
        hinges=(*inner.hinges, *outer.hinges),
        drives=(*inner.drives, *outer.drives),
        probes=tuple(
            Probe(name=name, body="platform", at=centre, direction=direction)
            for name, direction in (("x", 0.0), ("y", math.pi / 2.0))
        ),
    )


def joined(*outlines: Loop) -> Loop:
    """Return the outline of straight-edged pieces that touch along edges."""
    from shapely import Polygon, get_coordinates, union_all

    whole = union_all([Polygon(o.points) for o in outlines], grid_size=1e-9).simplify(0.0)
    corners = get_coordinates(whole)[:-1]
    return Loop(tuple((float(x), float(y)) for x, y in corners))


TOPOLOGY = Topology(
    name="side-by-side-xy",
    title="XY stage of two guides side by side in one plate",
    source="S. T. Smith, Flexures: Elements of Elastic Mechanisms, Gordon and Breach, 2000 (guides "
    "in series)",
    parameters=SideBySideXYParameters,
    construct=side_by_side_xy,
)
