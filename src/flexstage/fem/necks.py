"""Stress on the free surfaces of the notches, linear in the displacement."""

from dataclasses import dataclass, replace

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.elasticity import Continuum
from flexstage.elasticity.loaded import COMPONENTS
from flexstage.elasticity.resources import parallel
from flexstage.elasticity.shapes import METRE
from flexstage.fem.geometry import exactly, surface_edge
from flexstage.fem.layered_plate import LayeredPlate
from flexstage.stage import Stage

#: Indices of the components of stress in a plane model: xx, yy, zz and xy.
IN_PLANE = (0, 1, 2, 5)
#: Points along an edge; its ends lie on vertices, where adjacent elements are averaged.
ALONG = (0.0, 0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NeckPoints:
    """Points on the surfaces of the notches, each once for every element that touches it."""

    hinges: tuple[str, ...]
    """Names of the hinges."""
    places: NDArray[np.void]
    """Points of the mesh, shape (m,)."""
    position: Array
    """Where they are [m], shape (m, 3)."""
    owner: NDArray[np.intp]
    """Index into `hinges`, shape (m,)."""

    @property
    def point(self) -> NDArray[np.intp]:
        """Number of the point that each place belongs to, shape (m,)."""
        key = np.column_stack((self.owner, np.round(self.position * 1e9).astype(np.int64)))
        _, point = np.unique(key, axis=0, return_inverse=True)
        return point.ravel()

    def of(self, hinge: int) -> "NeckPoints":
        """Return those of one hinge."""
        own = self.owner == hinge
        return replace(
            self, places=self.places[own], position=self.position[own], owner=self.owner[own]
        )


def neck_points(mesh: ng.Mesh, stage: Stage) -> NeckPoints:
    """Return the points at which the stress of the notches is computed."""
    return surface_points(mesh, tuple(h.name for h in stage.hinges))


def surface_points(mesh: ng.Mesh, hinges: tuple[str, ...]) -> NeckPoints:
    """Return points along every element's edge or face on the surfaces of notches."""
    rules = {ng.ET.SEGM: _rule([(s, 0.0, 0.0) for s in ALONG])}
    if mesh.dim == 3:
        rules = {ng.ET.QUAD: _rule([(s, t, 0.0) for s in ALONG for t in ALONG])}
    found, owner = [], []
    for i, name in enumerate(hinges):
        surface = mesh.Boundaries(exactly(surface_edge(name)))
        places = mesh.MapToAllElements(rules, surface)
        found.append(places)
        owner.append(np.full(len(places), i, dtype=np.intp))
    if not found:
        nothing = np.zeros(0, dtype=np.intp)
        return NeckPoints(
            hinges=(), places=np.zeros(0, dtype="V1"), position=np.zeros((0, 3)), owner=nothing
        )
    places = np.concatenate(found)
    position = np.asarray(ng.CoefficientFunction((ng.x, ng.y, ng.z))(places)) / METRE
    return NeckPoints(
        hinges=hinges,
        places=places,
        position=position,
        owner=np.concatenate(owner),
    )


def _rule(points: list[tuple[float, float, float]]) -> ng.IntegrationRule:
    return ng.IntegrationRule(points=points, weights=[1.0] * len(points))


def neck_stress(
    continuum: Continuum, points: NeckPoints, u: Array, temperature: float = 0.0
) -> Array:
    """Return the stress at the points of the notches.

    Components xx, yy, zz, yz, xz, xy [Pa], shape (m, 6) or, of r displacements, (m, 6, r);
    `temperature` is a uniform change that goes with them [K].
    """
    if not points.owner.size:
        return np.zeros((0, 6, *u.shape[1:]))
    if u.ndim == 2:
        columns = [neck_stress(continuum, points, column, temperature) for column in u.T]
        return np.stack(columns, axis=-1)
    stress = continuum.stress(u, temperature)
    six = ng.CoefficientFunction(tuple(stress[i, j] for i, j in COMPONENTS))
    with parallel():
        return np.asarray(ng.BoundaryFromVolumeCF(six)(points.places))


def layered_stress(plate: LayeredPlate, points: NeckPoints, basis: Array) -> Array:
    """Return the stress of displacements of a plate at the points of its notches, level by level.

    Components [Pa] are those of `COMPONENTS`, of a plane model those of `IN_PLANE`; shape
    (l, m, c, r).
    """
    r = basis.shape[1]
    through, strained = plate.through, plate.plane.strained
    parts, z = through.components, through.levels
    kept = range(len(COMPONENTS)) if through.in_space else IN_PLANE
    if not len(points.places):
        return np.zeros((z.size, 0, len(kept), r))
    fields = plate.expanded(basis)
    values, slopes = _slopes_at(points, plate.plane.mesh, plate.plane.order, fields)
    functions = through.values_at(z)
    gradient = np.zeros((z.size, len(values), 3, 3, r))  # of displacement i along j
    for i, (d, kind, k) in enumerate(parts):
        value, slope = (f[k][:, None, None] for f in functions[kind])
        gradient[:, :, d, 0] += value * slopes[None, :, i, :, 0]
        gradient[:, :, d, 1] += value * slopes[None, :, i, :, 1]
        gradient[:, :, d, 2] += slope * values[None, :, i]
    gradient = gradient.reshape(-1, 3, 3, r)
    shear, (lame, more) = plate.shear_modulus, plate.lame
    where: Array | float = 0.0
    if strained is not None:
        where = np.asarray(ng.BoundaryFromVolumeCF(strained)(points.places)).reshape(-1, 1)
    volume = (lame + more * where) * np.einsum("miir->mr", gradient)
    # a plane model strains nothing across the plate, and is stressed there in plane strain alone
    across = volume if through.in_space else where * volume
    found = np.stack(
        [
            ((across if i == 2 else volume) if i == j else 0.0)
            + shear * (gradient[:, i, j] + gradient[:, j, i])
            for i, j in (COMPONENTS[k] for k in kept)
        ],
        axis=1,
    )
    return found.reshape(z.size, -1, len(kept), r)


def _slopes_at(points: NeckPoints, mesh: ng.Mesh, order: int, u: Array) -> tuple[Array, Array]:
    """Return fields in a plane and their derivatives [1/m] at the points of notches.

    Of c components of r displacements, shape (c, n, r): shapes (m, c, r) and (m, c, r, 2).
    """
    c, _, r = u.shape
    # all fields as the components of one function: they are evaluated at once
    function = ng.GridFunction(ng.H1(mesh, order=order, dim=c * r))
    function.vec.FV().NumPy()[:] = u.transpose(1, 0, 2).reshape(-1)
    found = []
    for field in (function, ng.Grad(function)):
        found.append(np.asarray(ng.BoundaryFromVolumeCF(field)(points.places)))
    return found[0].reshape(-1, c, r), METRE * found[1].reshape(-1, c, r, 2)
