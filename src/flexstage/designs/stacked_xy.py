"""Two guides for one axis each, stacked: two plates, the upper one on the platform of the lower."""

import math
from dataclasses import dataclass, field, replace

from flexstage.designs.parameters import Topology
from flexstage.designs.pieces import PlateParameters, plate
from flexstage.designs.single_axis import SingleAxisParameters, extent, names_of_axis
from flexstage.files.ranges import Size
from flexstage.stage import ExtraMass, PlaneMotion, Stage, mass_properties, moved

# between the plates where they are drawn beside each other
_APART = 10e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class StackedXYParameters(PlateParameters):
    """The dimensions of two guides that are stacked."""

    x: SingleAxisParameters = field(default_factory=SingleAxisParameters)
    """The lower guide."""
    y: SingleAxisParameters = field(default_factory=SingleAxisParameters)
    """The upper guide, turned by a quarter."""
    spacer: Size = 3e-3
    """Height of the spacer between the platform of the lower plate and the upper plate [m]."""

    @property
    def heights(self) -> tuple[float, float]:
        """Height of the top of the upper plate above the middle of the lower and the upper [m].

        It is the Abbe offset of each guide for what stands on the stage.
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
    """Build an XY stage of two stacked guides: its two plates beside each other, as they are cut.

    A stage lies in one plane and these plates do not: here both bases are held, and the lower
    platform carries the upper plate as a mass. Each axis moves as it does; what it does to the
    point above both platforms, by its rotations times its height and by how the plates are mounted,
    is in `flexstage.studies.motion_errors`.

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
    beside = plate(
        p,
        "stacked-xy",
        "XY stage of two stacked guides, its plates drawn beside each other",
        bodies=(body for part in parts for body in part.bodies),
        hinges=(hinge for part in parts for hinge in part.hinges),
        drives=(drive for part in parts for drive in part.drives),
        probes=(probe for part in parts for probe in part.probes),
    )
    return replace(
        beside,
        notes=(
            "Two plates, drawn beside each other: the upper one, turned by a quarter, stands on "
            "the platform of the lower one, which carries it here as a mass. Frequencies at which "
            "both move together, and motions out of the plane, are not in it.",
        ),
    )


TOPOLOGY = Topology(
    name="stacked-xy",
    title="XY stage of two stacked guides, one plate on the other",
    source="S. T. Smith, Flexures: Elements of Elastic Mechanisms, Gordon and Breach, 2000; "
    "offsets: J. B. Bryan, Precision Engineering 1 (1979) 129",
    parameters=StackedXYParameters,
    construct=stacked_xy,
)
