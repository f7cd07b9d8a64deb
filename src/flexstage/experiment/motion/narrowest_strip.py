"""The narrowest strip between parallel lines that holds points of a plane."""

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array, Integers

#: Parts of the abscissa whose highest points rule out most others before the hull is built.
_PARTS = 256


def narrowest_strip(x: Array, y: Array, *, orthogonal: bool) -> tuple[int, int, int]:
    """Return the three points that the narrowest strip rests on.

    Two are on one line, from left to right, and the third is on the other. The two differ in x, so
    a strip along y is not considered. The width is measured square to the strip where `orthogonal`,
    else along y.

    Examples
    --------
    >>> narrowest_strip(np.array([0.0, 1.0, 3.0]), np.array([0.0, 0.7, 0.1]), orthogonal=False)
    (0, 2, 1)
    """
    # a tilt and a scale change no hull, but the rounding of the cross products
    a, b = x - x.mean(), y - y.mean()
    b = b - float(a @ b / (a @ a)) * a
    b = b / (float(np.abs(b).max()) or 1.0)
    upper, lower = _upper_hull(a, b), _upper_hull(a, -b)
    edges = np.concatenate([_pairs(upper), _pairs(lower)])
    opposite = np.concatenate([_opposite(x, y, upper, lower), _opposite(x, y, lower, upper)])
    i, j = edges[:, 0], edges[:, 1]
    run, rise = x[j] - x[i], y[j] - y[i]
    # differences first, so that no large ordinate is subtracted from another
    width = np.abs((y[opposite] - y[i]) - rise / run * (x[opposite] - x[i]))
    if orthogonal:
        width = width * np.abs(run) / np.hypot(run, rise)
    best = int(np.argmin(width))
    return int(i[best]), int(j[best]), int(opposite[best])


def _pairs(hull: Integers) -> Integers:
    return np.stack([hull[:-1], hull[1:]], axis=1)


def _opposite(x: Array, y: Array, hull: Integers, other: Integers) -> Integers:
    """For each edge of one half of the hull, the point of the other that is farthest from it."""

    def slopes(at: Integers) -> Array:
        return np.diff(y[at]) / np.diff(x[at])

    wanted, given = slopes(hull), slopes(other)
    # the slopes of the other half rise or fall all the way: the tangent point is found by bisection
    falling = given.size > 1 and given[0] > given[-1]
    place = np.searchsorted(-given, -wanted) if falling else np.searchsorted(given, wanted)
    # rounding of nearly equal slopes may put it one corner off
    near = np.clip(place[:, None] + np.array([-1, 0, 1]), 0, other.size - 1)
    candidates = other[near]
    start = hull[:-1, None]
    height = np.abs((y[candidates] - y[start]) - wanted[:, None] * (x[candidates] - x[start]))
    return candidates[np.arange(wanted.size), np.argmax(height, axis=1)]


def _upper_hull(x: Array, y: Array) -> Integers:
    """Corners of the upper half of the convex hull, from left to right (Andrew, 1979)."""
    order = np.lexsort((-y, x))
    # of points one over the other the highest alone can be a corner
    order = order[np.concatenate(([True], np.diff(x[order]) > 0.0))]
    if order.size > 4 * _PARTS:
        order = order[_not_below(x[order], y[order])]
    hull: list[int] = []
    for k, u, v in zip(order.tolist(), x[order].tolist(), y[order].tolist(), strict=True):
        while len(hull) > 1:
            p, q = hull[-2], hull[-1]
            if (x[q] - x[p]) * (v - y[p]) < (y[q] - y[p]) * (u - x[p]):
                break
            hull.pop()
        hull.append(k)
    return np.array(hull, dtype=np.intp)


def _not_below(x: Array, y: Array) -> NDArray[np.bool_]:
    """Points that are not under the hull of some of them; x rises."""
    starts = np.linspace(0, x.size, _PARTS, endpoint=False).astype(np.intp)
    ends = np.append(starts[1:], x.size)
    highest = [int(s + np.argmax(y[s:e])) for s, e in zip(starts, ends, strict=True)]
    some = np.unique(np.array([0, *highest, x.size - 1]))
    corner = some[_upper_hull(x[some], y[some])]
    # the corners themselves stay, whatever the rounding of the interpolation says
    keep = y >= np.interp(x, x[corner], y[corner])
    keep[corner] = True
    return keep
