"""Tetrahedral mesh of a solid, fine where it is thin, by a mesher in its own process."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import ngsolve as ng
import numpy as np
from netgen.meshing import MeshingParameters, MeshingStep
from netgen.occ import OCCGeometry, TopoDS_Shape
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.elasticity.own_process import BrokenDownError, in_own_process
from flexstage.elasticity.shapes import METRE
from flexstage.fem.mesh import require_within

#: Smallest element at thin places, in sizes of the part.
SMALLEST = 2e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class _Meshing:
    """Limits of the search for thin places and of the repair of folded elements."""

    opposed: float = -0.85
    """The opposite face of a wall has a normal within 32 degrees: no wedge is thin."""
    passes: int = 5
    """Largest number of searches for thin places."""
    thinner: float = 0.9
    """A search that finds no place thinner by this factor is the last."""
    repairs: int = 7
    """Largest number of meshes."""
    finer: float = 1.5
    """Factor on the elements to a radius from each mesh to the next."""
    flattened: float = 0.02
    """Least over mean Jacobian determinant of an element that counts as folded."""
    straightened: float = 0.01
    """Part of the elements that may be straightened."""
    rounds: int = 8
    """Largest number of rounds of straightening."""
    lost: float = 0.01
    """Part of the volume that a mesh may lack."""


_LIMITS = _Meshing()
# where rays start in a triangle: in its middle and towards its corners
_SPREAD = np.array([[1 / 3, 1 / 3, 1 / 3], [0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])


class MesherError(RuntimeError):
    """The mesher failed; the reason may be empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshTask:
    """Geometry and settings of a mesh, in millimetres, with the terms of `PartMesh`."""

    geometry: OCCGeometry
    """The solids, with sizes at faces."""
    diagonal: float
    """Diagonal of the box about them."""
    order: int
    """Order to which the elements will be curved."""
    largest: float
    """Largest element."""
    thin: float
    """Same as in `PartMesh`."""
    grading: float
    """Same as in `PartMesh`."""
    curvature: float
    """Same as in `PartMesh`."""


def generate(task: MeshTask) -> object | None:
    """Mesh solids with straight tetrahedra that can be curved.

    Thin places are found on the mesh of the surface itself, which is made coarse first and again
    as long as that shows thinner places: from each triangle rays go inwards to the opposite
    surface. A few elements that curving would fold can be straightened; where many are, the mesh is
    made anew with more elements to a radius.

    It is None where curving folds many elements of every mesh.
    """
    at, sizes = np.zeros((0, 3)), np.zeros(0)
    thinnest = np.inf
    for _ in range(_LIMITS.passes if task.thin else 0):
        surface = _run(task, task.curvature, (at, sizes), MeshingStep.MESHSURFACE)
        more, wall = thickness_below(surface, task.largest / task.thin)
        at = np.concatenate([at, more])
        sizes = np.concatenate([sizes, np.maximum(task.thin * wall, SMALLEST * task.diagonal)])
        now = float(wall.min(initial=np.inf))
        if not now < _LIMITS.thinner * thinnest:
            break
        thinnest = now
    for k in range(_LIMITS.repairs):
        netgen_mesh = _run(
            task, task.curvature * _LIMITS.finer**k, (at, sizes), MeshingStep.MESHVOLUME
        )
        mesh = ng.Mesh(netgen_mesh)
        if mesh.ne == 0:
            raise MesherError("it made no element")
        mesh.Curve(task.order)
        if straighten_folded(mesh, task.order):
            return netgen_mesh
    return None


def generate_alone(task: MeshTask) -> object | None:
    """Return the result of `generate` in a process of its own."""
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
    return np.flatnonzero(values.min(axis=1) < _LIMITS.flattened * np.abs(values).mean(axis=1))


