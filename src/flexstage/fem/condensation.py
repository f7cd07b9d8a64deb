"""A floating or held body condensed to its interfaces: flexibility, modes, stress."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.elasticity import Continuum
from flexstage.elasticity.shapes import METRE
from flexstage.fem.constrained import Constrained, PlanePart
from flexstage.fem.geometry import MOUNTING, either, notch_region, stage_faces
from flexstage.fem.half_notch import stress_of_necks
from flexstage.fem.mesh import sound_mesh
from flexstage.fem.neck_rows import edge_means, neck_rows
from flexstage.fem.ports import body_motion, drive_vector
from flexstage.fem.substructure import BODY, PointReading, Substructure
from flexstage.stage import mass_properties

#: Loads inside a body: forces and moment on its mean motion, one kelvin, one kelvin by metre.
LOADS = ("x", "y", "rotation", "temperature", "temperature gradient x", "temperature gradient y")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Condensed:
    r"""A body in a few coordinates, :math:`u = T q + \Phi \eta + U p`.

    The coordinates are the motions of its interfaces (3 for each neck, then 1 for each patch), its
    modes with held interfaces, and its responses to loads inside it with held interfaces.
    """

    stiffness: Array
    """Stiffness of the coordinates, shape (r, r)."""
    mass: Array
    """Mass of the coordinates, shape (r, r)."""
    loads: Array
    """Forces on the coordinates, shape (l, r), of each of `LOADS` and of a unit force at each
    reading. So the first three rows are the mean displacement x, y of the body at its centre of
    mass and its rotation too, and the last ones the readings.
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
        """Mean displacement x, y [m] at the centre of mass, and rotation [rad], shape (3, r)."""
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DisplacementRecovery:
    """The way back from the coordinates of a body to the displacement on its mesh."""

    continuum: Continuum
    """The body on its mesh, relative to its own point of reference."""
    basis: Array
    """Displacement for each coordinate, shape (n, r)."""


def condense(part: Substructure) -> Condensed:
    r"""Condense a body to the mean motions of its interfaces.

    Each neck has three: displacement along and across its hinge and rotation, each the mean that
    does work with its traction. These are the tractions of a beam, uniform and linear along the
    hinge and parabolic across, with what `flexstage.fem.neck_rows.shaped` adds to them so that
    the neck stays plane where it must. With the rows P of these means, the body under interface
    forces obeys

    .. math:: K u = P^T\lambda, \quad P u = q, \quad K_c = \partial\lambda/\partial q

    and `flexstage.fem.constrained.Constrained` solves it, floating bodies as well as held ones.

    The matrices are for the `REFERENCE` material.

    Notes
    -----
    R. J. Guyan, AIAA J. 3 (1965) 380, and R. R. Craig, M. C. C. Bampton, AIAA J. 6 (1968) 1313,
    with means in place of single displacements. Validity: exact but for the shape of the traction
    in the necks, which is that of notches whose two halves are alike for about a neck's thickness.
    """
    return _condense(part)[0]


def recover(part: Substructure, condensed: Condensed) -> DisplacementRecovery:
    """Return to the displacements of a body that was condensed before."""
    again, recovery = _condense(part)
    # Modes may have come with other signs, and equal ones mixed: both know how the interfaces and
    # the loads move them.
    m, modes = again.interfaces, again.modes
    was, now = (
        np.concatenate(
            (c.mass[:m, modes] / np.abs(c.mass[:m, modes]).max(initial=1e-300), c.motion[:, modes])
        )
        for c in (condensed, again)
    )
    left, _, right = np.linalg.svd(now.T @ was)
    basis = recovery.basis.copy()
    basis[:, modes] = basis[:, modes] @ (left @ right)
    return DisplacementRecovery(continuum=recovery.continuum, basis=basis)


def _condense(part: Substructure) -> tuple[Condensed, DisplacementRecovery]:
    stage = part.stage()
    faces = stage_faces(stage, [BODY])
    mesh = sound_mesh(stage, faces, part.mesh)
    strained = (
        notch_region(str(i), n.which) for i, n in enumerate(part.necks) if n.plane == "strain"
    )
    properties = mass_properties(stage)[BODY]
    continuum = Continuum(
        mesh,
        part.material(),
        order=part.mesh.order,
        thickness=part.thickness,
        strain=either(strained),
        held=MOUNTING if part.held else "",
    )
    rows, blocks = [np.zeros((0, continuum.size))], []
    for neck, means in zip(part.necks, edge_means(mesh, part.mesh.order, part.necks), strict=True):
        beam, normal, shear = neck_rows(neck, means)
        rows += [beam, normal, shear]
        blocks.append((len(normal), len(shear)))
    for drive in stage.drives:
        rows.append(drive_vector(continuum, stage, drive, faces.patches, "elastic")[None])
    body = Constrained(PlanePart(continuum), np.concatenate(rows), blocks, floating=not part.held)
    centre = properties.centre
    motion = body_motion(continuum, stage, BODY, centre)
    thermal = (continuum.thermal(c) for c in (1.0, ng.x / METRE, ng.y / METRE))
    readings = (reading_row(continuum, r, centre, motion) for r in part.readings)
    inner = np.array([*motion, *thermal, *readings])
    basis, K, interfaces = body.reduced(inner, part.modes)
    mass = basis.T @ continuum.mass_times(basis)
    loads = inner @ basis
    condensed = Condensed(
        stiffness=K,
        mass=0.5 * (mass + mass.T),
        loads=loads,
        reactions=reactions(K, mass, loads, interfaces),
        **stress_of_necks(part)._asdict(),
        interfaces=interfaces,
        inertia=(properties.mass, *properties.centre, properties.inertia),
        elements=int(mesh.ne),
        unknowns=continuum.size,
        held=faces.held,
    )
    return condensed, DisplacementRecovery(continuum=continuum, basis=basis)


def reactions(stiffness: Array, mass: Array, loads: Array, interfaces: int) -> Array:
    """Return the forces that hold the interfaces while the other coordinates move.

    A mode is held against its inertia, the response to a load inside the body against the load,
    less what the modes have of it.
    """
    m, inner = interfaces, len(stiffness) - len(loads)
    squares, coupling = np.diag(stiffness)[m:inner], mass[:m, m:inner]
    return np.hstack((-coupling * squares, coupling @ loads[:, m:inner].T - loads[:, :m].T))


def reading_row(
    continuum: Continuum,
    reading: PointReading,
    centre: tuple[float, float],
    motion: Array,
    lifted: Callable[[Array], Array] = lambda row: row,
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
