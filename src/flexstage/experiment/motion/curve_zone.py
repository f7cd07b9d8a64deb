"""The narrowest zone between two parallel lines that holds a measured curve."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.estimate import Estimate
from flexstage.experiment.motion.motion_curve import Direction, MotionCurve

# curves that are simulated to find what noise adds: each takes a search of its own
_TRIALS = 120


def zone_contacts(position: Array, values: Array) -> tuple[float, Array]:
    """Return the width of the narrowest zone about values, and how it depends on them.

    The zone touches two points on one side and one between them on the other; its width, in the
    direction of the values, is the distance of the one from the line through the two. One side of
    it is an edge of the convex hull. With several values at each position, shape (r, g); the
    weights are the derivative of the width after the values, in their shape.

    Examples
    --------
    >>> width, weights = zone_contacts(np.array([0.0, 1.0, 4.0]), np.array([0.0, 3.0, 4.0]))
    >>> float(width), weights.tolist()
    (2.0, [-0.75, 1.0, -0.25])
    """
    y = np.atleast_2d(values)
    top, bottom = np.argmax(y, axis=0), np.argmin(y, axis=0)
    columns = np.arange(position.size)
    upper, lower = y[top, columns], y[bottom, columns]
    best, weights = np.inf, np.zeros_like(y)
    for sign, side, other, rows, opposite in (
        (1.0, upper, lower, top, bottom),
        (-1.0, -lower, -upper, bottom, top),
    ):
        hull = _upper_hull(position, side)
        slopes = np.diff(side[hull]) / np.diff(position[hull])
        # the farthest point below an edge: one product of edges and points is fast enough
        a = hull[:-1]
        depth = (side[a] - slopes * position[a])[:, None] + np.outer(slopes, position) - other
        widths = depth.max(axis=1)
        i = int(np.argmin(widths))
        if widths[i] < best:
            best = float(widths[i])
            j, k, m = int(hull[i]), int(hull[i + 1]), int(np.argmax(depth[i]))
            share = (position[m] - position[j]) / (position[k] - position[j])
            weights = np.zeros_like(y)
            weights[rows[j], j] += sign * (1.0 - share)
            weights[rows[k], k] += sign * share
            weights[opposite[m], m] -= sign
    return best, weights.reshape(values.shape)


def _upper_hull(x: Array, y: Array) -> NDArray[np.intp]:
    hull: list[int] = []
    for i in range(x.size):
        while len(hull) > 1:
            a, b = hull[-2], hull[-1]
            if (y[b] - y[a]) * (x[i] - x[a]) > (y[i] - y[a]) * (x[b] - x[a]):
                break
            hull.pop()
        hull.append(i)
    return np.array(hull, dtype=np.intp)


def zone_range(
    curve: MotionCurve, direction: Direction | Literal["both"] = "mean", *, seed: int = 0
) -> Estimate:
    """Return the width of the narrowest zone, in the direction of the reading, about a curve.

    Of both runs, one zone about the two; what noise adds is taken off.
    """
    from flexstage.experiment.motion import curve_extremes as extremes

    x = curve.grid(201)
    names: tuple[Direction, ...] = ("forward", "backward") if direction == "both" else (direction,)
    rows = np.array([curve.rows(x, name) for name in names])  # (r, g, 2 k)
    # what a straight line adds changes no zone: without it the noise is told from the shape
    off = extremes.line_weights(x, "least_squares")
    base = off @ rows.mean(axis=0)
    rows = rows - base
    coefficients = curve.coefficients.ravel()

    def width(c: Array) -> float:
        return zone_contacts(x, rows @ c)[0]

    observed, weights = zone_contacts(x, rows @ coefficients)
    noise, wide = (n[:: max(n.shape[0] // _TRIALS, 1)] for n in
                   extremes.noise_of_coefficients(curve, seed))  # fmt: skip
    truth = extremes.shrunk(curve, rows.reshape(-1, rows.shape[-1]))
    added = float(np.mean([width(truth + e) for e in noise])) - width(truth)
    alone = float(np.quantile([width(e) for e in wide], 0.95))
    found = curve.of_coefficients(np.einsum("rg,rgk->k", weights, rows), reach=1.5)
    return extremes.corrected(found, observed, added, alone)
