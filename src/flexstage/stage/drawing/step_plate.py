"""The contours of a plate of constant thickness from a STEP file: the edges of its face."""

import itertools
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import StageError
from flexstage.stage.curve import Curve
from flexstage.stage.drawing.entities import Sheet
from flexstage.stage.drawing.strokes import circle_of

if TYPE_CHECKING:
    from netgen.occ import TopoDS_Shape

_SAMPLES = 65  # points of an edge that tell what it is
_CURVE = 257  # points of an edge that is neither line nor arc
_SAME = 1e-6  # of lengths, areas and volumes, in parts of them
_EXACT = 1e-8  # points of a line or an arc are off by less [m]
_CANDIDATES = 40  # largest faces that may be the plate's


def read_step_plate(path: str | os.PathLike[str]) -> Sheet:
    """Read the edges of the face of a plate, and its thickness.

    A plate that lies across an axis of the file keeps its coordinates: x and y where it lies
    across z, y and z across x, z and x across y.
    """
    from flexstage.elasticity.step_file import of_step

    return of_step(Path(path), _sheet, path)


def _sheet(shape: "TopoDS_Shape", path: str | os.PathLike[str]) -> Sheet:
    from flexstage.elasticity.shapes import METRE

    solids = list(shape.solids)
    if len(solids) != 1:
        raise StageError(
            f"'{path}' contains {len(solids)} solids instead of one plate: export the plate alone"
        )
    solid = solids[0]
    faces = sorted(solid.faces, key=lambda f: -f.mass)[:_CANDIDATES]
    for face in faces:
        found = _as_plate(solid, face, faces)
        if found is not None:
            axes, thickness = found
            curves = [
                (Curve(a, b, bulge), "")
                for edge in face.edges
                for a, b, bulge in _pieces(_points(edge, _SAMPLES), edge, axes, METRE)
            ]
            return Sheet(
                curves=tuple(curves), unit=1e-3, unit_name="mm", thickness=thickness / METRE
            )
    raise StageError(
        f"the solid in '{path}' is not a plate of constant thickness: it has no two equal, "
        "parallel faces with all material between them; 'flexstage part' analyses such parts in "
        "three dimensions"
    )


def _points(edge: Any, count: int) -> Array:
    first, last = edge.parameter_interval
    made = [edge.Value(first + (last - first) * k / (count - 1)) for k in range(count)]
    return np.array([(p.x, p.y, p.z) for p in made])


def _as_plate(
    solid: "TopoDS_Shape", face: Any, faces: list[Any]
) -> tuple[tuple[Array, Array], float] | None:
    """Return the axes in a face and the thickness [mm] if the solid is its extrusion."""
    edges = list(face.edges)
    # the tip of a cone is an edge without a curve, which the kernel cannot walk along
    if not all(e.mass > 0.0 for e in edges):
        return None
    points = np.vstack([_points(e, 9) for e in edges])
    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle, full_matrices=False)
    if sizes[2] > _SAME * sizes[0]:
        return None
    normal = np.asarray(axes[2], dtype=np.float64)
    thickness = round(float(solid.mass / face.mass), 9)
    twin = any(
        abs(other.mass - face.mass) < _SAME * face.mass
        and abs(abs((_centre(other) - _centre(face)) @ normal) - thickness) < 1e-5 * thickness
        and np.hypot(*np.cross(_centre(other) - _centre(face), normal)[:2]) < _SAME * sizes[0]
        for other in faces
    )
    if not twin:
        return None
    # all of the solid lies between the two
    corners = np.array([(v.p.x, v.p.y, v.p.z) for v in solid.vertices])
    height = (corners - middle) @ normal
    if float(np.ptp(height)) > thickness * (1.0 + 1e-5):
        return None
    k = int(np.argmax(np.abs(normal)))
    if abs(normal[k]) > 1.0 - 1e-12:
        unit = np.eye(3)
        return (unit[(k + 1) % 3], unit[(k + 2) % 3]), thickness
    normal = normal * math.copysign(1.0, normal[k])
    v = np.cross(normal, np.eye(3)[(k + 1) % 3]).astype(float)
    v = v / math.sqrt(float(v @ v))
    return (np.cross(v, normal).astype(float), v), thickness


def _centre(face: Any) -> Array:
    c = face.center
    return np.array([c.x, c.y, c.z])


def _pieces(
    points: Array, edge: Any, axes: tuple[Array, Array], metre: float
) -> list[tuple[tuple[float, float], tuple[float, float], float]]:
    """Return an edge as a line, as arcs, or as a polyline [m]."""

    def flat(points: Array) -> Array:
        return np.column_stack([points @ axes[0], points @ axes[1]]) / metre

    plane = flat(points)
    at = [(x, y) for x, y in plane.tolist()]
    chord = plane[-1] - plane[0]
    length = float(np.hypot(*chord))
    if length > 0.0:
        off = (plane - plane[0]) @ np.array([-chord[1], chord[0]]) / length
        if float(np.max(np.abs(off))) < _EXACT:
            return [(at[0], at[-1], 0.0)]
    centre, _, off = circle_of(plane)
    if off < _EXACT:
        angles = np.unwrap(np.arctan2(*(plane - np.array(centre)).T[::-1]))
        sweep = float(angles[-1] - angles[0])
        half = _SAMPLES // 2
        ends = [0, half, _SAMPLES - 1] if abs(sweep) > 1.5 * math.pi else [0, _SAMPLES - 1]
        made = []
        for a, b in itertools.pairwise(ends):
            bulge = math.tan(0.25 * float(angles[b] - angles[a]))
            made.append((at[a], at[b], bulge))
        return made
    fine = [(x, y) for x, y in flat(_points(edge, _CURVE)).tolist()]
    return [(a, b, 0.0) for a, b in itertools.pairwise(fine)]
