"""Tetrahedra for a solid of any shape, fine where it is thin."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import ngsolve as ng
import numpy as np
from netgen.meshing import MeshingParameters, MeshingStep
from netgen.occ import OCCGeometry, TopoDS_Shape
from numpy.typing import NDArray

from flexstage.elasticity import METRE
from flexstage.errors import ModelError

__all__ = ["PartMesh", "mesh_shape", "thickness_below"]

Array = NDArray[np.float64]
_OPPOSED = -0.85  # a wall ends where the surface looks back within 32 degrees: no wedge is thin
_SMALLEST = 2e-3  # smallest element that thinness asks for, in sizes of the part
_PASSES, _THINNER = 5, 0.9  # searches at most; a search that finds no thinner place is the last
_REPAIRS, _FINER = 7, 1.5  # meshes that are tried, each with more elements to a radius
_FLATTENED = 0.02  # least over mean Jacobian determinant of an element that counts as folded
_STRAIGHTENED = 0.01  # part of the elements that may be straightened
_ROUNDS = 8
# where rays start in a triangle: in its middle and towards its corners
_SPREAD = np.array([[1 / 3, 1 / 3, 1 / 3], [0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])
_LOST = 0.01  # part of the volume that a mesh may lack


@dataclass(frozen=True, slots=True, kw_only=True)
class PartMesh:
    """How fine a mesh of a part is.

    Parameters
    ----------
    order : int
        Order to which the elements are curved; the displacement's order is given apart, and should
        be no less [1].
    size : float, optional
        Largest element [m]; a quarter of the diagonal of the part where not given.
    thin : float
        Largest element where the part is thin, in local thicknesses; 0 does not look for thin
        places [1].
    grading : float
        How fast elements grow, 0.1 (slowly) to 1 [1].
    curvature : float
        Elements to a radius of curvature, 0.2 to 20 [1].
    sizes : Mapping
        Largest element at faces, by their names [m].

    Raises
    ------
    ModelError
        A figure is out of its range.
    """

    order: int = 3
    size: float | None = None
    thin: float = 1.5
    grading: float = 0.5
    curvature: float = 1.0
    sizes: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, low, high in (
            ("order", 1, 8),
            ("thin", 0.0, 100.0),
            ("grading", 0.1, 1.0),
            ("curvature", 0.2, 20.0),
        ):
            if not low <= (value := getattr(self, name)) <= high:
                raise ModelError(f"{name} of a mesh must be {low:g} to {high:g}, got {value!r}")
        for value in (self.size, *self.sizes.values()):
            if value is not None and not value > 0.0:
                raise ModelError(f"a mesh size must be positive [m], got {value!r}")


def mesh_shape(shape: TopoDS_Shape, settings: PartMesh, source: str) -> ng.Mesh:
    """Mesh solids with curved tetrahedra.

    Parameters
    ----------
    shape : netgen.occ.TopoDS_Shape
        The solids, in millimetres.
    settings : PartMesh
        How fine.
    source : str
        What they are called in messages.

    Returns
    -------
    ngsolve.Mesh
        The mesh, in millimetres.

    Raises
    ------
    ModelError
        The mesher failed.

    Notes
    -----
    Thin places are found on the mesh of the surface itself, which is made coarse first and again
    as long as that shows thinner places: from each triangle rays go inwards to where the surface
    looks back at them. A few elements that curving would
    fold are left straight; where many are, the mesh is made anew with more elements to a radius.
    """
    geometry = OCCGeometry(shape)
    low, high = shape.bounding_box
    diagonal = float(np.linalg.norm([high.x - low.x, high.y - low.y, high.z - low.z]))
    largest = settings.size * METRE if settings.size is not None else 0.25 * diagonal
    at, sizes = np.zeros((0, 3)), np.zeros(0)
    kept = [(f, f.maxh) for f in shape.faces]
    try:
        for f in shape.faces:
            if f.name in settings.sizes:
                f.maxh = min(f.maxh, settings.sizes[f.name] * METRE)
        if settings.thin:
            thinnest = np.inf
            for _ in range(_PASSES):
                surface = _run(geometry, settings, largest, (at, sizes), source, surface=True)
                more, wall = thickness_below(surface, largest / settings.thin)
                at = np.concatenate([at, more])
                wanted = np.maximum(settings.thin * wall, _SMALLEST * diagonal)
                sizes = np.concatenate([sizes, wanted])
                now = float(wall.min(initial=np.inf))
                if not now < _THINNER * thinnest:
                    break
                thinnest = now
        for k in range(_REPAIRS):
            rules = replace(settings, curvature=settings.curvature * _FINER**k)
            mesh = ng.Mesh(_run(geometry, rules, largest, (at, sizes), source, surface=False))
            if mesh.ne == 0:
                raise ModelError(f"the mesher made no element of {source}: change the mesh size")
            mesh.Curve(settings.order)
            if _unfold(mesh, settings.order):
                break
        else:
            raise ModelError(
                f"curving to order {settings.order} folds many elements of {source}: give smaller "
                "sizes, more elements to a radius (curvature), or a lower order"
            )
    finally:
        for f, before in kept:
            f.maxh = before
    whole = sum(s.mass for s in shape.solids)
    meshed = float(ng.Integrate(ng.CoefficientFunction(1.0), mesh))
    if settings.order > 1 and abs(meshed - whole) > _LOST * whole:
        raise ModelError(
            f"the mesh of {source} holds {meshed:.6g} mm^3 of its {whole:.6g} mm^3: the mesher "
            "lost a face; change the mesh size or repair the part"
        )
    return mesh


def _folded(mesh: ng.Mesh, rule: ng.IntegrationRule) -> NDArray[np.intp]:
    """Return the elements that curving folds, or nearly folds."""
    determinant = ng.Det(ng.specialcf.JacobianMatrix(3))
    values = determinant(mesh.MapToAllElements(rule, ng.VOL)).reshape(mesh.ne, -1)
    return np.flatnonzero(values.min(axis=1) < _FLATTENED * np.abs(values).mean(axis=1))


def _unfold(mesh: ng.Mesh, order: int) -> bool:
    """Straighten elements that curving folds, as far as need be; return False where they are many.

    The curved shape is written as the straight one and a hierarchical polynomial displacement: what
    edges and faces add beyond the corners can then be taken back element by element, and neighbours
    still fit.
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


