"""Pareto fronts: what several goals cost each other, and the design that is chosen of it."""

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
from flexstage.studies.explore.optimise.multi_fidelity import SearchOptions, find_optimum, start_notes
from flexstage.studies.explore.optimise.local_search import (
    FEASIBLE,
    Bools,
    LocalOptimum,
    local_search,
    violation_of,
)
from flexstage.studies.explore.optimise.optimum import Optimum
from flexstage.studies.explore.optimise.problem import HeldGoal, Problem, StageProgram
from flexstage.studies.explore.optimise.rounding import drawn
from flexstage.studies.explore.workers import Workers

# points of the front that are searched on by slopes
_REFINED = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Generation:
    """Stages that a search for a front looked at, as they are handed over to who watches."""

    points: Array
    """The variables, in SI, shape (S, d)."""
    values: Array
    """Figures of the problem by the lumped model, shape (S, F)."""
    kept: Bools
    """Which keep every requirement, shape (S,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Front(Result):
    """Stages of which none is better in every goal than another."""

    table_key: ClassVar[str] = "front"

    problem: Problem
    """What was sought."""
    points: Array
    """The variables in SI, shape (N, d), along the front by the first goal."""
    values: Array
    """Figures by the lumped model, shape (N, F)."""
    model: str
    """The finer model that was asked."""
    asked: tuple[int, ...]
    """Which points it was asked about."""
    found: Array
    """Figures by the finer model, shape (K, F)."""
    chosen: int
    """Which point was chosen."""
    optimum: Optimum
    """The chosen design, made better on the ladder at the same values of all other goals."""
    generations: int
    """Generations that were bred."""
    evaluations: Mapping[str, int]
    """Evaluations by model, those of `optimum` left out."""
    searched: Array = field(repr=False)
    """Figures of all stages on the way that keep every requirement, shape (M, F)."""

    __repr__ = short_repr

    def data(self) -> dict[str, Any]:
        names, named = self.problem.family.names, self.problem.named
        return {
            **self.problem.data(),
            "front": [
                {"variables": dict(zip(names, plain(point), strict=True)), "lumped": named(values)}
                for point, values in zip(self.points, self.values, strict=True)
            ],
            "asked": [
                {"point": number, self.model: named(values)}
                for number, values in zip(self.asked, self.found, strict=True)
            ],
            **picked(self, "chosen", "generations", "evaluations"),
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

    The front is bred from a Sobol' sample and from the best stage by each goal alone (NSGA-II, Deb
    et al. 2002, IEEE Trans. Evolutionary Computation 6, 182), then some of its points are searched
    on by slopes: the first goal, the others no worse than they are (Haimes et al. 1971). The chosen
    design is the knee, which is nearest to the best of all goals in parts of what the front spans;
    the ladder makes it better in the first goal by the finer model, the others held where they are:
    so its multipliers are the rates of exchange.

    Parameters
    ----------
    problem : Problem
        What is sought; two goals or more.
    options : SearchOptions, optional
        How it is searched.
    workers : Workers, optional
        Who evaluates the stages of a generation.

    Returns
    -------
    Front
        The front; the same whatever the number of workers.

    Raises
    ------
    ModelError
        There are not two goals, or no stage keeps the requirements.

    Notes
    -----
    Validity: by the lumped model, but for the points that the finer one was asked about; the front
    is as complete as the evaluations allow.
    """
    if len(problem.goals) < 2:
        raise ModelError("a Pareto front needs two goals: with one there is a best stage")
    require_extra("explore", "pymoo", "a Pareto front", ModelError)
    search = _FrontSearch(problem, options or SearchOptions(), workers or Workers(1))
    return search.run()


def non_dominated(costs: Array) -> Bools:
    """Return which rows of costs (N, k) no other row betters in one column without loss in another.

    Examples
    --------
    >>> non_dominated(np.array([[1.0, 3.0], [2.0, 2.0], [2.0, 4.0]]))
    array([ True,  True, False])
    """
    keep = np.ones(len(costs), dtype=bool)
    for i, row in enumerate(costs):
        below = np.all(costs <= row, axis=1) & np.any(costs < row, axis=1)
        # of equal ones the first
        below |= np.all(costs == row, axis=1) & (np.arange(len(costs)) < i)
        keep[i] = not below.any()
    return keep


def knee_of(costs: Array) -> int:
    """Return the row of a front (N, k) that is nearest to the best of all, in parts of its spans.

    Examples
    --------
    >>> knee_of(np.array([[0.0, 10.0], [1.0, 2.0], [5.0, 0.0]]))
    1
    """
    span = np.ptp(costs, axis=0)
    scaled = (costs - costs.min(axis=0)) / np.where(span > 0.0, span, 1.0)
    return int(np.argmin(np.linalg.norm(scaled, axis=1)))


