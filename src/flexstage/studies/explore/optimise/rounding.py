"""Rounding of an optimum: needless changes are undone, other dimensions rounded for a drawing."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from flexstage.base.arrays import Array
from flexstage.quantities.units import parse
from flexstage.studies.explore.optimise.local_search import MARGIN, LocalOptimum, violation_of
from flexstage.studies.explore.optimise.problem import Problem, StageProgram
from flexstage.studies.explore.variables import Variable, is_data_sheet


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rounding:
    """Settings of the rounding."""

    length_power: int = -6
    """Power of ten of the last digit of a length [m]."""
    angle_decimals: int = 3
    """Number of decimals of an angle [deg]."""
    digits: int = 6
    """Significant digits of other quantities."""
    same: float = 1e-9
    """Difference of equal values, as a share of the bounds."""
    least_gain: float = 1e-4
    """Least gain of a changed dimension, as a share of the goal; others are reset."""
    violation_weight: float = 100.0
    """Weight of violations relative to the goal."""
    neighbours: int = 2
    """Number of rounded values to either side that are candidates."""
    exchanges: int = 200
    """Largest number of exchanges by gradients."""
    least_improvement: float = 1e-9
    """Least improvement by an exchange."""
    alternatives: int = 20
    """Number of alternatives if the result is impossible."""
    rounds: int = 3
    """Largest number of linearisations."""
    tolerance: float = 1e-5
    """Violation at which the rounding is complete."""


_ROUNDING = _Rounding()


def rounded_values(variable: Variable, value: float, neighbours: int = 0) -> list[float]:
    """Return the rounded values nearest to a value [SI], the nearest first.

    Lengths are whole um, angles whole 0.001 deg; other quantities and data of actuators have six
    significant digits. All lie within the bounds; without any, the nearest bound is returned.

    Parameters
    ----------
    variable : Variable
        The dimension.
    value : float
        Its value [SI].
    neighbours : int
        Number of further values to either side, within the bounds.

    Examples
    --------
    >>> from flexstage.stage.designs import StageTemplate
    >>> from flexstage.studies.explore.variables import variables_of
    >>> spacing, = variables_of(StageTemplate.of("parallelogram"), ["leg_spacing=30..50 mm"])
    >>> rounded_values(spacing, 0.0412345678)
    [0.041235]
    >>> rounded_values(spacing, 0.0499996, neighbours=1)
    [0.05, 0.049999, 0.049998]
    """
    angle = variable.dimension == "angle"
    length = variable.dimension == "length" and not is_data_sheet(variable.name)
    decimals = _ROUNDING.angle_decimals
    power = (
        _ROUNDING.length_power
        if length
        else math.floor(math.log10(abs(value) or 1.0)) + 1 - _ROUNDING.digits
    )
    nearest = round(math.degrees(value) * 10**decimals if angle else value * 10.0**-power)
    digits = range(nearest - neighbours - 1, nearest + neighbours + 2)
    values = [
        # as decimals, so that the number is exactly that of the text "8.123 mm"
        parse(f"{n / 10**decimals:.{decimals}f} deg", "angle") if angle else float(f"{n}e{power}")
        for n in digits
    ]
    inside = [v for v in values if variable.low <= v <= variable.high]
    if not inside:
        return [min((variable.low, variable.high), key=lambda v: abs(v - value))]
    return sorted(inside, key=lambda v: abs(v - value))[: 2 * neighbours + 1]


def rounded_point(problem: Problem, x: Array) -> Array:
    """Return a point in SI, with exact rounded or described values.

    The conversion from variables between 0 and 1 loses a last bit, which the file would show.
    """
    point = problem.point(x)
    for j, variable in enumerate(problem.family.variables):
        near = (variable.usual, variable.low, variable.high, *rounded_values(variable, point[j]))
        best = min(near, key=lambda v: abs(v - point[j]))
        if abs(best - point[j]) <= _ROUNDING.same * problem.width[j]:
            point[j] = best
    return point


def is_rounded(problem: Problem, point: Array) -> bool:
    """Return whether all values of a point in SI are rounded or as described."""
    return all(
        value in (variable.usual, *rounded_values(variable, value))
        for variable, value in zip(problem.family.variables, point.tolist(), strict=True)
    )


def round_optimum(
    program: StageProgram, optimum: LocalOptimum
) -> tuple[LocalOptimum, LocalOptimum]:
    """Return an optimum without needless changes, and the same with rounded dimensions.

    A dimension is reset to its described value if that costs less than a ten-thousandth of the goal
    and of any limit. The others are rounded together: to the neighbouring values of least violation
    and, among these, of the best goal, by linear models and, if those are too coarse, by the model.
    """
    reset = _without_needless_changes(program, optimum)
    rounded = _rounded(program, reset)
    return reset, reset if rounded is None else rounded


def _without_needless_changes(program: StageProgram, optimum: LocalOptimum) -> LocalOptimum:
    problem = program.problem
    described, x = problem.position(problem.family.usual), optimum.point
    changed = np.flatnonzero(
        (np.abs(x - described) > _ROUNDING.same) & (described >= 0.0) & (described <= 1.0)
    )
    if not changed.size:
        return optimum

    def reset(indices: Iterable[int]) -> Array:
        y = x.copy()
        for j in indices:
            y[j] = described[j]
        return y

    cost = _cost(program, optimum.values)
    singles = np.array([reset([j]) for j in changed.tolist()])
    values = program.scaled(singles, program.figures(singles))
    losses = np.array([_cost(program, row) - cost for row in values])
    order = [int(changed[k]) for k in np.argsort(losses) if losses[k] <= _ROUNDING.least_gain]

    def is_free(indices: list[int]) -> bool:
        values = program.values(reset(indices)[None])[0]
        loss = _cost(program, values) - cost
        return bool(np.all(np.isfinite(values))) and loss <= _ROUNDING.least_gain

    if not order:
        return optimum
    indices: list[int] = order if is_free(order) else []
    if not indices:
        for j in order:
            if is_free([*indices, j]):
                indices.append(j)
    y = reset(indices)
    values, slopes = program.slopes(y)
    if not indices or not (np.all(np.isfinite(values)) and np.all(np.isfinite(slopes))):
        return optimum
    return _at(program, optimum, y, values, slopes)


def _cost(program: StageProgram, values: Array) -> float:
    """Return goal, if any, plus weighted violations; infinite for an impossible point."""
    if not np.all(np.isfinite(values)):
        return math.inf
    violation = float(violation_of(values[1:], program.low, program.high).sum())
    goal = float(values[0]) if program.problem.goals else 0.0
    return goal + _ROUNDING.violation_weight * violation


def _rounded(program: StageProgram, optimum: LocalOptimum) -> LocalOptimum | None:
    """Return the best rounded point nearby; None if none is possible."""
    problem = program.problem
    point = rounded_point(problem, optimum.point)
    candidates = []
    for variable, value in zip(problem.family.variables, point.tolist(), strict=True):
        near = (
            [value]
            if value == variable.usual
            else rounded_values(variable, value, _ROUNDING.neighbours)
        )
        candidates.append((np.array(near) - variable.low) / (variable.high - variable.low))
    linear, y = optimum, np.array([values[0] for values in candidates])
    best: LocalOptimum | None = None
    for _ in range(_ROUNDING.rounds):
        trials = (
            (y, program.values(y[None])[0]) for y in _best_first(program, linear, y, candidates)
        )
        possible = next((trial for trial in trials if np.all(np.isfinite(trial[1]))), None)
        if possible is None:
            break
        y, values = possible
        if best is not None and _cost(program, values) >= _cost(program, best.values):
            break
        best = _at(program, optimum, y, values, optimum.slopes)
        if best.violation <= max(optimum.violation, _ROUNDING.tolerance):
            break
        values, slopes = program.slopes(y)
        if not (np.all(np.isfinite(values)) and np.all(np.isfinite(slopes))):
            break
        linear = replace(optimum, point=y, values=values, slopes=slopes)
    return best


def _best_first(
    program: StageProgram, linear: LocalOptimum, y: Array, candidates: list[Array]
) -> Iterator[Array]:
    """Yield the best candidates by the linear model about an optimum, then their neighbours.

    The exchange of one or two values at a time begins at y.
    """
    normals = np.array([boundary.normal for boundary in linear.boundaries]).reshape(-1, len(y))
    rows = np.vstack([linear.slopes, normals])
    low = np.append(program.low, np.full(len(normals), -np.inf))
    high = np.append(program.high, [boundary.offset + MARGIN for boundary in linear.boundaries])
    goal = 1.0 if program.problem.goals else 0.0
    index = np.concatenate([np.full(len(c), j) for j, c in enumerate(candidates)])
    value = np.concatenate(candidates)
    first, second = np.nonzero(np.triu(index[:, None] != index, 1))

    def costs(values: Array) -> Array:
        violation = violation_of(values[:, 1:], low, high).sum(axis=1)
        return goal * values[:, 0] + _ROUNDING.violation_weight * violation

    y = y.copy()
    single_costs = np.zeros(0)
    for _ in range(_ROUNDING.exchanges):
        current = np.append(linear.values, normals @ linear.point) + rows @ (y - linear.point)
        changes = rows[:, index].T * (value - y[index])[:, None]
        cost = costs(current[None])[0]
        single_costs = costs(current + changes)
        k = int(np.argmin(single_costs))
        if single_costs[k] < cost - _ROUNDING.least_improvement:
            y[index[k]] = value[k]
            continue
        pair_costs = costs(current + changes[first] + changes[second])
        k = int(np.argmin(pair_costs)) if len(pair_costs) else -1
        if k < 0 or pair_costs[k] >= cost - _ROUNDING.least_improvement:
            break
        y[index[[first[k], second[k]]]] = value[[first[k], second[k]]]
    yield y
    for k in np.argsort(single_costs, kind="stable")[: _ROUNDING.alternatives]:
        if value[k] != y[index[k]]:
            alternative = y.copy()
            alternative[index[k]] = value[k]
            yield alternative


def _at(
    program: StageProgram, optimum: LocalOptimum, point: Array, values: Array, slopes: Array
) -> LocalOptimum:
    violation = float(violation_of(values[1:], program.low, program.high).sum())
    return replace(optimum, point=point, values=values, slopes=slopes, violation=violation)
