"""The surface of a part as triangles, made by the geometry kernel without the mesher."""

from dataclasses import dataclass

import numpy as np
from netgen.occ import OCCGeometry

from flexstage.arrays import Array, Integers
from flexstage.elasticity.unit import METRE
from flexstage.fem.part import Part


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartSurface:
    """Triangles of the faces of a part."""

    triangles: Array
    """Their corners, outwards counter-clockwise [m], shape (t, 3, 3)."""
    face: Integers
    """Number of the part's face that each belongs to, shape (t,)."""
    lines: Array
    """Both ends of the pieces of its edges [m], shape (e, 2, 3)."""
    edge: Integers
    """Number of the edge that each belongs to, shape (e,)."""

    @property
    def area_vectors(self) -> Array:
        """Outward normals of the triangles, as long as their areas [m^2], shape (t, 3)."""
        a, b, c = np.moveaxis(self.triangles, 1, 0)
        return 0.5 * np.cross(b - a, c - a)


def part_surface(part: Part) -> PartSurface:
    """Return the surface of a part as triangles.

    They are coarse where it is flat, and within about 1 % of the area of curved faces.
    """
    # what the library's own viewer draws; it has no other way to the kernel's triangles
    shown = OCCGeometry(part.shape)._visualizationData()
    triangles = np.array(shown["vertices"], dtype=float).reshape(-1, 3, 3) / METRE
    lines = np.array(shown["edges"], dtype=float).reshape(-1, 2, 3) / METRE
    face = np.array(shown["indices"], dtype=np.intp).reshape(len(triangles), -1)[:, 0]
    edge = np.array(shown["edge_indices"], dtype=np.intp).reshape(len(lines), -1)[:, 0]
    forward = np.array([f.forward for f in part.faces])[face]
    triangles[~forward] = triangles[~forward][:, ::-1]
    twice = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    there = np.linalg.norm(twice, axis=1) > 0.0
    return PartSurface(triangles=triangles[there], face=face[there], lines=lines, edge=edge)
