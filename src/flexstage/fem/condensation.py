"""A body condensed to its interfaces, floating or held: flexibility, modes, stress.

The tractions for unit motions of its interfaces give its stiffness; its softest modes are found by
block Lanczos iteration.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import NamedTuple

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import block_diag

from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.elasticity import Continuum
from flexstage.elasticity.shapes import METRE
from flexstage.fem.geometry import (
    MOUNTING,
    StageFaces,
    body_region,
    either,
    exactly,
    notch_region,
    stage_faces,
)
from flexstage.fem.layered_plate import LayeredPlate
from flexstage.fem.mesh import MESHER, mesh_without_slivers, moved_mesh
from flexstage.fem.necks import (
    IN_PLANE,
    LOADS,
    CutNeck,
    constraint_matrix,
    edge_means,
    neck_mix,
    neck_motions,
)
from flexstage.fem.notch_block import (
    ENRICHMENT_RADIUS,
    NECK_POWERS,
    NotchBlock,
    neck_stress,
    neck_tractions,
)
from flexstage.fem.plane_integrals import PlaneIntegrals
from flexstage.fem.stage_system import drive_vector, region_materials, rigid_regions
from flexstage.fem.substructure import BODY, PointReading, Substructure
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.stage import MassProperties, mass_properties
from flexstage.stage.contour import Root, hinge_root

_STEPS = 60
_NEAR = 1e-9  # two points are one [m]
# A body is wider than a root by this much of the root's height, or as good as not.
_WIDER = 0.5
_DEPENDENT = 1e-13  # mass that rounding leaves of displacements that others make up


def softest_modes(
    respond: Callable[[Array], Array],
    mass_times: Callable[[Array], Array],
    start: Array,
    count: int,
    settled: float,
) -> tuple[Array, Array]:
    r"""Return the lowest modes of an elastic part.

    Parameters
    ----------
    respond : callable
        Returns the displacements under loads, one a column.
    mass_times : callable
        Multiplies displacements by the mass matrix.
    start : Array
        Loads to begin with, shape (n, b), which excite all required modes.
    count : int
        Number of modes.
    settled : float
        Largest relative change of the squares of frequencies in the last step. As a rule their
        error is less than a tenth of it then.

    Returns
    -------
    tuple
        Squares of angular frequencies [rad^2/s^2], shape (count,), and modes with these as modal
        stiffness, shape (n, count).

    Raises
    ------
    ConvergenceError
        They are not found in 60 steps.

    Notes
    -----
    G. H. Golub, R. Underwood, in Mathematical Software III (1977) 361. Each block is made
    orthogonal to all before it, so that no mode comes twice.
    """
    basis: list[Array] = []
    weighted: list[Array] = []
    answers: list[Array] = []
    flexible = np.zeros((0, 0))
    last = np.zeros(count)
    block = respond(start)
    heavy = mass_times(block)
    for _ in range(_STEPS):
        for _ in range(2):
            for earlier, its in zip(basis, weighted, strict=True):
                share = its.T @ block
                block = block - earlier @ share
                heavy = heavy - its @ share
            mix = independent(block.T @ heavy)
            block, heavy = block @ mix, heavy @ mix
        answer = respond(heavy)
        basis.append(block)
        weighted.append(heavy)
        answers.append(answer)
        # K answers = weighted + P^T lambda, and P answers = 0, where interfaces P are held
        new = np.concatenate([w.T @ answer for w in weighted])
        at = len(flexible)
        flexible = np.block([[flexible, new[:at]], [new[:at].T, new[at:]]])
        flexible = 0.5 * (flexible + flexible.T)
        if len(flexible) >= count:
            lowest = 1.0 / np.linalg.eigvalsh(flexible)[: -count - 1 : -1]
            if np.all(np.abs(lowest - last) <= settled * lowest):
                values, turn = np.linalg.eigh(flexible)
                values, turn = values[: -count - 1 : -1], turn[:, : -count - 1 : -1]
                # by one more iteration than the basis, these are orthogonal in K
                return 1.0 / values, np.hstack(answers) @ (turn / values)
            last = lowest
        block, heavy = answer, mass_times(answer)
    raise ConvergenceError(f"the {count} lowest modes were not found in {_STEPS} steps")


def independent(mass: Array) -> Array:
    """Return combinations of displacements with unit mass, without dependent ones."""
    size = 1.0 / np.sqrt(np.diag(mass))
    values, vectors = np.linalg.eigh(0.5 * (mass + mass.T) * np.outer(size, size))
    retained = values > _DEPENDENT * values.max(initial=0.0)
    return size[:, None] * vectors[:, retained] / np.sqrt(values[retained])


_COINCIDENT = (
    1e11  # two interfaces are one if a unit force on both in turn moves them so little apart
)
_SPRING = 1e3  # as many times as stiff as the mesh is there
_SETTLED = 1e-3  # of the squares of frequencies, from one step to the next
_BLOCK = 8  # loads that the search for modes starts with


class PrescribedDisplacement:
    r"""A body whose interface motions q = P u are given.

    A floating body is solved for balanced loads alone, up to its rigid motions R, independently of
    its supports: the flexibility with inertia relief. Interface forces and rigid motion are then
    found together, with :math:`X = K^+ P^T`, :math:`G = P X`, :math:`A = P R`:

    .. math:: \begin{bmatrix} G & A\\ A^T & 0\end{bmatrix}
              \begin{bmatrix}\lambda\\ a\end{bmatrix}
              = \begin{bmatrix} q - P K^+ f\\ -R^T f\end{bmatrix},
              \quad u = K^+ f + X\lambda + R a

    The rows P have shape (m, n); where `mixed` is given, it says of the flexibility of what rows,
    shape (m, m), they are made up, shape (k, m). Loads and displacements are one a column.
    """

    def __init__(
        self,
        part: LayeredPlate,
        P: Array,
        mixed: Callable[[Array], Array] | None = None,
        *,
        floating: bool,
    ) -> None:
        self.part = part
        self.rigid = part.rigid
        self.weighted = part.mass_times(self.rigid)
        self._balance = np.zeros((part.size, 0)), np.zeros((part.size, 0))
        if floating:
            factor = np.linalg.cholesky(self.rigid.T @ self.weighted)
            self._balance = (
                np.linalg.solve(factor, self.rigid.T).T,
                np.linalg.solve(factor, self.weighted.T).T,
            )
        # balanced loads leave nothing to stiff springs at three unknowns, whichever they are
        self._factor = part.factorised(part.pins if floating else None, _SPRING)
        X = self.loose(P.T)
        if mixed is not None:
            mix = mixed(P @ X)
            P, X = mix @ P, X @ mix.T
        # most of the rows are of the unknowns on one neck
        self.P, self.X = sp.csr_matrix(P), X
        G = P @ X
        G = 0.5 * (G + G.T)
        A = P @ self._balance[0]
        # rows and rigid motions scaled equally: metres and radians become comparable
        self._row = 1.0 / np.sqrt(np.diag(G))
        A = A * self._row[:, None]
        if floating and (len(A) < 3 or np.linalg.matrix_rank(A, tol=1e-9 * np.abs(A).max()) < 3):
            raise ModelError(
                "a body has no hinge and is not fixed, so it cannot be condensed: add a hinge, or "
                "fix it"
            )
        self._column = 1.0 / np.abs(A).max(axis=0, initial=0.0) if len(A) else np.zeros(0)
        A = A * self._column
        none = np.zeros((A.shape[1], A.shape[1]))
        saddle = np.block([[G * np.outer(self._row, self._row), A], [A.T, none]])
        self._saddle = np.linalg.inv(saddle) if len(A) else np.zeros((0, 0))
        if np.abs(self._saddle).max(initial=0.0) > _COINCIDENT:
            raise ModelError(
                "two drives touch a body at the same place in the same direction, so that their "
                "patches have the same motion: move one of them"
            )

    def loose(self, load: Array) -> Array:
        """Return the response to the balanced part of loads, free of rigid motions.

        Of a fixed body, the response to the full load.
        """
        rigid, weighted = self._balance
        u = self._factor.solve(load - weighted @ (rigid.T @ load))
        return u - rigid @ (weighted.T @ u)

    def _multipliers(self, gap: Array, moment: Array) -> tuple[Array, Array]:
        """Interface forces and rigid motion that close a gap and balance the loads."""
        m = len(self._row)
        right = np.concatenate((self._row[:, None] * gap, self._column[:, None] * moment))
        solution = self._saddle @ right if m else np.zeros_like(right)
        return self._row[:, None] * solution[:m], self._column[:, None] * solution[m:]

    def interface_shapes(self) -> tuple[Array, Array]:
        """Return displacements for unit motions of the interfaces, and the stiffness.

        Shapes (n, m) and (m, m).
        """
        m = len(self._row)
        force, rigid = self._multipliers(np.eye(m), np.zeros((self._balance[0].shape[1], m)))
        return self.X @ force + self._balance[0] @ rigid, 0.5 * (force + force.T)

    def fixed_response(self, load: Array) -> Array:
        """Return the response to loads with fixed interfaces."""
        u = self.loose(load)
        force, rigid = self._multipliers(-self.P @ u, -self._balance[0].T @ load)
        return u + self.X @ force + self._balance[0] @ rigid

    def modes(self, count: int) -> tuple[Array, Array]:
        """Return the lowest modes with fixed interfaces.

        Squares of their angular frequencies [rad^2/s^2], shape (count,), and shapes with these as
        modal stiffness, shape (n, count).
        """
        if not count or not len(self._row):
            return np.zeros(0), np.zeros((self.part.size, 0))
        mass_times = self.part.mass_times
        start = mass_times(np.random.default_rng(0).standard_normal((self.part.size, _BLOCK)))
        return softest_modes(self.fixed_response, mass_times, start, count, _SETTLED)

    def reduced(self, loads: Array, count: int) -> tuple[Array, Array, int]:
        """Return the coordinates of the body: interfaces, modes, responses to loads inside it.

        Loads are one a row, shape (k, n), and `count` is the number of modes. Returns displacements
        for each coordinate, shape (n, r), their stiffness, shape (r, r), and the number of
        interfaces.
        """
        T, stiff = self.interface_shapes()
        squares, modes = self.modes(count)
        U, inner = self.responses(loads, squares, modes)
        stiffness = np.asarray(block_diag(stiff, np.diag(squares), inner))
        return np.column_stack((T, modes, U)), stiffness, len(stiff)

    def responses(self, loads: Array, squares: Array, modes: Array) -> tuple[Array, Array]:
        """Return responses to loads with fixed interfaces, less the contribution of the modes.

        Loads are one a row here, shape (k, n). Returns displacements, shape (n, k), and their
        stiffness, shape (k, k).
        """
        full_response = self.fixed_response(loads.T)
        share = modes.T @ loads.T
        rest = share / squares[:, None]
        stiff = full_response.T @ loads.T - share.T @ rest
        return full_response - modes @ rest, 0.5 * (stiff + stiff.T)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Condensed:
    r"""A body in a few coordinates, :math:`u = T q + \Phi \eta + U p`.

    The coordinates are the motions of its interfaces (those of `InterfaceDofs` for each neck, then
    one for each patch), its modes with fixed interfaces, and its responses to loads inside it with
    fixed interfaces.
    """

    stiffness: Array
    """Stiffness of the coordinates, shape (r, r)."""
    mass: Array
    """Mass of the coordinates, shape (r, r)."""
    loads: Array
    """Forces on the coordinates, shape (l, r), of each of `InterfaceDofs.loads` and of a unit force
    at each reading. So the first three rows are the mean motion of the body at its centre of mass
    too, in its plane displacement x, y and rotation, and the last ones the readings.
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
    supports: str
    """Supports of the body, as text."""

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
        """Indices of the coordinates that are modes."""
        return slice(self.interfaces, self.stiffness.shape[0] - len(self.loads))

    @property
    def inner(self) -> slice:
        """Indices of the coordinates that are responses to loads inside the body."""
        return slice(self.stiffness.shape[0] - len(self.loads), self.stiffness.shape[0])


