"""Local search: sequential quadratic programming in a trust region, with feasibility boundaries."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array

Bools = NDArray[np.bool_]

#: Distance that a search keeps from a boundary, as a share of the bounds.
MARGIN = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Boundary:
    """A linear boundary of the possible points: normal . x <= offset."""

    normal: Array
    """Unit vector out of the possible region, shape (d,)."""
    offset: float
    """Distance from the origin along the normal, less `MARGIN`."""
    beyond: Array
    """An impossible point just beyond the boundary, shape (d,)."""


def find_boundary(
    possible: Callable[[Array], Bools], inside: Array, step: Array
) -> Boundary | None:
    """Return the boundary between a possible point and an impossible one.

    The distances along each variable give the normal. It is exact for a plane boundary, such as
    that of dimensions in a row between two faces.

    Parameters
    ----------
    possible : callable
        Function that returns which of the points (S, d) are possible.
    inside : array
        A possible point, from 0 to 1, shape (d,).
    step : array
        Step to an impossible point, shape (d,).

    Returns
    -------
    Boundary or None
        None where no single variable crosses the boundary.

    Notes
    -----
    Validity: components of the normal below a thirtieth of the largest are taken as zero.

    Examples
    --------
    >>> inside, step = np.array([0.5, 0.2]), np.array([0.4, 0.4])
    >>> boundary = find_boundary(lambda x: x @ [3.0, 4.0] <= 3.5, inside, step)
    >>> np.round(boundary.normal, 3), round(boundary.offset, 3)
    (array([0.6, 0.8]), 0.7)
    """
    # distance from the boundary at which the normal is measured, and search distance along each
    # variable: less than the margin, so that other boundaries are not found
    distance, reach, halvings = 2e-6, 6e-5, 18
    length = float(np.linalg.norm(step))
    if length < distance:
        return None
    low, high = 0.0, 1.0
    while (high - low) * length > 0.02 * distance:
        middle = 0.5 * (low + high)
        ok = bool(possible((inside + middle * step)[None])[0])
        low, high = (middle, high) if ok else (low, middle)
    crossing, outside = inside + low * step, inside + high * step
    before = inside + max(low - distance / length, 0.0) * step
    d = len(inside)
    directions = np.vstack([np.eye(d), -np.eye(d)]) * reach
    blocked = np.flatnonzero(~possible(before + directions))
    if not len(blocked):
        return None
    near, far = np.zeros(len(blocked)), np.ones(len(blocked))
    for _ in range(halvings):
        middle = 0.5 * (near + far)
        ok = possible(before + middle[:, None] * directions[blocked])
        near, far = np.where(ok, middle, near), np.where(ok, far, middle)
    slope = np.zeros(2 * d)
    slope[blocked] = 2.0 / (near + far)
    normal = slope[:d] - slope[d:]
    size = float(np.linalg.norm(normal))
    if size == 0.0 or float(normal @ step) <= 0.0:
        return None
    normal = normal / size
    return Boundary(normal=normal, offset=float(normal @ crossing) - MARGIN, beyond=outside)


def interior_point(possible: Callable[[Array], Bools], point: Array) -> Array:
    """Return a point near a possible one, at `MARGIN` from boundaries along every variable.

    Boundaries cannot be distinguished at a point where two of them meet. The point is returned
    unchanged where no step leads away from all of them.
    """
    directions = np.vstack([np.eye(len(point)), -np.eye(len(point))]) * MARGIN
    for _ in range(4):  # steps of one margin
        blocked = directions[~possible(np.clip(point + directions, 0.0, 1.0))]
        candidate = np.clip(point - 1.1 * blocked.sum(axis=0), 0.0, 1.0)
        if not np.any(candidate != point) or not possible(candidate[None])[0]:
            break
        point = candidate
    return point


def with_boundary(boundaries: tuple[Boundary, ...], boundary: Boundary) -> tuple[Boundary, ...]:
    """Return boundaries with a further one, which replaces an older measurement of the same."""
    # two with normals within 2.6 degrees are one
    others = (b for b in boundaries if float(boundary.normal @ b.normal) <= 0.999)
    return (*others, boundary)


#: Violation up to which a constraint counts as satisfied.
FEASIBLE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class _TrustRegion:
    """Settings of the trust region; lengths are shares of the bounds."""

    initial: float = 0.15
    """Initial half width."""
    largest: float = 0.5
    """Largest half width."""
    smallest: float = 1e-6
    """Half width below which a search has converged."""
    growth: float = 2.0
    """Factor on the half width after a good step."""
    reduction: float = 0.4
    """Factor on the half width after a bad step."""
    acceptance: float = 1e-4
    """Least ratio of actual to predicted gain of an accepted step."""
    good: float = 0.7
    """Ratio of actual to predicted gain, and share of the half width, of a good step."""
    boundaries: int = 3
    """Number of boundaries that are located in one step, before the region is reduced."""
    idle: int = 4
    """Number of steps without a change of the objective after which a search has converged."""


_REGION = _TrustRegion()


class Program(Protocol):
    """Objective and constraints over variables from 0 to 1; the objective is minimised."""

    @property
    def low(self) -> Array:
        """Lower limit of each constraint, shape (m,); minus infinity for none."""
        ...

    @property
    def high(self) -> Array:
        """Upper limit of each constraint, shape (m,); infinity for none."""
        ...

    def values(self, points: Array) -> Array:
        """Return objective and constraints at points (S, d), shape (S, 1 + m).

        NaN where a point is impossible.
        """
        ...

    def slopes(self, point: Array) -> tuple[Array, Array]:
        """Return the values at a point (d,), shape (1 + m,), and their gradients (1 + m, d)."""
        ...

    def possible(self, points: Array) -> Bools:
        """Return which points (S, d) are possible."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Iterate:
    """An accepted point of a search."""

    point: Array
    """The variables, from 0 to 1, shape (d,)."""
    values: Array
    """Objective and constraints, shape (1 + m,)."""
    violation: float
    """Sum of the constraint violations."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalOptimum(Iterate):
    """End point of a local search."""

    slopes: Array
    """Gradients of objective and constraints, shape (1 + m, d)."""
    boundaries: tuple[Boundary, ...] = ()
    """Boundaries of the possible points that were located."""
    converged: bool
    """True if no better point is near; False if the search used all its steps."""

    @property
    def feasible(self) -> bool:
        """True if every constraint is satisfied."""
        return self.violation <= FEASIBLE * 10.0


def violation_of(values: Array, low: Array, high: Array) -> Array:
    """Return the violation of each constraint; `values` are without the objective."""
    return np.maximum(values - high, 0.0) + np.maximum(low - values, 0.0)


def local_search(
    program: Program,
    start: Array,
    *,
    steps: int = 60,
    tolerance: float = 1e-5,
    curvature: Array | None = None,
    boundaries: tuple[Boundary, ...] = (),
    reach: float = 1.0,
    on_iterate: Callable[[Iterate], None] = lambda _: None,
) -> LocalOptimum | None:
    """Return the optimum near a start by sequential quadratic programming in a trust region.

    Each step minimises a quadratic model of the Lagrangian under linear models of the constraints
    (`bounded_step`). It is accepted if it lowers objective + mu x violation (an exact penalty
    function: Han 1977; Nocedal, Wright 2006, Numerical Optimization, algorithm 18.3), else the
    region shrinks. The Hessian is updated from the gradients (BFGS, damped as by Powell 1978). A
    step to an impossible point locates the boundary (`find_boundary`) and is repeated with it as a
    constraint. A point on a boundary is moved inside first (`interior_point`).

    Parameters
    ----------
    program : Program
        Objective and constraints.
    start : array
        Start point, from 0 to 1, shape (d,).
    steps : int
        Largest number of steps.
    tolerance : float
        Predicted gain of the penalty function below which the search has converged.
    curvature : array, optional
        Hessian of the objective if known, shape (d, d).
    boundaries : tuple of Boundary
        Known boundaries of the possible points.
    reach : float
        Largest change of a variable from the start, as a share of its bounds.
    on_iterate : callable
        Callback for each accepted point.

    Returns
    -------
    LocalOptimum or None
        None if the start is impossible.

    Notes
    -----
    Validity: smooth functions; a local optimum, not a global one. If the constraints contradict
    each other, it is the point of least violation.
    """
    x = np.clip(np.asarray(start, dtype=float), 0.0, 1.0)
    values, slopes = program.slopes(x)
    if not _finite(values, slopes):
        return None
    search = _started(program, _Point(x, values, slopes), reach, tolerance)
    search.boundaries = boundaries
    if curvature is not None:
        search.curvature, search.fixed_curvature = curvature, True
    path = [_iterate(program, search.point)]
    on_iterate(path[0])
    converged = False
    for _ in range(steps):
        if not search.step():
            converged = search.converged
            break
        path.append(_iterate(program, search.point))
        on_iterate(path[-1])
        if _stalled(path, tolerance):
            converged = True
            break
    last = path[-1]
    return LocalOptimum(
        point=last.point,
        values=last.values,
        violation=last.violation,
        slopes=search.point.slopes,
        boundaries=search.boundaries,
        converged=converged,
    )


class _Point(NamedTuple):
    """A point with its values and gradients."""

    x: Array
    values: Array
    slopes: Array


class _Trial(NamedTuple):
    """A step of the quadratic model, its predicted gain and its actual gain."""

    p: Array
    multipliers: Array
    predicted: float
    gain: float


@dataclass(slots=True, kw_only=True, eq=False)
class _Search:
    """State of a local search between two steps."""

    program: Program
    """Objective and constraints."""
    low: Array
    """Lower limits of the constraints, shape (m,)."""
    high: Array
    """Upper limits of the constraints, shape (m,)."""
    least: Array
    """Lower bounds of the variables, shape (d,)."""
    most: Array
    """Upper bounds of the variables, shape (d,)."""
    tolerance: float
    """Predicted gain below which the search has converged."""
    point: _Point
    """The current point."""
    curvature: Array
    """Hessian of the Lagrangian, shape (d, d)."""
    fixed_curvature: bool = False
    """True if the Hessian is exact and is not updated."""
    region: float = _REGION.initial
    """Half width of the trust region."""
    penalty: float = 1.0
    """Weight of the violation in the penalty function."""
    boundaries: tuple[Boundary, ...] = ()
    """Boundaries of the possible points that were located."""
    converged: bool = False
    """True if no step lowers the penalty function."""

    def step(self) -> bool:
        """Accept a step that lowers the penalty function; False if there is none."""
        while self.region > _REGION.smallest:
            trial = self._trial()
            if trial is None:
                return False
            x = self.point.x + trial.p
            values, slopes = self.program.slopes(x)
            if not _finite(values, slopes):
                self.region *= _REGION.reduction  # the point is possible, its neighbours are not
                continue
            longest = float(np.max(np.abs(trial.p)))
            if trial.gain > _REGION.good * trial.predicted and longest > _REGION.good * self.region:
                self.region = min(_REGION.growth * self.region, _REGION.largest)
            if not self.fixed_curvature:
                change = (slopes - self.point.slopes).T @ np.append(1.0, trial.multipliers)
                self.curvature = _updated(self.curvature, trial.p, change)
            self.point = _Point(x, values, slopes)
            return True
        self.converged = True
        return False

    def _trial(self) -> _Trial | None:
        """Return a step with a sufficient gain; None at an optimum."""
        blocked = 0
        while self.region > _REGION.smallest:
            model = self._model()
            if model is None:
                self.region *= _REGION.reduction
                continue
            p, multipliers, predicted, _ = model
            if predicted <= self.tolerance * min(1.0, self.region / _REGION.initial):
                break
            step = self._best_step(p, predicted)
            if step is None and not blocked and self._moved_inside(p):
                blocked += 1
                continue
            if step is None:  # the point is impossible
                boundary = (
                    find_boundary(self.program.possible, self.point.x, p)
                    if blocked < _REGION.boundaries
                    else None
                )
                blocked += 1
                if boundary is None:
                    self.region *= _REGION.reduction
                else:
                    self.boundaries = with_boundary(self.boundaries, boundary)
                continue
            q, gain = step
            if gain >= _REGION.acceptance * predicted:
                return _Trial(q, multipliers, predicted, gain)
            self.region = _REGION.reduction * min(self.region, float(np.max(np.abs(q))))
        self.converged = True
        return None

    def _moved_inside(self, p: Array) -> bool:
        """Move the point inside if a step meets a boundary within the margin; return if it did."""
        x = self.point.x
        near = x + min(MARGIN / float(np.max(np.abs(p))), 1.0) * p
        if bool(self.program.possible(near[None])[0]):
            return False
        interior = np.clip(interior_point(self.program.possible, x), self.least, self.most)
        values, slopes = self.program.slopes(interior)
        if not np.any(interior != x) or not _finite(values, slopes):
            return False
        self.point = _Point(interior, values, slopes)
        return True

    def _model(self) -> _Trial | None:
        """Return the step of the quadratic model, and set the penalty by its multipliers."""
        x, values, slopes = self.point
        W = np.array([boundary.normal for boundary in self.boundaries]).reshape(-1, len(x))
        room = np.array([boundary.offset for boundary in self.boundaries]) - W @ x
        A, g = slopes[1:], slopes[0]
        model = bounded_step(
            self.curvature,
            g,
            np.vstack([A, W]),
            np.append(self.low - values[1:], np.full(len(W), -np.inf)),
            # a point within the margin of a boundary moves away from it
            np.append(self.high - values[1:], np.maximum(room, -0.3 * self.region)),
            np.maximum(-self.region, self.least - x),
            np.minimum(self.region, self.most - x),
            hard=len(W),
        )
        if model is None:
            return None
        p, multipliers = model.step, model.multipliers[: len(self.low)]
        violation = self._violation(values[1:])
        reduction = violation - self._violation(values[1:] + A @ p)
        descent = -float(g @ p + 0.5 * p @ self.curvature @ p)
        penalty = 0.0 if model.relaxed else 1.5 * float(np.max(np.abs(multipliers), initial=0.0))
        self.penalty = max(self.penalty, penalty) if violation > FEASIBLE else max(penalty, 1e-6)
        if reduction > FEASIBLE:  # the step must lower the penalty function
            self.penalty = max(self.penalty, -2.0 * descent / reduction)
        return _Trial(p, multipliers, descent + self.penalty * reduction, 0.0)

    def _violation(self, constraints: Array) -> float:
        return float(violation_of(constraints, self.low, self.high).sum())

    def _merit(self, values: Array) -> float:
        return float(values[0] + self.penalty * self._violation(values[1:]))

    def _best_step(self, p: Array, predicted: float) -> tuple[Array, float] | None:
        """Return the step, with a second-order correction if better, and its gain."""
        x, values, slopes = self.point
        merit = self._merit(values)
        trial = self.program.values((x + p)[None])[0]
        if not _finite(trial):
            return None
        gain = merit - self._merit(trial)
        if gain >= 0.1 * predicted:
            return p, gain
        # second-order correction: the linear models, shifted to the constraints at x + p
        excess = np.maximum(trial[1:] - self.high, 0.0) - np.maximum(self.low - trial[1:], 0.0)
        active = excess != 0.0
        if not active.any():
            return p, gain
        correction = -np.linalg.pinv(slopes[1:][active], rcond=1e-8) @ excess[active]
        q = np.clip(x + p + correction, self.least, self.most) - x
        if float(np.max(np.abs(q))) > 1.5 * self.region:
            return p, gain
        corrected = self.program.values((x + q)[None])[0]
        corrected_gain = merit - self._merit(corrected) if _finite(corrected) else -np.inf
        return (q, corrected_gain) if corrected_gain > gain else (p, gain)


def _started(program: Program, point: _Point, reach: float, tolerance: float) -> _Search:
    steepness = max(float(np.linalg.norm(point.slopes[0])), 1e-3)
    return _Search(
        program=program,
        low=program.low,
        high=program.high,
        least=np.maximum(point.x - reach, 0.0),
        most=np.minimum(point.x + reach, 1.0),
        tolerance=tolerance,
        point=point,
        curvature=np.eye(len(point.x)) * steepness,
    )


def _finite(*arrays: Array) -> bool:
    return all(bool(np.all(np.isfinite(array))) for array in arrays)


def _stalled(path: list[Iterate], tolerance: float) -> bool:
    """Return whether the last steps were feasible without a change of the objective."""
    last = path[-_REGION.idle :]
    same = float(np.ptp([one.values[0] for one in last])) < tolerance
    return (
        len(last) == _REGION.idle and same and all(one.violation < 10.0 * FEASIBLE for one in last)
    )


def _iterate(program: Program, point: _Point) -> Iterate:
    violation = violation_of(point.values[1:], program.low, program.high)
    return Iterate(point=point.x, values=point.values, violation=float(violation.sum()))


def _updated(B: Array, p: Array, change: Array) -> Array:
    """Return the damped BFGS update of a Hessian, kept positive definite.

    `change` is the change of the gradient of the Lagrangian over the step p.
    """
    Bp = B @ p
    expected, observed = float(p @ Bp), float(p @ change)
    if expected <= 1e-14:
        return B
    share = 1.0 if observed >= 0.2 * expected else 0.8 * expected / (expected - observed)
    r = share * change + (1.0 - share) * Bp
    updated = B - np.outer(Bp, Bp) / expected + np.outer(r, r) / float(p @ r)
    # rounding errors must not make it indefinite, nor a kink arbitrarily stiff
    spectrum, basis = np.linalg.eigh(updated)
    return (basis * np.clip(spectrum, 1e-6, 1e6)) @ basis.T


# tolerance of an equation, so that its two inequalities have a common point
_EQUATION_TOLERANCE = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuadraticStep:
    """The minimum of a quadratic function under linear inequalities."""

    step: Array
    """The step, shape (d,)."""
    multipliers: Array
    """Lagrange multiplier of each inequality, at least 0, shape (m,)."""
    relaxed: bool = False
    """True if limits were relaxed; their multipliers are meaningless then."""


def smallest_quadratic(B: Array, g: Array, G: Array, h: Array) -> QuadraticStep | None:
    """Return the minimum of p·B·p/2 + g·p where G p >= h; None if no p satisfies that.

    With B = L Lᵀ and z = Lᵀ p + L⁻¹ g it is the point z nearest to 0 within the inequalities, by
    non-negative least squares (Lawson, Hanson 1974, Solving Least Squares Problems, ch. 23).

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
    Validity: dozens of variables and inequalities. Multipliers are not unique where the active
    inequalities are linearly dependent.

    Examples
    --------
    The nearest point to (3, 0) where x <= 1 and x + y >= 2:

    >>> G, h = np.array([[-1.0, 0.0], [1.0, 1.0]]), np.array([-1.0, 2.0])
    >>> minimum = smallest_quadratic(np.eye(2), np.array([-3.0, 0.0]), G, h)
    >>> np.round(minimum.step, 9), np.round(minimum.multipliers, 9)
    (array([1., 1.]), array([3., 1.]))
    """
    from scipy.linalg import cho_factor, solve_triangular
    from scipy.optimize import nnls

    L = np.tril(cho_factor(B, lower=True)[0])
    inner = solve_triangular(L, g, lower=True)
    rows = solve_triangular(L, G.T, lower=True).T
    size = np.linalg.norm(rows, axis=1)
    # an inequality that no step changes is either satisfied or not
    movable = size > 1e-12 * float(size.max(initial=0.0))
    if np.any(h[~movable] > _EQUATION_TOLERANCE):
        return None
    size = size[movable]
    rows, limit = rows[movable] / size[:, None], (h[movable] + rows[movable] @ inner) / size
    # scale all inequalities so that the step is of the order of 1
    unit = max(float(np.max(np.abs(limit), initial=0.0)), 1e-300)
    system = np.vstack([rows.T, limit[None] / unit])
    target = np.zeros(len(g) + 1)
    target[-1] = 1.0
    try:
        dual, _ = nnls(system, target, maxiter=50 * (len(g) + len(h)))
    except RuntimeError:
        return None
    residual = system @ dual - target
    if -residual[-1] < 1e-7:  # the inequalities contradict each other
        return None
    z = -unit * residual[:-1] / residual[-1]
    step = solve_triangular(L.T, z - inner)
    multipliers = np.zeros(len(h))
    multipliers[movable] = -unit * dual / residual[-1] / size
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

    If no p satisfies all of them, low and high are relaxed by their least violation (Omojokun 1989;
    Nocedal, Wright 2006, Numerical Optimization, 18.5).

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
        Number of last rows that are relaxed after all others.

    Returns
    -------
    QuadraticStep or None
        The minimum with multipliers, shape (m + d,), of the rows, then of the variables: positive
        at an upper limit, negative at a lower one. None where the numbers are too badly scaled.

    Examples
    --------
    >>> one = np.array([1.0])
    >>> bounded_step(np.eye(1), -one, np.eye(1), 2 * one, 3 * one, -one, 0.5 * one).step
    array([0.5])
    """
    d = len(g)
    for relaxed in (False, True):
        if relaxed:
            weight = np.ones(len(A))
            weight[len(A) - hard :] = 1e4  # weight of their violation
            over, under = _least_violation(
                weight[:, None] * A, weight * low, weight * high, 0.8 * least, 0.8 * most
            )
            over, under = over / weight, under / weight
            # and by a tenth of the reduction, so that more than one point is possible
            high = high + over + 0.1 * np.maximum(np.maximum(-high, 0.0) - over, 0.0)
            low = low - under - 0.1 * np.maximum(np.maximum(low, 0.0) - under, 0.0)
        room = _EQUATION_TOLERANCE * (1.0 + np.where(np.isfinite(high), np.abs(high), 0.0))
        rows = np.vstack([A, np.eye(d)])
        upper, lower = np.append(high + room, most), np.append(low - room, least)
        above, below = np.isfinite(upper), np.isfinite(lower)
        G = np.vstack([-rows[above], rows[below]])
        h = np.concatenate([-upper[above], lower[below]])
        minimum = smallest_quadratic(B, g, G, h)
        if minimum is None:
            continue
        multipliers = np.zeros(len(rows))
        multipliers[above] += minimum.multipliers[: above.sum()]
        multipliers[below] -= minimum.multipliers[above.sum() :]
        step = np.clip(minimum.step, least, most)
        return QuadraticStep(step=step, multipliers=multipliers, relaxed=relaxed)
    return None


def _least_violation(
    A: Array, low: Array, high: Array, least: Array, most: Array
) -> tuple[Array, Array]:
    """Return the excess of A p over high, and below low, of least total violation."""
    from scipy.optimize import lsq_linear

    # slacks s within the limits, as far as A p can reach: A p - s, and A p - low for equations
    reach = 1.0 + np.abs(A) @ np.maximum(np.abs(least), np.abs(most))
    bottom = np.clip(low, -reach, reach)
    top = np.maximum(np.clip(high, -reach, reach), bottom)
    free = bottom < top
    slack = -np.eye(len(low))[:, free]
    fixed = np.where(free, 0.0, bottom)
    variable = most > least
    solution = lsq_linear(
        np.hstack([A[:, variable], slack]),
        fixed,
        (np.append(least[variable], bottom[free]), np.append(most[variable], top[free])),
        method="bvls",
        tol=1e-12,
    )
    values = A[:, variable] @ solution.x[: variable.sum()]
    return np.maximum(values - high, 0.0), np.maximum(low - values, 0.0)
