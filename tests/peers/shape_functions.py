"""Shape functions of quadratic elements, and the weights by which their nodes share an integral."""

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array

Index = NDArray[np.intp]

_GAUSS = (np.array([-1.0, 0.0, 1.0]) * np.sqrt(0.6), np.array([5.0, 8.0, 5.0]) / 9.0)


def line(s: Array) -> Array:
    """End, middle, end of an edge at s in -1..1, shape (q, 3)."""
    return np.stack((0.5 * s * (s - 1.0), 1.0 - s**2, 0.5 * s * (s + 1.0)), axis=1)


def quadrilateral(s: Array, t: Array) -> Array:
    """Serendipity functions of eight nodes at s, t in -1..1, shape (q, 8)."""
    at = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    corners = [0.25 * (1 + s * a) * (1 + t * b) * (s * a + t * b - 1) for a, b in at]
    middles = [
        0.5 * (1 - s**2) * (1 - t),
        0.5 * (1 + s) * (1 - t**2),
        0.5 * (1 - s**2) * (1 + t),
        0.5 * (1 - s) * (1 - t**2),
    ]
    return np.stack(corners + middles, axis=1)


def wedge(r: Array, s: Array, z: Array) -> Array:
    """Serendipity functions of fifteen nodes at a point of a triangle and z in -1..1, (q, 15)."""
    area = (1.0 - r - s, r, s)
    found = [0.5 * a * ((2 * a - 1) * (1 + e * z) - (1 - z**2)) for e in (-1, 1) for a in area]
    pairs = ((0, 1), (1, 2), (2, 0))
    found += [2 * area[i] * area[j] * (1 + e * z) for e in (-1, 1) for i, j in pairs]
    found += [a * (1 - z**2) for a in area]
    return np.stack(found, axis=1)


def brick(r: Array, s: Array, z: Array) -> Array:
    """Serendipity functions of twenty nodes at r, s, z in -1..1, shape (q, 20)."""
    at = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    corners = [
        0.125 * (1 + r * a) * (1 + s * b) * (1 + z * c) * (r * a + s * b + z * c - 2)
        for c in (-1, 1)
        for a, b in at
    ]
    sides = [
        0.25 * (1 - x**2) * (1 + y * e) * (1 + z * c)
        for c in (-1, 1)
        for x, y, e in ((r, s, -1), (s, r, 1), (r, s, 1), (s, r, -1))
    ]
    upright = [0.25 * (1 + r * a) * (1 + s * b) * (1 - z**2) for a, b in at]
    return np.stack(corners + sides + upright, axis=1)


def _slopes(function: object, at: list[Array]) -> list[Array]:
    """Derivatives; the functions are quadratic in each direction, so that this is exact."""
    step = 0.5
    found = []
    for k in range(len(at)):
        up, down = list(at), list(at)
        up[k], down[k] = at[k] + step, at[k] - step
        found.append((function(*up) - function(*down)) / (2 * step))  # type: ignore[operator]
    return found


def edge_shares(nodes: Array, edges: Index) -> Array:
    """Share of each node in the mean over edges of a plane grid, shape (n,); their sum is 1."""
    s, w = _GAUSS
    N = line(s)
    (D,) = _slopes(line, [s])
    size = np.linalg.norm(np.einsum("qi,eic->eqc", D, nodes[edges]), axis=2)
    return _gather(nodes, edges, N, size * w)


def face_shares(nodes: Array, faces: Index) -> Array:
    """Share of each node in the mean over faces of eight nodes, shape (n,); their sum is 1."""
    s, t = (a.ravel() for a in np.meshgrid(_GAUSS[0], _GAUSS[0]))
    w = np.outer(_GAUSS[1], _GAUSS[1]).ravel()
    N = quadrilateral(s, t)
    a, b = (np.einsum("qi,eic->eqc", D, nodes[faces]) for D in _slopes(quadrilateral, [s, t]))
    return _gather(nodes, faces, N, np.linalg.norm(np.cross(a, b), axis=2) * w)


def solid_points(nodes: Array, elements: Index) -> tuple[Array, Array, Array]:
    """Return functions, places and volumes of the quadrature points of wedges or bricks.

    Shapes (q, n), (m, q, 3), (m, q); exact to the fourth order in the plane.
    """
    if elements.shape[1] == 15:
        function = wedge
        # six points of a triangle, G. R. Cowper, Int. J. Numer. Meth. Eng. 7 (1973) 405
        a, b = 0.445948490915965, 0.091576213509771
        r = np.array([a, 1 - 2 * a, a, b, 1 - 2 * b, b])
        s = np.array([a, a, 1 - 2 * a, b, b, 1 - 2 * b])
        w = 0.5 * np.repeat([0.223381589678011, 0.109951743655322], 3)
    else:
        function = brick
        r, s = (c.ravel() for c in np.meshgrid(_GAUSS[0], _GAUSS[0]))
        w = np.outer(_GAUSS[1], _GAUSS[1]).ravel()
    at = [np.tile(r, 3), np.tile(s, 3), np.repeat(_GAUSS[0], r.size)]
    weights = np.tile(w, 3) * np.repeat(_GAUSS[1], r.size)
    N, D = function(*at), _slopes(function, at)
    J = np.stack([np.einsum("qi,eic->eqc", d, nodes[elements]) for d in D], axis=2)
    return N, np.einsum("qi,eic->eqc", N, nodes[elements]), np.linalg.det(J) * weights


def _gather(nodes: Array, parts: Index, N: Array, size: Array) -> Array:
    shares = np.zeros(nodes.shape[0])
    np.add.at(shares, parts, size @ N)
    return shares / size.sum()
