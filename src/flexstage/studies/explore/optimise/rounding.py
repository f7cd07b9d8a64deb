"""Dimensions as a drawing has them: what gains nothing stays as described, the rest is rounded."""

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
class _Drawing:
    """What a drawing has, and how it is rounded to."""

    um: int = -6
    """Power of ten of the last digit of a length [m]."""
    deg: int = 3
    """Digits behind the point of an angle [deg]."""
    digits: int = 6
    """Significant digits of what has no last digit on a drawing."""
    same: float = 1e-9
    """Parts of the bounds within which a value is one that a drawing has."""
    gains: float = 1e-4
    """What a dimension must gain, in parts of the goal, not to go back to its description."""
    missed: float = 100.0
    """How much more it counts to miss a requirement."""
    beside: int = 2
    """Values to either side that are tried."""
    changes: int = 200
    """Changes by slopes at most."""
    tells: float = 1e-9
    """What each of them must bring."""
    others: int = 20
    """What lies beside their result, and is tried where that is no stage."""
    rounds: int = 3
    """How often slopes are taken anew."""
    kept: float = 1e-5
    """Until nothing is missed by more than this."""


_DRAWING = _Drawing()


def on_drawing(variable: Variable, value: float, beside: int = 0) -> list[float]:
    """Return the values nearest to one that a drawing may have [SI], the nearest first.

    Lengths are whole um, angles whole 0.001 deg; whatever else, also of a data sheet, has six
    significant digits. None is beyond the bounds; where none is left it is the nearest bound.

    Parameters
    ----------
    variable : Variable
        The dimension.
    value : float
        Its value [SI].
    beside : int
        Twice as many others are returned with the nearest, the next ones within the bounds.

    Examples
    --------
    >>> from flexstage.stage.designs import StageTemplate
    >>> from flexstage.studies.explore.variables import variables_of
    >>> spacing, = variables_of(StageTemplate.of("parallelogram"), ["leg_spacing=30..50 mm"])
    >>> on_drawing(spacing, 0.0412345678)
    [0.041235]
    >>> on_drawing(spacing, 0.0499996, beside=1)
    [0.05, 0.049999, 0.049998]
    """
    angle = variable.dimension == "angle"
    length = variable.dimension == "length" and not is_data_sheet(variable.name)
    power = (
        _DRAWING.um if length else math.floor(math.log10(abs(value) or 1.0)) + 1 - _DRAWING.digits
    )
    nearest = round(math.degrees(value) * 10**_DRAWING.deg if angle else value * 10.0**-power)
    digits = range(nearest - beside - 1, nearest + beside + 2)
    found = [
        # as decimals, so that 8.123 mm is the very number that its text means
        parse(f"{n / 10**_DRAWING.deg:.{_DRAWING.deg}f} deg", "angle")
        if angle
        else float(f"{n}e{power}")
        for n in digits
    ]
    inside = [v for v in found if variable.low <= v <= variable.high]
    if not inside:
        return [min((variable.low, variable.high), key=lambda v: abs(v - value))]
    return sorted(inside, key=lambda v: abs(v - value))[: 2 * beside + 1]


def drawn_point(problem: Problem, x: Array) -> Array:
    """Return a point in SI: values that a drawing, or the description, has without their rounding.

    Between variables from 0 to 1 and SI a last bit is lost, which would stand in the file.
    """
    point = problem.point(x)
    for j, variable in enumerate(problem.family.variables):
        near = (variable.usual, variable.low, variable.high, *on_drawing(variable, point[j]))
        best = min(near, key=lambda v: abs(v - point[j]))
        if abs(best - point[j]) <= _DRAWING.same * problem.width[j]:
            point[j] = best
    return point


def is_drawn(problem: Problem, point: Array) -> bool:
    """Say whether a point in SI has only values that a drawing, or the description, has."""
    return all(
        value in (variable.usual, *on_drawing(variable, value))
        for variable, value in zip(problem.family.variables, point.tolist(), strict=True)
    )


def drawn(program: StageProgram, found: LocalOptimum) -> tuple[LocalOptimum, LocalOptimum]:
    """Return an optimum without needless changes, and the same as a drawing has it.

    A dimension goes back to what the description says where that costs less than a ten-thousandth
    of the goal and of any limit. Then all others are rounded, together: the values beside the
    optimum that miss the requirements least, and among those cost least of the goal, by the slopes
    there, and by the model itself where the slopes are too rough.
    """
    kept = _without_needless(program, found)
    drawing = _rounded(program, kept)
    return kept, kept if drawing is None else drawing


