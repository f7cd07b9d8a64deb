"""Which limits hold an optimum, and what it would give to move each (Lagrange multipliers)."""

from typing import Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.explore.figures import Requirement
from flexstage.explore.optimise.local_search import LocalOptimum
from flexstage.explore.optimise.optimum import Held, Side
from flexstage.explore.optimise.problem import Goal, Scale, StageProgram
from flexstage.quantities import number

# how near a limit is held, in parts of it; and share of the slope of the goal that counts
_AT, _AT_WALL, _MATTERS = 2e-3, 2e-3, 1e-3
# slope of a scaled figure, over all bounds, below which nothing that is varied moves it
_MOVED = 1e-3


def balance(slope: Array, normals: Array) -> tuple[Array, float]:
    """Return the multipliers of the limits that hold an optimum, and what they leave unbalanced.

    At an optimum the slope of the objective is balanced by those of the limits that hold it, each
    with a multiplier of at least 0: slope + multipliers · normals = 0 (Karush 1939; Kuhn, Tucker
    1951). The multiplier is what the objective falls by for a limit that is moved outwards by one.

    Parameters
    ----------
    slope : array
        Slope of the objective that is minimised, shape (d,).
    normals : array
        Slopes of the active limits, outwards, shape (m, d).

    Returns
    -------
    multipliers : array
        Shape (m,).
    unbalanced : float
        Length of what is left, in parts of the slope.

    Examples
    --------
    >>> balance(np.array([-2.0, -3.0]), np.eye(2))[0]
    array([2., 3.])
    """
    from scipy.optimize import nnls

    size = float(np.linalg.norm(slope))
    if size == 0.0 or not len(normals):
        return np.zeros(len(normals)), float(size > 0.0)
    found, left = nnls(normals.T, -slope)
    return found, float(left) / size


def held_by(program: StageProgram, optimum: LocalOptimum) -> tuple[tuple[Held, ...], int, float]:
    """Return what holds an optimum, how many directions are free, and what stays unbalanced."""
    problem, x, slopes = program.problem, optimum.point, optimum.slopes
    values, low, high = optimum.values[1:], program.low, program.high
    sides: list[tuple[str, int, Side, Array]] = []
    for i in range(len(values)):
        room = _AT * max(abs(values[i]), 1e-3)
        if values[i] >= high[i] - room or low[i] == high[i]:
            sides.append(("requirement", i, "high", slopes[1 + i]))
        if values[i] <= low[i] + room or low[i] == high[i]:
            sides.append(("requirement", i, "low", -slopes[1 + i]))
    sides = [side for side in sides if float(np.linalg.norm(side[3])) > _MOVED]
    unit = np.eye(len(x))
    for j in range(len(x)):
        if x[j] <= 1e-6:
            sides.append(("bound", j, "low", -unit[j]))
        if x[j] >= 1.0 - 1e-6:
            sides.append(("bound", j, "high", unit[j]))
    for k, wall in enumerate(optimum.walls):
        if wall.offset - wall.normal @ x < _AT_WALL:
            sides.append(("wall", k, "high", wall.normal))
    normals = np.array([side[3] for side in sides]).reshape(-1, len(x))
    multipliers, left = balance(slopes[0], normals)
    share = multipliers * np.linalg.norm(normals, axis=1)
    per = _per_objective(program, float(optimum.values[0]))
    order = np.argsort(-share, kind="stable")
    least = _MATTERS * float(np.linalg.norm(slopes[0]))
    held = []
    for n in order:
        kind, i, side, _ = sides[n]
        if share[n] <= least and problem.goals:
            continue
        # values to match hold it by nature
        if kind == "requirement" and low[i] == high[i] and not problem.goals:
            continue
        if kind == "requirement":
            of_goal = i >= len(problem.all_requirements)
            asked = problem.limits[i]
            rate = per * float(multipliers[n])
            held.append(_requirement(program, asked, side, rate, of_goal=of_goal))
        elif kind == "bound":
            held.append(_bound(program, i, side, per * float(multipliers[n])))
        else:
            why = program.fault(optimum.walls[i].beyond) or "the stage is at fault"
            text = f"at the edge of what can be built; a step further: {why}"
            held.append(Held(kind="wall", name="", side="high", limit=0.0, rate=0.0, text=text))
    free = len(x) - int(np.linalg.matrix_rank(normals, tol=1e-6)) if sides else len(x)
    return tuple(held), free, left if problem.goals else 0.0


def _per_objective(program: StageProgram, objective: float) -> float:
    """Return by how much the figure of the goal changes for a change of the objective by one."""
    if not program.problem.goals:
        return 0.0
    best = np.array(program.goal_figure(objective))
    scale = Scale(reference=program.goal_reference)
    return program.problem.goals[0].sign / float(scale.slope(best))


def _requirement(
    program: StageProgram, asked: Requirement, side: Side, multiplier: float, *, of_goal: bool
) -> Held:
    limit = asked.high if side == "high" else asked.low
    assert limit is not None
    outwards = 1.0 if side == "high" else -1.0
    # the objective falls by the multiplier for each unit by which the scaled limit moves out
    rate = -outwards * multiplier * float(Scale.of(asked).slope(np.array(limit)))
    shown = asked.figure.shown
    step = round_step(abs(limit) * shown.factor) / shown.factor
    text = f"held by {asked.figure.name} {'<=' if side == 'high' else '>='} "
    text += asked.figure.text(limit)
    if of_goal:
        text = f"rate of exchange at {asked.figure.name} {asked.figure.text(limit)}"
    if program.problem.goals:
        text += _relaxed(program.problem.goals[0], asked.figure.text(step), rate * outwards * step)
    kind: Literal["goal", "requirement"] = "goal" if of_goal else "requirement"
    return Held(kind=kind, name=asked.figure.name, side=side, limit=limit, rate=rate, text=text)


def _bound(program: StageProgram, i: int, side: Side, multiplier: float) -> Held:
    variable = program.problem.family.variables[i]
    limit = variable.high if side == "high" else variable.low
    outwards = 1.0 if side == "high" else -1.0
    text = f"held by the bound {variable.name} {'<=' if side == 'high' else '>='} "
    text += variable.text(limit)
    rate = -outwards * multiplier / (variable.high - variable.low)
    if program.problem.goals:
        step = round_step((variable.high - variable.low) * variable.factor) / variable.factor
        text += _relaxed(program.problem.goals[0], variable.text(step), rate * outwards * step)
    return Held(kind="bound", name=variable.name, side=side, limit=limit, rate=rate, text=text)


def _relaxed(goal: Goal, step: str, gain: float) -> str:
    shown = goal.figure.shown
    sign = "+" if gain >= 0.0 else "−"
    value = f"{sign}{number(abs(gain) * shown.factor, 2)} {shown.shown_unit}".strip()
    return f"; relaxing it by {step} would give {value} of {goal.figure.name}"


def round_step(size: float) -> float:
    """Return a round hundredth of a size: 1, 2 or 5 times a power of ten."""
    if size == 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(0.02 * size))
    return float(power * max(m for m in (1.0, 2.0, 5.0) if m * power <= 0.02 * size * (1.0 + 1e-9)))
