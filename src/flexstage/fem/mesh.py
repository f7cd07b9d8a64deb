"""Meshes of a stage: triangles in its plane, or prisms through its thickness."""

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from netgen.meshing import IdentificationType, MeshingParameters
from netgen.occ import Glue, OCCGeometry, TopoDS_Shape, Vec
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.elasticity.resources import parallel, require_memory
from flexstage.elasticity.shapes import METRE
from flexstage.fem.geometry import StageFaces, body_region, surface_edge
from flexstage.stage import Loop, Stage

#: Least shape of an element; below it a sliver makes its neighbourhood inaccurate [1].
SLIVER = 0.15
_TRIES = 6

# At a corner that points into a body the stress is singular, and the mesh dominates the error of
# the body's stiffness: largest element there, in plate thicknesses, and the least turn [rad].
_AT_CORNER, _TURN = 0.1, 0.3
_SAME = 1e-6  # two points are one [mm]
_GROWTH = 0.35  # of an element, by its distance from the small ones [1]

#: Lock of the mesher and its meshes for one thread at a time; matrices are factorised in parallel.
MESHER = threading.RLock()

#: Boundary on the middle plane of a stage, where a half of its thickness is meshed.
MIDDLE = "middle"


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSettings:
    """Settings of a mesh.

    Raises
    ------
    ModelError
        A setting is out of its range.
    """

    order: int = 4
    """Polynomial order of the displacement, 1 to 8."""
    neck_size: float = 0.8
    """Largest element along the surface of a notch, in neck thicknesses [1]."""
    grading: float = 0.6
    """Growth of elements away from the necks, 0.1 (slow) to 1 [1]."""
    size: float = 2.0
    """Largest element, in plate thicknesses [1]."""
    layers: int = 1
    """Layers of prisms through half the thickness; not used in a plane mesh."""

    def __post_init__(self) -> None:
        require_within(
            self,
            order=(1, 8),
            neck_size=(0.05, 20.0),
            grading=(0.1, 1.0),
            size=(0.01, 100.0),
            layers=(1, 16),
        )


def require_within(settings: object, **ranges: tuple[float, float]) -> None:
    """Refuse settings of a mesh that are out of their ranges."""
    for name, (low, high) in ranges.items():
        if not low <= (value := getattr(settings, name)) <= high:
            raise ModelError(f"{name} of a mesh must be {low:g} to {high:g}, got {value!r}")


#: Factors on the requested size, tried in turn until the plate is filled with prisms.
_SIZES = (1.0, 0.85, 1.15)


def _refine(stage: Stage, faces: StageFaces, settings: MeshSettings) -> None:
    necks = {surface_edge(h.name): h.profile.neck_thickness for h in stage.hinges}
    for edge in faces.shape.edges:
        if edge.name in necks:
            edge.maxh = settings.neck_size * necks[edge.name] * METRE


#: Places in the plane and the largest element there [mm].
Sizes = Sequence[tuple[tuple[float, float], float]]


def _generate(
    shape: TopoDS_Shape, dimension: int, largest: float, grading: float, sizes: Sizes
) -> ng.Mesh:
    geometry = OCCGeometry(shape, dim=dimension)
    rules = MeshingParameters(maxh=largest * METRE, grading=grading)
    levels = {corner.z for corner in shape.bounding_box}
    for (x, y), size in sizes:
        for z in levels:
            rules.RestrictH(x, y, z, size)
    try:
        # a plane is meshed by one thread: waiting threads would keep the cores busy
        with parallel(1 if dimension == 2 else None):
            netgen_mesh = geometry.GenerateMesh(rules)
    except Exception as error:  # the mesher raises its own class, and RuntimeError
        raise ModelError(
            f"the mesher could not mesh the part ({str(error).strip() or 'no reason given'}): "
            "look for slivers and overlaps with 'flexstage check'"
        ) from error
    mesh = ng.Mesh(netgen_mesh)
    if mesh.ne == 0:
        raise ModelError("the mesher made no element: the part has no area")
    return mesh


def _require_room(stage: Stage, faces: StageFaces, settings: MeshSettings, dimension: int) -> None:
    """Refuse elements so small that their number alone does not fit in memory."""
    largest = settings.size * stage.thickness * METRE
    area = sum(f.mass for f in faces.shape.faces)
    # no triangle is larger than an equilateral one, and the necks only add to them
    elements = area / (math.sqrt(3.0) / 4.0 * largest**2)
    p = settings.order
    each = p**2 if dimension == 2 else 1.5 * p**3 * settings.layers
    require_memory(
        int(elements * each), dimension, p, layered=dimension == 3 and settings.layers == 1
    )


