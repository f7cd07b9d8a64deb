"""The plane of a stage meshed by Gmsh (C. Geuzaine, J.-F. Remacle, Int. J. Numer. Meth. Eng. 79
(2009) 1309): fine at the notches, and coarser with the distance from them.
"""

import math
import signal
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from netgen.occ import TopoDS_Shape
from scipy.spatial import KDTree

from flexstage.elasticity.shapes import METRE
from flexstage.fem.geometry import surface_edge
from flexstage.stage import Stage
from tests.peers.grids import Grid

# what Gmsh calls a triangle of six nodes, and a quadrilateral of eight
_KINDS = {False: 9, True: 16}


def started() -> Any:
    """Return Gmsh after its start, or skip the test where it does not load."""
    try:
        import gmsh
    except (ImportError, OSError) as error:  # its shared libraries need others of the system
        pytest.skip(f"Gmsh does not load here: {error}")
    broken_pipe = signal.getsignal(signal.SIGPIPE)
    gmsh.initialize([], interruptible=False)
    # a library of it gives the signal back its default, which ends the process of later tests
    signal.signal(signal.SIGPIPE, broken_pipe)
    return gmsh


def plane_grid(
    stage: Stage,
    outline: TopoDS_Shape,
    *,
    neck_size: float,
    size: float,
    slope: float = 0.5,
    quadrilaterals: bool = False,
) -> Grid:
    """Mesh the named faces of a stage: the neck size is in neck thicknesses, the size in metres.

    The slope is the growth of elements over the distance from the notches.
    """
    gmsh = started()
    try:
        with tempfile.TemporaryDirectory(prefix="gmsh-") as folder:
            path = str(Path(folder) / "plane.brep")
            outline.WriteBrep(path)
            gmsh.model.occ.importShapes(path)
        gmsh.model.occ.synchronize()
        regions, edges = (_names(gmsh, d, s) for d, s in ((2, outline.faces), (1, outline.edges)))
        by_size: dict[float, list[int]] = {}
        necks = {surface_edge(h.name): h.profile.neck_thickness for h in stage.hinges}
        for tag, name in edges.items():
            if name in necks:
                by_size.setdefault(neck_size * necks[name], []).append(tag)
        sizes = []
        for least, curves in by_size.items():
            away = _field(gmsh, "Distance", CurvesList=curves)
            reach = {"DistMin": 0.0, "DistMax": (size - least) * METRE / slope}
            limits = {"SizeMin": least * METRE, "SizeMax": size * METRE}
            sizes.append(_field(gmsh, "Threshold", InField=away, **limits, **reach))
        gmsh.model.mesh.field.setAsBackgroundMesh(_field(gmsh, "Min", FieldsList=sizes))
        options = {
            "MeshSizeExtendFromBoundary": 0,
            "MeshSizeFromPoints": 0,
            # its usual 1e-9 takes twenty times as long for the lines as the plane does afterwards
            "LcIntegrationPrecision": 1e-3,
            "MaxNumThreads2D": 2,
            "ElementOrder": 2,
            "SecondOrderIncomplete": quadrilaterals,
            "RecombineAll": quadrilaterals,
            "SubdivisionAlgorithm": quadrilaterals,
            "MeshSizeFromCurvature": 16 if quadrilaterals else 8,
        }
        if quadrilaterals:
            _rows_in_notches(gmsh, regions, edges, necks, neck_size)
        for name, value in options.items():
            gmsh.option.setNumber(f"Mesh.{name}", value)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.mesh.generate(2)
        return _grid(gmsh, regions, edges, quadrilaterals)
    finally:
        gmsh.finalize()


def _names(gmsh: Any, dimension: int, shapes: Any) -> dict[int, str]:
    """Name what Gmsh read by what lies at the same place."""
    tags = [tag for _, tag in gmsh.model.getEntities(dimension)]
    centres = [gmsh.model.occ.getCenterOfMass(dimension, tag) for tag in tags]
    away, nearest = KDTree([(s.center.x, s.center.y, s.center.z) for s in shapes]).query(centres)
    if np.max(away) > 1e-6:
        raise ValueError("Gmsh reads another outline than was written")
    names = [s.name or "" for s in shapes]
    return {tag: names[i] for tag, i in zip(tags, np.atleast_1d(nearest).tolist(), strict=True)}


def _rows_in_notches(
    gmsh: Any,
    regions: dict[int, str],
    edges: dict[int, str],
    necks: Mapping[str, float],
    neck_size: float,
) -> None:
    """Have the halves of notches, of four sides each, filled with rows of quadrilaterals."""
    for tag in (tag for tag, name in regions.items() if name.startswith("notch ")):
        sides = [abs(side) for _, side in gmsh.model.getBoundary([(2, tag)], oriented=False)]
        free = [side for side in sides if edges[side] in necks]
        least = neck_size * necks[edges[free[0]]] * METRE
        for side in sides:
            length = gmsh.model.occ.getMass(1, side) if side in free else least / neck_size
            count = max(1, math.ceil(length / least))
            gmsh.model.mesh.setTransfiniteCurve(side, count + 1)
        gmsh.model.mesh.setTransfiniteSurface(tag)


def _field(gmsh: Any, kind: str, **values: Any) -> int:
    field = gmsh.model.mesh.field
    number = field.add(kind)
    for name, value in values.items():
        (field.setNumbers if isinstance(value, list) else field.setNumber)(number, name, value)
    return number


def _grid(gmsh: Any, regions: dict[int, str], edges: dict[int, str], four: bool) -> Grid:
    mesh = gmsh.model.mesh
    numbers, places, _ = mesh.getNodes()
    at = np.zeros(int(numbers.max()) + 1, dtype=np.intp)
    at[numbers] = np.arange(numbers.size)
    elements, names = [], []
    for tag, name in regions.items():
        kinds, _, nodes = mesh.getElements(2, tag)
        if list(kinds) != [_KINDS[four]]:
            raise ValueError(f"elements of one kind are needed, Gmsh made {list(kinds)}")
        elements.append(at[nodes[0]].reshape(-1, 8 if four else 6))
        names += [name] * len(elements[-1])
    sides: dict[str, list[Any]] = {}
    for tag, name in edges.items():
        if name:
            _, _, nodes = mesh.getElements(1, tag)
            # end, end, middle
            sides.setdefault(name, []).append(at[nodes[0]].reshape(-1, 3)[:, [0, 2, 1]])
    used, renumbered = np.unique(np.vstack(elements), return_inverse=True)
    new = np.full(numbers.size, -1)
    new[used] = np.arange(used.size)
    return Grid(
        nodes=places.reshape(-1, 3)[used, :2] / METRE,
        elements=renumbered.reshape(-1, 8 if four else 6),
        regions=tuple(names),
        sides={name: new[np.vstack(rows)] for name, rows in sides.items()},
    )
