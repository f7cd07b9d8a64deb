"""Meshes of a stage: triangles in its plane, or prisms through its thickness."""

import math
from dataclasses import dataclass, replace

import ngsolve as ng
import numpy as np
from netgen.meshing import IdentificationType
from netgen.occ import Glue, OCCGeometry, TopoDS_Shape, Vec

from flexstage.elasticity.resources import parallel, require_memory
from flexstage.elasticity.shapes import METRE
from flexstage.errors import ModelError
from flexstage.fem.geometry import StageFaces, surface_edge
from flexstage.stage import Stage

#: Below it an element is a sliver that spoils the figures of its neighbourhood [1].
SLIVER = 0.15
_TRIES = 4

#: Boundary on the middle plane of a stage, where a half of its thickness is meshed.
MIDDLE = "middle"


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSettings:
    """How fine a mesh is.

    Raises
    ------
    ModelError
        A figure is out of its range.
    """

    order: int = 4
    """Polynomial order of the displacement, 1 to 8."""
    neck_size: float = 0.8
    """Largest element along the surface of a notch, in neck thicknesses [1]."""
    grading: float = 0.6
    """How fast elements grow away from the necks, 0.1 (slowly) to 1 [1]."""
    size: float = 2.0
    """Largest element, in plate thicknesses [1]."""
    layers: int = 1
    """Layers of prisms through half the thickness; of a plane mesh it says nothing."""

    def __post_init__(self) -> None:
        for name, low, high in (
            ("order", 1, 8),
            ("neck_size", 0.05, 20.0),
            ("grading", 0.1, 1.0),
            ("size", 0.01, 100.0),
            ("layers", 1, 16),
        ):
            if not low <= (value := getattr(self, name)) <= high:
                raise ModelError(f"{name} of a mesh must be {low:g} to {high:g}, got {value!r}")


#: Sizes that are tried, over the one that is asked for, until the plate is filled with prisms.
_SIZES = (1.0, 0.85, 1.15)


def _refine(stage: Stage, faces: StageFaces, settings: MeshSettings) -> None:
    necks = {surface_edge(h.name): h.profile.neck_thickness for h in stage.hinges}
    for edge in faces.shape.edges:
        if edge.name in necks:
            edge.maxh = settings.neck_size * necks[edge.name] * METRE


def _generate(shape: TopoDS_Shape, dimension: int, largest: float, grading: float) -> ng.Mesh:
    geometry = OCCGeometry(shape, dim=dimension)
    try:
        with parallel():
            made = geometry.GenerateMesh(maxh=largest * METRE, grading=grading)
    except Exception as error:  # the mesher raises its own class, and RuntimeError
        raise ModelError(
            f"the mesher could not mesh the part ({str(error).strip() or 'no reason given'}): "
            "look for slivers and overlaps with 'flexstage check'"
        ) from error
    mesh = ng.Mesh(made)
    if mesh.ne == 0:
        raise ModelError("the mesher made no element: the part has no area")
    return mesh


def _afford(stage: Stage, faces: StageFaces, settings: MeshSettings, dimension: int) -> None:
    """Refuse elements so small that already their number does not fit in memory."""
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


def plane_mesh(stage: Stage, faces: StageFaces, settings: MeshSettings) -> ng.Mesh:
    """Mesh the plane of a stage with curved triangles.

    It is in millimetres, with regions and boundaries named as in `flexstage.fem.geometry`.
    """
    _afford(stage, faces, settings, 2)
    _refine(stage, faces, settings)
    return face_mesh(faces.shape, stage.thickness, settings)


def face_mesh(shape: TopoDS_Shape, thickness: float, settings: MeshSettings) -> ng.Mesh:
    """Mesh a face, of a plate as thick as is said [m], with curved triangles."""
    mesh = _generate(shape, 2, settings.size * thickness, settings.grading)
    mesh.Curve(settings.order)
    return mesh


def prism_mesh(stage: Stage, faces: StageFaces, settings: MeshSettings) -> ng.Mesh:
    """Mesh the upper half of a stage's thickness with layers of curved prisms.

    The plane z = 0 is the middle of the plate; whatever a stage does is symmetric about it or the
    opposite, so that two half models hold the whole answer.

    It is in millimetres; the boundary `MIDDLE` lies on z = 0, the others are named as the edges
    that they grow from.
    """
    _afford(stage, faces, settings, 3)
    _refine(stage, faces, settings)
    height = 0.5 * stage.thickness * METRE / settings.layers
    slabs = [
        faces.shape.Move(Vec(0.0, 0.0, k * height)).Extrude(Vec(0.0, 0.0, height))
        for k in range(settings.layers)
    ]
    whole = slabs[0] if len(slabs) == 1 else Glue(slabs)
    # What lies over one another is meshed alike, with prisms between: the two level faces of each
    # solid, however many bodies share a centre. Layers are slabs of their own: splitting prisms
    # afterwards would lose the curvature of their sides.
    for solid in whole.solids:
        below, above = sorted(_level_faces(solid, height), key=lambda f: f.center.z)
        layer = round(below.center.z / height)
        if layer == 0:
            below.name = MIDDLE
        below.Identify(above, f"layer {layer}", IdentificationType.CLOSESURFACES)
    for share in _SIZES:
        mesh = _generate(whole, 3, share * settings.size * stage.thickness, settings.grading)
        if all(e.type == ng.ET.PRISM for e in mesh.Elements(ng.VOL)):
            break
    else:
        raise ModelError(
            "the mesher did not fill the plate with prisms, at three sizes of the elements: take "
            "the model in the plane or the superelements, or look for slivers with 'flexstage "
            "check'"
        )
    mesh.Curve(settings.order)
    return mesh


def worst_shape(mesh: ng.Mesh) -> float:
    r"""Return the shape of the worst element of a plane mesh.

    The shape is :math:`2\det J/|J|^2` with the map J from the equilateral triangle, at its worst
    point: 1 for an equilateral element, 0 for one without area, negative for one turned over.

    The mesh is of triangles, curved or not.
    """
    jacobian = ng.specialcf.JacobianMatrix(2)
    places = mesh.MapToAllElements(ng.IntegrationRule(ng.ET.TRIG, 4), ng.VOL)
    map_ = np.asarray(jacobian(places)).reshape(-1, 2, 2)
    # the reference triangle has a right angle: this turns it into the equilateral one
    map_ = map_ @ np.array([[1.0, -1.0 / np.sqrt(3.0)], [0.0, 2.0 / np.sqrt(3.0)]])
    return float((2.0 * np.linalg.det(map_) / np.sum(map_**2, axis=(1, 2))).min())


def sound_mesh(stage: Stage, faces: StageFaces, settings: MeshSettings) -> ng.Mesh:
    """Mesh the plane of a stage, again where the mesher left a sliver.

    Now and then the mesher closes a gap between fine and coarse elements with a sliver. A slower
    grading leaves it more room.

    It is the first mesh without a sliver of some tries, or else the best.
    """
    best = plane_mesh(stage, faces, settings)
    shape = worst_shape(best)
    grading = settings.grading
    for _ in range(_TRIES - 1):
        grading = max(0.1, 0.85 * grading)
        if shape >= SLIVER or grading >= settings.grading:
            break
        other = plane_mesh(stage, faces, replace(settings, grading=grading))
        if (found := worst_shape(other)) > shape:
            best, shape = other, found
    return best