def _level_faces(solid: TopoDS_Shape, height: float) -> list[TopoDS_Shape]:
    boxes = [(f, f.bounding_box) for f in solid.faces]
    return [f for f, (low, high) in boxes if high.z - low.z < 1e-3 * height]


def corner_sizes(stage: Stage, faces: StageFaces) -> Sizes:
    """Return the sizes of elements at the corners that point into bodies."""
    there = {f.name for f in faces.shape.faces}
    size = _AT_CORNER * stage.thickness * METRE
    sizes = []
    for body in stage.bodies:
        if body_region(body.name) in there:
            loops = [(body.outline, 1.0), *((h, -1.0) for h in body.holes if isinstance(h, Loop))]
            for loop, side in loops:
                sizes += [
                    ((METRE * x, METRE * y), size)
                    for (x, y), turn in _turns(loop)
                    if side * turn < -_TURN
                ]
    return sizes


def _turns(loop: Loop) -> list[tuple[tuple[float, float], float]]:
    """Return the turn of a loop at its corners, positive where they point outwards [rad]."""
    segments = loop.segments()
    area = sum(a[0] * b[1] - a[1] * b[0] for a, b, _ in segments)
    turns = []
    for (a, b, bent), (_, c, bends) in zip(segments, segments[1:] + segments[:1], strict=True):
        before = math.atan2(b[1] - a[1], b[0] - a[0]) + 2.0 * math.atan(bent)
        after = math.atan2(c[1] - b[1], c[0] - b[0]) - 2.0 * math.atan(bends)
        turn = math.remainder(after - before, 2.0 * math.pi)
        turns.append((b, math.copysign(turn, turn * area)))
    return turns


def plane_mesh(
    stage: Stage, faces: StageFaces, settings: MeshSettings, sizes: Sizes = ()
) -> ng.Mesh:
    """Mesh the plane of a stage with curved triangles.

    It is in millimetres, with regions and boundaries named as in `flexstage.fem.geometry`; `sizes`
    are of elements at places other than notches and corners.
    """
    _require_room(stage, faces, settings, 2)
    _refine(stage, faces, settings)
    return face_mesh(faces.shape, stage.thickness, settings, [*corner_sizes(stage, faces), *sizes])


def face_mesh(
    shape: TopoDS_Shape, thickness: float, settings: MeshSettings, sizes: Sizes = ()
) -> ng.Mesh:
    """Mesh a face of a plate of some thickness [m] with curved triangles."""
    mesh = _generate(shape, 2, settings.size * thickness, settings.grading, sizes)
    mesh.Curve(settings.order)
    return mesh


def prism_mesh(stage: Stage, faces: StageFaces, settings: MeshSettings) -> ng.Mesh:
    """Mesh the upper half of a stage's thickness with layers of curved prisms.

    The plane z = 0 is the middle of the plate; the motion of a stage is symmetric or antisymmetric
    about it, so that two half models suffice.

    It is in millimetres; the boundary `MIDDLE` lies on z = 0, the others are named as the edges
    from which they are extruded.
    """
    _require_room(stage, faces, settings, 3)
    _refine(stage, faces, settings)
    height = 0.5 * stage.thickness * METRE / settings.layers
    slabs = [
        faces.shape.Move(Vec(0.0, 0.0, k * height)).Extrude(Vec(0.0, 0.0, height))
        for k in range(settings.layers)
    ]
    solid_stack = slabs[0] if len(slabs) == 1 else Glue(slabs)
    # The two level faces of each solid have the same mesh, with prisms between, however many bodies
    # share a centre. Layers are slabs of their own: splitting prisms afterwards would lose the
    # curvature of their sides.
    for solid in solid_stack.solids:
        below, above = sorted(_level_faces(solid, height), key=lambda f: f.center.z)
        layer = round(below.center.z / height)
        if layer == 0:
            below.name = MIDDLE
        below.Identify(above, f"layer {layer}", IdentificationType.CLOSESURFACES)
    for share in _SIZES:
        largest = share * settings.size * stage.thickness
        mesh = _generate(solid_stack, 3, largest, settings.grading, corner_sizes(stage, faces))
        if all(e.type == ng.ET.PRISM for e in mesh.Elements(ng.VOL)):
            break
    else:
        raise ModelError(
            "the mesher did not fill the plate with prisms, at three sizes of the elements: use "
            "the plane model or the superelements, or look for slivers with 'flexstage check'"
        )
    mesh.Curve(settings.order)
    return mesh