def condense(part: Substructure, like: Substructure | None = None) -> Condensed:
    r"""Condense a body of a plate to the mean motions of its necks, by `part.through`.

    The motions of a neck are those of a beam: along and across its hinge and rotation, in space
    each with the lowest functions through the thickness, and the displacement through the plate and
    its slope over the neck. Each is the mean that does work with its traction, uniform and linear
    along the hinge and parabolic across; with these tractions go others without resultant, of
    higher powers over the neck and of the other functions, so that the neck stays plane where
    required (`flexstage.fem.necks.neck_mix`). With the rows P of these means, the body under
    interface forces obeys

    .. math:: K u = P^T\lambda, \quad P u = q, \quad K_c = \partial\lambda/\partial q

    and `PrescribedDisplacement` solves it, for free bodies as well as fixed ones.

    The matrices are for the `REFERENCE` material and the thickness of `part.through`. With `like`,
    another body of the same form, its mesh is moved with the outline where that is possible: errors
    of the mesh then cancel in differences between the two.

    Notes
    -----
    R. J. Guyan, AIAA J. 3 (1965) 380, and R. R. Craig, M. C. C. Bampton, AIAA J. 6 (1968) 1313,
    with means in place of single displacements. Validity: exact but for the shape of the traction
    in the necks, which is that of notches whose two halves are equal for about a neck's thickness.
    """
    return condensed_with_shapes(part, like)[0]


