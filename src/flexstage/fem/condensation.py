"""A floating or held body condensed to its interfaces: flexibility, modes, stress."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from flexstage.arrays import Array
from flexstage.elasticity import Continuum
from flexstage.elasticity.shapes import METRE
from flexstage.fem.constrained import Constrained
from flexstage.fem.geometry import (
    MOUNTING,
    StageFaces,
    either,
    exactly,
    notch_region,
    stage_faces,
)
from flexstage.fem.half_notch import REACH, NotchBlock, neck_tractions, stress_of_necks
from flexstage.fem.layered_plate import LayeredPlate, PlaneIntegrals
from flexstage.fem.mesh import MESHER, sound_mesh
from flexstage.fem.neck_motions import LOADS, edge_means, motion_rows, neck_mix, neck_motions
from flexstage.fem.ports import drive_vector, rigid_regions
from flexstage.fem.substructure import BODY, CutNeck, PointReading, Substructure
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.stage import MassProperties, mass_properties


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Condensed:
    r"""A body in a few coordinates, :math:`u = T q + \Phi \eta + U p`.

    The coordinates are the motions of its interfaces (those of `Freedom` for each neck, then 1 for
    each patch), its modes with held interfaces, and its responses to loads inside it with held
    interfaces.
    """

    stiffness: Array
    """Stiffness of the coordinates, shape (r, r)."""
    mass: Array
    """Mass of the coordinates, shape (r, r)."""
    loads: Array
    """Forces on the coordinates, shape (l, r), of each of `Freedom.loads` and of a unit force at
    each reading. So the first three rows are the mean motion of the body at its centre of mass too,
    in its plane displacement x, y and rotation, and the last ones the readings.
    """
    reactions: Array
    """Forces that hold the interfaces while the other coordinates move, shape (i, r - i)."""
    stress: Array
    """Stress on the surface of the notches, neck by neck, for each unit force on the own neck:
    components xx, yy, zz, xy, or xx, yy, zz, yz, xz, xy in space; shape (m, c, e).
    """
    neck: NDArray[np.int64]
    """Number of the neck of each of these places, shape (m,)."""
    point: NDArray[np.int64]
    """Number of the point of each place, shape (m,)."""
    seam: NDArray[np.int64]
    """1 or -1 of places at the left or right end of the neck itself, which the other half of the
    notch has too; 0 elsewhere; shape (m,).
    """
    interfaces: int
    """Number of coordinates that are motions of interfaces."""
    inertia: tuple[float, float, float, float]
    """Mass [kg], centre x, y [m] and moment of inertia about it [kg m^2]."""
    elements: int
    """Elements of the mesh."""
    unknowns: int
    """Unknowns of the mesh."""
    held: str
    """What holds the body, in words."""

    @property
    def motion(self) -> Array:
        """Mean motion at the centre of mass, in the plane x, y [m] and rotation [rad], (3, r)."""
        return self.loads[:3]

    @property
    def readings(self) -> Array:
        """Each reading [m, or rad for a rotation], shape (k, r)."""
        return self.loads[len(LOADS) :]

    def forces(self, q: Array) -> Array:
        """Return the force on each interface, shape (i, k), for coordinates, shape (r, k)."""
        m = self.interfaces
        return self.stiffness[:m, :m] @ q[:m] + self.reactions @ q[m:]

    @property
    def modes(self) -> slice:
        """Which coordinates are modes."""
        return slice(self.interfaces, self.stiffness.shape[0] - len(self.loads))

    @property
    def inner(self) -> slice:
        """Which coordinates are responses to loads inside the body."""
        return slice(self.stiffness.shape[0] - len(self.loads), self.stiffness.shape[0])


def condense(part: Substructure) -> Condensed:
    r"""Condense a body of a plate to the mean motions of its necks, as `part.through` has it.

    The motions of a neck are those of a beam: along and across its hinge and rotation, in space
    each with the lowest functions through the thickness, and the displacement through the plate and
    its slope over the neck. Each is the mean that does work with its traction, uniform and linear
    along the hinge and parabolic across; with these tractions go others without resultant, of
    higher powers over the neck and of the other functions, so that the neck stays plane where it
    must (`flexstage.fem.neck_motions.neck_mix`). With the rows P of these means, the body under
    interface forces obeys

    .. math:: K u = P^T\lambda, \quad P u = q, \quad K_c = \partial\lambda/\partial q

    and `flexstage.fem.constrained.Constrained` solves it, floating bodies as well as held ones.

    The matrices are for the `REFERENCE` material and the thickness of `part.through`.

    Notes
    -----
    R. J. Guyan, AIAA J. 3 (1965) 380, and R. R. Craig, M. C. C. Bampton, AIAA J. 6 (1968) 1313,
    with means in place of single displacements. Validity: exact but for the shape of the traction
    in the necks, which is that of notches whose two halves are alike for about a neck's thickness.
    """
    return condensed_with_shapes(part)[0]


def condensed_with_shapes(part: Substructure) -> tuple[Condensed, LayeredPlate, Array]:
    """Condense a body; return besides its unknowns, and their displacement for each coordinate."""
    tractions = [_tractions(part, neck) for neck in part.necks] if part.through.in_space else None
    with MESHER:
        ready = _prepared(part, tractions)
    plate, loads = ready.plate, ready.loads
    mixed = None if tractions else partial(_mixed, part, plate.plane.order)
    body = Constrained(plate, ready.rows, mixed, floating=not part.held)
    basis, K, interfaces = body.reduced(loads, part.modes)
    mass = basis.T @ plate.mass_times(basis)
    loads = loads @ basis
    condensed = Condensed(
        stiffness=K,
        mass=0.5 * (mass + mass.T),
        loads=loads,
        reactions=reactions(K, mass, loads, interfaces),
        **stress_of_necks(part)._asdict(),
        interfaces=interfaces,
        inertia=(ready.properties.mass, *ready.properties.centre, ready.properties.inertia),
        elements=int(plate.plane.mesh.ne),
        # of a plane model with those that are held
        unknowns=plate.size if part.through.in_space else 2 * plate.plane.width,
        held=ready.held,
    )
    return condensed, plate, basis


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Ready:
    """A body on its mesh, before anything is factorised."""

    plate: LayeredPlate
    rows: Array
    """Motions of its interfaces, shape (m, n)."""
    loads: Array
    """Loads inside it, shape (l, n)."""
    properties: MassProperties
    """Its mass."""
    held: str
    """What holds it, in words."""


@lru_cache(maxsize=2)
def _meshed(part: Substructure) -> tuple[StageFaces, PlaneIntegrals, list[Array]]:
    """Mesh a body, for all its motions: its faces, integrals over its plane, means over necks."""
    faces = stage_faces(part.stage(), [BODY])
    mesh = sound_mesh(part.stage(), faces, part.mesh)
    plane = PlaneIntegrals(
        mesh, order=part.mesh.order, held=MOUNTING if part.held else "", strain=_strained(part)
    )
    return faces, plane, edge_means(mesh, part.mesh.order, part.necks)


def _strained(part: Substructure) -> str:
    names = (notch_region(str(i), n.which) for i, n in enumerate(part.necks) if n.plane == "strain")
    return either(names)


def _prepared(part: Substructure, tractions: Sequence[Array] | None) -> _Ready:
    through, stage = part.through, part.stage()
    in_plane = ThroughThickness(thickness=part.thickness)
    faces, plane, means = _meshed(replace(part, through=in_plane, readings=(), modes=0))
    plate = LayeredPlate(
        plane,
        part.material(),
        through,
        notches=[
            (
                exactly(notch_region(str(i), n.which)),
                n.at,
                n.profile.length / 2.0 + REACH * n.profile.root_height,
            )
            for i, n in enumerate(part.necks)
        ],
    )
    passed, rest, _, _ = neck_motions(through, plane.order)
    rows = [np.zeros((0, plate.size))]
    for neck, own, mix in zip(part.necks, means, tractions or [None] * len(means), strict=True):
        direction = math.cos(neck.direction), math.sin(neck.direction)
        rows.append(motion_rows(plate, own, (*passed, *rest), direction, mix))
    # the thickness of the part is one for its mesh; it weighs as much as it is thick
    properties = mass_properties(replace(stage, thickness=through.thickness))[BODY]
    motion = plate.motion(rigid_regions(stage, BODY), properties.centre)
    if through.out_of_plane:
        loads = [*motion, plate.thermal(1.0, 1)]
    else:
        flat = Continuum(
            plane.mesh, part.material(), order=plane.order, thickness=through.thickness
        )
        pushed = (drive_vector(flat, stage, d, faces.patches, "elastic") for d in stage.drives)
        rows += [plate.mean(row)[None] for row in pushed]
        thermal = (plate.thermal(c, 0) for c in (1.0, ng.x / METRE, ng.y / METRE))
        readings = (
            _reading_row(flat, r, properties.centre, motion, plate.middle) for r in part.readings
        )
        loads = [*motion, *thermal, *readings]
    return _Ready(
        plate=plate,
        rows=np.concatenate(rows),
        loads=np.array(loads),
        properties=properties,
        held=faces.held,
    )


def _tractions(part: Substructure, neck: CutNeck) -> Array:
    """Return what makes up each motion of a neck in space: of the half notch alone."""
    half = NotchBlock(
        profile=neck.profile,
        wide=False,
        plane=neck.plane,
        through=part.through,
        mesh=part.mesh,
        poissons_ratio=part.poissons_ratio,
        powers=part.mesh.order,
    )
    return neck_tractions(half)


def _mixed(part: Substructure, degree: int, flexibility: Array) -> Array:
    """Return what makes up each motion of an interface in a plane model: of the body itself."""
    each = sum(map(len, neck_motions(part.through, degree)[:2]))
    count = len(part.necks)
    blocks = [
        neck_mix(flexibility[each * i :, each * i :], part.through, degree) for i in range(count)
    ]
    return np.asarray(block_diag(*blocks, np.eye(len(flexibility) - count * each)))


def reactions(stiffness: Array, mass: Array, loads: Array, interfaces: int) -> Array:
    """Return the forces that hold the interfaces while the other coordinates move.

    A mode is held against its inertia, the response to a load inside the body against the load,
    less what the modes have of it.
    """
    m, inner = interfaces, len(stiffness) - len(loads)
    squares, coupling = np.diag(stiffness)[m:inner], mass[:m, m:inner]
    return np.hstack((-coupling * squares, coupling @ loads[:, m:inner].T - loads[:, :m].T))


def _reading_row(
    continuum: Continuum,
    reading: PointReading,
    centre: tuple[float, float],
    motion: Array,
    lifted: Callable[[Array], Array],
) -> Array:
    """Displacement of a point, or rotation of the body.

    Where there is no material, it is that of what rides on the mean motion. `lifted` makes a row of
    the part of one of the plane continuum.
    """
    if reading.direction is None:
        return motion[2]
    along = (math.cos(reading.direction), math.sin(reading.direction))
    x, y = reading.at
    if continuum.mesh.Contains(METRE * x, METRE * y):
        return lifted(continuum.point((x, y), along))
    arm = along[1] * (x - centre[0]) - along[0] * (y - centre[1])
    return along[0] * motion[0] + along[1] * motion[1] + arm * motion[2]
