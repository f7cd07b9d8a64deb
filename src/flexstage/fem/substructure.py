"""A stage cut at its necks into bodies with their half notches, as separate parts.

A part has all inputs of its condensation.
"""

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import metadata, resources
from pathlib import Path
from typing import Literal

from flexstage.base.errors import StageError
from flexstage.fem.layered_plate import REFERENCE, UncheckedMaterial
from flexstage.fem.mesh import MeshSettings
from flexstage.fem.necks import CutNeck
from flexstage.fem.stage_system import Supports
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.files.cache.memory import source_hash
from flexstage.hinges import plane_state
from flexstage.hinges.hinge_spring import PlaneState
from flexstage.quantities.material import Material
from flexstage.stage import Body, Circle, Drive, Force, Hinge, Loop, Probe, Stage
from flexstage.stage.outline import Point

#: Name of the body in the stage that a substructure is meshed as.
BODY = "body"
_REST = "rest"

#: Version of the condensation: to be changed whenever the same substructure gives other figures.
_ALGORITHM = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadPatch:
    """Patch of a drive on a body."""

    at: Point
    """The point [m]."""
    direction: float
    """Direction of the drive [rad]."""
    half_width: float
    """Half of the width over which its force is spread [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointReading:
    """A measured point of a body."""

    at: Point
    """The point [m]."""
    direction: float | None
    """The direction of measurement [rad]; None where it is the rotation of the body."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Substructure:
    """A body with its half notches, relative to a point of its own and without names.

    Two bodies with equal substructures are condensed to the same matrices, wherever they are.
    """

    outline: Loop
    """Outline of the body, without the half notches."""
    holes: tuple[Loop | Circle, ...]
    """Openings."""
    mounting_holes: tuple[Circle, ...]
    """Holes for bolts."""
    fixed: bool
    """True if it is a fixed body, which is supported at these holes."""
    necks: tuple[CutNeck, ...]
    """Necks at which it is cut from its neighbours."""
    patches: tuple[LoadPatch, ...]
    """Patches of the drives."""
    readings: tuple[PointReading, ...]
    """Measured points."""
    poissons_ratio: float
    """Poisson's ratio of its notches, and of itself where it has no material of its own [1]."""
    body_material: Material | None
    """Material of its outline, where its notches are of `REFERENCE`; None where it is the same."""
    rigid: bool
    """True if its outline does not deform."""
    thickness: float
    """Thickness to which the size of its elements refers [m]."""
    mesh: MeshSettings
    """Mesh settings."""
    modes: int
    """Number of modes with fixed interfaces."""
    through: ThroughThickness
    """Functions of the displacement through its thickness."""

    def __hash__(self) -> int:
        # of a part of it: bodies are looked up by the hundred
        return hash((self.outline, self.through, len(self.necks)))

    def key(self) -> str:
        """Return the SHA-256 of all inputs of its condensation, the software included."""
        # the text of a float is that of no other float
        return hashlib.sha256(f"{_software()} {self!r}".encode()).hexdigest()

    def material(self) -> Material:
        """Return the material of its condensation: `REFERENCE` with its own Poisson's ratio."""
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
            fixed=self.fixed,
            material=self.body_material,
            rigid=self.rigid,
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
    """Return the identity of the software: versions, and a hash of the sources involved."""
    package = Path(str(resources.files("flexstage")))
    sources = [
        source_hash(package / room)
        for room in ("files/cache", "elasticity", "fem", "hinges", "stage")
    ]
    return " ".join((str(_ALGORITHM), metadata.version("ngsolve"), *sources))