def _run(
    geometry: OCCGeometry,
    settings: PartMesh,
    largest: float,
    points: tuple[Array, Array],
    source: str,
    *,
    surface: bool,
) -> object:
    rules = MeshingParameters(
        maxh=largest,
        grading=settings.grading,
        curvaturesafety=settings.curvature,
        perfstepsend=MeshingStep.MESHSURFACE if surface else MeshingStep.MESHVOLUME,
    )
    for place, size in zip(*points, strict=True):
        rules.RestrictH(*place.tolist(), float(size))
    try:
        with ng.TaskManager():
            return geometry.GenerateMesh(rules)
    except Exception as error:  # the mesher raises its own class, and RuntimeError
        raise ModelError(
            f"the mesher could not mesh {source} ({str(error).strip() or 'no reason given'}): "
            "look for slivers and tiny edges in the CAD program, or change the mesh size"
        ) from error


def thickness_below(surface: object, limit: float) -> tuple[Array, Array]:
    """Return where the body behind a meshed surface is thinner than a limit.

    Parameters
    ----------
    surface : netgen.meshing.Mesh
        Triangles, with their normals outwards.
    limit : float
        The limit, in the mesh's unit.

    Returns
    -------
    tuple of numpy.ndarray
        Places on the surface, shape (k, 3), and the thickness below each, shape (k,).
    """
    points = surface.Coordinates()  # type: ignore[attr-defined]
    corners = np.array(
        [[p.nr - 1 for p in e.vertices[:3]] for e in surface.Elements2D()]  # type: ignore[attr-defined]
    )
    a, b, c = points[corners[:, 0]], points[corners[:, 1]], points[corners[:, 2]]
    ab, ac = b - a, c - a
    normal = np.cross(ab, ac)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    middle = (a + b + c) / 3.0
    reach = np.max([np.linalg.norm(middle - corner, axis=1) for corner in (a, b, c)], axis=0)
    places, found = [], []
    for i in range(len(a)):
        ray = -normal[i]
        offset = middle - middle[i]
        along = offset @ ray
        span = reach + reach[i]
        # triangles that look back, and that a ray from this one can meet within the limit
        near = (normal @ normal[i] < _OPPOSED) & (along > -span) & (along < limit + span)
        near &= np.einsum("ij,ij->i", offset, offset) - along**2 < span**2
        if near.any():
            for origin in _SPREAD @ np.array([a[i], b[i], c[i]]):
                distance = _first_hit(origin, ray, a[near], ab[near], ac[near])
                if distance < limit:
                    places.append(origin)
                    found.append(distance)
    return np.array(places).reshape(-1, 3), np.array(found)


def _first_hit(origin: Array, ray: Array, a: Array, ab: Array, ac: Array) -> float:
    """Return how far a ray goes to the first of some triangles (Möller and Trumbore, 1997)."""
    p = np.cross(ray, ac)
    det = np.einsum("ij,ij->i", ab, p)
    det = np.where(np.abs(det) < 1e-300, np.nan, det)
    s = origin - a
    q = np.cross(s, ab)
    u = np.einsum("ij,ij->i", s, p) / det
    v = (q @ ray) / det
    distance = np.einsum("ij,ij->i", ac, q) / det
    edge = 1e-9
    inside = (u >= -edge) & (v >= -edge) & (u + v <= 1.0 + edge) & (distance > 0.0)
    return float(distance[inside].min()) if inside.any() else np.inf