def _without_needless(program: StageProgram, found: LocalOptimum) -> LocalOptimum:
    problem = program.problem
    home, x = problem.position(problem.family.usual), found.point
    away = np.flatnonzero((np.abs(x - home) > _DRAWING.same) & (home >= 0.0) & (home <= 1.0))
    if not away.size:
        return found

    def back(which: Iterable[int]) -> Array:
        y = x.copy()
        for j in which:
            y[j] = home[j]
        return y

    here = _cost(program, found.values)
    singles = np.array([back([j]) for j in away.tolist()])
    values = program.scaled(singles, program.figures(singles))
    losses = np.array([_cost(program, row) - here for row in values])
    order = [int(away[k]) for k in np.argsort(losses) if losses[k] <= _DRAWING.gains]

    def costs_nothing(which: list[int]) -> bool:
        there = program.values(back(which)[None])[0]
        return bool(np.all(np.isfinite(there))) and _cost(program, there) - here <= _DRAWING.gains

    if not order:
        return found
    chosen: list[int] = order if costs_nothing(order) else []
    if not chosen:
        for j in order:
            if costs_nothing([*chosen, j]):
                chosen.append(j)
    y = back(chosen)
    values, slopes = program.slopes(y)
    if not chosen or not (np.all(np.isfinite(values)) and np.all(np.isfinite(slopes))):
        return found
    return _at(program, found, y, values, slopes)


def _cost(program: StageProgram, values: Array) -> float:
    """Goal, where there is one, and what the limits are missed by; infinite where impossible."""
    if not np.all(np.isfinite(values)):
        return math.inf
    off = float(violation_of(values[1:], program.low, program.high).sum())
    return (float(values[0]) if program.problem.goals else 0.0) + _DRAWING.missed * off


def _rounded(program: StageProgram, found: LocalOptimum) -> LocalOptimum | None:
    """Return the best point nearby that a drawing can have; None where none is possible."""
    problem = program.problem
    point = drawn_point(problem, found.point)
    candidates = []
    for variable, value in zip(problem.family.variables, point.tolist(), strict=True):
        stays = value == variable.usual
        near = np.array([value] if stays else on_drawing(variable, value, _DRAWING.beside))
        candidates.append((near - variable.low) / (variable.high - variable.low))
    at, y = found, np.array([values[0] for values in candidates])
    best: LocalOptimum | None = None
    for _ in range(_DRAWING.rounds):
        tried = ((y, program.values(y[None])[0]) for y in _best_first(program, at, y, candidates))
        possible = next((one for one in tried if np.all(np.isfinite(one[1]))), None)
        if possible is None:
            break
        y, values = possible
        if best is not None and _cost(program, values) >= _cost(program, best.values):
            break
        best = _at(program, found, y, values, found.slopes)
        if best.violation <= max(found.violation, _DRAWING.kept):
            break
        values, slopes = program.slopes(y)
        if not (np.all(np.isfinite(values)) and np.all(np.isfinite(slopes))):
            break
        at = replace(found, point=y, values=values, slopes=slopes)
    return best


def _best_first(
    program: StageProgram, at: LocalOptimum, y: Array, candidates: list[Array]
) -> Iterator[Array]:
    """Yield the best choice of candidates by slopes, changed from y; then what lies beside it."""
    walls = np.array([wall.normal for wall in at.walls]).reshape(-1, len(y))
    rows = np.vstack([at.slopes, walls])
    low = np.append(program.low, np.full(len(walls), -np.inf))
    high = np.append(program.high, [wall.offset + MARGIN for wall in at.walls])
    goal = 1.0 if program.problem.goals else 0.0
    which = np.concatenate([np.full(len(c), j) for j, c in enumerate(candidates)])
    value = np.concatenate(candidates)
    apart = np.triu(which[:, None] != which, 1)
    first, second = np.nonzero(apart)

    def costs(found: Array) -> Array:
        off = violation_of(found[:, 1:], low, high).sum(axis=1)
        return goal * found[:, 0] + _DRAWING.missed * off

    y = y.copy()
    one = np.zeros(0)
    for _ in range(_DRAWING.changes):
        here = np.append(at.values, walls @ at.point) + rows @ (y - at.point)
        moved = rows[:, which].T * (value - y[which])[:, None]
        now = costs(here[None])[0]
        one = costs(here + moved)
        k = int(np.argmin(one))
        if one[k] < now - _DRAWING.tells:
            y[which[k]] = value[k]
            continue
        two = costs(here + moved[first] + moved[second])
        k = int(np.argmin(two)) if len(two) else -1
        if k < 0 or two[k] >= now - _DRAWING.tells:
            break
        y[which[[first[k], second[k]]]] = value[[first[k], second[k]]]
    yield y
    for k in np.argsort(one, kind="stable")[: _DRAWING.others]:
        if value[k] != y[which[k]]:
            beside = y.copy()
            beside[which[k]] = value[k]
            yield beside


def _at(
    program: StageProgram, found: LocalOptimum, point: Array, values: Array, slopes: Array
) -> LocalOptimum:
    off = violation_of(values[1:], program.low, program.high)
    return replace(found, point=point, values=values, slopes=slopes, violation=float(off.sum()))