def shapes(mesh: ng.Mesh) -> Array:
    r"""Return the shapes of the elements of a plane mesh.

    The shape is :math:`2\det J/|J|^2` with the map J from the equilateral triangle, at its worst
    point: 1 for an equilateral element, 0 for one without area, negative for one turned over.

    The mesh is of triangles, curved or not.
    """
    jacobian = ng.specialcf.JacobianMatrix(2)
    places = mesh.MapToAllElements(ng.IntegrationRule(ng.ET.TRIG, 4), ng.VOL)
    map_ = np.asarray(jacobian(places)).reshape(mesh.ne, -1, 2, 2)
    # the reference triangle has a right angle: this turns it into the equilateral one
    map_ = map_ @ np.array([[1.0, -1.0 / np.sqrt(3.0)], [0.0, 2.0 / np.sqrt(3.0)]])
    return (2.0 * np.linalg.det(map_) / np.sum(map_**2, axis=(2, 3))).min(axis=1)


def mesh_without_slivers(stage: Stage, faces: StageFaces, settings: MeshSettings) -> ng.Mesh:
    """Mesh the plane of a stage, again where the mesher left slivers.

    Now and then the mesher closes a gap between fine and coarse elements with a fan of slivers.
    Sizes along them then prescribe the growth of elements.

    It is the first mesh without a sliver in a few tries, or else the best.
    """
    sizes: list[tuple[tuple[float, float], float]] = []
    best, least = None, -math.inf
    for _ in range(_TRIES):
        mesh = plane_mesh(stage, faces, settings, sizes)
        qualities = shapes(mesh)
        if best is None or qualities.min() > least:
            best, least = mesh, float(qualities.min())
        bad = np.flatnonzero(qualities < SLIVER)
        if not bad.size:
            break
        sizes += _graded(mesh, bad)
    return best


def moved_mesh(
    mesh: ng.Mesh, before: StageFaces, after: StageFaces, settings: MeshSettings
) -> ng.Mesh | None:
    """Return the mesh of some faces moved to others of the same form; None if theirs is another.

    Vertices of an edge keep their share of its length, and the others follow evenly. Errors by the
    mesh are then about the same before and after, and cancel in differences.
    """
    geometry = OCCGeometry(after.shape, dim=2)
    there = _numbered(list(geometry.edges), after.corners)
    here = _numbered(list(OCCGeometry(before.shape, dim=2).edges), before.corners)
    if there is None or here is None or here.keys() != there.keys():
        return None
    key_of = {number: key for key, (number, _) in here.items()}
    moved = mesh.ngmesh.Copy()
    places = np.array([point.p[:2] for point in moved.Points()])
    shifts, known = np.zeros_like(places), np.zeros(len(places), dtype=bool)
    for segment in moved.Elements1D():
        key = key_of[moved.EdgeDescriptor(segment.index).edgenr]
        ends = [vertex.nr - 1 for vertex in segment.vertices[:2]]
        shifts[ends] = _moved_along(here[key][1], there[key][1], places[ends]) - places[ends]
        known[ends] = True
    corners = np.array([[v.nr - 1 for v in e.vertices[:3]] for e in moved.Elements2D()])
    shifts[~known] = _followed(places, corners, shifts, known)
    for point, (x, y) in zip(moved.Points(), (places + shifts).tolist(), strict=True):
        point[0], point[1] = x, y
    for descriptor in moved.EdgeDescriptors():
        descriptor.edgenr = there[key_of[descriptor.edgenr]][0]
    moved.SetGeometry(geometry)
    result = ng.Mesh(moved)
    result.Curve(settings.order)
    return result if shapes(result).min() > 0.5 * min(SLIVER, shapes(mesh).min()) else None


#: Corners of an edge, and the side on which it is bent.
_EdgeKey = tuple[int, int, float]