def condensed_with_shapes(
    part: Substructure, like: Substructure | None = None
) -> tuple[Condensed, LayeredPlate, Array]:
    """Condense a body; also return its plate, and the displacement for each coordinate."""
    tractions = [_tractions(part, neck) for neck in part.necks] if part.through.in_space else None
    with MESHER:
        body_on_mesh = _prepared(part, tractions, like)
    plate, loads = body_on_mesh.plate, body_on_mesh.loads
    mixed = None if tractions else partial(_mixed, part, plate.plane.order)
    body = PrescribedDisplacement(plate, body_on_mesh.rows, mixed, floating=not part.fixed)
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
        inertia=(
            body_on_mesh.properties.mass,
            *body_on_mesh.properties.centre,
            body_on_mesh.properties.inertia,
        ),
        elements=int(plate.plane.mesh.ne),
        # of a plane model with those that are held
        unknowns=plate.size if part.through.in_space else 2 * plate.plane.width,
        supports=body_on_mesh.supports,
    )
    return condensed, plate, basis


class StressOfNecks(NamedTuple):
    """Stress of all half notches of a body, as in `flexstage.fem.condensation.Condensed`."""

    stress: Array
    neck: NDArray[np.int64]
    point: NDArray[np.int64]
    seam: NDArray[np.int64]