def straighten_folded(mesh: ng.Mesh, order: int) -> bool:
    """Straighten elements that curving folds, as far as necessary.

    The curved shape is written as the straight one and a hierarchical polynomial displacement: the
    contributions of edges and faces can then be removed element by element, and neighbours still
    fit.

    Returns False where they are too many.
    """
    rule = ng.IntegrationRule(ng.ET.TET, 2 * order)
    bad = _folded(mesh, rule)
    if order < 2 or not len(bad):
        return True
    if len(bad) > _LIMITS.straightened * mesh.ne:
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
    for k in range(_LIMITS.rounds):
        touched.update(bad.tolist())
        for e in bad:
            dofs = np.array(space.GetDofNrs(ng.ElementId(ng.VOL, int(e))))
            values[dofs] *= 0.6 if k < _LIMITS.rounds // 2 else 0.0
        bad = _folded(mesh, rule)
        if not len(bad):
            return len(touched) <= _LIMITS.straightened * mesh.ne
    return False


def thickness_below(surface: object, limit: float) -> tuple[Array, Array]:
    """Return the places at which the body behind a meshed surface is thinner than a limit.

    Lengths are in the mesh's unit; the normals of the surface point outwards. Returns places on it,
    shape (k, 3), and the thickness below each, shape (k,).
    """
    points = surface.Coordinates()  # type: ignore[attr-defined]
    corners = np.array(
        [[p.nr - 1 for p in e.vertices[:3]] for e in surface.Elements2D()]  # type: ignore[attr-defined]
    )
    triangles = points[corners]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    starts = _SPREAD @ triangles
    walls = first_hits(triangles, normal, starts, -normal, limit)
    thin = walls < limit
    return starts[thin], walls[thin]


def first_hits(triangles: Array, normal: Array, starts: Array, rays: Array, limit: float) -> Array:
    """Return the distance along rays to the first opposed triangle.

    Corners of the triangles, shape (t, 3, 3), and their unit normals; `starts`, shape (n, s, 3),
    have one unit direction for each group, shape (n, 3). It is infinity where there is none within
    the limit, shape (n, s).
    """
    a, ab, ac = (
        triangles[:, 0],
        triangles[:, 1] - triangles[:, 0],
        triangles[:, 2] - triangles[:, 0],
    )
    middle = triangles.mean(axis=1)
    reach = np.linalg.norm(middle[:, None] - triangles, axis=2).max(axis=1)
    distances = np.full(starts.shape[:2], np.inf)
    for i, (origins, ray) in enumerate(zip(starts, rays, strict=True)):
        centre = origins.mean(axis=0)
        wide = float(np.sqrt(((origins - centre) ** 2).sum(axis=1).max()))
        offset = middle - centre
        along = offset @ ray
        span = reach + wide
        # triangles that look back, and that a ray from here can meet within the limit
        near = (normal @ ray > -_LIMITS.opposed) & (along > -span) & (along < limit + span)
        near &= np.einsum("ij,ij->i", offset, offset) - along**2 < span**2
        which = np.flatnonzero(near)
        if len(which):
            distance = _hits(origins, ray, a[which], ab[which], ac[which])
            distances[i] = np.where(distance < limit, distance, np.inf)
    return distances


def _across(p: Array, q: Array) -> Array:
    """Return the vector product; NumPy's own spends most of its time on the axes."""
    x, y, z = p[..., 0], p[..., 1], p[..., 2]
    u, v, w = q[..., 0], q[..., 1], q[..., 2]
    return np.stack((y * w - z * v, z * u - x * w, x * v - y * u), axis=-1)


