"""Mass, centre of mass and inertia of every body of a stage, exact for arcs."""

from dataclasses import dataclass
from functools import lru_cache

from flexstage.hinges import Profile
from flexstage.stage.model import Body, Hinge, Stage
from flexstage.stage.outline import AreaIntegrals, Circle, Loop, Point

# on which side of the neck, along the hinge, the halves of bodies a and b lie
_SIDES = (-1.0, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class MassProperties:
    """Mass of a body and its distribution in the plane."""

    mass: float
    """Mass [kg]."""
    centre: tuple[float, float]
    """Centre of mass (x, y) [m]."""
    inertia: float
    """Moment of inertia about its own centre of mass, normal to the plane [kg m^2]."""


def mass_properties(stage: Stage) -> dict[str, MassProperties]:
    """Return mass, centre of mass and inertia of every body.

    A body is its outline less its holes and mounting holes, of its own material where it has one,
    the half notch of each of its hinges that touches it, and its extra masses.

    Parameters
    ----------
    stage : Stage
        The stage.

    Returns
    -------
    dict of str to MassProperties
        By name of body, in the order of the stage.

    Notes
    -----
    Areas bounded by lines and arcs are integrated in closed form, half notches by the quadrature of
    their profile, to about 1e-13.

    Examples
    --------
    >>> from flexstage.quantities.material import material
    >>> from flexstage.stage import Body
    >>> plate = Loop(((0.0, 0.0), (0.03, 0.0), (0.03, 0.02), (0.0, 0.02)))
    >>> stage = Stage(name="plate", thickness=0.01, material=material("Al 7075-T6"),
    ...               bodies=(Body(name="plate", outline=plate),))
    >>> round(mass_properties(stage)["plate"].mass, 5)
    0.01686
    """
    halves: dict[str, list[tuple[Hinge, float]]] = {body.name: [] for body in stage.bodies}
    for hinge in stage.hinges:
        for name, side in zip(hinge.bodies, _SIDES, strict=True):
            halves[name].append((hinge, side))
    h, notch = stage.thickness, stage.thickness * stage.material.density
    return {
        b.name: _of(b, tuple(halves[b.name]), notch, h * stage.material_of(b).density)
        for b in stage.bodies
    }


def outer_size(stage: Stage) -> tuple[float, float, float]:
    """Return width along x, height along y and thickness of the plate.

    Parameters
    ----------
    stage : Stage
        The stage.

    Returns
    -------
    tuple of float
        Of the outlines of all bodies, without drives and what is mounted on it [m].

    Notes
    -----
    Validity: exact for arcs.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> [round(1e3 * v, 3) for v in outer_size(design("parallelogram"))]
    [68.5, 61.0, 8.0]
    """
    bounds = [body.outline.bounds() for body in stage.bodies]
    x0, y0, x1, y1 = zip(*bounds, strict=True)
    return max(x1) - min(x0), max(y1) - min(y0), stage.thickness


# a stage has dozens of hinges but a handful of profiles
@lru_cache(maxsize=1024)
def _half_notch(profile: Profile) -> tuple[float, float, float, float]:
    return profile.half_area_integrals()


# where stages follow one another of which a parameter changes, most bodies stay as they are
@lru_cache(maxsize=4096)
def _of(
    body: Body, halves: tuple[tuple[Hinge, float], ...], of_notches: float, of_body: float
) -> MassProperties:
    # about a point of the body, so that a small body far from the origin loses no digits
    ox, oy = body.outline.points[0]

    def about(shape: Loop | Circle) -> AreaIntegrals:
        loop = shape.loop() if isinstance(shape, Circle) else shape
        return loop.mapped(lambda p: (p[0] - ox, p[1] - oy)).integrals()

    plate = about(body.outline)
    for hole in (*body.holes, *body.mounting_holes):
        plate = plate.plus(about(hole), -1.0)
    # mass, its first moments and its polar moment about the point, by mass for each area
    parts = [tuple(of_body * v for v in (plate.area, plate.x, plate.y, plate.xx + plate.yy))]
    for hinge, side in halves:
        area, along, across, polar = _half_notch(hinge.profile)
        parts.append(
            _shifted(
                of_notches * area,
                hinge.to_plane(side * along / area, across / area),
                of_notches * (polar - (along**2 + across**2) / area),
                (ox, oy),
            )
        )
    parts += [_shifted(m.mass, m.at, m.inertia, (ox, oy)) for m in body.extra_masses]
    mass, first_x, first_y, polar = (sum(column) for column in zip(*parts, strict=True))
    x, y = first_x / mass, first_y / mass
    return MassProperties(mass=mass, centre=(ox + x, oy + y), inertia=polar - mass * (x**2 + y**2))


def _shifted(
    mass: float, centre: Point, inertia: float, origin: Point
) -> tuple[float, float, float, float]:
    """Return mass, first moments and polar moment about the origin of a part."""
    x, y = centre[0] - origin[0], centre[1] - origin[1]
    return mass, mass * x, mass * y, inertia + mass * (x**2 + y**2)
