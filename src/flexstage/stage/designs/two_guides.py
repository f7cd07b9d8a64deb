"""Two guides for one axis each as an XY stage: side by side in one plate, or one on the other."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

from flexstage.base.errors import StageError
from flexstage.files.ranges import Size, require_ranges
from flexstage.hinges import RightCircular
from flexstage.stage import Body, ExtraMass, Loop, PlaneMotion, Probe, Stage, mass_properties, moved
from flexstage.stage.designs.parallelogram import (
    DoubleParallelogramParameters,
    ParallelogramParameters,
    double_parallelogram,
    parallelogram,
)
from flexstage.stage.designs.parameters import Topology
from flexstage.stage.designs.pieces import Leg, PlateParameters, box, fine_screw, plate
from flexstage.stage.drive import AnyActuator


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleAxisParameters:
    """The dimensions of a guide for one axis, whose drive pushes its platform itself.

    Raises
    ------
    StageError
        A dimension is not positive and finite.
    """

    guide: Literal["parallelogram", "double-parallelogram"] = "parallelogram"
    """Kind of guide."""
    leg: Leg = field(
        default_factory=lambda: Leg(
            notch=RightCircular(neck_thickness=0.5e-3, radius=2e-3), bar_length=26e-3
        )
    )
    """Legs; each is a bar between two notches, or a leaf."""
    leg_spacing: Size = 40e-3
    """Distance between legs [m]."""
    platform_height: Size = 40e-3
    """Height of the platform across its motion [m]."""
    actuator_length: Size = 2e-3
    """Distance between the platform and the reaction face of the drive [m]."""
    actuator: AnyActuator = field(default_factory=lambda: fine_screw(200e-6))
    """Actuator of the axis."""

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "a guide")

    def build(self, plate: PlateParameters) -> Stage:
        """Build the guide alone, as a part of a plate: its axis is x, its platform ``platform``."""
        dimensions: dict[str, Any] = {
            **{f.name: getattr(plate, f.name) for f in fields(PlateParameters)},
            **{f.name: getattr(self, f.name) for f in fields(self) if f.name != "guide"},
        }
        if self.guide == "parallelogram":
            return parallelogram(ParallelogramParameters(**dimensions))
        return double_parallelogram(DoubleParallelogramParameters(**dimensions))


def names_of_axis(guide: Stage, axis: str, bodies: Mapping[str, str]) -> dict[str, str]:
    """Return new names for all parts of a guide of the axis x.

    Its drive, probe and axis are called by the axis, as ``y``; its other bodies and its hinges have
    it before their names, as ``y-left-leg``.
    """
    parts = [part.name for part in (*guide.bodies, *guide.hinges)]
    return {**{name: f"{axis}-{name}" for name in parts}, "x": axis, **bodies}


def base_of(guide: Stage) -> Body:
    """Return the fixed body of a guide."""
    return next(body for body in guide.bodies if body.fixed)


def extent(guide: Stage) -> tuple[float, float, float, float]:
    """Return the smallest and the largest x and y of the outlines of a stage [m]."""
    x0, y0, x1, y1 = zip(*(body.outline.bounds() for body in guide.bodies), strict=True)
    return min(x0), min(y0), max(x1), max(y1)


@dataclass(frozen=True, slots=True, kw_only=True)
class SideBySideXYParameters(PlateParameters):
    """The dimensions of two guides side by side."""

    x: SingleAxisParameters = field(default_factory=SingleAxisParameters)
    """The guide that stands on the base, a parallelogram."""
    y: SingleAxisParameters = field(default_factory=SingleAxisParameters)
    """The guide next to it, which its platform carries."""
    gap: Size = 2e-3
    """Distance between the guides [m]."""

    def __post_init__(self) -> None:
        PlateParameters.__post_init__(self)
        if self.x.guide != "parallelogram":
            raise StageError(
                f"the guide of x must be a parallelogram, got '{self.x.guide}': its base encloses "
                "its platform, which cannot reach a guide next to it"
            )


def side_by_side_xy(p: SideBySideXYParameters) -> Stage:
    """Build an XY stage of two guides side by side in one plane.

    The guide of x stands on the base. Its platform extends sideways and is the base of the guide of
    y, rotated by 90 deg: a chain of two, in one plate, driven directly, where a nested stage has
    the second guide inside the first. The middle of the platform of y lies on the line of the drive
    of x, and as far from its guide as one is long: a yaw of x moves it across by that arm.

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

    union = union_all([Polygon(o.points) for o in outlines], grid_size=1e-9).simplify(0.0)
    corners = get_coordinates(union)[:-1]
    return Loop(tuple((float(x), float(y)) for x, y in corners))


