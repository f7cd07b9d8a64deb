"""Fields on a mesh as points and flat cells, for pictures and for files.

Elements of high order are curved, and fields within them are not linear; each is divided into small
cells whose corners are mapped into it, without a search.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array, Integers
from flexstage.elasticity.loaded import COMPONENTS, von_mises_of
from flexstage.elasticity.resources import parallel
from flexstage.elasticity.shapes import METRE
from flexstage.fem.geometry import body_region, exactly, notch_region, outer_region
from flexstage.fem.mesh import MIDDLE
from flexstage.fem.model import StageModel, UncoupledProblem

# Corners nearer than this [m] are one; the mesher's tolerance is a hundred times as large, and
# rounding moves a corner by a millionth of it.
_SAME = 1e-9

# Where the stress has the opposite sign below the middle plane: yz and xz.
_ODD = np.array([0, 0, 0, 1, 1, 0], dtype=bool)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sample:
    """A field at the corners of small cells."""

    points: Array
    """The corners at rest [m], shape (n, 3)."""
    cells: Integers
    """Corners of each cell: of triangles, counter-clockwise, shape (m, 3), or of wedges, whose
    first three have their normal outwards, shape (m, 6).
    """
    region: Integers
    """Index of the region of each cell into `Sampler.regions`, shape (m,)."""
    displacement: Array
    """Displacement [m], shape (n, 3)."""
    stress: Array | None
    """Components xx, yy, zz, yz, xz, xy, averaged over the elements about a corner [Pa], shape (n,
    6); None where it was not requested.
    """

    @property
    def magnitude(self) -> Array:
        """Magnitude of the displacement [m], shape (n,)."""
        return np.linalg.norm(self.displacement, axis=1)

    @property
    def von_mises(self) -> Array:
        """Equivalent stress of von Mises [Pa], shape (n,)."""
        assert self.stress is not None
        return von_mises_of(self.stress)

    def moved(self, factor: float = 1.0) -> Array:
        """Return the displaced corners [m], shape (n, 3), motion exaggerated by a factor."""
        return self.points + factor * self.displacement


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Corners of the cells, each once, and the place of the mesh of each corner."""

    points: Array
    cells: Integers
    region: Integers
    corner: Integers  # the corner that each mapped place is, mirrored places after the others
    below: NDArray[np.bool_]  # whether a place is mirrored


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampler:
    """Division of the elements of a mesh into small cells, with fields at their corners.

    Notes
    -----
    Validity: the cells are straight, and a value within one is linear between corners: with four
    parts the area of the study's piezo stage is kept to 1e-4. Stress at a corner of several
    elements is the mean of their values.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.fem import MeshSettings, plane_model
    >>> model = plane_model(design("parallelogram"), MeshSettings(order=2, neck_size=2.0))
    >>> sampler = Sampler(model=model)
    >>> round(sampler.area * 1e4, 2)  # cm^2
    24.18
    """

    model: StageModel
    """The model."""
    divisions: int = 4
    """Parts of each edge of an element, 1 to 32."""
    extent: Literal["plane", "whole"] = "plane"
    """``plane`` for triangles: the plane model, or the middle plane of one in three dimensions;
    ``whole`` for the entire model: wedges over the full thickness in three dimensions, the half
    below the middle plane mirrored from the meshed one.
    """
    seams: bool = False
    """True if corners are separate where two regions meet, so that stress is averaged in each
    alone.
    """

    @property
    def mesh(self) -> ng.Mesh:
        """The mesh [mm]."""
        return self.model.problems[0].continuum.mesh

    @property
    def solid(self) -> bool:
        """True if the cells are wedges."""
        return self.extent == "whole" and self.mesh.dim == 3

    @cached_property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions: bodies without their half notches, and half notches."""
        return tuple(dict.fromkeys(self.mesh.GetMaterials()))

    @cached_property
    def bodies(self) -> Mapping[str, int]:
        """Index of the body that each region is a part of, in the order of the stage."""
        stage = self.model.stage
        index = {b.name: i for i, b in enumerate(stage.bodies)}
        regions = {body_region(b.name): i for i, b in enumerate(stage.bodies)}
        for hinge in stage.hinges:
            for which, name in enumerate(hinge.bodies):
                for region in (notch_region, outer_region):
                    regions[region(hinge.name, which)] = index[name]
        return regions

    @cached_property
    def places(self) -> NDArray[np.void]:
        """Points of the mesh at the corners of the cells, element after element."""
        n = self.divisions
        corners = lattice(n)
        flat = ng.IntegrationRule(points=[(a, b, 0.0) for a, b in corners], weights=_ones(corners))
        if self.mesh.dim == 2:
            return self.mesh.MapToAllElements({ng.ET.TRIG: flat}, self.mesh.Materials(".*"))
        if not self.solid:
            middle = self.mesh.Boundaries(exactly(MIDDLE))
            return self.mesh.MapToAllElements({ng.ET.TRIG: flat}, middle)
        points = [(a, b, k / n) for k in range(n + 1) for a, b in corners]
        rule = ng.IntegrationRule(points=points, weights=_ones(points))
        return self.mesh.MapToAllElements({ng.ET.PRISM: rule}, self.mesh.Materials(".*"))

    @cached_property
    def _cells(self) -> _Cells:
        position = self._evaluate(ng.CoefficientFunction((ng.x, ng.y, ng.z))) / METRE
        names = {name: i for i, name in enumerate(self.regions)}
        number = [float(names[m]) for m in self.mesh.GetMaterials()]
        region = np.rint(self._evaluate(ng.CoefficientFunction(number), inside=True).ravel())
        region = region.astype(np.intp)
        pattern, count = triangles(self.divisions), lattice_size(self.divisions)
        if self.solid:
            pattern = wedges(pattern, count, self.divisions)
            count *= self.divisions + 1
        elements = position.shape[0] // count
        cells = pattern[None] + count * np.arange(elements)[:, None, None]
        cells = turned(position, cells.reshape(-1, pattern.shape[1]))
        of_cell = np.repeat(region[::count], pattern.shape[0])
        below = np.zeros(position.shape[0], dtype=bool)
        if self.solid:
            # mirrored wedges are turned over, so that their first three corners look outwards
            other = cells[:, [0, 2, 1, 3, 5, 4]] + position.shape[0]
            cells, of_cell = np.concatenate((cells, other)), np.tile(of_cell, 2)
            position = np.concatenate((position, position * (1.0, 1.0, -1.0)))
            region, below = np.tile(region, 2), np.concatenate((below, ~below))
        apart = region if self.seams else np.zeros_like(region)
        points, corner = merged(position, apart)
        return _Cells(points, corner[cells], of_cell, corner, below)

    @property
    def area(self) -> float:
        """Area of all triangles [m^2], or volume of all wedges [m^3]."""
        return float(sizes(self._cells.points, self._cells.cells).sum())

    @cached_property
    def outline(self) -> tuple[Integers, ...]:
        """Closed lines of corners about the triangles, material to the left."""
        return loops(self._cells.cells)

    def read(self, q: Array, *, stress: bool = True) -> Sample:
        """Return displacement and stress at the corners.

        q are the coordinates of the system, shape (r,).
        """
        cells = self._cells
        total = np.zeros((cells.below.size, 3))
        parts = np.zeros((cells.below.size, 6)) if stress else None
        for problem, u in self.model.displacement(q):
            if not (problem.basis @ q).any():
                continue
            total += self._displacement(problem, u)
            if parts is not None:
                parts += self._stress(problem, q)
        return Sample(
            points=cells.points,
            cells=cells.cells,
            region=cells.region,
            displacement=self._mean(total),
            stress=None if parts is None else self._mean(parts),
        )

    def neck_peak(self, q: Array, hinge: str) -> tuple[Array, float]:
        """Return the point of largest stress on the surface of a notch, and that stress.

        Returns the point [m], shape (3,), and its equivalent stress [Pa]: the largest one of this
        hinge by the system.
        """
        stress, points = self.model.system.stress, self.model.problems[0].points
        assert stress is not None
        assert stress.point is not None
        of_hinge = np.flatnonzero(stress.owner == stress.hinges.index(hinge))
        # the elements that share a point are averaged there
        _, first, shared = np.unique(stress.point[of_hinge], return_index=True, return_inverse=True)
        parts = stress.components(q)[of_hinge]
        count = np.bincount(shared.ravel())
        mean = [np.bincount(shared.ravel(), weights=part) / count for part in parts.T]
        equivalent = von_mises_of(np.column_stack(mean))
        worst = int(np.argmax(equivalent))
        return points.position[of_hinge[first[worst]]], float(equivalent[worst])

    def _displacement(self, problem: UncoupledProblem, u: ng.GridFunction) -> Array:
        values = self._evaluate(u)
        if values.shape[1] == 2:
            values = np.column_stack((values, np.zeros(values.shape[0])))
        if not self.solid:
            return values
        # symmetric about the middle plane, or the opposite
        mirror = (1.0, 1.0, -1.0) if not problem.out_of_plane else (-1.0, -1.0, 1.0)
        return np.concatenate((values, values * mirror))

    def _stress(self, problem: UncoupledProblem, q: Array) -> Array:
        tensor = problem.continuum.stress(problem.basis @ q)
        # compiled, what the components share is computed once
        six = ng.CoefficientFunction(tuple(tensor[i, j] for i, j in COMPONENTS)).Compile()
        values = self._evaluate(six, inside=True)
        if not self.solid:
            return values
        mirror = np.where(problem.out_of_plane == _ODD, 1.0, -1.0)
        return np.concatenate((values, values * mirror))

    def _evaluate(self, function: ng.CoefficientFunction, *, inside: bool = False) -> Array:
        """Return values at the places; `inside` for functions that only the elements have."""
        on_boundary = self.mesh.dim == 3 and not self.solid
        if inside and on_boundary:
            function = ng.BoundaryFromVolumeCF(function)
        with parallel():
            values = np.asarray(function(self.places))
        return values.reshape(self.places.shape[0], -1)

    def _mean(self, values: Array) -> Array:
        """Return the mean over the places that are one corner."""
        count = self._cells.points.shape[0]
        share = np.bincount(self._cells.corner, minlength=count)
        columns = [
            np.bincount(self._cells.corner, weights=v, minlength=count) / share for v in values.T
        ]
        return np.column_stack(columns)


def _ones(points: Sequence[object]) -> list[float]:
    return [1.0] * len(points)


def lattice(n: int) -> list[tuple[float, float]]:
    """Return points of a triangle whose edges are divided evenly.

    The triangle is (0, 0), (1, 0), (0, 1), each edge has n parts, and the points are row by row.
    """
    return [(i / n, j / n) for j in range(n + 1) for i in range(n + 1 - j)]


def lattice_size(n: int) -> int:
    """Return the number of points of `lattice`.

    Examples
    --------
    >>> lattice_size(4)
    15
    """
    return (n + 1) * (n + 2) // 2


def triangles(n: int) -> Integers:
    """Return the triangles between the points of `lattice`: indices of corners, shape (n^2, 3)."""
    start = [j * (n + 1) - j * (j - 1) // 2 for j in range(n + 2)]
    corners = []
    for j in range(n):
        for i in range(n - j):
            a, above = start[j] + i, start[j + 1] + i
            corners.append((a, a + 1, above))
            if i < n - j - 1:
                corners.append((a + 1, above + 1, above))
    return np.array(corners, dtype=np.intp)


def wedges(base: Integers, count: int, layers: int) -> Integers:
    """Return wedges over triangles, in layers.

    `base` are the corners of the triangles in the lowest layer, shape (m, 3); a layer has `count`
    points. Indices of their corners, shape (m layers, 6).
    """
    levels = [np.hstack((base + k * count, base + (k + 1) * count)) for k in range(layers)]
    return np.concatenate(levels)


def sizes(points: Array, cells: Integers) -> Array:
    """Return area of triangles or volume of wedges between level planes.

    The area [m^2] is positive of triangles that turn left about +z, the volume [m^3] of wedges
    whose first face looks outwards; corners (m, 3) or (m, 6), shape (m,).
    """
    a, b, c = (points[cells[:, i]] for i in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    if cells.shape[1] == 3:
        return area
    return area * (a - points[cells[:, 3]])[:, 2]


def turned(points: Array, cells: Integers) -> Integers:
    """Order the corners of cells so that none has a negative size."""
    wrong = sizes(points, cells) < 0.0
    order = [0, 2, 1] if cells.shape[1] == 3 else [0, 2, 1, 3, 5, 4]
    return np.where(wrong[:, None], cells[:, order], cells)


def merged(points: Array, apart: Integers) -> tuple[Array, Integers]:
    """Merge points that lie in one place.

    Points of different groups `apart`, shape (n,), stay apart. Returns the merged points, and the
    number of each original point among them, shape (n,).
    """
    key = np.column_stack((apart, np.rint(points / _SAME).astype(np.int64)))
    order = np.lexsort(key.T)
    key = key[order]
    new = np.ones(order.size, dtype=bool)
    new[1:] = (key[1:] != key[:-1]).any(axis=1)
    corner = np.empty(order.size, dtype=np.intp)
    corner[order] = np.cumsum(new) - 1
    return points[order[new]], corner


def loops(cells: Integers) -> tuple[Integers, ...]:
    """Chain the edges of only one triangle.

    The triangles turn left, shape (m, 3), and lie to the left of the lines; the first corner of a
    line is not repeated as last.
    """
    edges = np.concatenate((cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]))
    size = int(cells.max()) + 1
    forth, back = edges[:, 0] * size + edges[:, 1], edges[:, 1] * size + edges[:, 0]
    alone = edges[~np.isin(forth, back)]
    following: dict[int, list[int]] = {}
    for a, b in alone.tolist():
        following.setdefault(a, []).append(b)
    lines = []
    while following:
        at, loop = next(iter(following)), []
        while at in following:
            loop.append(at)
            ends = following[at]
            at = ends.pop()
            if not ends:
                del following[loop[-1]]
        lines.append(np.array(loop, dtype=np.intp))
    return tuple(lines)
