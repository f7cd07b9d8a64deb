"""Pareto fronts of several goals, and the selection of one design."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.lazy import require_extra
from flexstage.base.short_repr import short_repr
from flexstage.files.plain import picked, plain
from flexstage.files.result import Result
from flexstage.studies.explore.batches import Job
from flexstage.studies.explore.family import evaluate
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.optimise.local_search import (
    FEASIBLE,
    Bools,
    LocalOptimum,
    local_search,
    violation_of,
)
from flexstage.studies.explore.optimise.multi_fidelity import (
    SearchOptions,
    find_optimum,
    start_notes,
)
from flexstage.studies.explore.optimise.optimum import Optimum
from flexstage.studies.explore.optimise.problem import FixedGoal, Problem, StageProgram
from flexstage.studies.explore.optimise.rounding import round_optimum
from flexstage.studies.explore.workers import Workers

#: Number of points of the front that a local search refines.
_REFINED = 8
#: Number of stages of a generation.
_POPULATION = 48
#: Number of points of the front that the finer model recomputes, besides the selected one.
_RECOMPUTED = 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Generation:
    """A generation of a running search for a front, for a progress listener."""

    points: Array
    """The variables, in SI, shape (S, d)."""
    values: Array
    """Figures of the problem by the lumped model, shape (S, F)."""
    feasible: Bools
    """True for stages that meet every requirement, shape (S,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Front(Result):
    """A Pareto front: stages of which none is better than another in every goal."""

    table_key: ClassVar[str] = "front"

    problem: Problem
    """The problem."""
    points: Array
    """Variables in SI, shape (N, d), in the order of the first goal."""
    values: Array
    """Figures by the lumped model, shape (N, F)."""
    model: str
    """The finer model."""
    recomputed: tuple[int, ...]
    """Indices of the points that the finer model recomputed."""
    recomputed_values: Array
    """Figures by the finer model, shape (K, F)."""
    selected: int
    """Index of the selected point."""
    optimum: Optimum
    """The selected design, optimised in the first goal with all other goals fixed."""
    generations: int
    """Number of generations."""
    evaluations: Mapping[str, int]
    """Number of evaluations by model, without those of `optimum`."""
    searched: Array = field(repr=False)
    """Figures of all evaluated stages that meet every requirement, shape (M, F)."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        names, by_name = self.problem.family.names, self.problem.by_name
        return {
            **self.problem.data(),
            "front": [
                {
                    "variables": dict(zip(names, plain(point), strict=True)),
                    "lumped": by_name(values),
                }
                for point, values in zip(self.points, self.values, strict=True)
            ],
            "recomputed": [
                {"point": number, self.model: by_name(values)}
                for number, values in zip(self.recomputed, self.recomputed_values, strict=True)
            ],
            **picked(self, "selected", "generations", "evaluations"),
            "optimum": self.optimum.data(),
        }

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Goals and requirements, in the order of the columns."""
        return self.problem.figures


def find_front(
    problem: Problem, options: SearchOptions | None = None, workers: Workers | None = None
) -> Front:
    """Return the Pareto front of several goals, and one design of it.

    The first generation is a Sobol' sample with the optimum of each goal alone (NSGA-II, Deb et al.
    2002, IEEE Trans. Evolutionary Computation 6, 182). A local search then improves some points of
    the front in the first goal, with the others as constraints (Haimes et al. 1971). The selected
    design is the knee: the point nearest to the best values of all goals, relative to the range of
    the front. A multi-fidelity search optimises its first goal with the others fixed, so that its
    multipliers are the trade-offs of the goals.

    Parameters
    ----------
    problem : Problem
        The problem, with two goals or more.
    options : SearchOptions, optional
        Options of the search.
    workers : Workers, optional
        Workers that evaluate the stages of a generation.

    Returns
    -------
    Front
        The front; it does not depend on the number of workers.

    Raises
    ------
    ModelError
        There are fewer than two goals, or the requirements are not met by any stage.

    Notes
    -----
    Validity: figures of the lumped model, except for the recomputed points. The number of
    evaluations limits the completeness of the front.
    """
    if len(problem.goals) < 2:
        raise ModelError("a Pareto front needs two goals or more: one goal has an optimum")
    require_extra("explore", "pymoo", "a Pareto front", ModelError)
    search = _new_search(problem, options or SearchOptions(), workers or Workers(1))
    with progress.subtask(0.0, 0.6):
        generations = _evolve(search, _goal_optima(search))
    with progress.subtask(0.6, 0.7):
        _refine(search)
    x, values = search.front()
    selected = knee_of(search.costs(values))
    recomputed = _spread(len(x), selected)
    model, points = search.options.model, problem.point(x)
    with progress.subtask(0.7, 0.8):
        progress.update(f"front by {model}")
        finer = evaluate_with(search.workers, problem, points[list(recomputed)], model)
        search.counts[model] += len(recomputed)
    with progress.subtask(0.8, 1.0):
        optimum = _improved(search, x[selected], values[selected])
    return Front(
        problem=problem,
        points=points,
        values=values,
        model=model,
        recomputed=recomputed,
        recomputed_values=finer,
        selected=selected,
        optimum=optimum,
        generations=generations,
        evaluations=dict(search.counts),
        searched=np.concatenate(search.figures)[search.feasible_so_far()],
    )


def non_dominated(costs: Array) -> Bools:
    """Return which rows of costs (N, k) are not dominated by another row.

    Examples
    --------
    >>> non_dominated(np.array([[1.0, 3.0], [2.0, 2.0], [2.0, 4.0]]))
    array([ True,  True, False])
    """
    best = np.ones(len(costs), dtype=bool)
    for i, row in enumerate(costs):
        dominating = np.all(costs <= row, axis=1) & np.any(costs < row, axis=1)
        # of equal rows the first is kept
        dominating |= np.all(costs == row, axis=1) & (np.arange(len(costs)) < i)
        best[i] = not dominating.any()
    return best


def knee_of(costs: Array) -> int:
    """Return the row of a front (N, k) nearest to the best value of each column, scaled by ranges.

    Examples
    --------
    >>> knee_of(np.array([[0.0, 10.0], [1.0, 2.0], [5.0, 0.0]]))
    1
    """
    span = np.ptp(costs, axis=0)
    scaled = (costs - costs.min(axis=0)) / np.where(span > 0.0, span, 1.0)
    return int(np.argmin(np.linalg.norm(scaled, axis=1)))


def evaluate_rows(payload: Any, start: int, stop: int) -> dict[str, Array]:
    """Evaluate a batch of points of a generation."""
    problem, points, model = payload
    values = evaluate(problem.family, points[start:stop], problem.figures, model).values
    for row, point in zip(values, points[start:stop], strict=True):
        if np.all(np.isfinite(row)) and problem.fault(point):
            row[:] = np.nan
    return {"values": values}


def evaluate_with(
    workers: Workers, problem: Problem, points: Array, model: str, name: str = "optimise"
) -> Array:
    """Return figures (S, F) of points (S, d) in SI by workers; NaN for infeasible stages."""
    job = Job(
        name=name,
        work=evaluate_rows,
        payload=(problem, points, model),
        count=len(points),
        batch=6,  # of the stages of a generation
    )
    return workers.run(job)["values"]


@dataclass(slots=True, kw_only=True, eq=False)
class _FrontSearch:
    """State of a search for a Pareto front: all evaluated points and their figures."""

    problem: Problem
    options: SearchOptions
    workers: Workers
    start: Array
    """Start point, variables from 0 to 1."""
    signs: Array
    """Factor on each goal for minimisation."""
    columns: list[int]
    """Column of each goal in the figures."""
    counts: Counter[str] = field(default_factory=Counter)
    """Number of evaluations, by model."""
    points: list[Array] = field(default_factory=list)
    """Evaluated points, variables from 0 to 1, in batches."""
    figures: list[Array] = field(default_factory=list)
    """Their figures by the lumped model."""

    def program(self, goal: int, others: Mapping[int, float]) -> StageProgram:
        """Return the problem of one goal, with limits of other goals."""
        problem = self.problem
        fixed = tuple(FixedGoal(goal=problem.goals[i], value=v) for i, v in others.items())
        single = replace(problem, goals=(problem.goals[goal],), other_goals=fixed)
        return StageProgram(problem=single, nearest_to=self.start, counts=self.counts)

    def evaluate(self, x: Array, name: str = "optimise") -> Array:
        """Evaluate points, variables from 0 to 1, and record them."""
        problem = self.problem
        figures = evaluate_with(self.workers, problem, problem.point(x), "lumped", name)
        self.counts["lumped"] += len(x)
        self.points.append(x)
        self.figures.append(figures)
        feasible = self.feasible(x, figures)
        generation = Generation(points=problem.point(x), values=figures, feasible=feasible)
        progress.hand_over(generation)
        return figures

    def violations(self, x: Array, figures: Array) -> Array:
        """Return the violations of the requirements, shape (S, m)."""
        program = StageProgram(problem=self.problem, nearest_to=self.start, counts=self.counts)
        rows = program.scaled(x, figures)[:, 1:]
        violations = violation_of(rows, program.low, program.high)
        possible = np.all(np.isfinite(figures), axis=1)
        # larger than that of any possible stage
        return np.where(possible[:, None], violations, 1e3)

    def costs(self, figures: Array) -> Array:
        """Return the goals for minimisation, shape (S, k)."""
        return figures[:, self.columns] * self.signs

    def feasible(self, x: Array, figures: Array) -> Bools:
        """Return which stages meet every requirement."""
        return np.all(self.violations(x, figures) <= 10.0 * FEASIBLE, axis=1)

    def feasible_so_far(self) -> Bools:
        """Return which of all evaluated stages meet every requirement."""
        return self.feasible(np.concatenate(self.points), np.concatenate(self.figures))

    def front(self) -> tuple[Array, Array]:
        """Return points, from 0 to 1, and figures of the front, in the order of the first goal."""
        feasible = self.feasible_so_far()
        x, figures = np.concatenate(self.points)[feasible], np.concatenate(self.figures)[feasible]
        if not len(x):
            raise ModelError(
                f"none of {self.counts['lumped']} stages meets all requirements: relax one, widen "
                "the bounds, or allow more evaluations"
            )
        costs = self.costs(figures)
        best = np.flatnonzero(non_dominated(costs))
        best = best[np.argsort(costs[best, 0], kind="stable")]
        return x[best], figures[best]


def _new_search(problem: Problem, options: SearchOptions, workers: Workers) -> _FrontSearch:
    family = problem.family
    start = family.usual if options.start == "described" else family.middle
    columns = {figure: i for i, figure in enumerate(problem.figures)}
    return _FrontSearch(
        problem=problem,
        options=options,
        workers=workers,
        start=np.clip(problem.position(start), 0.0, 1.0),
        signs=np.array([goal.sign for goal in problem.goals]),
        columns=[columns[goal.figure] for goal in problem.goals],
    )


def _goal_optima(search: _FrontSearch) -> Array:
    """Return the optimum of each goal alone: the ends of the front."""
    optima, goals = [], len(search.problem.goals)
    for goal in range(goals):
        progress.update(f"optimum of goal {goal + 1}", 0.1 * goal / goals)
        optimum = _local_optimum(search.program(goal, {}), search.start)
        if optimum is not None:
            optima.append(optimum)
    return np.array(optima).reshape(-1, len(search.start))


def _local_optimum(program: StageProgram, x: Array) -> Array | None:
    figures = program.figures(x[None])[0]
    if np.isfinite(figures[0]) and figures[0] != 0.0:
        program = replace(program, goal_reference=abs(float(figures[0])))
    optimum = local_search(program, x, steps=25, tolerance=1e-4)
    return None if optimum is None else optimum.point


def _evolve(search: _FrontSearch, optima: Array) -> int:
    """Evaluate generations until the evaluations are used up; return their number."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.evaluator import Evaluator
    from pymoo.core.population import Population
    from pymoo.core.problem import Problem as Bounds
    from pymoo.problems.static import StaticProblem
    from scipy.stats import qmc

    d, seed = len(search.start), search.options.seed
    sample = qmc.Sobol(d, rng=seed).random(2 ** int(np.log2(_POPULATION)))
    known = np.vstack([search.start[None], optima])
    first = np.vstack([known, sample[: max(_POPULATION - len(known), 0)]])
    bounds = Bounds(
        n_var=d,
        n_obj=len(search.problem.goals),
        n_ieq_constr=len(search.problem.all_requirements),
        xl=np.zeros(d),
        xu=np.ones(d),
    )
    sampling: Any = Population.new("X", first)
    algorithm = NSGA2(pop_size=len(first), sampling=sampling)
    algorithm.setup(bounds, termination=("n_gen", 10**6), seed=seed, verbose=False)
    generations = 0
    budget = search.options.budget(d) - _REFINED * 10 * (d + 1)
    while generations == 0 or search.counts["lumped"] + _POPULATION <= budget:
        population: Any = algorithm.ask()
        x = np.clip(np.asarray(population.get("X"), dtype=float), 0.0, 1.0)
        used, total = search.counts["lumped"], max(budget, 1)
        with progress.subtask(used / total, (used + len(x)) / total):
            figures = search.evaluate(x, f"generation {generations + 1}")
        costs = search.costs(np.where(np.isfinite(figures), figures, 0.0))
        static = StaticProblem(bounds, F=costs, G=search.violations(x, figures) - FEASIBLE)
        Evaluator().eval(static, population)
        algorithm.tell(infills=population)
        generations += 1
    return generations


def _refine(search: _FrontSearch) -> None:
    """Improve points of the front in the first goal, with the other goals as constraints."""
    x, values = search.front()
    optima = []
    for k in _spread(len(x), 0)[:_REFINED]:
        progress.update("refinement of the front")
        others = {i: float(values[k, c]) for i, c in enumerate(search.columns) if i > 0}
        optimum = _local_optimum(search.program(0, others), x[k])
        if optimum is not None:
            optima.append(optimum)
    if optima:
        search.evaluate(np.array(optima))


def _spread(count: int, selected: int) -> tuple[int, ...]:
    """Return indices of evenly spaced points of a front, with its ends and the selected one."""
    even = np.linspace(0, count - 1, min(_RECOMPUTED, count)).round().astype(int)
    return tuple(sorted({selected, *map(int, even)}))


def _improved(search: _FrontSearch, x: Array, values: Array) -> Optimum:
    """Optimise the first goal from a point, the others fixed at their values by the finer model."""
    model, problem, columns = search.options.model, search.problem, search.columns
    others = {i: float(values[c]) for i, c in enumerate(columns) if i > 0}
    point = problem.point(_rounded(search.program(0, others), x))
    finer = evaluate_with(search.workers, problem, point[None], model)[0]
    search.counts[model] += 1
    others = {i: float(finer[c]) for i, c in enumerate(columns) if i > 0}
    if not np.all(np.isfinite(list(others.values()))):
        raise ModelError(f"the {model} model has no figures of the selected stage")
    single = search.program(0, others).problem
    optimum = find_optimum(single, replace(search.options, starts=0), point)
    # the gain is relative to the start of the whole search
    start = problem.point(search.start)
    levels = []
    for level in optimum.levels:
        at_start = evaluate(single.family, start[None], optimum.figures, level.model)
        levels.append(replace(level, start=at_start.values[0]))
    notes = (*start_notes(problem, search.options), *optimum.notes)
    return replace(optimum, start=start, levels=tuple(levels), notes=notes)


def _rounded(program: StageProgram, x: Array) -> Array:
    """Return a rounded point; unchanged if it is impossible."""
    values, slopes = program.slopes(x)
    if not (np.all(np.isfinite(values)) and np.all(np.isfinite(slopes))):
        return x
    violation = float(violation_of(values[1:], program.low, program.high).sum())
    optimum = LocalOptimum(
        point=x, values=values, violation=violation, slopes=slopes, converged=False
    )
    return round_optimum(program, optimum)[1].point