def stress_of_necks(part: Substructure) -> StressOfNecks:
    """Return the stress of the half notches of a body by unit forces on them.

    Effects of a body on a notch beyond these forces are omitted (Saint-Venant).
    """
    stage = part.stage()
    stresses, owner, points, seams, used = [], [], [], [], 0
    for i, (neck, hinge) in enumerate(zip(part.necks, stage.hinges, strict=True)):
        half = neck_stress(notch_block_of(part, i, hinge_root(stage, hinge, neck.which)))
        stress = half.of_half(neck.which, neck.direction)
        levels, places, components, _ = stress.shape
        level, count = np.arange(levels)[:, None], int(half.point.max()) + 1
        # the ends of the neck, where the other half begins
        ends = np.sign(half.place[:, 1]) * (np.abs(half.place[:, 0]) < _NEAR)
        stresses.append(stress.reshape(levels * places, components, -1))
        owner.append(np.full(levels * places, i))
        points.append((used + half.point + count * level).ravel())
        seams.append((ends * (level + 1)).ravel())
        used += count * levels
    nothing = np.zeros(0, dtype=np.int64)
    return StressOfNecks(
        np.concatenate(stresses) if stresses else np.zeros((0, len(IN_PLANE), 0)),
        *(
            np.concatenate((nothing, *numbers)).astype(np.int64)
            for numbers in (owner, points, seams)
        ),
    )


