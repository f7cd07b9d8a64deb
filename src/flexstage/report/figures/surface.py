"""Triangulated surface of a stage with its states, for animated pictures in space."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array, Integers
from flexstage.export.body_cells import BodyCells, body_cells
from flexstage.quantities.quantity import number
from flexstage.report.figures.body_motion import MOST_MODES, full_stroke
from flexstage.system import Analysis, AxisAnalysis, DriveCondition

if TYPE_CHECKING:
    from flexstage.fem import StageModel
    from flexstage.fem.sampling import Sample

# Faces of a tetrahedron and of a wedge, by the numbers of their corners.
_FACES = {
    4: ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
    6: ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceState:
    """Motion of a surface in a static state or a mode."""

    name: str
    """Its name: the axis at full stroke, or the number of the mode with its frequency."""
    words: str
    """Its cause, in words."""
    displacement: Array
    """Displacement of each corner [m], of a mode as part of the largest [1], shape (n, 3)."""
    stress: Array | None = None
    """Equivalent stress of each corner [Pa], NaN where none is known, shape (n,); None of a mode.
    """
    limit: float = 0.0
    """Largest stress at the hinges [Pa]; the singular stress at fixed edges is higher."""

    @property
    def largest(self) -> float:
        """The largest displacement [m], of a mode [1]."""
        return float(np.linalg.norm(self.displacement, axis=1).max(initial=0.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StageSurface:
    """The surface of a stage at rest, and its states.

    Notes
    -----
    Validity: that of the model. Rigid and condensed bodies are drawn with notches as bent bars
    between them, an illustration with the largest stress of each notch. The stress of a mesh is
    averaged over the elements at a corner.
    """

    points: Array
    """Corners at rest [m], shape (n, 3)."""
    triangles: Integers
    """Corners of each triangle, shape (m, 3)."""
    edges: Integers
    """Corners of each drawn edge, shape (k, 2)."""
    flat: bool
    """True if it is in a plane."""
    statics: tuple[SurfaceState, ...]
    """Each axis at full stroke."""
    modes: dict[DriveCondition, tuple[SurfaceState, ...]]
    """The lowest modes, by condition of the drives."""

    @property
    def size(self) -> float:
        """The longer side of the stage in its plane [m]."""
        return float(np.ptp(self.points[:, :2], axis=0).max())


def stage_surface(analysis: Analysis, mesh: "StageModel | None" = None) -> StageSurface:
    """Return the surface of a stage with the states of an analysis.

    `mesh` is that of the finite elements behind it, where there are any.
    """
    surface = _Meshed(analysis, mesh) if mesh is not None else _Bodies(analysis)
    used, triangles = np.unique(surface.triangles, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    count = len(analysis.axes) + sum(min(MOST_MODES, f.frequency_hz.size)
                                     for f in analysis.modes.values())  # fmt: skip
    finished = 0

    def report_progress() -> None:
        nonlocal finished
        progress.update("shapes", finished / max(count, 1))
        finished += 1

    statics = []
    for axis in analysis.axes:
        report_progress()
        displacement, stress = surface.static(axis)
        statics.append(
            SurfaceState(
                name=f"{axis.axis} at full stroke",
                words=full_stroke(analysis, axis),
                displacement=displacement[used],
                stress=stress[used],
                limit=max(axis.static.hinge_stress.values(), default=0.0),
            )
        )
    modes: dict[DriveCondition, tuple[SurfaceState, ...]] = {}
    for condition, modes_found in analysis.modes.items():
        states = []
        for k, frequency in enumerate(modes_found.frequency_hz[:MOST_MODES].tolist()):
            report_progress()
            moved, words = surface.mode(modes_found.shapes[:, k])
            largest = float(np.linalg.norm(moved, axis=1).max(initial=0.0)) or 1.0
            states.append(
                SurfaceState(
                    name=f"{k + 1}: {number(frequency)} Hz",
                    words=f"mode {k + 1}, drives {condition}{words}",
                    displacement=moved[used] / largest,
                )
            )
        modes[condition] = tuple(states)
    return StageSurface(
        points=surface.points[used],
        triangles=triangles,
        edges=sharp_edges(surface.points[used], triangles),
        flat=surface.flat,
        statics=tuple(statics),
        modes=modes,
    )


class _Bodies:
    """Rigid bodies over the full thickness, with bent notches between them."""

    flat = False

    def __init__(self, analysis: Analysis) -> None:
        self._system = analysis.system
        self._cells: BodyCells = body_cells(analysis.stage)
        self._mass = analysis.characteristics.value("mass", "stage")
        self.points = self._cells.points
        # parts that meet keep separate corners and surfaces
        self.triangles = outer_faces(self._cells.cells)

    def static(self, axis: AxisAnalysis) -> tuple[Array, Array]:
        cells, stress = self._cells, axis.static.hinge_stress
        by_hinge = np.array([*(stress.get(h.name, np.nan) for h in cells.stage.hinges), np.nan])
        return (
            cells.displacement(self._system, axis.static.q),
            by_hinge[cells.hinge][cells.point_region],
        )

    def mode(self, q: Array) -> tuple[Array, str]:
        moved = self._cells.displacement(self._system, q)
        # an in-plane mode of unit modal mass moves some point by 1/sqrt(mass)
        if self._mass * float((moved**2).sum(axis=1).max(initial=0.0)) < 0.5:
            return np.zeros_like(moved), "; out of the plane or within a body: not visible here"
        return moved, ""


class _Meshed:
    """The surface of a mesh."""

    def __init__(self, analysis: Analysis, mesh: "StageModel") -> None:
        from flexstage.fem.sampling import Sampler

        finest = 4
        # most triangles of a divided surface; a solid has two sides
        most_triangles = 40_000

        solid = mesh.problems[0].continuum.dimension == 3
        most = most_triangles // (2 if solid else 1)
        fine = [d for d in range(1, finest + 1) if mesh.elements * d**2 <= most]
        self._sampler: Sampler = Sampler(
            model=mesh, divisions=max(fine, default=1), extent="whole", seams=False
        )
        at_rest: Sample = self._sampler.read(np.zeros(mesh.system.order), stress=False)
        self.points = at_rest.points
        self.flat = not solid
        self.triangles = outer_faces(at_rest.cells) if solid else at_rest.cells

    def static(self, axis: AxisAnalysis) -> tuple[Array, Array]:
        sample = self._sampler.read(axis.static.q)
        return sample.displacement, sample.von_mises

    def mode(self, q: Array) -> tuple[Array, str]:
        return self._sampler.read(q, stress=False).displacement, ""


def outer_faces(cells: Integers) -> Integers:
    """Return the faces that belong to only one tetrahedron or wedge, shape (m, 3).

    Examples
    --------
    >>> outer_faces(np.array([[0, 1, 2, 3], [0, 2, 1, 4]])).shape
    (6, 3)
    """
    faces_found = []
    faces = _FACES[cells.shape[1]]
    for corners in (3, 4):
        every = [cells[:, face] for face in faces if len(face) == corners]
        if not every:
            continue
        stacked = np.concatenate(every)
        _, first, count = np.unique(
            np.sort(stacked, axis=1), axis=0, return_index=True, return_counts=True
        )
        outer = stacked[first[count == 1]]
        faces_found.append(outer[:, :3])
        if corners == 4:
            faces_found.append(outer[:, [0, 2, 3]])
    return np.concatenate(faces_found)


def sharp_edges(points: Array, triangles: Integers) -> Integers:
    """Return the edges of triangles at which a surface ends or turns by more than 30 degrees.

    Corners in one place count as one; shape (k, 2).
    """
    # nearer corners are one [m]
    same_place = 1e-9
    # cosine of the smallest angle between two faces with a drawn edge, 30 degrees
    sharp = 0.866
    _, same = np.unique(np.rint(points / same_place), axis=0, return_inverse=True)
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    normal = normal / np.where(size > 0.0, size, 1.0)[:, None]
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    of = np.tile(np.arange(len(triangles)), 3)
    key = np.sort(same.reshape(-1)[edges], axis=1)
    order = np.lexsort(key.T)
    key, of, edges = key[order], of[order], edges[order]
    first = np.ones(len(key), dtype=bool)
    first[1:] = (key[1:] != key[:-1]).any(axis=1)
    starts = np.flatnonzero(first)
    count = np.diff(np.append(starts, len(key)))
    pair = count == 2
    turn = np.ones(len(starts), dtype=bool)
    first_face, second_face = of[starts[pair]], of[starts[pair] + 1]
    turn[pair] = np.abs(np.einsum("ij,ij->i", normal[first_face], normal[second_face])) < sharp
    # more than two triangles at an edge: parts that touch
    turn[count > 2] = False
    return edges[starts[turn]]
