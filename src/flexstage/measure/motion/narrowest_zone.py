"""The narrowest zones that hold points: a strip in a plane, and a cylinder in space."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.arrays import Array, Integers
from flexstage.errors import ConvergenceError, RecordError
from flexstage.estimate import Estimate

#: Parts of the abscissa whose highest points rule out most others before the hull is built.
_PARTS = 256
#: Rounds in which a farthest point is added, Newton steps at most, and what counts as inside.
_ROUNDS, _STEPS, _INSIDE = 200, 60, 1e-13
#: Share of the weight below which a point does not carry the cylinder.
_CARRIES = 1e-6


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StraightnessCylinder:
    """The narrowest cylinder about points along a line in space."""

    diameter: Estimate
    """Its diameter: the straightness deviation in space [m]."""
    slopes: Array
    """Slope of its axis across and vertically, over along [1], shape (2,)."""
    offsets: Array
    """Place of its axis across and vertically where along is 0 [m], shape (2,)."""
    contacts: tuple[int, ...]
    """Numbers of the points on its surface that it hangs on, two to five."""
    weights: Array
    """Share of each contact in the balance that proves the diameter least [1]; their sum is 1."""
    gap: float
    """How much a narrower cylinder could save at most [m], by the dual problem."""


def minimum_zone_cylinder(
    along: ArrayLike, across: ArrayLike, vertical: ArrayLike, *, covariance: ArrayLike | None = None
) -> StraightnessCylinder:
    """Return the narrowest cylinder that holds all points, its diameter measured square to `along`.

    The greatest distance r of a point from the axis is a convex function of the four numbers of the
    axis. It is least where weights w_i of 0 or more on the farthest points balance: the sums of
    w_i e_i and of w_i x_i e_i vanish, with e_i the directions from the axis to the points. For any
    weights, the root of the least weighted mean square is a lower bound of r (Lawson, 1961), from
    which `gap` comes. Few points are solved for by a barrier method, and the farthest of the others
    is added until all are inside.

    Parameters
    ----------
    along : array_like
        Position along the motion [m], shape (n,).
    across, vertical : array_like
        Deviations in the two directions square to it [m], shape (n,).
    covariance : array_like, optional
        Covariance of the deviations of each point, the same in the two directions [m^2]: shape ()
        or (n,) of variances, or (2, 2) or (n, 2, 2) of across and vertical.

    Returns
    -------
    StraightnessCylinder
        Diameter, axis, contact points and weights.

    Validity
    --------
    Square to `along`, not to the axis: the two differ by half the square of the slope of the axis,
    5e-7 of the diameter at 1 mrad. The uncertainty is linear, that of the contact points while they
    stay the contact points; noise makes the diameter grow as it does every distance of extremes.

    Raises
    ------
    RecordError
        There are fewer than three points, one is not finite, all have the same position along, or
        the covariance has a wrong shape.
    ConvergenceError
        The contact points are not found.

    Examples
    --------
    >>> x = np.linspace(0.0, 1e-3, 9)
    >>> helix = minimum_zone_cylinder(x, 2e-6 * np.cos(4e3 * x), 2e-6 * np.sin(4e3 * x))
    >>> print(f"{1e6 * helix.diameter.value:.3f} um")
    2.832 um
    """
    x = np.asarray(along, dtype=np.float64)
    p = np.stack(np.broadcast_arrays(across, vertical), axis=-1).astype(np.float64)
    if x.ndim != 1 or x.size < 3 or p.shape != (x.size, 2):
        raise RecordError(
            "a cylinder needs at least three points, each with its place along, across and "
            f"vertically, got shapes {x.shape} and {p.shape[:-1]}"
        )
    if not (np.isfinite(x).all() and np.isfinite(p).all()) or not np.ptp(x) > 0.0:
        raise RecordError("the points of a cylinder must be finite and differ in their place along")
    line = np.stack([np.ones_like(x), (x - x.mean()) / np.ptp(x)], axis=1)
    straight, *_ = np.linalg.lstsq(line, p, rcond=None)
    rest = p - line @ straight
    scale = float(np.abs(rest).max()) or 1.0
    chosen, weights, axis = _narrowest(line, rest / scale)
    away = rest / scale - line @ axis
    radius = float(np.sqrt((away**2).sum(1).max()))
    bound = float(np.sqrt(max(weights @ (away[chosen] ** 2).sum(1), 0.0)))
    keep = weights > _CARRIES
    contacts, weights = chosen[keep], weights[keep] / weights[keep].sum()
    total = straight + scale * axis
    slopes = total[1] / np.ptp(x)
    gradient = 2.0 * weights[:, None] * away[contacts] / (radius or 1.0)
    return StraightnessCylinder(
        diameter=_estimate(2.0 * scale * radius, gradient, contacts, covariance, x.size),
        slopes=slopes,
        offsets=total[0] - slopes * x.mean(),
        contacts=tuple(int(i) for i in contacts),
        weights=weights,
        gap=2.0 * scale * abs(radius - bound),
    )


def _narrowest(line: Array, p: Array) -> tuple[Integers, Array, Array]:
    """Return points that carry the cylinder, their weights, and its axis, shape (2, 2)."""
    distance = (p**2).sum(1)
    chosen = [int(np.argmin(line[:, 1])), int(np.argmax(line[:, 1])), int(np.argmax(distance))]
    chosen = list(dict.fromkeys(chosen))
    for _ in range(_ROUNDS):
        axis, weights = _solve(line[chosen], p[chosen])
        distance = ((p - line @ axis) ** 2).sum(1)
        farthest = int(np.argmax(distance))
        if farthest in chosen or distance[farthest] <= distance[chosen].max() * (1 + _INSIDE):
            return np.array(chosen), weights, axis
        # what carries nothing may go, so that the set stays small
        chosen = [i for i, w in zip(chosen, weights, strict=True) if w > 1e-9]
        chosen.append(farthest)
    raise ConvergenceError(f"the contact points of a cylinder were not found in {_ROUNDS} rounds")


def _solve(a: Array, p: Array) -> tuple[Array, Array]:
    """Minimise the greatest squared distance over the axis, by a barrier; few points.

    Unknowns are the axis, four numbers, and the squared radius t; the weights are those of the
    barrier, mu / (t - d_i^2).
    """
    n = len(a)
    axis: Array = np.asarray(np.linalg.lstsq(a, p, rcond=None)[0], dtype=np.float64)
    size = float(((p - a @ axis) ** 2).sum(1).max())
    if size <= 1e-28:
        return axis, np.full(n, 1.0 / n)
    t, mu = 2.0 * size, 0.3 * size
    while True:
        for _ in range(_STEPS):
            step, decrement = _newton(a, p, axis, t, mu)
            length = _room(a, p, axis, t, step)
            axis, t = axis + length * step[:4].reshape(2, 2), t + length * step[4]
            if decrement < 1e-9 and length > 0.9:
                break
        if mu <= 1e-9 * size:
            break
        mu *= 0.1
    slack = t - ((p - a @ axis) ** 2).sum(1)
    weights = mu / slack
    return _polished(a, p, axis, weights / weights.sum())


def _newton(a: Array, p: Array, axis: Array, t: float, mu: float) -> tuple[Array, float]:
    """Newton's step for t / mu - sum log(t - d_i^2), and how far it is from rest."""
    r = p - a @ axis
    slack = t - (r**2).sum(1)
    # derivative of d_i^2 by the axis (rows: constant, slope; columns: across, vertical)
    g = np.concatenate([-2.0 * (a[:, :, None] * r[:, None, :]).reshape(len(a), 4),
                        -np.ones((len(a), 1))], axis=1)  # fmt: skip
    gradient = (g / slack[:, None]).sum(0)
    gradient[4] += 1.0 / mu
    h = np.einsum("ni,nj,n->ij", g, g, 1.0 / slack**2)
    curvature = 2.0 * np.einsum("ni,nj,n->ij", a, a, 1.0 / slack)
    h[:4, :4] += np.kron(curvature, np.eye(2))
    root = np.sqrt(h.diagonal())
    step = -np.linalg.solve(h / root / root[:, None], gradient / root) / root
    return step, float(-gradient @ step)