_LAYER = 2.0  # depth below the faces of plane stress at a notch, in the thinnest necks
# Modes of a body in space, with held necks: plates that many necks hold have low ones.
# In the plane they are stiffer, and fewer are enough.
_BY_NECK, _MOST_IN_PLANE, _MOST = 3, 12, 15
_DIGITS = 12  # coordinates are rounded to a picometre, so that copies at other places are equal


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """A substructure at its place in a stage."""

    body: Body
    """The body."""
    part: Substructure
    """The substructure."""
    origin: Point
    """Position of its reference point [m]."""
    hinges: tuple[int, ...]
    """Number of the hinge of each of its necks."""
    patches: tuple[tuple[tuple[str, int], ...], ...]
    """The drives' names and sides (0 pushed, 1 reacting) of each of its patches."""
    readings: tuple[tuple[tuple[str, float], ...], ...]
    """Each probe's name and sign of each of its readings."""


def notch_states(stage: Stage, plane: PlaneState | Literal["auto"]) -> tuple[PlaneState, ...]:
    """Choose plane stress or plane strain for every notch.

    One for each hinge; ``auto`` is by width against neck.
    """
    return tuple(
        plane_state(stage.thickness, h.profile.neck_thickness, plane) for h in stage.hinges
    )


def cut_free(
    stage: Stage,
    settings: MeshSettings,
    *,
    plane: PlaneState | Literal["auto"] = "auto",
    modes: int,
    supports: Supports = "rigid",
) -> tuple[Placed, ...]:
    """Cut a stage at its necks.

    `modes` is their number for each body with fixed interfaces; with `supports` ``rigid`` a drive
    that reacts on a fixed body reacts on the ground.

    Examples
    --------
    The eight guide legs of this stage are of four kinds, its four links of two:

    >>> from flexstage.stage.designs import design
    >>> bodies = cut_free(design("vgtu-piezo"), MeshSettings(), modes=3)
    >>> len(bodies), len({b.part.key() for b in bodies})
    (21, 15)
    """
    states = notch_states(stage, plane)
    thickness = _preferred(stage.thickness)
    cut = []
    for body in stage.bodies:
        x0, y0 = origin = body.outline.points[0]

        def near(p: Point, x0: float = x0, y0: float = y0) -> Point:
            # adding nothing turns a negative zero, which would be another hash, into zero
            return round(p[0] - x0, _DIGITS) + 0.0, round(p[1] - y0, _DIGITS) + 0.0

        hinges = [i for i, h in enumerate(stage.hinges) if body.name in h.bodies]
        touched = _touched(stage, body, near, supports)
        read = _read(stage, body, near)
        part = Substructure(
            outline=_moved_loop(body.outline, near),
            holes=tuple(
                _moved_circle(h, near) if isinstance(h, Circle) else _moved_loop(h, near)
                for h in body.holes
            ),
            mounting_holes=tuple(_moved_circle(h, near) for h in body.mounting_holes),
            fixed=body.fixed,
            necks=tuple(_neck(stage.hinges[i], body, near, states[i]) for i in hinges),
            patches=tuple(touched),
            readings=tuple(read),
            poissons_ratio=stage.material.poissons_ratio,
            body_material=_of_body(stage, body),
            rigid=body.rigid,
            thickness=thickness,
            mesh=settings,
            modes=modes,
            through=ThroughThickness(thickness=thickness),
        )
        cut.append(
            Placed(
                body=body,
                part=part,
                origin=origin,
                hinges=tuple(hinges),
                patches=tuple(map(tuple, touched.values())),
                readings=tuple(map(tuple, read.values())),
            )
        )
    return tuple(cut)


