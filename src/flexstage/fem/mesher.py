"""The mesher, which may end its process: it is called in one of its own."""

from dataclasses import dataclass

import ngsolve as ng
import numpy as np
from netgen.meshing import MeshingParameters, MeshingStep
from netgen.occ import OCCGeometry
from numpy.typing import NDArray

from flexstage.arrays import Array

#: Smallest element that thinness asks for, in sizes of the part.
SMALLEST = 2e-3
_OPPOSED = -0.85  # a wall ends where the surface looks back within 32 degrees: no wedge is thin
_PASSES, _THINNER = 5, 0.9  # searches at most; a search that finds no thinner place is the last
_REPAIRS, _FINER = 7, 1.5  # meshes that are tried, each with more elements to a radius
_FLATTENED = 0.02  # least over mean Jacobian determinant of an element that counts as folded
_STRAIGHTENED = 0.01  # part of the elements that may be straightened
_ROUNDS = 8
# where rays start in a triangle: in its middle and towards its corners
_SPREAD = np.array([[1 / 3, 1 / 3, 1 / 3], [0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])


class MesherError(RuntimeError):
    """The mesher says that it failed; the reason may be empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshTask:
    """What is to be meshed and how, in millimetres; the words are those of `PartMesh`."""

    geometry: OCCGeometry
    """The solids; sizes at faces stand in them."""
    diagonal: float
    """Of the box about them."""
    order: int
    """Order to which the elements will be curved."""
    largest: float
    """Largest element."""
    thin: float
    """As of `PartMesh`."""
    grading: float
    """As of `PartMesh`."""
    curvature: float
    """As of `PartMesh`."""


def generate(task: MeshTask) -> object | None:
    """Mesh solids with straight tetrahedra that can be curved.

    Thin places are found on the mesh of the surface itself, which is made coarse first and again
    as long as that shows thinner places: from each triangle rays go inwards to where the surface
    looks back at them. A few elements that curving would fold can be straightened; where many are,
    the mesh is made anew with more elements to a radius.

    None where curving folds many elements of every mesh that was tried.
    """
    at, sizes = np.zeros((0, 3)), np.zeros(0)
    thinnest = np.inf
    for _ in range(_PASSES if task.thin else 0):
        surface = _run(task, task.curvature, (at, sizes), MeshingStep.MESHSURFACE)
        more, wall = thickness_below(surface, task.largest / task.thin)
        at = np.concatenate([at, more])
        sizes = np.concatenate([sizes, np.maximum(task.thin * wall, SMALLEST * task.diagonal)])
        now = float(wall.min(initial=np.inf))
        if not now < _THINNER * thinnest:
            break
        thinnest = now
    for k in range(_REPAIRS):
        made = _run(task, task.curvature * _FINER**k, (at, sizes), MeshingStep.MESHVOLUME)
        mesh = ng.Mesh(made)
        if mesh.ne == 0:
            raise MesherError("it made no element")
        mesh.Curve(task.order)
        if unfold(mesh, task.order):
            return made
    return None


def generate_alone(task: MeshTask) -> object | None:
    """Return what `generate` makes in a process that does nothing else."""
    with ng.TaskManager():
        return generate(task)


def _run(task: MeshTask, curvature: float, points: tuple[Array, Array], end: object) -> object:
    rules = MeshingParameters(
        maxh=task.largest,
        grading=task.grading,
        curvaturesafety=curvature,
        perfstepsend=end,
    )
    for place, size in zip(*points, strict=True):
        rules.RestrictH(*place.tolist(), float(size))
    try:
        return task.geometry.GenerateMesh(rules)
    except Exception as error:  # the mesher raises its own class, and RuntimeError
        raise MesherError(str(error).strip()) from error


def _folded(mesh: ng.Mesh, rule: ng.IntegrationRule) -> NDArray[np.intp]:
    """Return the elements that curving folds, or nearly folds."""
    determinant = ng.Det(ng.specialcf.JacobianMatrix(3))
    values = determinant(mesh.MapToAllElements(rule, ng.VOL)).reshape(mesh.ne, -1)
    return np.flatnonzero(values.min(axis=1) < _FLATTENED * np.abs(values).mean(axis=1))


def unfold(mesh: ng.Mesh, order: int) -> bool:
    """Straighten elements that curving folds, as far as need be.

    The curved shape is written as the straight one and a hierarchical polynomial displacement: what
    edges and faces add beyond the corners can then be taken back element by element, and neighbours
    still fit.

    Returns False where they are too many.
    """
    rule = ng.IntegrationRule(ng.ET.TET, 2 * order)
    bad = _folded(mesh, rule)
    if order < 2 or not len(bad):
        return True
    if len(bad) > _STRAIGHTENED * mesh.ne:
        return False
    space = ng.VectorH1(mesh, order=order)
    bend = ng.GridFunction(space)
    bend.Set(ng.CoefficientFunction((ng.x, ng.y, ng.z)))
    values = bend.vec.FV().NumPy()
    one = space.ndof // 3
    for c in range(3):
        values[c * one : c * one + mesh.nv] = 0.0  # the corners stay where they are
    mesh.Curve(1)
    mesh.SetDeformation(bend)
    touched: set[int] = set()
    for k in range(_ROUNDS):
        touched.update(bad.tolist())
        for e in bad:
            dofs = np.array(space.GetDofNrs(ng.ElementId(ng.VOL, int(e))))
            values[dofs] *= 0.6 if k < _ROUNDS // 2 else 0.0
        bad = _folded(mesh, rule)
        if not len(bad):
            return len(touched) <= _STRAIGHTENED * mesh.ne
    return False


def thickness_below(surface: object, limit: float) -> tuple[Array, Array]:
    """Return where the body behind a meshed surface is thinner than a limit.

    In the mesh's unit; the normals of the surface look outwards. Returns places on it, shape (k,
    3), and the thickness below each, shape (k,).
    """
    points = surface.Coordinates()  # type: ignore[attr-defined]
    corners = np.array(
        [[p.nr - 1 for p in e.vertices[:3]] for e in surface.Elements2D()]  # type: ignore[attr-defined]
    )
    triangles = points[corners]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    starts = _SPREAD @ triangles
    found = first_hits(triangles, normal, starts, -normal, limit)
    thin = found < limit
    return starts[thin], found[thin]


def first_hits(triangles: Array, normal: Array, starts: Array, rays: Array, limit: float) -> Array:
    """Return how far rays go to the first triangle that looks back at them.

    Corners of the triangles, shape (t, 3, 3), and their unit normals; `starts`, shape (n, s, 3),
    lie side by side with one unit direction each, shape (n, 3). Infinity where there is none within
    the limit, shape (n, s).
    """
    a, ab, ac = (
        triangles[:, 0],
        triangles[:, 1] - triangles[:, 0],
        triangles[:, 2] - triangles[:, 0],
    )
    middle = triangles.mean(axis=1)
    reach = np.linalg.norm(middle[:, None] - triangles, axis=2).max(axis=1)
    found = np.full(starts.shape[:2], np.inf)
    for i, (origins, ray) in enumerate(zip(starts, rays, strict=True)):
        centre = origins.mean(axis=0)
        wide = float(np.sqrt(((origins - centre) ** 2).sum(axis=1).max()))
        offset = middle - centre
        along = offset @ ray
        span = reach + wide
        # triangles that look back, and that a ray from here can meet within the limit
        near = (normal @ ray > -_OPPOSED) & (along > -span) & (along < limit + span)
        near &= np.einsum("ij,ij->i", offset, offset) - along**2 < span**2
        which = np.flatnonzero(near)
        if len(which):
            distance = _hits(origins, ray, a[which], ab[which], ac[which])
            found[i] = np.where(distance < limit, distance, np.inf)
    return found


def _across(p: Array, q: Array) -> Array:
    """Return the vector product; NumPy's own spends most of its time on the axes."""
    x, y, z = p[..., 0], p[..., 1], p[..., 2]
    u, v, w = q[..., 0], q[..., 1], q[..., 2]
    return np.stack((y * w - z * v, z * u - x * w, x * v - y * u), axis=-1)


def _hits(origins: Array, ray: Array, a: Array, ab: Array, ac: Array) -> Array:
    """Return how far rays go to the first of some triangles (Möller and Trumbore, 1997)."""
    p = _across(ray, ac)
    det = np.einsum("ij,ij->i", ab, p)
    det = np.where(np.abs(det) < 1e-300, np.nan, det)
    s = origins[:, None] - a
    q = _across(s, ab)
    u = np.einsum("kij,ij->ki", s, p) / det
    v = (q @ ray) / det
    distance = np.einsum("kij,ij->ki", q, ac) / det
    edge = 1e-9
    inside = (u >= -edge) & (v >= -edge) & (u + v <= 1.0 + edge) & (distance > 0.0)
    return np.where(inside, distance, np.inf).min(axis=1)