def _polished(a: Array, p: Array, axis: Array, weights: Array) -> tuple[Array, Array]:
    """Solve the conditions of balance on the points that carry, by Newton's method.

    Where they cannot be told, as of points that stand in a regular pattern, the barrier's answer
    stays.
    """
    carry = np.flatnonzero(weights > 1e-4)
    u, q, w, m = a[carry], p[carry], weights[carry], carry.size
    found = axis
    for _ in range(6):
        r = q - u @ found
        d = (r**2).sum(1)
        # unknowns: axis (4), squared radius, weights
        residual = np.concatenate([d - w @ d, (u.T @ (w[:, None] * r)).ravel(), [w.sum() - 1.0]])
        slopes = -2.0 * (u[:, :, None] * r[:, None, :]).reshape(m, 4)
        J = np.zeros((m + 5, m + 5))
        J[:m, :4], J[:m, 4] = slopes, -1.0
        J[m : m + 4, :4] = -np.kron(u.T @ (w[:, None] * u), np.eye(2))
        J[m : m + 4, 5:] = -0.5 * slopes.T
        J[m + 4, 5:] = 1.0
        step, *_ = np.linalg.lstsq(J, -residual, rcond=1e-13)
        found, w = found + step[:4].reshape(2, 2), w + step[5:]
    before, after = (((p - a @ x) ** 2).sum(1).max() for x in (axis, found))
    if after <= before and np.all(w >= 0.0):
        weights = np.zeros(len(a))
        weights[carry] = w / w.sum()
        return found, weights
    return axis, weights


def _room(a: Array, p: Array, axis: Array, t: float, step: Array) -> float:
    """Longest part of a step, halved as often as needed, that stays inside."""
    length = 1.0
    while length > 1e-12:
        moved = axis + length * step[:4].reshape(2, 2)
        slack = t - ((p - a @ axis) ** 2).sum(1)
        if np.all(t + length * step[4] - ((p - a @ moved) ** 2).sum(1) > 0.05 * slack):
            return length
        length *= 0.5
    return 0.0


def _estimate(
    value: float, gradient: Array, contacts: Integers, covariance: ArrayLike | None, n: int
) -> Estimate:
    note = "noise widens a distance between extremes, which is not taken off here"
    if covariance is None:
        return Estimate(value=value, unit="m", note=note)
    c = np.asarray(covariance, dtype=np.float64)
    if c.shape in {(), (n,)}:
        c = np.broadcast_to(c, (n,))[:, None, None] * np.eye(2)
    if c.shape not in {(2, 2), (n, 2, 2)} or not np.isfinite(c).all():
        raise RecordError(
            f"the covariance of {n} points across and vertically must be finite, of shape (), "
            f"({n},), (2, 2) or ({n}, 2, 2), got {c.shape}"
        )
    own = np.broadcast_to(c, (n, 2, 2))[contacts]
    variance = float(np.einsum("ni,nij,nj->", gradient, own, gradient))
    uncertainty = float(np.sqrt(max(variance, 0.0)))
    return Estimate.of(value, uncertainty, "m", source="noise of the points", note=note)
