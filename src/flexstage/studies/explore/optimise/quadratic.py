"""The step of a sequential quadratic search: least violation first, then the best descent."""

from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array

# what an equation may be off, so that its two inequalities leave a point between them
_APART = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuadraticStep:
    """The minimum of a quadratic function under linear inequalities."""

    step: Array
    """The step, shape (d,)."""
    multipliers: Array
    """Lagrange multiplier of each inequality, at least 0, shape (m,)."""
    relaxed: bool = False
    """Whether limits had to give way, whose multipliers say nothing then."""


def smallest_quadratic(B: Array, g: Array, G: Array, h: Array) -> QuadraticStep | None:
    """Return the minimum of p·B·p/2 + g·p where G p >= h; None where no p is allowed.

    With B = L Lᵀ and z = Lᵀ p + L⁻¹ g it is the point z nearest to 0 within inequalities, which
    non-negative least squares finds (Lawson, Hanson 1974, Solving Least Squares Problems, ch. 23).

    Parameters
    ----------
    B : array
        Positive definite, shape (d, d).
    g : array
        Shape (d,).
    G, h : array
        Shapes (m, d) and (m,).

    Returns
    -------
    QuadraticStep or None
        The minimum and the multipliers, for which B p + g = Gᵀ multipliers.

    Notes
    -----
    Validity: some dozens of variables and inequalities; multipliers are one choice of several where
    the active inequalities depend on each other.

    Examples
    --------
    The nearest point to (3, 0) where x <= 1 and x + y >= 2:

    >>> G, h = np.array([[-1.0, 0.0], [1.0, 1.0]]), np.array([-1.0, 2.0])
    >>> found = smallest_quadratic(np.eye(2), np.array([-3.0, 0.0]), G, h)
    >>> np.round(found.step, 9), np.round(found.multipliers, 9)
    (array([1., 1.]), array([3., 1.]))
    """
    from scipy.linalg import cho_factor, solve_triangular
    from scipy.optimize import nnls

    L = np.tril(cho_factor(B, lower=True)[0])
    inner = solve_triangular(L, g, lower=True)
    rows = solve_triangular(L, G.T, lower=True).T
    size = np.linalg.norm(rows, axis=1)
    # what no step changes is kept or is not
    told = size > 1e-12 * float(size.max(initial=0.0))
    if np.any(h[~told] > _APART):
        return None
    size = size[told]
    rows, limit = rows[told] / size[:, None], (h[told] + rows[told] @ inner) / size
    # every inequality in one unit: of the size of the step, which is about 1 then
    unit = max(float(np.max(np.abs(limit), initial=0.0)), 1e-300)
    system = np.vstack([rows.T, limit[None] / unit])
    wanted = np.zeros(len(g) + 1)
    wanted[-1] = 1.0
    try:
        dual, _ = nnls(system, wanted, maxiter=50 * (len(g) + len(h)))
    except RuntimeError:
        return None
    residual = system @ dual - wanted
    if -residual[-1] < 1e-7:  # so short, inequalities contradict each other
        return None
    z = -unit * residual[:-1] / residual[-1]
    step = solve_triangular(L.T, z - inner)
    multipliers = np.zeros(len(h))
    multipliers[told] = -unit * dual / residual[-1] / size
    return QuadraticStep(step=step, multipliers=multipliers)


def bounded_step(
    B: Array,
    g: Array,
    A: Array,
    low: Array,
    high: Array,
    least: Array,
    most: Array,
    *,
    hard: int = 0,
) -> QuadraticStep | None:
    """Return the minimum of p·B·p/2 + g·p where low <= A p <= high and least <= p <= most.

    Where no p is within all of them, low and high give way by what the least violation of all
    together leaves (Omojokun 1989; Nocedal, Wright 2006, Numerical Optimization, 18.5).

    Parameters
    ----------
    B, g : array
        Shapes (d, d) and (d,).
    A : array
        Shape (m, d).
    low, high : array
        Shape (m,); infinite where there is no limit, equal for an equation.
    least, most : array
        Shape (d,), finite.
    hard : int
        So many of the last rows do not give way before all others do.

    Returns
    -------
    QuadraticStep or None
        The minimum; its multipliers, shape (m + d,), are of the rows, then of the variables:
        positive where the upper limit holds, negative where the lower one does. None where the
        numbers are too badly scaled for it.

    Examples
    --------
    >>> one = np.array([1.0])
    >>> bounded_step(np.eye(1), -one, np.eye(1), 2 * one, 3 * one, -one, 0.5 * one).step
    array([0.5])
    """
    d = len(g)
    for give in (False, True):
        if give:
            weight = np.ones(len(A))
            weight[len(A) - hard :] = 1e4  # so much more it counts to violate them
            over, under = _least_violation(
                weight[:, None] * A, weight * low, weight * high, 0.8 * least, 0.8 * most
            )
            over, under = over / weight, under / weight
            # and by a tenth of what it mends, so that more than one point is left
            high = high + over + 0.1 * np.maximum(np.maximum(-high, 0.0) - over, 0.0)
            low = low - under - 0.1 * np.maximum(np.maximum(low, 0.0) - under, 0.0)
        room = _APART * (1.0 + np.where(np.isfinite(high), np.abs(high), 0.0))
        rows = np.vstack([A, np.eye(d)])
        upper, lower = np.append(high + room, most), np.append(low - room, least)
        some, more = np.isfinite(upper), np.isfinite(lower)
        G = np.vstack([-rows[some], rows[more]])
        h = np.concatenate([-upper[some], lower[more]])
        found = smallest_quadratic(B, g, G, h)
        if found is None:
            continue
        multipliers = np.zeros(len(rows))
        multipliers[some] += found.multipliers[: some.sum()]
        multipliers[more] -= found.multipliers[some.sum() :]
        step = np.clip(found.step, least, most)
        return QuadraticStep(step=step, multipliers=multipliers, relaxed=give)
    return None


def _least_violation(
    A: Array, low: Array, high: Array, least: Array, most: Array
) -> tuple[Array, Array]:
    """Return what A p is above high, and below low, where that is least, all together."""
    from scipy.optimize import lsq_linear

    # with slacks s within the limits, as far as A p can reach: A p - s, and of equations A p - low
    reach = 1.0 + np.abs(A) @ np.maximum(np.abs(least), np.abs(most))
    bottom = np.clip(low, -reach, reach)
    top = np.maximum(np.clip(high, -reach, reach), bottom)
    free = bottom < top
    slack = -np.eye(len(low))[:, free]
    fixed = np.where(free, 0.0, bottom)
    open_ = most > least
    found = lsq_linear(
        np.hstack([A[:, open_], slack]),
        fixed,
        (np.append(least[open_], bottom[free]), np.append(most[open_], top[free])),
        method="bvls",
        tol=1e-12,
    )
    at = A[:, open_] @ found.x[: open_.sum()]
    return np.maximum(at - high, 0.0), np.maximum(low - at, 0.0)