def in_space(stage: Stage, placed: Sequence[Placed]) -> tuple[tuple[Placed, ...], ...]:
    """Return the bodies of a stage as those of a plate in space: in the plane and out of it.

    The depth of the layer below its faces is a preferred number (ISO 3, series R5), so that the
    bodies stay the same where a neck changes a little.
    """
    thinnest = min((h.profile.neck_thickness for h in stage.hinges), default=stage.thickness)
    layer = min(_LAYER * _preferred(thinnest, 5), stage.thickness / 4.0)
    parts = []
    for out_of_plane, most in ((False, _MOST_IN_PLANE), (True, _MOST)):
        through = ThroughThickness(
            thickness=stage.thickness, layer=layer, out_of_plane=out_of_plane
        )
        parts.append(
            tuple(
                replace(
                    p,
                    part=replace(
                        p.part,
                        through=through,
                        necks=tuple(replace(n, plane="stress") for n in p.part.necks),
                        modes=min(max(p.part.modes, _BY_NECK * len(p.hinges)), most),
                        # the edges of drives stay, so that both motions have one mesh
                        readings=() if out_of_plane else p.part.readings,
                    ),
                    patches=() if out_of_plane else p.patches,
                    readings=() if out_of_plane else p.readings,
                )
                for p in placed
            )
        )
    return tuple(parts)


def _of_body(stage: Stage, body: Body) -> Material | None:
    """Return the material of a body where its notches are of `REFERENCE`."""
    material, plate = body.material, stage.material
    if material is None or material == plate:
        return None
    if material.thermal_expansion and plate.thermal_expansion == 0.0:
        raise StageError(
            f"body '{body.name}' expands and the plate's material '{plate.name}' has a "
            "thermal_expansion of 0, to which nothing can be related: write 1e-12 1/K for it"
        )
    expands = (material.thermal_expansion or 0.0) / (plate.thermal_expansion or 1.0)
    return UncheckedMaterial(
        name=BODY,
        youngs_modulus=REFERENCE.youngs_modulus * (material.youngs_modulus / plate.youngs_modulus),
        poissons_ratio=material.poissons_ratio,
        density=REFERENCE.density * (material.density / plate.density),
        thermal_expansion=(REFERENCE.thermal_expansion or 0.0) * expands,
    )


_Move = Callable[[Point], Point]


def _touched(
    stage: Stage, body: Body, near: _Move, supports: Supports
) -> dict[LoadPatch, list[tuple[str, int]]]:
    """Find the patches of a body; drives with the same point and direction share one."""
    uses: dict[LoadPatch, list[tuple[str, int]]] = {}
    if body.fixed and supports == "rigid":
        return uses
    for drive in stage.drives:
        for which in (0, 1):
            if _side(drive, which) == body.name:
                patch = LoadPatch(
                    at=near(drive.at[which]),
                    direction=drive.direction,
                    half_width=drive.patch_half_width,
                )
                uses.setdefault(patch, []).append((drive.name, which))
    return uses


def _side(drive: Drive, which: int) -> str:
    return (drive.pushes, drive.reacts)[which]


def _read(stage: Stage, body: Body, near: _Move) -> dict[PointReading, list[tuple[str, float]]]:
    """Find the readings of a body, each with the probes that use it and their sign."""
    uses: dict[PointReading, list[tuple[str, float]]] = {}
    for probe in stage.probes:
        reading = PointReading(at=near(probe.at), direction=probe.direction)
        for name, sign in ((probe.body, 1.0), (probe.relative_to, -1.0)):
            if name == body.name:
                uses.setdefault(reading, []).append((probe.name, sign))
    return uses


def _moved_loop(loop: Loop, near: _Move) -> Loop:
    return replace(loop, points=tuple(map(near, loop.points)))


def _moved_circle(circle: Circle, near: _Move) -> Circle:
    return replace(circle, centre=near(circle.centre))


def _neck(hinge: Hinge, body: Body, near: _Move, plane: PlaneState) -> CutNeck:
    return CutNeck(
        at=near(hinge.at),
        direction=hinge.direction,
        which=hinge.bodies.index(body.name),
        profile=hinge.profile,
        contour=hinge.profile.contour(),
        plane=plane,
    )


def _preferred(thickness: float, series: int = 10) -> float:
    """Return the preferred number nearest to a thickness (ISO 3, of a series R5, R10, ...).

    The thickness of a plate sets the largest element. A value from a series keeps the mesh where
    the thickness changes a little.
    """
    return float(f"{10.0 ** (round(series * math.log10(thickness)) / series):.3g}")
