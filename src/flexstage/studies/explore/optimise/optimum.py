"""Result of an optimisation: figures by each model, active constraints and multipliers."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.provenance import Provenance
from flexstage.base.short_repr import short_repr
from flexstage.files.plain import picked, plain
from flexstage.files.result import Result
from flexstage.quantities.quantity import number
from flexstage.stage import Stage
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.optimise.local_search import LocalOptimum
from flexstage.studies.explore.optimise.problem import Goal, Problem, Scale, StageProgram

Side = Literal["low", "high"]

#: Violation up to which a requirement counts as met, as a share of its limit [1].
TOLERANCE = 2e-3
# ending of the name, and addition to the title, of an optimised stage
_NAME, _TITLE_ADDITION = re.compile(r"(.+)-optimised(?:-(\d+))?"), ", optimised: "


def new_names(problem: Problem) -> tuple[str, str]:
    """Return name and title of the optimised stage, which differ from those of the original."""
    stage = problem.family.template.stage()
    previous = _NAME.fullmatch(stage.name)
    name, count = (previous[1], int(previous[2] or 1) + 1) if previous else (stage.name, 1)
    ending = "-optimised" + (f"-{count}" if count > 1 else "")
    goals = (*problem.goals, *(other.goal for other in problem.other_goals))
    aim = ", ".join(goal.text for goal in goals)
    if not goals:
        requirements = list(problem.requirements)
        targets = [r for r in requirements if r.low == r.high] or requirements
        others = f" and {len(targets) - 1} more" if len(targets) > 1 else ""
        aim = f"{targets[0].text}{others}"
    title = (stage.title or name).partition(_TITLE_ADDITION)[0].rstrip(". ")
    # names have 80 characters at most
    return name[: 80 - len(ending)] + ending, f"{title}{_TITLE_ADDITION}{aim}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ActiveConstraint:
    """An active constraint, and the sensitivity of the goal to it."""

    kind: Literal["requirement", "bound", "feasibility", "goal"]
    """``requirement`` of a figure, ``bound`` of a variable, ``feasibility``: stages beyond are
    impossible; or another ``goal`` of a front, fixed at the selected point: then `rate` is the
    trade-off of the two goals.
    """
    name: str
    """Name of the figure or of the variable; empty for feasibility."""
    side: Side
    """Lower or upper limit."""
    limit: float
    """The limit, in the unit of the figure or in SI; 0 for feasibility."""
    rate: float
    """Change of the goal per unit change of the limit; 0 for feasibility."""
    text: str
    """The constraint and its sensitivity in words."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Level:
    """Figures of start and optimum by one model."""

    model: str
    """The model."""
    start: Array
    """Figures of the start, in the units of the quantities; NaN if it is impossible."""
    best: Array
    """Figures of the optimum."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Iteration:
    """An iteration of the multi-fidelity search: an optimum by the corrected and a finer model."""

    model: str
    """The finer model."""
    point: Array
    """The optimum of the corrected model, in SI."""
    predicted: Array
    """Figures by the corrected model."""
    computed: Array
    """Figures by the finer model."""
    evaluations: int
    """Number of evaluations of the lumped model so far."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HistoryEntry:
    """An accepted step of a local search."""

    search: int
    """Number of the search, from 0."""
    evaluations: int
    """Number of evaluations of the lumped model so far."""
    objective: float
    """Figure of the goal; without a goal the distance from the start, as a share of the bounds."""
    violation: float
    """Sum of the violations of the requirements, as shares of their limits."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SearchStep:
    """An accepted step of a running search, for a progress listener."""

    entry: HistoryEntry
    """The step."""
    point: Array
    """The variables, in SI, shape (d,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Optimum(Result):
    """Result of an optimisation with one goal or none."""

    table_key: ClassVar[str] = "variables"

    problem: Problem
    """The problem."""
    stage: Stage
    """The optimised stage."""
    text: str
    """Stage file of the optimised stage."""
    start: Array
    """Start point of the search, in SI, shape (d,)."""
    point: Array
    """Variables of the optimum, in SI, shape (d,)."""
    levels: tuple[Level, ...]
    """Figures of start and optimum by each model, from the lumped to the finest one."""
    active_constraints: tuple[ActiveConstraint, ...]
    """Active constraints, the most important first."""
    free_directions: int
    """Number of variables less that of independent active constraints."""
    stationarity_residual: float
    """Share of the gradient of the goal that the constraints do not balance; 0 at an optimum."""
    iterations: tuple[Iteration, ...]
    """Iterations of the multi-fidelity search."""
    history: tuple[HistoryEntry, ...] = field(repr=False)
    """Steps of all local searches."""
    evaluations: Mapping[str, int]
    """Number of evaluations by model; ``geometry`` for feasibility checks."""
    seconds: Mapping[str, float]
    """Computing time by model [s]."""
    seed: int
    """Seed of the starts."""
    notes: tuple[str, ...]
    """Remarks on the result."""
    provenance: Provenance
    """Origin of the result."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        problem, by_name = self.problem, self.problem.by_name
        return {
            **problem.data(),
            **picked(self, "met", "gain"),
            "variables": [
                {
                    **picked(variable, "name", "dimension", "low", "high", "described=usual"),
                    "start": float(start),
                    "best": float(best),
                }
                for variable, start, best in zip(
                    problem.family.variables, self.start, self.point, strict=True
                )
            ],
            "figures": [
                {"model": level.model, "start": by_name(level.start), "best": by_name(level.best)}
                for level in self.levels
            ],
            "excess": {
                r.text: plain(e) for r, e in zip(problem.all_requirements, self.excess, strict=True)
            },
            "active_constraints": [plain(c) for c in self.active_constraints if c.kind != "goal"],
            "trade_offs": [
                {
                    "goal": other.goal.text,
                    "value": other.value,
                    "rate": 0.0 if constraint is None else constraint.rate,
                    "of": problem.goals[0].figure.name,
                }
                for other, constraint in zip(problem.other_goals, self.trade_offs, strict=True)
            ],
            "iterations": [
                {
                    **picked(iteration, "model", "evaluations", "point"),
                    "predicted": by_name(iteration.predicted),
                    "computed": by_name(iteration.computed),
                }
                for iteration in self.iterations
            ],
            **picked(self, "history", "free_directions", "stationarity_residual", "evaluations"),
            **picked(self, "seconds", "seed", "notes", "provenance"),
        }

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Goals and requirements, in the order of the figures of each level."""
        return self.problem.figures

    @property
    def trade_offs(self) -> tuple[ActiveConstraint | None, ...]:
        """Trade-off of each other goal of a front with the first; None if it is not active."""
        constraints = {c.name: c for c in self.active_constraints if c.kind == "goal"}
        return tuple(constraints.get(o.goal.figure.name) for o in self.problem.other_goals)

    @property
    def excess(self) -> Array:
        """Excess of each requirement by the finest model, as a share of its limit."""
        best = dict(zip(self.figures, self.levels[-1].best, strict=True))
        requirements = self.problem.all_requirements
        return np.array([float(r.excess(np.array(best[r.figure]))) for r in requirements])

    @property
    def met(self) -> bool:
        """True if the finest model meets every requirement within `TOLERANCE`."""
        return bool(np.all(self.excess <= TOLERANCE))

    @property
    def gain(self) -> float | None:
        """Relative change of the goal from start to optimum by the finest model, if any."""
        if not self.problem.goals:
            return None
        last = self.levels[-1]
        return float(last.best[0] / last.start[0] - 1.0)


def balance(slope: Array, normals: Array) -> tuple[Array, float]:
    """Return the Lagrange multipliers of active constraints, and the stationarity residual.

    At an optimum the gradients of the active constraints balance that of the objective, each with a
    multiplier of at least 0: slope + multipliers · normals = 0 (Karush 1939; Kuhn, Tucker 1951).
    The multiplier is the decrease of the objective per unit relaxation of the limit.

    Parameters
    ----------
    slope : array
        Gradient of the minimised objective, shape (d,).
    normals : array
        Outward gradients of the active constraints, shape (m, d).

    Returns
    -------
    multipliers : array
        Shape (m,).
    residual : float
        Norm of the residual, as a share of that of the gradient.

    Examples
    --------
    >>> balance(np.array([-2.0, -3.0]), np.eye(2))[0]
    array([2., 3.])
    """
    from scipy.optimize import nnls

    size = float(np.linalg.norm(slope))
    if size == 0.0 or not len(normals):
        return np.zeros(len(normals)), float(size > 0.0)
    multipliers, residual = nnls(normals.T, -slope)
    return multipliers, float(residual) / size


def find_active_constraints(
    program: StageProgram, optimum: LocalOptimum
) -> tuple[tuple[ActiveConstraint, ...], int, float]:
    """Return active constraints, number of free directions and stationarity residual."""
    problem, x, slopes = program.problem, optimum.point, optimum.slopes
    limits = _active_limits(program, optimum)
    normals = np.array([limit.normal for limit in limits]).reshape(-1, len(x))
    multipliers, residual = balance(slopes[0], normals)
    share = multipliers * np.linalg.norm(normals, axis=1)
    per_objective = _goal_per_objective(program, float(optimum.values[0]))
    least = _LEAST_SHARE * float(np.linalg.norm(slopes[0]))
    constraints = []
    for n in np.argsort(-share, kind="stable"):
        limit = limits[n]
        if share[n] <= least and problem.goals:
            continue
        # a value to match is always active
        if limit.equation and not problem.goals:
            continue
        multiplier = per_objective * float(multipliers[n])
        if limit.kind == "requirement":
            constraints.append(_requirement(program, limit, multiplier))
        elif limit.kind == "bound":
            constraints.append(_bound(program, limit, multiplier))
        else:
            beyond = optimum.boundaries[limit.number].beyond
            reason = program.fault(beyond) or "the stage fails a check"
            constraints.append(_feasibility(reason))
    rank = int(np.linalg.matrix_rank(normals, tol=1e-6)) if limits else 0
    return tuple(constraints), len(x) - rank, residual if problem.goals else 0.0


#: Distance from a limit at which it is active, as a share of the limit or, for a boundary of
#: feasibility, of the bounds.
_NEAR = 2e-3
#: Norm of a gradient over all bounds below which no variable changes the figure.
_FLAT = 1e-3
#: Share of the gradient of the goal below which an active constraint is not reported.
_LEAST_SHARE = 1e-3


class _Limit(NamedTuple):
    """An active limit of a requirement, variable or boundary."""

    kind: Literal["requirement", "bound", "feasibility"]
    number: int
    side: Side
    normal: Array
    """Outward gradient, shape (d,)."""
    equation: bool = False


def _active_limits(program: StageProgram, optimum: LocalOptimum) -> list[_Limit]:
    x, slopes = optimum.point, optimum.slopes
    values, low, high = optimum.values[1:], program.low, program.high
    limits = []
    for i in range(len(values)):
        room, equation = _NEAR * max(abs(values[i]), 1e-3), bool(low[i] == high[i])
        if values[i] >= high[i] - room or equation:
            limits.append(_Limit("requirement", i, "high", slopes[1 + i], equation))
        if values[i] <= low[i] + room or equation:
            limits.append(_Limit("requirement", i, "low", -slopes[1 + i], equation))
    limits = [limit for limit in limits if float(np.linalg.norm(limit.normal)) > _FLAT]
    unit = np.eye(len(x))
    for j in range(len(x)):
        if x[j] <= 1e-6:
            limits.append(_Limit("bound", j, "low", -unit[j]))
        if x[j] >= 1.0 - 1e-6:
            limits.append(_Limit("bound", j, "high", unit[j]))
    for k, boundary in enumerate(optimum.boundaries):
        if boundary.offset - boundary.normal @ x < _NEAR:
            limits.append(_Limit("feasibility", k, "high", boundary.normal))
    return limits


def _goal_per_objective(program: StageProgram, objective: float) -> float:
    """Return the change of the figure of the goal per unit change of the objective."""
    if not program.problem.goals:
        return 0.0
    best = np.array(program.goal_figure(objective))
    scale = Scale(reference=program.goal_reference)
    return program.problem.goals[0].sign / float(scale.slope(best))


def _requirement(program: StageProgram, active: _Limit, multiplier: float) -> ActiveConstraint:
    side = active.side
    of_goal = active.number >= len(program.problem.all_requirements)
    requirement = program.problem.limits[active.number]
    limit = requirement.high if side == "high" else requirement.low
    assert limit is not None
    outwards = 1.0 if side == "high" else -1.0
    # the multiplier is the decrease of the objective per unit relaxation of the scaled limit
    rate = -outwards * multiplier * float(Scale.of(requirement).slope(np.array(limit)))
    figure = requirement.figure
    step = round_step(abs(limit) * figure.display.factor) / figure.display.factor
    text = f"active constraint {figure.name} {'<=' if side == 'high' else '>='} "
    text += figure.text(limit)
    if of_goal:
        text = f"trade-off at {figure.name} {figure.text(limit)}"
    if program.problem.goals:
        text += _relaxed(program.problem.goals[0], figure.text(step), rate * outwards * step)
    return ActiveConstraint(
        kind="goal" if of_goal else "requirement",
        name=figure.name,
        side=side,
        limit=limit,
        rate=rate,
        text=text,
    )


def _feasibility(reason: str) -> ActiveConstraint:
    text = f"manufacturability limit: {reason}"
    return ActiveConstraint(
        kind="feasibility", name="", side="high", limit=0.0, rate=0.0, text=text
    )


def _bound(program: StageProgram, active: _Limit, multiplier: float) -> ActiveConstraint:
    variable, side = program.problem.family.variables[active.number], active.side
    limit = variable.high if side == "high" else variable.low
    outwards = 1.0 if side == "high" else -1.0
    text = f"active bound {variable.name} {'<=' if side == 'high' else '>='} "
    text += variable.text(limit)
    rate = -outwards * multiplier / (variable.high - variable.low)
    if program.problem.goals:
        step = round_step((variable.high - variable.low) * variable.factor) / variable.factor
        text += _relaxed(program.problem.goals[0], variable.text(step), rate * outwards * step)
    return ActiveConstraint(
        kind="bound", name=variable.name, side=side, limit=limit, rate=rate, text=text
    )


def _relaxed(goal: Goal, step: str, change: float) -> str:
    quantity = goal.figure.display
    sign = "+" if change >= 0.0 else "−"
    value = f"{sign}{number(abs(change) * quantity.factor, 2)} {quantity.shown_unit}".strip()
    return f"; relaxing it by {step} changes {goal.figure.name} by {value}"


def round_step(size: float) -> float:
    """Return about a hundredth of a size: 1, 2 or 5 times a power of ten."""
    if size == 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(0.02 * size))
    return float(power * max(m for m in (1.0, 2.0, 5.0) if m * power <= 0.02 * size * (1.0 + 1e-9)))