def _numbered(
    edges: Sequence[TopoDS_Shape], corners: Sequence[tuple[float, float]]
) -> dict[_EdgeKey, tuple[int, Array]] | None:
    """Return the number of each edge from 1, with its start, middle and end [mm]; None if unclear.

    The start is at the corner of the lower number.
    """
    at = METRE * np.array(corners)
    numbers: dict[_EdgeKey, tuple[int, Array]] = {}
    for number, edge in enumerate(edges, start=1):
        first, last = edge.parameter_interval
        line = np.array([(p.x, p.y) for p in map(edge.Value, np.linspace(first, last, 3))])
        near = [np.flatnonzero(np.hypot(*(at - end).T) < _SAME) for end in line[[0, 2]]]
        if not all(n.size for n in near):
            return None
        start, end = (int(n[0]) for n in near)
        if start > end:
            start, end, line = end, start, line[::-1]
        chord, rise = line[2] - line[0], line[1] - line[0]
        bent = chord[0] * rise[1] - chord[1] * rise[0]
        side = float(np.sign(bent)) if abs(bent) > _SAME * math.hypot(*chord) else 0.0
        numbers[start, end, side] = number, line
    return numbers if len(numbers) == len(edges) else None


def _moved_along(before: Array, after: Array, places: Array) -> Array:
    """Return the places of points of a line or an arc on another one, both by three points."""
    angle, other = _sweep(before), _sweep(after)
    of_start, of_end = (
        np.hypot(*(places - end).T) / math.dist(before[0], before[2]) for end in before[[0, 2]]
    )
    share = of_start
    if angle:
        # from the nearer end: chords of more than half a circle become shorter again
        nearer = np.minimum(of_start, of_end) * math.sin(0.5 * angle)
        share = 2.0 * np.arcsin(np.minimum(nearer, 1.0)) / angle
        share = np.where(of_start <= of_end, share, 1.0 - share)
    chord = after[2] - after[0]
    if not other:
        return after[0] + share[:, None] * chord
    # a chord of the arc from its start turns from its tangent by half of the angle so far
    rise = after[1] - after[0]
    turn = math.copysign(0.5 * other, chord[0] * rise[1] - chord[1] * rise[0])
    turns, reach = turn * (1.0 - share), np.sin(0.5 * share * other) / math.sin(0.5 * other)
    cos, sin = reach * np.cos(turns), reach * np.sin(turns)
    x, y = cos * chord[0] - sin * chord[1], sin * chord[0] + cos * chord[1]
    return after[0] + np.column_stack((x, y))


def _sweep(line: Array) -> float:
    """Return the angle of an arc by its start, middle and end [rad]; 0 of a line."""
    ratio = 0.5 * math.dist(line[0], line[2]) / math.dist(line[0], line[1])
    angle = 4.0 * math.acos(min(ratio, 1.0))
    return angle if angle > 1e-4 else 0.0


def _followed(
    places: Array, triangles: NDArray[np.intp], shifts: Array, known: NDArray[np.bool_]
) -> Array:
    """Return the shifts of inner vertices: harmonic, linear on triangles; linear ones are exact."""
    if known.all():
        return np.zeros((0, 2))
    corners = places[triangles]
    opposite = np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1)
    area = np.abs(np.linalg.det(opposite[:, :2]))
    integrals = np.einsum("tik,tjk->tij", opposite, opposite) / area[:, None, None]
    rows, columns = np.repeat(triangles, 3, axis=1), np.tile(triangles, 3)
    size = (len(places), len(places))
    free = sp.csr_matrix((integrals.ravel(), (rows.ravel(), columns.ravel())), shape=size)[~known]
    return splu(free[:, ~known].tocsc()).solve(-(free[:, known] @ shifts[known]))


def _graded(mesh: ng.Mesh, slivers: NDArray[np.intp]) -> Sizes:
    """Return sizes that grow evenly from the short edge of each sliver to its far corner."""
    sizes: list[tuple[tuple[float, float], float]] = []
    for k in slivers:
        element = mesh[ng.ElementId(ng.VOL, int(k))]
        corners = np.array([mesh[v].point for v in element.vertices])
        edges = np.roll(corners, -1, axis=0) - np.roll(corners, 1, axis=0)
        lengths = np.hypot(*edges.T)
        far = int(np.argmin(lengths))
        short = float(lengths[far])
        start = np.delete(corners, far, axis=0).mean(axis=0)
        along = corners[far] - start
        length = math.hypot(*along)
        reach = short
        while reach < length:
            x, y = (start + along * (reach / length)).tolist()
            sizes.append(((x, y), short + _GROWTH * reach))
            reach *= 1.5
    return sizes
