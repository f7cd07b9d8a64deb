"""Search from a start for the best point nearby, by slopes, and how far a stage is possible."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.studies.explore.optimise.quadratic import bounded_step

Bools = NDArray[np.bool_]

#: How far inside a wall a search stays, in parts of the bounds.
MARGIN = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wall:
    """Points with normal . x <= offset are possible; those beyond are not."""

    normal: Array
    """Unit vector across the wall, out of what is possible, shape (d,)."""
    offset: float
    """Its distance from the origin along the normal, less `MARGIN`."""
    beyond: Array
    """A point just beyond it, shape (d,), which says why it is impossible."""


def find_wall(possible: Callable[[Array], Bools], inside: Array, step: Array) -> Wall | None:
    """Return the wall between a possible point and an impossible one.

    The distance to the wall along each variable gives its normal: exactly where the wall is plane,
    as it is where dimensions in a row must fit between two faces.

    Parameters
    ----------
    possible : callable
        Which of the points (S, d) are possible.
    inside : array
        A possible point, from 0 to 1, shape (d,).
    step : array
        What leads from it to an impossible one, shape (d,).

    Returns
    -------
    Wall or None
        None where no variable alone leads across it.

    Notes
    -----
    Validity: components of the normal below a thirtieth of the largest are not seen.

    Examples
    --------
    >>> inside, step = np.array([0.5, 0.2]), np.array([0.4, 0.4])
    >>> wall = find_wall(lambda x: x @ [3.0, 4.0] <= 3.5, inside, step)
    >>> np.round(wall.normal, 3), round(wall.offset, 3)
    (array([0.6, 0.8]), 0.7)
    """
    # how near to a wall its normal is measured, and how far is looked for it along each variable:
    # less than the margin from other walls, which are not to be taken for this one
    near_wall, reach, halvings = 2e-6, 6e-5, 18
    length = float(np.linalg.norm(step))
    if length < near_wall:
        return None
    low, high = 0.0, 1.0
    while (high - low) * length > 0.02 * near_wall:
        middle = 0.5 * (low + high)
        ok = bool(possible((inside + middle * step)[None])[0])
        low, high = (middle, high) if ok else (low, middle)
    at, outside = inside + low * step, inside + high * step
    before = inside + max(low - near_wall / length, 0.0) * step
    d = len(inside)
    ways = np.vstack([np.eye(d), -np.eye(d)]) * reach
    stopped = np.flatnonzero(~possible(before + ways))
    if not len(stopped):
        return None
    near, far = np.zeros(len(stopped)), np.ones(len(stopped))
    for _ in range(halvings):
        middle = 0.5 * (near + far)
        ok = possible(before + middle[:, None] * ways[stopped])
        near, far = np.where(ok, middle, near), np.where(ok, far, middle)
    slope = np.zeros(2 * d)
    slope[stopped] = 2.0 / (near + far)
    normal = slope[:d] - slope[d:]
    size = float(np.linalg.norm(normal))
    if size == 0.0 or float(normal @ step) <= 0.0:
        return None
    normal = normal / size
    return Wall(normal=normal, offset=float(normal @ at) - MARGIN, beyond=outside)


def inside(possible: Callable[[Array], Bools], point: Array) -> Array:
    """Return a point beside a possible one that keeps `MARGIN` from walls along every variable.

    On a wall, or where two meet, what lies beyond tells none of them from another. It is the point
    itself where no way leads from all of them.
    """
    ways = np.vstack([np.eye(len(point)), -np.eye(len(point))]) * MARGIN
    for _ in range(4):  # steps of the margin each
        stopped = ways[~possible(np.clip(point + ways, 0.0, 1.0))]
        there = np.clip(point - 1.1 * stopped.sum(axis=0), 0.0, 1.0)
        if not np.any(there != point) or not possible(there[None])[0]:
            break
        point = there
    return point


def joined(walls: tuple[Wall, ...], wall: Wall) -> tuple[Wall, ...]:
    """Return walls with another one, which replaces what was measured of it further away."""
    # two whose normals are within 2.6 degrees are one
    others = (w for w in walls if float(wall.normal @ w.normal) <= 0.999)
    return (*others, wall)


#: Violation that counts as none.
FEASIBLE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class _TrustRegion:
    """How far a step goes, in parts of the bounds, and what it must bring."""

    first: float = 0.15
    """Half width at first."""
    largest: float = 0.5
    """Half width at most."""
    smallest: float = 1e-6
    """Half width below which a search has ended."""
    wider: float = 2.0
    """What a good step widens it by."""
    narrower: float = 0.4
    """What a bad step leaves of it."""
    accepted: float = 1e-4
    """Share of the predicted gain that a step must bring."""
    good: float = 0.7
    """Share of it, and of the half width, beyond which the region grows."""
    walls: int = 3
    """Walls that are looked for in one step, before it is made shorter."""
    idle: int = 4
    """Steps without a change of the objective after which a search has ended."""


_REGION = _TrustRegion()


class Program(Protocol):
    """Minimise the first value where the others keep their limits, over variables from 0 to 1."""

    @property
    def low(self) -> Array:
        """Least allowed value of each constraint, shape (m,); minus infinity for none."""
        ...

    @property
    def high(self) -> Array:
        """Largest allowed value of each constraint, shape (m,)."""
        ...

    def values(self, points: Array) -> Array:
        """Return objective and constraints at points (S, d), shape (S, 1 + m).

        NaN where a point is impossible.
        """
        ...

    def slopes(self, point: Array) -> tuple[Array, Array]:
        """Return the values at a point (d,), shape (1 + m,), and their slopes (1 + m, d)."""
        ...

    def possible(self, points: Array) -> Bools:
        """Return which points (S, d) are possible at all."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Iterate:
    """One accepted point of a search."""

    point: Array
    """The variables, from 0 to 1, shape (d,)."""
    values: Array
    """Objective and constraints there, shape (1 + m,)."""
    violation: float
    """Sum of what the constraints are off their limits."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalOptimum(Iterate):
    """Where a local search ended."""

    slopes: Array
    """Slopes of objective and constraints, shape (1 + m, d)."""
    walls: tuple[Wall, ...] = ()
    """Walls met on the way, beyond which points are impossible."""
    converged: bool
    """Whether no better point is near; else the number of steps was used up."""

    @property
    def feasible(self) -> bool:
        """Whether every constraint is kept."""
        return self.violation <= FEASIBLE * 10.0


def violation_of(values: Array, low: Array, high: Array) -> Array:
    """Return what each constraint is off its limits; values without the objective."""
    return np.maximum(values - high, 0.0) + np.maximum(low - values, 0.0)


def local_search(
    program: Program,
    start: Array,
    *,
    steps: int = 60,
    tolerance: float = 1e-5,
    curvature: Array | None = None,
    walls: tuple[Wall, ...] = (),
    reach: float = 1.0,
    told: Callable[[Iterate], None] = lambda _: None,
) -> LocalOptimum | None:
    """Return the optimum near a start by sequential quadratic programming in a trust region.

    Each step minimises a quadratic model of the Lagrangian under linear models of the constraints
    (`bounded_step`); it is taken where it lowers objective + mu x violation (an exact penalty
    function: Han 1977; Nocedal, Wright 2006, Numerical Optimization, algorithm 18.3), else the
    region shrinks. Curvature is gathered from the slopes (BFGS, damped as by Powell 1978). A step
    to an impossible point finds the wall that it met (`find_wall`) and is taken again before it;
    from a point that lies on one it steps inside first (`inside`).

    Parameters
    ----------
    program : Program
        What is minimised.
    start : array
        Where to start, from 0 to 1, shape (d,).
    steps : int
        Largest number of slopes asked for.
    tolerance : float
        Gain in objective and violations at which it ends.
    curvature : array, optional
        Second derivatives of the objective where they are known, shape (d, d).
    walls : tuple of Wall
        Walls that are known.
    reach : float
        How far a variable may go from the start, in parts of its bounds.
    told : callable
        Called with each accepted point.

    Returns
    -------
    LocalOptimum or None
        None where the start is impossible.

    Notes
    -----
    Validity: smooth functions; a local optimum, not the best of all. Where the constraints
    contradict each other it ends where they are violated least.
    """
    x = np.clip(np.asarray(start, dtype=float), 0.0, 1.0)
    values, slopes = program.slopes(x)
    if not _finite(values, slopes):
        return None
    search = _Search(program, _Place(x, values, slopes), curvature, walls, tolerance)
    search.least, search.most = np.maximum(x - reach, 0.0), np.minimum(x + reach, 1.0)
    path = [_iterate(program, search.place)]
    told(path[0])
    converged = False
    for _ in range(steps):
        if not search.step():
            converged = search.converged
            break
        path.append(_iterate(program, search.place))
        told(path[-1])
        if _stalled(path, tolerance):
            converged = True
            break
    last = path[-1]
    return LocalOptimum(
        point=last.point,
        values=last.values,
        violation=last.violation,
        slopes=search.place.slopes,
        walls=search.walls,
        converged=converged,
    )


class _Place(NamedTuple):
    """A point with its values and slopes."""

    x: Array
    values: Array
    slopes: Array


class _Trial(NamedTuple):
    """A step that a model proposes, what it promises and what it brought."""

    p: Array
    multipliers: Array
    predicted: float
    gain: float


class _Search:
    """The state of a local search between two steps."""

    def __init__(
        self,
        program: Program,
        place: _Place,
        curvature: Array | None,
        walls: tuple[Wall, ...],
        tolerance: float,
    ) -> None:
        self.program, self.place, self.walls, self.tolerance = program, place, walls, tolerance
        self.low, self.high = program.low, program.high
        self.known = curvature is not None
        steep = max(float(np.linalg.norm(place.slopes[0])), 1e-3)
        self.B: Array = np.eye(len(place.x)) * steep if curvature is None else curvature
        self.region, self.penalty, self.converged = _REGION.first, 1.0, False
        self.least, self.most = np.zeros(len(place.x)), np.ones(len(place.x))

    def step(self) -> bool:
        """Take a step that lowers the penalty function; False where there is none."""
        while self.region > _REGION.smallest:
            trial = self._trial()
            if trial is None:
                return False
            x = self.place.x + trial.p
            values, slopes = self.program.slopes(x)
            if not _finite(values, slopes):
                self.region *= _REGION.narrower  # possible by itself, yet not around it
                continue
            longest = float(np.max(np.abs(trial.p)))
            if trial.gain > _REGION.good * trial.predicted and longest > _REGION.good * self.region:
                self.region = min(_REGION.wider * self.region, _REGION.largest)
            if not self.known:
                turned = (slopes - self.place.slopes).T @ np.append(1.0, trial.multipliers)
                self.B = _updated(self.B, trial.p, turned)
            self.place = _Place(x, values, slopes)
            return True
        self.converged = True
        return False

    def _trial(self) -> _Trial | None:
        """Return a step that brings what it promises; None at an optimum."""
        met = 0
        while self.region > _REGION.smallest:
            found = self._model()
            if found is None:
                self.region *= _REGION.narrower
                continue
            p, multipliers, predicted, _ = found
            if predicted <= self.tolerance * min(1.0, self.region / _REGION.first):
                break
            taken = self._taken(p, predicted)
            if taken is None and not met and self._stepped_inside(p):
                met += 1
                continue
            if taken is None:  # impossible there
                wall = (
                    find_wall(self.program.possible, self.place.x, p)
                    if met < _REGION.walls
                    else None
                )
                met += 1
                if wall is None:
                    self.region *= _REGION.narrower
                else:
                    self.walls = joined(self.walls, wall)
                continue
            q, gain = taken
            if gain >= _REGION.accepted * predicted:
                return _Trial(q, multipliers, predicted, gain)
            self.region = _REGION.narrower * min(self.region, float(np.max(np.abs(q))))
        self.converged = True
        return None

    def _stepped_inside(self, p: Array) -> bool:
        """Go away from walls where one is nearer than it should be along a step, if that is so."""
        x = self.place.x
        near = x + min(MARGIN / float(np.max(np.abs(p))), 1.0) * p
        if bool(self.program.possible(near[None])[0]):
            return False
        there = np.clip(inside(self.program.possible, x), self.least, self.most)
        values, slopes = self.program.slopes(there)
        if not np.any(there != x) or not _finite(values, slopes):
            return False
        self.place = _Place(there, values, slopes)
        return True

    def _model(self) -> _Trial | None:
        """Return the step of the quadratic model, and set the penalty by its multipliers."""
        x, values, slopes = self.place
        W = np.array([wall.normal for wall in self.walls]).reshape(-1, len(x))
        beyond = np.array([wall.offset for wall in self.walls]) - W @ x
        A, g = slopes[1:], slopes[0]
        found = bounded_step(
            self.B,
            g,
            np.vstack([A, W]),
            np.append(self.low - values[1:], np.full(len(W), -np.inf)),
            # what is nearer to a wall than it should be goes away from it
            np.append(self.high - values[1:], np.maximum(beyond, -0.3 * self.region)),
            np.maximum(-self.region, self.least - x),
            np.minimum(self.region, self.most - x),
            hard=len(W),
        )
        if found is None:
            return None
        p, multipliers = found.step, found.multipliers[: len(self.low)]
        was = self._off(values[1:])
        less = was - self._off(values[1:] + A @ p)
        model = -float(g @ p + 0.5 * p @ self.B @ p)
        wanted = 0.0 if found.relaxed else 1.5 * float(np.max(np.abs(multipliers), initial=0.0))
        self.penalty = max(self.penalty, wanted) if was > FEASIBLE else max(wanted, 1e-6)
        if less > FEASIBLE:  # the step must gain in the penalty function
            self.penalty = max(self.penalty, -2.0 * model / less)
        return _Trial(p, multipliers, model + self.penalty * less, 0.0)

    def _off(self, constraints: Array) -> float:
        return float(violation_of(constraints, self.low, self.high).sum())

    def _merit(self, found: Array) -> float:
        return float(found[0] + self.penalty * self._off(found[1:]))

    def _taken(self, p: Array, predicted: float) -> tuple[Array, float] | None:
        """Return the step, bent along the constraints where that is better, and its gain."""
        x, values, slopes = self.place
        here = self._merit(values)
        there = self.program.values((x + p)[None])[0]
        if not _finite(there):
            return None
        gain = here - self._merit(there)
        if gain >= 0.1 * predicted:
            return p, gain
        # second-order correction: the linear models, shifted to what the constraints are at x + p
        over = np.maximum(there[1:] - self.high, 0.0) - np.maximum(self.low - there[1:], 0.0)
        active = over != 0.0
        if not active.any():
            return p, gain
        more = -np.linalg.pinv(slopes[1:][active], rcond=1e-8) @ over[active]
        q = np.clip(x + p + more, self.least, self.most) - x
        if float(np.max(np.abs(q))) > 1.5 * self.region:
            return p, gain
        bent = self.program.values((x + q)[None])[0]
        better = here - self._merit(bent) if _finite(bent) else -np.inf
        return (q, better) if better > gain else (p, gain)


def _finite(*arrays: Array) -> bool:
    return all(bool(np.all(np.isfinite(array))) for array in arrays)


def _stalled(path: list[Iterate], tolerance: float) -> bool:
    """Whether the last steps, all of which keep the limits, changed the objective by nothing."""
    last = path[-_REGION.idle :]
    same = float(np.ptp([one.values[0] for one in last])) < tolerance
    return (
        len(last) == _REGION.idle and same and all(one.violation < 10.0 * FEASIBLE for one in last)
    )


def _iterate(program: Program, place: _Place) -> Iterate:
    off = violation_of(place.values[1:], program.low, program.high)
    return Iterate(point=place.x, values=place.values, violation=float(off.sum()))


def _updated(B: Array, p: Array, turned: Array) -> Array:
    """Return the curvature with what a step showed of it, kept positive definite."""
    Bp = B @ p
    curved, seen = float(p @ Bp), float(p @ turned)
    if curved <= 1e-14:
        return B
    share = 1.0 if seen >= 0.2 * curved else 0.8 * curved / (curved - seen)
    r = share * turned + (1.0 - share) * Bp
    updated = B - np.outer(Bp, Bp) / curved + np.outer(r, r) / float(p @ r)
    # rounding must not make it indefinite, nor a kink make it stiff beyond all measure
    spectrum, basis = np.linalg.eigh(updated)
    return (basis * np.clip(spectrum, 1e-6, 1e6)) @ basis.T
