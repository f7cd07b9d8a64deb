"""Quadratic grids as plain arrays: triangles of a mesh, quadrilaterals, and what they sweep out."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array

Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """Quadratic elements: corners first, then middles of their edges, counter-clockwise.

    In three dimensions: corners below, above; middles below, above, between (the order of C3D15 and
    C3D20). Lengths are in metres.
    """

    nodes: Array  # (n, 2 or 3)
    elements: Index  # (m, 6, 8, 15 or 20)
    regions: tuple[str, ...] = ()  # one for each element, where it has names
    sides: Mapping[str, Index] = field(default_factory=dict)  # named edges: end, middle, end

    def edges(self, where: Callable[[Array], NDArray[np.bool_]]) -> Index:
        """Edges of a plane grid all of whose nodes lie somewhere: end, middle, end."""
        corners = self.elements.shape[1] // 2
        first = np.arange(corners)
        sides = np.stack((first, corners + first, (first + 1) % corners), axis=1)
        rows = self.elements[:, sides].reshape(-1, 3)
        inside = where(self.nodes)
        return rows[inside[rows].all(axis=1)]


def triangles(mesh: object) -> Grid:
    """Take the triangles of an NGSolve mesh, in millimetres; middles lie on curved edges."""
    import ngsolve as ng

    points = [(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)]
    rule = ng.IntegrationRule(points=[(*p, 0) for p in points], weights=[0.0] * 6)
    mapped = mesh.MapToAllElements({ng.ET.TRIG: rule}, ng.VOL)  # type: ignore[attr-defined]
    xy = np.column_stack([ng.x(mapped).ravel(), ng.y(mapped).ravel()])
    nodes, elements = _shared(xy * 1e-3)
    elements = elements.reshape(-1, 6)
    a, b, c = (nodes[elements[:, k]] for k in range(3))
    turned = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] < 0.0
    elements[turned] = elements[turned][:, [0, 2, 1, 5, 4, 3]]
    names = tuple(e.mat for e in mesh.Elements())  # type: ignore[attr-defined]
    return Grid(nodes=nodes, elements=elements, regions=names)


def _shared(points: Array, tolerance: float = 1e-10) -> tuple[Array, Index]:
    """Give points that coincide one number."""
    keys = np.round(points / tolerance).astype(np.int64)
    # rounding may part two copies of a point: a tree joins what lies nearer than the tolerance
    from scipy.spatial import KDTree

    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    distinct = points[first]
    root = np.arange(distinct.shape[0])
    for a, b in KDTree(distinct).query_pairs(10.0 * tolerance):
        root[max(a, b)] = root[min(a, b)]
    kept, renumbered = np.unique(root, return_inverse=True)
    return distinct[kept], renumbered[number.ravel()]


def patch(x: Array, y: Array) -> tuple[Array, Index]:
    """Quadrilaterals on points of shape (2 a + 1, 2 b + 1), of which the inner ones are unused."""
    rows, columns = x.shape
    number = np.arange(rows * columns).reshape(rows, columns)
    i, j = np.meshgrid(np.arange(0, rows - 1, 2), np.arange(0, columns - 1, 2), indexing="ij")
    steps = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
    elements = np.stack([number[i + a, j + b].ravel() for a, b in steps], axis=1)
    return np.column_stack((x.ravel(), y.ravel())), elements


def join(patches: list[tuple[Array, Index]]) -> Grid:
    """Join patches along the sides where their nodes coincide; each runs counter-clockwise."""
    offset, parts = 0, []
    for nodes, elements in patches:
        parts.append(elements + offset)
        offset += nodes.shape[0]
    points, number = _shared(np.vstack([nodes for nodes, _ in patches]))
    elements = number[np.vstack(parts)]
    used, renumbered = np.unique(elements, return_inverse=True)
    return Grid(nodes=points[used], elements=renumbered.reshape(elements.shape))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sweep:
    """A plane grid swept along z: its solid, and the faces that edges of it sweep out."""

    solid: Grid
    full: Index  # number of each plane node at each level, ends of layers and middles; -1: none

    def faces(self, edges: Index) -> Index:
        """Faces of eight nodes: four corners, then the middles of their sides."""
        rows = []
        for low in range(0, self.full.shape[0] - 2, 2):
            below, between, above = self.full[low], self.full[low + 1], self.full[low + 2]
            a, m, b = edges.T
            rows.append(
                [below[a], below[b], above[b], above[a], below[m], between[b], above[m], between[a]]
            )
        return np.concatenate([np.stack(r, axis=1) for r in rows])


def sweep(plane: Grid, levels: Array) -> Sweep:
    """Sweep a plane grid along z to the levels [m], one layer of elements between two of them."""
    n, size = plane.nodes.shape[0], plane.elements.shape[1]
    corners = size // 2
    ends, middles = plane.elements[:, :corners], plane.elements[:, corners:]
    is_corner = np.zeros(n, dtype=bool)
    is_corner[ends] = True
    heights = np.empty(2 * len(levels) - 1)
    heights[::2] = levels
    heights[1::2] = 0.5 * (levels[1:] + levels[:-1])
    full = np.full((heights.size, n), -1)
    count, nodes = 0, []
    for k, z in enumerate(heights):
        here = np.arange(n) if k % 2 == 0 else np.flatnonzero(is_corner)
        full[k, here] = count + np.arange(here.size)
        count += here.size
        nodes.append(np.column_stack((plane.nodes[here], np.full(here.size, z))))
    parts = []
    for low in range(0, heights.size - 2, 2):
        below, between, above = full[low], full[low + 1], full[low + 2]
        parts.append(
            np.hstack((below[ends], above[ends], below[middles], above[middles], between[ends]))
        )
    layers = len(levels) - 1
    solid = Grid(nodes=np.vstack(nodes), elements=np.vstack(parts), regions=plane.regions * layers)
    return Sweep(solid=solid, full=full)