def _hits(origins: Array, ray: Array, a: Array, ab: Array, ac: Array) -> Array:
    """Return the distance along rays to the first of some triangles (Möller and Trumbore, 1997)."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class PartMesh:
    """Settings of the mesh of a part."""

    order: int = 3
    """Order to which the elements are curved; the displacement's order is separate, and should be
    no less [1].
    """
    size: float | None = None
    """Largest element [m]; a quarter of the diagonal of the part where not given."""
    thin: float = 1.5
    """Largest element where the part is thin, in local thicknesses; 0 for no search for thin places
    [1].
    """
    grading: float = 0.5
    """Growth of elements, 0.1 (slow) to 1 [1]."""
    curvature: float = 1.0
    """Elements to a radius of curvature, 0.2 to 20 [1]."""
    sizes: Mapping[str, float] = field(default_factory=dict)
    """Largest element at faces, by their names [m]."""

    def __post_init__(self) -> None:
        require_within(
            self, order=(1, 8), thin=(0.0, 100.0), grading=(0.1, 1.0), curvature=(0.2, 20.0)
        )
        for value in (self.size, *self.sizes.values()):
            if value is not None and not value > 0.0:
                raise ModelError(f"a mesh size must be positive [m], got {value!r}")

    def largest(self, diagonal: float) -> float:
        """Return the largest element [m] of a part whose box has a diagonal [m]."""
        return self.size if self.size is not None else 0.25 * diagonal


def diagonal(shape: TopoDS_Shape) -> float:
    """Return the diagonal of the box about a shape, in the shape's unit."""
    low, high = shape.bounding_box
    return math.dist((low.x, low.y, low.z), (high.x, high.y, high.z))


def mesh_shape(
    shape: TopoDS_Shape, settings: PartMesh, source: str, *, limit: float | None = None
) -> ng.Mesh:
    """Mesh solids with curved tetrahedra.

    The mesh is in millimetres, as the shape; `limit` is the computing time after which the mesher
    is stopped [s], where the system can do so.

    Notes
    -----
    The mesher runs in a process of its own, on one thread: on slivers it may abort, which would end
    the program.
    """
    former_sizes = [(f, f.maxh) for f in shape.faces]
    try:
        for f in shape.faces:
            if f.name in settings.sizes:
                f.maxh = min(f.maxh, settings.sizes[f.name] * METRE)
        task = MeshTask(
            geometry=OCCGeometry(shape),
            diagonal=diagonal(shape),
            order=settings.order,
            largest=settings.largest(diagonal(shape) / METRE) * METRE,
            thin=settings.thin,
            grading=settings.grading,
            curvature=settings.curvature,
        )
        netgen_mesh = in_own_process(generate_alone, task, seconds=limit)
    except BrokenDownError as error:
        raise ModelError(f"the mesher {error} on {source}: {_repair_advice(shape)}") from None
    except MesherError as error:
        raise ModelError(
            f"the mesher could not mesh {source} ({str(error) or 'no reason given'}): "
            f"{_repair_advice(shape)}"
        ) from error
    finally:
        for f, before in former_sizes:
            f.maxh = before
    if netgen_mesh is None:
        raise ModelError(
            f"curving to order {settings.order} folds many elements of {source}: give smaller "
            "sizes, more elements to a radius (curvature), or a lower order"
        )
    mesh = ng.Mesh(netgen_mesh)
    mesh.Curve(settings.order)
    straighten_folded(mesh, settings.order)
    volume = sum(s.mass for s in shape.solids)
    meshed = float(ng.Integrate(ng.CoefficientFunction(1.0), mesh))
    if settings.order > 1 and abs(meshed - volume) > _LIMITS.lost * volume:
        raise ModelError(
            f"the mesh of {source} contains {meshed:.6g} mm^3 of its {volume:.6g} mm^3: the mesher "
            "lost a face; change the mesh size or repair the part"
        )
    return mesh


def _repair_advice(shape: TopoDS_Shape) -> str:
    """Return advice on a part that cannot be meshed."""
    width = {f.name: 2.0 * f.mass / sum(e.mass for e in f.edges) for f in shape.faces}
    narrow = min(width, key=lambda name: width[name])
    edge = min(e.mass for e in shape.edges)
    return (
        f"its narrowest face, '{narrow}', is {width[narrow]:.2g} mm wide and its shortest edge "
        f"{edge:.2g} mm long; repair slivers in the CAD program, or change the mesh size"
    )
