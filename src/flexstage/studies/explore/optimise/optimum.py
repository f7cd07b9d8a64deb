"""The best stage that was found: its figures by each model, and what holds it."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.provenance import Provenance
from flexstage.base.short_repr import short_repr
from flexstage.files.plain import picked, plain
from flexstage.files.result import Result
from flexstage.quantities.quantity import number
from flexstage.stage import Stage
from flexstage.studies.explore.figures import Figure, Requirement
from flexstage.studies.explore.optimise.local_search import LocalOptimum
from flexstage.studies.explore.optimise.problem import Goal, Problem, Scale, StageProgram

Side = Literal["low", "high"]

#: Share of its limit by which a figure may be beyond it and still count as kept [1].
TOLERANCE = 2e-3
# how the name of an optimised stage ends, and what its title is told by
_OPTIMISED, _SOUGHT = re.compile(r"(.+)-optimised(?:-(\d+))?"), ", optimised: "


def new_names(problem: Problem) -> tuple[str, str]:
    """Return name and title of the best stage, which tell it from the one that it was made of."""
    stage = problem.family.template.stage()
    before = _OPTIMISED.fullmatch(stage.name)
    name, count = (before[1], int(before[2] or 1) + 1) if before else (stage.name, 1)
    ending = "-optimised" + (f"-{count}" if count > 1 else "")
    goals = (*problem.goals, *(held.goal for held in problem.exchanged))
    sought = ", ".join(goal.text for goal in goals)
    if not goals:
        asked = list(problem.requirements)
        targets = [r for r in asked if r.low == r.high] or asked
        more = f" and {len(targets) - 1} more" if len(targets) > 1 else ""
        sought = f"{targets[0].text}{more}"
    title = (stage.title or name).partition(_SOUGHT)[0].rstrip(". ")
    # names have 80 characters at most
    return name[: 80 - len(ending)] + ending, f"{title}{_SOUGHT}{sought}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """A limit that the best stage is at, and what it would give to move it."""

    kind: Literal["requirement", "bound", "wall", "goal"]
    """``requirement`` of a figure, ``bound`` of a variable, ``wall``: no stage beyond; or another
    ``goal`` of a front, held at the chosen point: then `rate` is what the two goals exchange.
    """
    name: str
    """Name of the figure or of the variable; empty for a wall."""
    side: Side
    """Whether it is the lower or the upper limit."""
    limit: float
    """The limit, in the unit of the figure or in SI; of a wall 0."""
    rate: float
    """Change of the goal for a change of the limit by one unit of it; of a wall 0."""
    text: str
    """It in a sentence."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Level:
    """The figures of start and best stage by one model."""

    model: str
    """The model."""
    start: Array
    """Those of the start, in the units of the quantities; NaN where it is no stage."""
    best: Array
    """Those of the best stage."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rung:
    """One turn of the ladder: an optimum of the searched model, and what a finer one says of it."""

    model: str
    """The finer model."""
    point: Array
    """The optimum of the searched model, corrected so far, in SI."""
    expected: Array
    """Figures that the corrected model expects there."""
    found: Array
    """Figures by the finer model."""
    evaluations: int
    """Evaluations of the searched model until then."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trace:
    """One accepted step of a local search."""

    search: int
    """Which search, counted from 0."""
    evaluations: int
    """Evaluations of the searched model until then."""
    objective: float
    """Figure of the goal; without a goal the distance from the start, in parts of the bounds."""
    violation: float
    """Sum of what the requirements are violated by, in parts of their limits."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SearchStep:
    """An accepted step of a search that goes on, as it is handed over to who watches."""

    trace: Trace
    """The step."""
    point: Array
    """The variables, in SI, shape (d,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Optimum(Result):
    """The best stage that was found."""

    table_key: ClassVar[str] = "variables"

    problem: Problem
    """What was sought."""
    stage: Stage
    """The stage."""
    text: str
    """The same as a stage file."""
    start: Array
    """Where the search began, in SI, shape (d,)."""
    point: Array
    """The variables of the best stage, in SI, shape (d,)."""
    levels: tuple[Level, ...]
    """Figures of start and best, the searched model first, the finest last."""
    held: tuple[Held, ...]
    """The limits that it is at, those that matter most first."""
    free: int
    """Directions in which it can be changed and meets its limits still: variables less limits."""
    unexplained: float
    """Share of the slope of the goal that the limits do not balance; 0 at an exact optimum."""
    rungs: tuple[Rung, ...]
    """The turns of the ladder."""
    trace: tuple[Trace, ...] = field(repr=False)
    """The steps of all searches."""
    evaluations: Mapping[str, int]
    """Evaluations by model; of ``geometry`` alone for what looked for walls."""
    seconds: Mapping[str, float]
    """Time that they took, by model [s]."""
    seed: int
    """Seed of the starts."""
    notes: tuple[str, ...]
    """What is to be known of it."""
    provenance: Provenance
    """Where it comes from."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        problem, named = self.problem, self.problem.named
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
                {"model": level.model, "start": named(level.start), "best": named(level.best)}
                for level in self.levels
            ],
            "excess": {
                r.text: plain(e) for r, e in zip(problem.all_requirements, self.excess, strict=True)
            },
            "held": [plain(held) for held in self.held if held.kind != "goal"],
            "rates_of_exchange": [
                {
                    "goal": held.goal.text,
                    "value": held.value,
                    "rate": 0.0 if rate is None else rate.rate,
                    "of": problem.goals[0].figure.name,
                }
                for held, rate in zip(problem.exchanged, self.exchange, strict=True)
            ],
            "ladder": [
                {
                    **picked(rung, "model", "evaluations", "point"),
                    "expected": named(rung.expected),
                    "found": named(rung.found),
                }
                for rung in self.rungs
            ],
            "history": plain(self.trace),
            **picked(self, "free", "unexplained", "evaluations", "seconds", "seed", "notes"),
            **picked(self, "provenance"),
        }

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Goals and requirements, in the order of the figures of each level."""
        return self.problem.figures

    @property
    def exchange(self) -> tuple[Held | None, ...]:
        """What each other goal of a front exchanges for the first; None where it costs nothing."""
        rates = {held.name: held for held in self.held if held.kind == "goal"}
        return tuple(rates.get(held.goal.figure.name) for held in self.problem.exchanged)

    @property
    def excess(self) -> Array:
        """What each requirement is exceeded by at the finest level, in parts of its limit."""
        best = dict(zip(self.figures, self.levels[-1].best, strict=True))
        asked = self.problem.all_requirements
        return np.array([float(r.excess(np.array(best[r.figure]))) for r in asked])

    @property
    def met(self) -> bool:
        """Whether every requirement is kept, within `TOLERANCE`, by the finest model."""
        return bool(np.all(self.excess <= TOLERANCE))

    @property
    def gain(self) -> float | None:
        """Relative change of the goal from start to best by the finest model; None without."""
        if not self.problem.goals:
            return None
        last = self.levels[-1]
        return float(last.best[0] / last.start[0] - 1.0)


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
    near = 2e-3  # how near a limit is held, in parts of it; a wall in parts of the bounds
    sides: list[tuple[str, int, Side, Array]] = []
    for i in range(len(values)):
        room = near * max(abs(values[i]), 1e-3)
        if values[i] >= high[i] - room or low[i] == high[i]:
            sides.append(("requirement", i, "high", slopes[1 + i]))
        if values[i] <= low[i] + room or low[i] == high[i]:
            sides.append(("requirement", i, "low", -slopes[1 + i]))
    # a slope of less, over all bounds: nothing that is varied moves the figure
    sides = [side for side in sides if float(np.linalg.norm(side[3])) > 1e-3]
    unit = np.eye(len(x))
    for j in range(len(x)):
        if x[j] <= 1e-6:
            sides.append(("bound", j, "low", -unit[j]))
        if x[j] >= 1.0 - 1e-6:
            sides.append(("bound", j, "high", unit[j]))
    for k, wall in enumerate(optimum.walls):
        if wall.offset - wall.normal @ x < near:
            sides.append(("wall", k, "high", wall.normal))
    normals = np.array([side[3] for side in sides]).reshape(-1, len(x))
    multipliers, left = balance(slopes[0], normals)
    share = multipliers * np.linalg.norm(normals, axis=1)
    per = _per_objective(program, float(optimum.values[0]))
    order = np.argsort(-share, kind="stable")
    least = 1e-3 * float(np.linalg.norm(slopes[0]))  # of the slope of the goal, what counts
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