SIDE_BY_SIDE_XY = Topology(
    name="side-by-side-xy",
    title="XY stage of two guides side by side in one plate",
    source="S. T. Smith, Flexures: Elements of Elastic Mechanisms, Gordon and Breach, 2000 (guides "
    "in series)",
    parameters=SideBySideXYParameters,
    construct=side_by_side_xy,
)


# between the plates, which are drawn side by side
_APART = 10e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class StackedXYParameters(PlateParameters):
    """The dimensions of two guides that are stacked."""

    x: SingleAxisParameters = field(default_factory=SingleAxisParameters)
    """The lower guide."""
    y: SingleAxisParameters = field(default_factory=SingleAxisParameters)
    """The upper guide, rotated by 90 deg."""
    spacer: Size = 3e-3
    """Height of the spacer between the platform of the lower plate and the upper plate [m]."""

    @property
    def heights(self) -> tuple[float, float]:
        """Height of the top of the upper plate above the middle of the lower and the upper [m].

        It is the Abbe offset of each guide for an object on the stage.
        """
        upper = 0.5 * self.thickness
        return 2.0 * upper + self.spacer + upper, upper


def plates(p: StackedXYParameters) -> tuple[Stage, Stage]:
    """Build the lower and the upper plate, each in coordinates of its own, its axis ``x``.

    The platform of the lower one carries the upper one, spread as it is, as an extra mass; the
    middles of both platforms are one above the other.
    """
    lower, upper = p.x.build(p), p.y.build(p)
    centre, above = lower.probe("x").at, upper.probe("x").at
    # the upper plate lies turned by a quarter, its platform above the lower one
    turn = PlaneMotion.reflection(math.pi / 4.0)
    x, y = turn.point(above)
    turn = replace(turn, shift=(centre[0] - x, centre[1] - y))
    riding = tuple(
        ExtraMass(mass=m.mass, at=turn.point(m.centre), inertia=m.inertia)
        for m in mass_properties(upper).values()
    )
    bodies = tuple(
        replace(body, extra_masses=riding) if body.name == "platform" else body
        for body in lower.bodies
    )
    return replace(lower, bodies=bodies), upper


def stacked_xy(p: StackedXYParameters) -> Stage:
    """Build an XY stage of two stacked guides: its two plates side by side, as they are cut.

    A stage lies in one plane and these plates do not: here both bases are fixed, and the lower
    platform carries the upper plate as a mass. The motion of each axis is exact; its effect on the
    point above both platforms, by its rotations times its height and by the mounting of the plates,
    is in `flexstage.studies.guided_axes`.

    Bodies, hinges and drives of the lower plate have ``x-`` before their names and those of the
    upper one ``y-``; drives, probes and axes are ``x`` and ``y``.

    Examples
    --------
    >>> stage = stacked_xy(StackedXYParameters())
    >>> [round(m.mass, 3) for m in stage.body("x-platform").extra_masses][:2]
    [0.042, 0.003]
    """
    lower, upper = plates(p)
    mirror = PlaneMotion.reflection(math.pi / 4.0)
    x0, y0, _, _ = extent(moved(upper, mirror))
    _, bottom, right, _ = extent(lower)
    parts = (
        moved(lower, PlaneMotion(), names_of_axis(lower, "x", {})),
        moved(
            upper,
            replace(mirror, shift=(right + _APART - x0, bottom - y0)),
            names_of_axis(upper, "y", {}),
        ),
    )
    side_by_side = plate(
        p,
        "stacked-xy",
        "XY stage of two stacked guides, its plates drawn side by side",
        bodies=(body for part in parts for body in part.bodies),
        hinges=(hinge for part in parts for hinge in part.hinges),
        drives=(drive for part in parts for drive in part.drives),
        probes=(probe for part in parts for probe in part.probes),
    )
    return replace(
        side_by_side,
        notes=(
            "Two plates, drawn side by side: the upper one, rotated by 90 deg, stands on the "
            "platform of the lower one, which carries it here as a mass. Modes in which both "
            "move together, and motions out of the plane, are not modelled.",
        ),
    )


STACKED_XY = Topology(
    name="stacked-xy",
    title="XY stage of two stacked guides, one plate on the other",
    source="S. T. Smith, Flexures: Elements of Elastic Mechanisms, Gordon and Breach, 2000; "
    "offsets: J. B. Bryan, Precision Engineering 1 (1979) 129",
    parameters=StackedXYParameters,
    construct=stacked_xy,
)