def evaluate_rows(payload: Any, start: int, stop: int) -> dict[str, Array]:
    """Evaluate some points of a generation: the work of a job."""
    problem, points, model = payload
    values = evaluate(problem.family, points[start:stop], problem.figures, model).values
    for row, point in zip(values, points[start:stop], strict=True):
        if np.all(np.isfinite(row)) and problem.fault(point):
            row[:] = np.nan
    return {"values": values}


def evaluate_with(
    workers: Workers, problem: Problem, points: Array, model: str, name: str = "optimise"
) -> Array:
    """Return figures (S, F) of points (S, d) in SI, shared by workers; NaN of what is at fault."""
    job = Job(
        name=name,
        work=evaluate_rows,
        payload=(problem, points, model),
        count=len(points),
        batch=6,  # of the 48 stages of a generation
    )
    return workers.run(job)["values"]


class _FrontSearch:
    """One search for a front."""

    def __init__(self, problem: Problem, options: SearchOptions, workers: Workers) -> None:
        self.problem, self.options, self.workers = problem, options, workers
        family = problem.family
        start = family.usual if options.start == "described" else family.middle
        self.start = np.clip(problem.position(start), 0.0, 1.0)
        self.signs = np.array([goal.sign for goal in problem.goals])
        at = {figure: i for i, figure in enumerate(problem.figures)}
        self.columns = [at[goal.figure] for goal in problem.goals]
        self.counts: Counter[str] = Counter()
        self.points: list[Array] = []
        self.figures: list[Array] = []

    def run(self) -> Front:
        with progress.subtask(0.0, 0.6):
            generations = self._breed(self._ends())
        with progress.subtask(0.6, 0.7):
            self._refine()
        x, values = self._front()
        chosen = knee_of(self._costs(values))
        asked = self._spread(len(x), chosen)
        model = self.options.model
        problem = self.problem
        with progress.subtask(0.7, 0.8):
            progress.update(f"front by {model}")
            points = problem.point(x)
            found = evaluate_with(self.workers, problem, points[list(asked)], model)
            self.counts[model] += len(asked)
        with progress.subtask(0.8, 1.0):
            optimum = self._choose(x[chosen], values[chosen])
        kept = self._feasible()
        return Front(
            problem=problem,
            points=points,
            values=values,
            model=model,
            asked=asked,
            found=found,
            chosen=chosen,
            optimum=optimum,
            generations=generations,
            evaluations=dict(self.counts),
            searched=np.concatenate(self.figures)[kept],
        )

    # ------------------------------------------------------------------ figures

    def _program(self, goal: int, held: Mapping[int, float]) -> StageProgram:
        """Return the problem of one goal, the others no worse than some values."""
        problem = self.problem
        others = tuple(HeldGoal(goal=problem.goals[i], value=value) for i, value in held.items())
        one = replace(problem, goals=(problem.goals[goal],), exchanged=others)
        return StageProgram(problem=one, nearest_to=self.start, counts=self.counts)

    def _all(self) -> StageProgram:
        """Return the problem as a program, for its requirements alone."""
        return StageProgram(problem=self.problem, nearest_to=self.start, counts=self.counts)

    def _evaluate(self, x: Array, name: str = "optimise") -> Array:
        """Evaluate points from 0 to 1, and remember them."""
        problem = self.problem
        found = evaluate_with(self.workers, problem, problem.point(x), "lumped", name)
        self.counts["lumped"] += len(x)
        self.points.append(x)
        self.figures.append(found)
        kept = self._kept(x, found)
        progress.hand_over(Generation(points=problem.point(x), values=found, kept=kept))
        return found

    def _violations(self, x: Array, figures: Array) -> Array:
        program = self._all()
        rows = program.scaled(x, figures)[:, 1:]
        off = violation_of(rows, program.low, program.high)
        possible = np.all(np.isfinite(figures), axis=1)
        # an impossible stage is off its limits by more than any that is possible
        return np.where(possible[:, None], off, 1e3)

    def _costs(self, figures: Array) -> Array:
        return figures[:, self.columns] * self.signs

    def _kept(self, x: Array, figures: Array) -> Bools:
        """Say which stages keep every requirement."""
        return np.all(self._violations(x, figures) <= 10.0 * FEASIBLE, axis=1)

    def _feasible(self) -> Bools:
        return self._kept(np.concatenate(self.points), np.concatenate(self.figures))

    # ------------------------------------------------------------------ the search

    def _ends(self) -> Array:
        """Return the best stages by each goal alone: the ends of the front."""
        ends = []
        for goal in range(len(self.problem.goals)):
            progress.update(f"best by goal {goal + 1}", 0.1 * goal / len(self.problem.goals))
            if (end := self._search(self._program(goal, {}), self.start)) is not None:
                ends.append(end)
        return np.array(ends).reshape(-1, len(self.start))

    def _search(self, program: StageProgram, x: Array) -> Array | None:
        first = program.figures(x[None])[0]
        if np.isfinite(first[0]) and first[0] != 0.0:
            program = replace(program, goal_reference=abs(float(first[0])))
        found = local_search(program, x, steps=25, tolerance=1e-4)
        return None if found is None else found.point

    def _breed(self, ends: Array) -> int:
        """Breed generations until the evaluations are used up."""
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.evaluator import Evaluator
        from pymoo.core.population import Population
        from pymoo.core.problem import Problem as Bounds
        from pymoo.problems.static import StaticProblem
        from scipy.stats import qmc

        d = len(self.start)
        population = 48  # stages of a generation
        sample = qmc.Sobol(d, rng=self.options.seed).random(2 ** int(np.log2(population)))
        known = np.vstack([self.start[None], ends])
        first = np.vstack([known, sample[: max(population - len(known), 0)]])
        requirements = len(self.problem.all_requirements)
        bounds = Bounds(
            n_var=d,
            n_obj=len(self.problem.goals),
            n_ieq_constr=requirements,
            xl=np.zeros(d),
            xu=np.ones(d),
        )
        sampling: Any = Population.new("X", first)
        algorithm = NSGA2(pop_size=len(first), sampling=sampling)
        algorithm.setup(bounds, termination=("n_gen", 10**6), seed=self.options.seed, verbose=False)
        generations = 0
        budget = self.options.budget(d) - _REFINED * 10 * (d + 1)
        while generations == 0 or self.counts["lumped"] + population <= budget:
            bred: Any = algorithm.ask()
            x = np.clip(np.asarray(bred.get("X"), dtype=float), 0.0, 1.0)
            done = self.counts["lumped"]
            with progress.subtask(done / max(budget, 1), (done + len(x)) / max(budget, 1)):
                figures = self._evaluate(x, f"generation {generations + 1}")
            costs = np.where(np.isfinite(figures), figures, 0.0)[:, self.columns] * self.signs
            static = StaticProblem(bounds, F=costs, G=self._violations(x, figures) - FEASIBLE)
            Evaluator().eval(static, bred)
            algorithm.tell(infills=bred)
            generations += 1
        return generations

    def _refine(self) -> None:
        """Search on from some points of the front, the other goals no worse than they are."""
        x, values = self._front()
        better = []
        for k in self._spread(len(x), 0)[:_REFINED]:
            progress.update("refine the front")
            held = {i: float(values[k, self.columns[i]]) for i in range(1, len(self.columns))}
            if (found := self._search(self._program(0, held), x[k])) is not None:
                better.append(found)
        if better:
            self._evaluate(np.array(better))

    def _front(self) -> tuple[Array, Array]:
        """Return the points from 0 to 1 and the figures of the front, by the first goal."""
        kept = self._feasible()
        x, figures = np.concatenate(self.points)[kept], np.concatenate(self.figures)[kept]
        if not len(x):
            raise ModelError(
                f"none of {self.counts['lumped']} stages keeps all requirements: relax one, widen "
                "the bounds, or allow more evaluations"
            )
        costs = self._costs(figures)
        best = np.flatnonzero(non_dominated(costs))
        best = best[np.argsort(costs[best, 0], kind="stable")]
        return x[best], figures[best]

    def _spread(self, count: int, chosen: int) -> tuple[int, ...]:
        """Return six points along the front, evenly, with the ends and the chosen one."""
        evenly = np.linspace(0, count - 1, min(6, count)).round().astype(int)
        return tuple(sorted({chosen, *map(int, evenly)}))

    def _choose(self, x: Array, values: Array) -> Optimum:
        """Climb the ladder from a point, the other goals held at what the finer model says."""
        model, others = self.options.model, range(1, len(self.columns))
        program = self._program(0, {i: float(values[self.columns[i]]) for i in others})
        point = self.problem.point(self._drawn(program, x))
        found = evaluate_with(self.workers, self.problem, point[None], model)[0]
        self.counts[model] += 1
        held = {i: float(found[self.columns[i]]) for i in others}
        if not np.all(np.isfinite(list(held.values()))):
            raise ModelError(f"the {model} model has no figures of the chosen stage")
        problem = self._program(0, held).problem
        optimum = find_optimum(problem, replace(self.options, starts=0), point)
        # what was gained counts from the start of the whole search
        start = self.problem.point(self.start)
        levels = []
        for level in optimum.levels:
            at_start = evaluate(problem.family, start[None], optimum.figures, level.model)
            levels.append(replace(level, start=at_start.values[0]))
        notes = (*start_notes(self.problem, self.options), *optimum.notes)
        return replace(optimum, start=start, levels=tuple(levels), notes=notes)

    def _drawn(self, program: StageProgram, x: Array) -> Array:
        """Return a point as a drawing has it; as it is where that is no stage."""
        values, slopes = program.slopes(x)
        if not (np.all(np.isfinite(values)) and np.all(np.isfinite(slopes))):
            return x
        off = violation_of(values[1:], program.low, program.high).sum()
        here = LocalOptimum(
            point=x, values=values, violation=float(off), slopes=slopes, converged=False
        )
        return drawn(program, here)[1].point
