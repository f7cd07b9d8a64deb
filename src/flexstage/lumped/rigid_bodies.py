"""A stage as rigid bodies and springs: the data of every lumped model.

Bodies carry mass and inertia, hinges a 3 x 3 stiffness about the neck, drives and probes measure
the distance of a point of one body from a point of another. Both the symbolic equations and the
nonlinear model use these data; neither needs outlines or notches.
"""

import math
from dataclasses import dataclass
from typing import Literal

from flexstage.base.arrays import Array
from flexstage.base.short_repr import short_repr
from flexstage.hinges.hinge_spring import PlaneState, plane_moduli
from flexstage.lumped.assemble import HingeSpring, cached_stress_rows, hinge_springs
from flexstage.lumped.leaf import LeafBeam, leaf_beam
from flexstage.stage.mass import mass_properties
from flexstage.stage.model import Stage
from flexstage.system.mechanical import find_named

Pair = tuple[float, float]
_HAS = ": the mechanism has"


@dataclass(frozen=True, slots=True, kw_only=True)
class RigidBody:
    """A rigid body in the plane."""

    name: str
    """Name."""
    mass: float
    """Mass m [kg]."""
    inertia: float
    """Moment of inertia J about its centre of mass [kg m^2]."""
    centre: Pair
    """Centre of mass (x, y) [m]."""
    fixed: bool = False
    """True if it is fixed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringHinge:
    """A hinge as a spring of two translations and a rotation, at the neck."""

    name: str
    """Name."""
    bodies: tuple[int, int]
    """Indices of the bodies a and b."""
    at: Pair
    """Centre of the neck (x, y) [m]."""
    direction: float
    """Direction from body a to body b, from the x axis to the left [rad]."""
    stiffness: Array
    """Forces (N, V, M) on body b for deformations (u, v, theta) of b against a, in the hinge's own
    axes [N/m, N, N m/rad], shape (3, 3).
    """
    leaf: LeafBeam | None = None
    """The beam that bends far under finite rotations; None for a notch, which bends at its neck."""
    stress: Array | None = None
    """Equivalent stress at critical points for the forces (N, V, M) [1/m^2, 1/m^2, 1/m^3], shape
    (2, 3), or (4, 3) of a leaf: those at its end in body a, then in body b.
    """

    @property
    def ends(self) -> tuple[Pair, Pair]:
        """Ends of the leaf in bodies a and b (x, y) [m]; of a notch, its neck."""
        half = 0.0 if self.leaf is None else 0.5 * self.leaf.length
        dx, dy = half * math.cos(self.direction), half * math.sin(self.direction)
        x, y = self.at
        return (x - dx, y - dy), (x + dx, y + dy)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """A distance that a drive imposes or a probe reads, or a rotation that a probe reads.

    It is the distance of point b from point a along a direction that turns with body a, or the
    rotation of b against a.
    """

    name: str
    """Name of the drive or probe."""
    bodies: tuple[int, int]
    """Indices of body a (-1 for the ground) and of body b."""
    points: tuple[Pair, Pair]
    """The points on a and on b (x, y) [m]."""
    direction: float | None
    """The direction, from the x axis to the left [rad]; None for a rotation."""
    stiffness: float | None = 0.0
    """Stiffness of a drive [N/m]; None if rigid, 0 for a force and for a probe."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mechanism:
    """Rigid bodies joined by springs."""

    name: str
    """Name."""
    bodies: tuple[RigidBody, ...]
    """The bodies, fixed ones included."""
    hinges: tuple[SpringHinge, ...]
    """The springs."""
    drives: tuple[Sight, ...] = ()
    """Drives, each from the body that it reacts on to the body that it pushes."""
    probes: tuple[Sight, ...] = ()
    """Probes."""

    __repr__ = short_repr

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the bodies that can move, in order."""
        return tuple(i for i, body in enumerate(self.bodies) if not body.fixed)

    @property
    def order(self) -> int:
        """Number of generalised coordinates, three for each free body."""
        return 3 * len(self.free)

    def drive(self, name: str) -> Sight:
        """Return a drive by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        Sight
            The drive.

        Raises
        ------
        ModelError
            There is no such drive.
        """
        return find_named("drive", name, self.drives, _HAS)

    def probe(self, name: str) -> Sight:
        """Return a probe by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        Sight
            The probe.

        Raises
        ------
        ModelError
            There is no such probe.
        """
        return find_named("probe", name, self.probes, _HAS)


def mechanism(
    stage: Stage, *, method: str = "wedge", plane: PlaneState | Literal["auto"] = "auto"
) -> Mechanism:
    """Return the rigid bodies and springs of a stage.

    Parameters
    ----------
    stage : Stage
        The stage.
    method : str
        Method of hinge stiffness, one of `flexstage.hinges.compliance.METHODS`.
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by the width of each notch against its neck.

    Returns
    -------
    Mechanism
        The same numbers that `flexstage.lumped.lumped_system` assembles.

    Raises
    ------
    HingeError
        The method is unknown.
    StageError
        The root of a hinge does not lie on its body.
    """
    masses = mass_properties(stage)
    index = {body.name: i for i, body in enumerate(stage.bodies)}
    hinges = tuple(
        SpringHinge(
            name=spring.hinge.name,
            bodies=(index[spring.hinge.bodies[0]], index[spring.hinge.bodies[1]]),
            at=spring.hinge.at,
            direction=spring.hinge.direction,
            stiffness=spring.stiffness,
            leaf=_leaf(stage, spring),
            stress=cached_stress_rows(
                spring.hinge.profile, stage.thickness, stage.material.poissons_ratio, spring.plane
            ),
        )
        for spring in hinge_springs(stage, method=method, plane=plane)
    )
    return Mechanism(
        name=stage.name,
        bodies=tuple(
            RigidBody(
                name=b.name,
                mass=masses[b.name].mass,
                inertia=masses[b.name].inertia,
                centre=masses[b.name].centre,
                fixed=b.fixed,
            )
            for b in stage.bodies
        ),
        hinges=hinges,
        drives=tuple(
            Sight(
                name=d.name,
                bodies=(index[d.reacts], index[d.pushes]),
                points=(d.at[1], d.at[0]),
                direction=d.direction,
                stiffness=d.mounted.stiffness,
            )
            for d in stage.drives
        ),
        probes=tuple(
            Sight(
                name=p.name,
                bodies=(-1 if p.relative_to is None else index[p.relative_to], index[p.body]),
                points=(p.at, p.at),
                direction=p.direction,
            )
            for p in stage.probes
        ),
    )


def _leaf(stage: Stage, spring: HingeSpring) -> LeafBeam | None:
    if spring.hinge.profile.flat_length == 0.0:
        return None
    material = stage.material
    elastic = plane_moduli(material.youngs_modulus, material.poissons_ratio, spring.plane)
    return leaf_beam(spring.hinge.profile, *elastic, stage.thickness)