def notch_block_of(part: Substructure, number: int, root: Root) -> NotchBlock:
    """Return the half notch at a neck of a body, with its root on it."""
    neck = part.necks[number]
    return NotchBlock(
        profile=neck.profile,
        wide=any(
            math.dist(end, corner) > _WIDER * neck.profile.root_height
            for end, corner in zip(root.ends, root.edge, strict=True)
        ),
        plane=neck.plane,
        through=part.through,
        mesh=part.mesh,
        poissons_ratio=part.poissons_ratio,
        powers=max(part.mesh.order, NECK_POWERS),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _MeshedBody:
    """A body on its mesh, before anything is factorised."""

    plate: LayeredPlate
    rows: Array
    """Motions of its interfaces, shape (m, n)."""
    loads: Array
    """Loads inside it, shape (l, n)."""
    properties: MassProperties
    """Mass properties of the body."""
    supports: str
    """Supports of the body, as text."""


@lru_cache(maxsize=64)
def _faces_on_mesh(part: Substructure) -> tuple[StageFaces, ng.Mesh]:
    faces = stage_faces(part.stage(), [BODY])
    return faces, mesh_without_slivers(part.stage(), faces, part.mesh)


def _faces_on_moved_mesh(part: Substructure, like: Substructure) -> tuple[StageFaces, ng.Mesh]:
    faces = stage_faces(part.stage(), [BODY])
    faces_before, mesh_before = _faces_on_mesh(like)
    mesh = moved_mesh(mesh_before, faces_before, faces, part.mesh)
    return _faces_on_mesh(part) if mesh is None else (faces, mesh)


def _bare(part: Substructure) -> Substructure:
    """Return a body with all that its mesh depends on, and the same for all motions."""
    in_plane = ThroughThickness(thickness=part.thickness)
    return replace(part, through=in_plane, readings=(), modes=0)


@lru_cache(maxsize=2)
def _meshed(
    part: Substructure, like: Substructure | None
) -> tuple[StageFaces, PlaneIntegrals, list[Array]]:
    """Mesh a body, for all its motions: its faces, integrals over its plane, means over necks."""
    faces, mesh = _faces_on_moved_mesh(part, like) if like else _faces_on_mesh(part)
    plane = PlaneIntegrals(
        mesh,
        order=part.mesh.order,
        fixed=MOUNTING if part.fixed else "",
        strain=_strained(part),
        other=either(region_materials(part.stage())),
    )
    return faces, plane, edge_means(mesh, part.mesh.order, part.necks)


def _strained(part: Substructure) -> str:
    names = (notch_region(str(i), n.which) for i, n in enumerate(part.necks) if n.plane == "strain")
    return either(names)


def _prepared(
    part: Substructure, tractions: Sequence[Array] | None, like: Substructure | None
) -> _MeshedBody:
    through, stage = part.through, part.stage()
    faces, plane, means = _meshed(_bare(part), like and _bare(like))
    plate = LayeredPlate(
        plane,
        part.material(),
        through,
        notches=[
            (
                exactly(notch_region(str(i), n.which)),
                n.at,
                n.profile.length / 2.0 + ENRICHMENT_RADIUS * n.profile.root_height,
            )
            for i, n in enumerate(part.necks)
        ],
        other=region_materials(stage).get(body_region(BODY)),
    )
    motions = neck_motions(through, plane.order).every
    rows = [np.zeros((0, plate.size))]
    for neck, neck_means, mix in zip(
        part.necks, means, tractions or [None] * len(means), strict=True
    ):
        direction = math.cos(neck.direction), math.sin(neck.direction)
        rows.append(constraint_matrix(plate, neck_means, motions, direction, mix))
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
    return _MeshedBody(
        plate=plate,
        rows=np.concatenate(rows),
        loads=np.array(loads),
        properties=properties,
        supports=faces.supports,
    )


def _tractions(part: Substructure, neck: CutNeck) -> Array:
    """Return the composition of each motion of a neck in space: of the half notch alone."""
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
    """Return the composition of each motion of an interface in a plane model: of the body."""
    each = len(neck_motions(part.through, degree).every)
    count = len(part.necks)
    blocks = [
        neck_mix(flexibility[each * i :, each * i :], part.through, degree) for i in range(count)
    ]
    return np.asarray(block_diag(*blocks, np.eye(len(flexibility) - count * each)))


def reactions(stiffness: Array, mass: Array, loads: Array, interfaces: int) -> Array:
    """Return the forces that hold the interfaces while the other coordinates move.

    A mode needs them against its inertia, the response to a load inside the body against the load,
    less the contribution of the modes.
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
    """Return the displacement of a point, or the rotation of the body, as a row.

    Where there is no material, the point follows the mean motion of the body. `lifted` converts a
    row of the plane continuum to one of the part.
    """
    if reading.direction is None:
        return motion[2]
    along = (math.cos(reading.direction), math.sin(reading.direction))
    x, y = reading.at
    if continuum.mesh.Contains(METRE * x, METRE * y):
        return lifted(continuum.point((x, y), along))
    arm = along[1] * (x - centre[0]) - along[0] * (y - centre[1])
    return along[0] * motion[0] + along[1] * motion[1] + arm * motion[2]
