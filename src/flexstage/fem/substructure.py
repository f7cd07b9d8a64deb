"""A body with its half notches as a part of its own: all that its condensation depends on."""

import hashlib
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import metadata, resources
from pathlib import Path

from flexstage.cache.memory import source_hash
from flexstage.fem.mesh import MeshSettings
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.hinges import Profile
from flexstage.hinges.hinge_spring import PlaneState
from flexstage.hinges.profile import Vertex
from flexstage.material import Material
from flexstage.stage import Body, Circle, Force, Hinge, Loop, Probe, Stage
from flexstage.stage.outline import Point

#: Name of the body in the stage that a substructure is meshed as.
BODY = "body"
_REST = "rest"

#: Change it whenever the condensation of the same substructure gives other figures.
_ALGORITHM = 2

#: Stiffness and mass go with modulus, density and expansion, so that one condensation, with these
#: round figures, serves every material of the same Poisson's ratio.
REFERENCE = Material(
    name="reference",
    youngs_modulus=1e11,
    poissons_ratio=0.0,
    density=1e4,
    thermal_expansion=1e-5,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class CutNeck:
    """A neck at which a body was cut from its neighbour."""

    at: Point
    """Centre of the neck [m]."""
    direction: float
    """Direction of the hinge [rad]."""
    which: int
    """0 where the body is the first of the hinge's bodies, 1 where it is the second."""
    profile: Profile
    """The notch."""
    contour: tuple[Vertex, ...]
    """Its contour."""
    plane: PlaneState
    """``stress`` or ``strain``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadPatch:
    """Where a drive touches a body."""

    at: Point
    """The point [m]."""
    direction: float
    """Direction of the drive [rad]."""
    half_width: float
    """Half of the width over which its force is spread [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointReading:
    """Where the motion of a body is read."""

    at: Point
    """The point [m]."""
    direction: float | None
    """The direction that is read [rad]; None where it is the rotation of the body."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Substructure:
    """A body with its half notches, relative to a point of its own and without names.

    Two bodies with equal substructures are condensed to the same matrices, wherever they are.
    """

    outline: Loop
    """Outline of the body, without the half notches."""
    holes: tuple[Loop | Circle, ...]
    """Its openings."""
    mounting_holes: tuple[Circle, ...]
    """Its holes for bolts."""
    held: bool
    """Whether it is a fixed body, which is held by these holes."""
    necks: tuple[CutNeck, ...]
    """Where it was cut from its neighbours."""
    patches: tuple[LoadPatch, ...]
    """Where drives touch it."""
    readings: tuple[PointReading, ...]
    """Where it is read."""
    poissons_ratio: float
    """Poisson's ratio of its material [1]."""
    thickness: float
    """Thickness that the size of its elements is measured by [m]."""
    mesh: MeshSettings
    """How fine it is meshed."""
    modes: int
    """Number of modes with held interfaces."""
    through: ThroughThickness
    """How displacements run through its thickness."""

    def __hash__(self) -> int:
        # of a part of it: bodies are looked up by the hundred
        return hash((self.outline, self.through, len(self.necks)))

    def key(self) -> str:
        """Return the SHA-256 of all that its condensation depends on, the software included."""
        # the text of a float is that of no other float
        return hashlib.sha256(f"{_software()} {self!r}".encode()).hexdigest()

    def material(self) -> Material:
        """Return what it is condensed with: `REFERENCE` with its own Poisson's ratio."""
        return replace(REFERENCE, poissons_ratio=self.poissons_ratio)

    def stage(self) -> Stage:
        """Return a stage of which it is a body, for the mesher.

        The body is `BODY`, its hinges, drives and probes are named by their number; the body at
        their other ends has no meaning.
        """
        nothing = Body(name=_REST, outline=Loop(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))))
        body = Body(
            name=BODY,
            outline=self.outline,
            holes=self.holes,
            mounting_holes=self.mounting_holes,
            fixed=self.held,
        )
        return Stage(
            name="substructure",
            thickness=self.thickness,
            material=self.material(),
            bodies=(body, nothing),
            hinges=tuple(
                Hinge(
                    name=str(i),
                    bodies=(BODY, _REST) if n.which == 0 else (_REST, BODY),
                    at=n.at,
                    direction=n.direction,
                    profile=n.profile,
                )
                for i, n in enumerate(self.necks)
            ),
            drives=tuple(
                Force(
                    name=str(i),
                    pushes=BODY,
                    reacts=_REST,
                    at=(p.at, p.at),
                    direction=p.direction,
                    patch_half_width=p.half_width,
                    largest_force=1.0,
                )
                for i, p in enumerate(self.patches)
            ),
            probes=tuple(
                Probe(
                    name=str(i),
                    body=BODY,
                    at=r.at,
                    direction=r.direction,
                    reads="rotation" if r.direction is None else "displacement",
                )
                for i, r in enumerate(self.readings)
            ),
        )


@lru_cache(maxsize=1)
def _software() -> str:
    """Name the software that condenses: versions, and a hash of the sources that take part."""
    package = Path(str(resources.files("flexstage")))
    sources = [
        source_hash(package / room) for room in ("cache", "elasticity", "fem", "hinges", "stage")
    ]
    return " ".join((str(_ALGORITHM), metadata.version("ngsolve"), *sources))
