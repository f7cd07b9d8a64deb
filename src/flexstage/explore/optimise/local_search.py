"""Search from a start for the best point nearby, by slopes, where some points are impossible."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from flexstage.arrays import Array
from flexstage.explore.optimise.quadratic import bounded_step
from flexstage.explore.optimise.walls import Wall, find_wall, joined

# trust region: its first half width, what a good step widens it by, what a bad one leaves of it
_FIRST, _LARGEST, _WIDER, _NARROWER = 0.15, 0.5, 2.0, 0.4
# share of the predicted gain that a step must bring, and beyond which the region grows
_ACCEPTED, _GOOD = 1e-4, 0.7
#: Violation that counts as none.
FEASIBLE = 1e-6
_SMALLEST = 1e-6
# steps without a change of the objective after which a search has ended
_IDLE = 4
# walls that are looked for in one step, before it is made shorter
_WALLS = 6


class Program(Protocol):
    """Minimise the first value where the others keep their limits, over variables from 0 to 1."""

    low: Array
    """Least allowed value of each constraint, shape (m,); minus infinity for none."""
    high: Array
    """Largest allowed value of each constraint, shape (m,)."""

    def values(self, points: Array) -> Array:
        """Return objective and constraints at points (S, d), shape (S, 1 + m).

        NaN where a point is impossible.
        """
        ...

    def slopes(self, point: Array) -> tuple[Array, Array]:
        """Return the values at a point (d,), shape (1 + m,), and their slopes (1 + m, d)."""
        ...

    def possible(self, points: Array) -> Array:
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
    iterates: tuple[Iterate, ...] = field(default=(), repr=False)
    """The points on the way, from the start."""

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
    told: Callable[[Iterate], None] = lambda _: None,
) -> LocalOptimum | None:
    """Return the optimum near a start by sequential quadratic programming in a trust region.

    Each step minimises a quadratic model of the Lagrangian under linear models of the constraints
    (`bounded_step`); it is taken where it lowers objective + mu x violation (an exact penalty
    function: Han 1977; Nocedal, Wright 2006, Numerical Optimization, algorithm 18.3), else the
    region shrinks. Curvature is gathered from the slopes (BFGS, damped as by Powell 1978). A step
    to an impossible point finds the wall that it met (`find_wall`) and is taken again before it.

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
    if not np.all(np.isfinite(values)) or not np.all(np.isfinite(slopes)):
        return None
    low, high = program.low, program.high
    n = len(x)
    B = np.eye(n) * max(float(np.linalg.norm(slopes[0])), 1e-3) if curvature is None else curvature
    region, penalty, converged = _FIRST, 1.0, False
    path = [_iterate(program, x, values)]
    told(path[0])
    for _ in range(steps):
        found, met = None, 0
        while region > _SMALLEST:
            A, least, most = slopes[1:], np.maximum(-region, -x), np.minimum(region, 1.0 - x)
            W = np.array([wall.normal for wall in walls]).reshape(-1, n)
            beyond = np.array([wall.offset for wall in walls]) - W @ x
            found = bounded_step(
                B,
                slopes[0],
                np.vstack([A, W]),
                np.append(low - values[1:], np.full(len(walls), -np.inf)),
                np.append(high - values[1:], np.maximum(beyond, 0.0)),
                least,
                most,
            )
            if found is None:
                region *= _NARROWER
                continue
            p, was = found.step, path[-1].violation
            linear = violation_of(values[1:] + A @ p, low, high).sum()
            model = -(slopes[0] @ p + 0.5 * p @ B @ p)
            largest = float(np.max(np.abs(found.multipliers[: len(low)]), initial=0.0))
            penalty = max(penalty, 1.5 * largest) if was > FEASIBLE else max(1.5 * largest, 1e-6)
            if was - linear > FEASIBLE:  # the step must gain in the penalty function
                penalty = max(penalty, -2.0 * model / (was - linear))
            predicted = model + penalty * (was - linear)
            if predicted <= tolerance * min(1.0, region / _FIRST):
                converged = True
                break
            taken = _try(program, x, p, values, slopes, penalty, predicted, region)
            if taken is None:  # impossible there
                wall = find_wall(program.possible, x, p)
                met += 1
                if wall is None or met > _WALLS:
                    region *= _NARROWER
                else:
                    walls = joined(walls, wall)
                continue
            p, gain = taken
            if gain >= _ACCEPTED * predicted:
                break
            region = _NARROWER * min(region, float(np.max(np.abs(p))))
        else:
            converged = True
        if converged or found is None:
            break
        ahead, steeper = program.slopes(x + p)
        if not (np.all(np.isfinite(ahead)) and np.all(np.isfinite(steeper))):
            region *= _NARROWER  # possible by itself, yet not around it
            if region <= _SMALLEST:
                break
            continue
        if gain > _GOOD * predicted and float(np.max(np.abs(p))) > 0.7 * region:
            region = min(_WIDER * region, _LARGEST)
        if curvature is None:
            multipliers = found.multipliers[: len(low)]
            turned = (steeper - slopes).T @ np.append(1.0, multipliers)
            B = _updated(B, p, turned)
        x, values, slopes = x + p, ahead, steeper
        path.append(_iterate(program, x, values))
        told(path[-1])
        if _stalled(path, tolerance):
            converged = True
            break
    last = path[-1]
    return LocalOptimum(
        point=last.point,
        values=last.values,
        violation=last.violation,
        slopes=slopes,
        walls=walls,
        converged=converged,
        iterates=tuple(path),
    )


def _stalled(path: list[Iterate], tolerance: float) -> bool:
    """Whether the last steps, all of which keep the limits, changed the objective by nothing."""
    last = path[-_IDLE:]
    same = float(np.ptp([one.values[0] for one in last])) < tolerance
    return len(last) == _IDLE and same and all(one.violation < 10.0 * FEASIBLE for one in last)


def _iterate(program: Program, x: Array, values: Array) -> Iterate:
    off = violation_of(values[1:], program.low, program.high)
    return Iterate(point=x, values=values, violation=float(off.sum()))


def _try(
    program: Program,
    x: Array,
    p: Array,
    values: Array,
    slopes: Array,
    penalty: float,
    predicted: float,
    region: float,
) -> tuple[Array, float] | None:
    """Return the step, bent along the constraints where that is better, and its gain."""

    def merit(found: Array) -> float:
        return float(found[0] + penalty * violation_of(found[1:], program.low, program.high).sum())

    here = merit(values)
    there = program.values((x + p)[None])[0]
    if not np.all(np.isfinite(there)):
        return None
    gain = here - merit(there)
    if gain >= 0.1 * predicted:
        return p, gain
    # second-order correction: the linear models, shifted to what the constraints are at x + p
    bent = there[1:] - slopes[1:] @ p
    active = (bent + slopes[1:] @ p > program.high) | (bent + slopes[1:] @ p < program.low)
    if not active.any():
        return p, gain
    A = slopes[1:][active]
    off = np.maximum(there[1:] - program.high, 0.0) - np.maximum(program.low - there[1:], 0.0)
    more = -np.linalg.pinv(A, rcond=1e-8) @ off[active]
    q = np.clip(x + p + more, 0.0, 1.0) - x
    if float(np.max(np.abs(q))) > 1.5 * region:
        return p, gain
    corrected = program.values((x + q)[None])[0]
    if not np.all(np.isfinite(corrected)):
        return p, gain
    better = here - merit(corrected)
    return (q, better) if better > gain else (p, gain)


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
