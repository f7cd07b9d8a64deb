"""Small flat cells that elements are divided into: triangles and wedges."""

import numpy as np

from flexstage.arrays import Array, Integers

# Corners nearer than this [m] are one; the mesher's tolerance is a hundred times as large, and
# rounding moves a corner by a millionth of it.
_SAME = 1e-9


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
    found = []
    for j in range(n):
        for i in range(n - j):
            a, above = start[j] + i, start[j + 1] + i
            found.append((a, a + 1, above))
            if i < n - j - 1:
                found.append((a + 1, above + 1, above))
    return np.array(found, dtype=np.intp)


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
    """Keep points that lie in one place once.

    Points of different groups `apart`, shape (n,), stay apart. Returns the points that are kept,
    and which of them each point is, shape (n,).
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
    """Chain the edges that one triangle alone has.

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
    found = []
    while following:
        at, loop = next(iter(following)), []
        while at in following:
            loop.append(at)
            ends = following[at]
            at = ends.pop()
            if not ends:
                del following[loop[-1]]
        found.append(np.array(loop, dtype=np.intp))
    return tuple(found)
