"""How well shaped the elements of a plane mesh are, and meshes without slivers."""

from dataclasses import replace

import ngsolve as ng
import numpy as np

from flexstage.fem.geometry import StageFaces
from flexstage.fem.mesh import MeshSettings, plane_mesh
from flexstage.stage import Stage

#: Below it an element is a sliver that spoils the figures of its neighbourhood [1].
SLIVER = 0.15
_TRIES = 4


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
