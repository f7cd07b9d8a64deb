"""Multi-fidelity search: finer models correct and confirm a search of the lumped model."""

import math
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.provenance import provenance
from flexstage.stage import check
from flexstage.studies.explore.family import evaluate
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.optimise.local_search import (
    FEASIBLE,
    Boundary,
    Iterate,
    LocalOptimum,
    local_search,
    violation_of,
)
from flexstage.studies.explore.optimise.optimum import (
    TOLERANCE,
    HistoryEntry,
    Iteration,
    Level,
    Optimum,
    SearchStep,
    find_active_constraints,
    new_names,
)
from flexstage.studies.explore.optimise.problem import Correction, Problem, StageProgram
from flexstage.studies.explore.optimise.rounding import is_rounded, round_optimum, rounded_point
from flexstage.studies.models import known_model

Start = Literal["described", "middle"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Effort:
    """Distribution of the evaluations; tuned on both stages of the study and on a guide."""

    per_variable: int = 250
    """Default number of evaluations for each variable."""
    sample: int = 64
    """Number of points from which further starts are selected."""
    most_steps: int = 60
    """Largest number of steps of a local search."""
    fewest_steps: int = 4
    """Least number of steps of a local search."""
    reserve: float = 0.4
    """Share of the evaluations for searches with the corrected model."""
    iterations: int = 12
    """Largest number of iterations with the finer model."""
    iteration_share: float = 0.4
    """Share of the remaining evaluations in one iteration."""
    reach: float = 0.4
    """Initial search range of an iteration, as a share of the bounds."""
    good_agreement: float = 1e-2
    """Relative difference of the models below which the search range grows."""
    agreement: float = 1e-3
    """Relative difference of the models at convergence."""
    learning: int = 2
    """Number of iterations until the correction has gradients of the difference of the models."""
    remaining_work: float = 0.67
    """Share of the work that remains after an iteration, for the progress display."""
    repairs: int = 3
    """Largest number of corrections by the confirming model."""
    repair_share: float = 0.1
    """Share of all evaluations for each of these corrections."""
    repair_reach: float = 0.1
    """Initial search range of these corrections, as a share of the bounds."""


_EFFORT = _Effort()
_VIOLATION_BY_ROUNDING = (
    "rounded to 0.001 mm and 0.001 deg the stage violates a requirement, and so do the "
    "neighbouring rounded values"
)
_UNROUNDED = (
    "no neighbouring stage with dimensions of whole 0.001 mm and 0.001 deg is possible: the "
    "dimensions are unrounded"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchOptions:
    """Options of a multi-fidelity search."""

    start: Start = "described"
    """Start point: the stage as ``described``, or the ``middle`` of all bounds."""
    model: str = "superelement"
    """Model that corrects the lumped one; ``lumped`` for no correction."""
    confirm: str | None = None
    """Finer model of `flexstage.studies.models` that confirms the optimum; None for no check."""
    evaluations: int | None = None
    """Largest number of evaluations of the lumped model; by default 250 times the number of
    variables plus two.
    """
    starts: int = 3
    """Number of further starts, for a search with a goal."""
    seed: int = 0
    """Seed of the further starts."""

    def __post_init__(self) -> None:
        if (self.evaluations is not None and self.evaluations < 1) or self.starts < 0:
            raise ModelError(
                f"a search needs at least 1 evaluation and 0 or more further starts, got "
                f"{self.evaluations} and {self.starts}"
            )
        if self.model not in ("lumped", "superelement"):
            raise ModelError(
                f"the model of a search must be lumped or superelement, got '{self.model}'"
            )
        if self.confirm is not None:
            known_model(self.confirm)
        if self.confirm == "lumped":
            raise ModelError("the confirming model must be finer than lumped")

    def budget(self, variables: int) -> int:
        """Return the largest number of evaluations of the lumped model."""
        default = _EFFORT.per_variable * (variables + 2)
        return default if self.evaluations is None else self.evaluations


def find_optimum(
    problem: Problem, options: SearchOptions | None = None, start: Array | None = None
) -> Optimum:
    """Return the optimum of one goal, or the nearest stage that meets the requirements.

    The lumped model is searched from the start and from the best points of a Sobol' sample
    (`local_search`). The finer model is evaluated at the optimum only. The ratio of both models, to
    first order about that point, corrects the lumped figures, which are searched again, until the
    finer model confirms the prediction (Bandler et al. 1994, IEEE Trans. MTT 42, 2536: space
    mapping; Echeverria, Hemker 2005: manifold mapping).

    Parameters
    ----------
    problem : Problem
        The problem, with one goal or none.
    options : SearchOptions, optional
        Options of the search.
    start : array, optional
        Start point in SI, shape (d,), instead of that of the options.

    Returns
    -------
    Optimum
        The optimum. If the requirements cannot all be met, it is the point of least violation, and
        the result says so.

    Raises
    ------
    ModelError
        No possible stage was found within the bounds.

    Notes
    -----
    Validity: a local optimum, the best of several starts. Multipliers are those of the corrected
    model, for small changes.
    """
    if len(problem.goals) > 1:
        raise ModelError("several goals have no single optimum: compute their Pareto front")
    search = _new_search(problem, options or SearchOptions(), start)
    lumped, confirm = search.options.model == "lumped", search.options.confirm
    ends = (0.9 if lumped else 0.5), (0.9 if confirm is None else 0.6)
    with progress.subtask(0.0, ends[0]):
        optimum = _rounded(search, _lumped_optimum(search))
    with progress.subtask(*ends):
        candidates = [_candidate(search, optimum)] if lumped else _iterate(search, optimum)
    with progress.subtask(ends[1], ends[1] + 0.1):
        best = _best_or_start(search, _best(problem, candidates) if candidates else None)
    if confirm is not None:
        with progress.subtask(ends[1] + 0.1, 0.9):
            best = _confirm(search, confirm, best)
        with progress.subtask(0.9, 1.0):
            best = _best_or_start(search, best)
    return _result(search, best)


def start_notes(problem: Problem, options: SearchOptions) -> tuple[str, ...]:
    """Return a note if the middle of the bounds is the described stage."""
    family = problem.family
    if options.start != "middle" or not np.allclose(family.middle, family.usual, rtol=1e-9):
        return ()
    return (
        "--start middle is the described stage here, as bounds in per cent are symmetric about its "
        "values: give ranges such as NAME=LOW..HIGH for another start",
    )


@dataclass(slots=True, kw_only=True, eq=False)
class _Candidate:
    """A point with figures of the finest model so far."""

    optimum: LocalOptimum
    """Optimum of the corrected model."""
    correction: Correction | None
    """Correction of the lumped model at that time."""
    figures: Array
    """Figures by the finest model."""
    violation: float
    """Largest violation of a requirement by the finest model."""
    objective: float
    """Objective by the finest model."""
    confirmed: bool = False
    """True if the figures are those of the confirming model."""


@dataclass(slots=True, kw_only=True)
class _Phase:
    """A phase of the search, for the progress display."""

    text: str
    """Name of the phase."""
    before: int
    """Evaluations of the lumped model before it."""
    share: float
    """Evaluations that it may use."""
    best: float = math.inf
    """Least feasible objective of the corrected model in this phase."""


@dataclass(slots=True, kw_only=True, eq=False)
class _Models:
    """Figures by the models of the result; each point is computed once."""

    problem: Problem
    evaluations: Counter[str]
    """Number of evaluations, by model."""
    figures: dict[tuple[str, bytes], Array] = field(default_factory=dict)
    """Computed figures, by model and point."""
    faults: dict[str, str] = field(default_factory=dict)
    """Last reason for missing figures, by model."""
    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    """Computing time by model [s]."""

    def at(self, model: str, x: Array) -> Array:
        """Return the figures of a point, variables from 0 to 1, by a model."""
        key = (model, x.tobytes())
        if key not in self.figures:
            began = time.perf_counter()
            point = rounded_point(self.problem, x)[None]
            evaluation = evaluate(self.problem.family, point, self.problem.figures, model)
            self.figures[key] = evaluation.values[0]
            if not np.all(np.isfinite(evaluation.values)):
                self.faults[model] = evaluation.faults[0] or "some of its figures are missing"
            self.seconds[model] += time.perf_counter() - began
            self.evaluations[model] += 1
        return self.figures[key]


@dataclass(slots=True, kw_only=True, eq=False)
class _Search:
    """State of a multi-fidelity search."""

    problem: Problem
    options: SearchOptions
    start: Array
    """Start point, variables from 0 to 1."""
    program: StageProgram
    """The lumped model with its current correction."""
    models: _Models
    """Figures of single points by all models."""
    budget: int
    """Largest number of evaluations of the lumped model."""
    notes: list[str]
    phase: _Phase = field(default_factory=lambda: _Phase(text="", before=0, share=1.0))
    searches: int = 0
    """Number of local searches."""
    history: list[HistoryEntry] = field(default_factory=list)
    """Accepted steps of all local searches."""
    iterations: list[Iteration] = field(default_factory=list)
    """Comparisons of the corrected model with finer ones."""
    boundaries: tuple[Boundary, ...] = ()
    """Boundaries of the possible stages that were located."""
    unrounded: dict[bytes, LocalOptimum] = field(default_factory=dict)
    """Optima before rounding, by the rounded point."""

    @property
    def used(self) -> int:
        """Number of evaluations of the lumped model so far."""
        return self.program.counts["lumped"]

    @property
    def remaining(self) -> float:
        """Remaining number of evaluations of the lumped model."""
        return float(self.budget - self.used)

    def begin(self, text: str, evaluations: float) -> None:
        """Begin a phase with a number of evaluations."""
        self.phase = _Phase(text=text, before=self.used, share=max(evaluations, 1.0))

    def compare(self, model: str, optimum: LocalOptimum, predicted: Array, computed: Array) -> None:
        """Record the figures of an optimum as predicted and as computed by a finer model."""
        self.iterations.append(
            Iteration(
                model=model,
                point=self.problem.point(optimum.point),
                predicted=predicted,
                computed=computed,
                evaluations=self.used,
            )
        )


def _new_search(problem: Problem, options: SearchOptions, start: Array | None) -> _Search:
    family, notes = problem.family, [*problem.notes]
    if start is None:
        notes += start_notes(problem, options)
        start = family.usual if options.start == "described" else family.middle
    x = problem.position(start)
    outside = (x < -1e-9) | (x > 1.0 + 1e-9)
    if outside.any():
        names = [family.names[k] for k in np.flatnonzero(outside)]
        raise ModelError(
            f"the stage as described lies outside the bounds of {', '.join(names[:3])}: "
            "widen them, or start from their middle with --start middle"
        )
    x = np.clip(x, 0.0, 1.0)
    program = StageProgram(problem=problem, nearest_to=x)
    return _Search(
        problem=problem,
        options=options,
        start=x,
        program=program,
        models=_Models(problem=problem, evaluations=program.counts),
        budget=options.budget(len(x)),
        notes=notes,
    )


# ------------------------------------------------------------------------ search of the lumped
# model


def _lumped_optimum(search: _Search) -> LocalOptimum:
    """Return the best optimum of the lumped model from the start and from further points."""
    options, program = search.options, search.program
    searches = 1 + (options.starts if search.problem.goals else 0)
    reserve = 0.0 if options.model == "lumped" else _EFFORT.reserve * search.budget
    optima: list[LocalOptimum] = []
    search.begin("", search.budget - reserve)
    for start in _start_points(search):
        share = (search.remaining - reserve) / max(searches - len(optima), 1)
        search.phase.text = f"lumped search {len(optima) + 1} of {searches}"
        optimum = None if program.fault(start) else _local_optimum(search, start, share)
        if optimum is not None:
            optima.append(optimum)
        if len(optima) >= searches and any(o.feasible for o in optima):
            break
        if len(optima) >= 2 * searches or (optima and search.remaining <= reserve):
            break
    if not optima:
        raise ModelError(
            "no search could begin, as some stages near every possible start are impossible: widen "
            "the bounds, or start elsewhere"
        )
    return min(optima, key=lambda o: (max(o.violation, 10.0 * FEASIBLE), o.values[0]))


def _start_points(search: _Search) -> Iterator[Array]:
    """Yield the start, then points of a sample: the best first, without a goal the nearest."""
    from scipy.stats import qmc

    start, program, goals = search.start, search.program, search.problem.goals
    start_figures = program.figures(start[None])
    start_possible = bool(np.all(np.isfinite(start_figures)))
    if start_possible:
        _set_goal_reference(search, start_figures)
        yield start
    count = min(_EFFORT.sample, max(search.budget // 20, 1))
    sampler = qmc.Sobol(len(start), rng=search.options.seed)
    sample = sampler.random(2 ** int(np.log2(count)))
    figures = program.figures(sample)
    possible = np.all(np.isfinite(figures), axis=1)
    if not start_possible and not possible.any():
        fault = program.fault(start) or "its figures cannot be computed"
        raise ModelError(
            f"none of {1 + len(sample)} stages within the bounds is possible; the start is not, as "
            f"{fault}"
        )
    if not start_possible:
        _set_goal_reference(search, figures[possible])
    values = search.program.scaled(sample, figures)
    if goals:
        violation = violation_of(values[:, 1:], program.low, program.high).sum(axis=1)
        rank = np.where(violation > 0.5, 10.0 + violation, values[:, 0] + violation)
    else:
        rank = np.linalg.norm(sample - start, axis=1)
    yield from (sample[i] for i in np.argsort(rank, kind="stable") if possible[i])


def _set_goal_reference(search: _Search, figures: Array) -> None:
    """Scale the goal by its first value."""
    if search.problem.goals and figures[0, 0] != 0.0:
        search.program = replace(search.program, goal_reference=abs(float(figures[0, 0])))


def _local_optimum(
    search: _Search, start: Array, evaluations: float, reach: float = 1.0
) -> LocalOptimum | None:
    """Search from a start, with a number of evaluations and a search range."""
    number, program, problem = search.searches, search.program, search.problem
    search.searches += 1

    def on_iterate(iterate: Iterate) -> None:
        _report(search, iterate)
        value = iterate.values[0]
        objective = program.goal_figure(value) if problem.goals else np.sqrt(2.0 * value)
        entry = HistoryEntry(
            search=number,
            evaluations=search.used,
            objective=float(objective),
            violation=iterate.violation,
        )
        search.history.append(entry)
        progress.hand_over(SearchStep(entry=entry, point=problem.point(iterate.point)))

    began, d = time.perf_counter(), len(start)
    optimum = local_search(
        program,
        start,
        steps=max(min(_EFFORT.most_steps, int(evaluations / (2 * d + 3))), _EFFORT.fewest_steps),
        curvature=None if problem.goals else np.eye(d),
        boundaries=search.boundaries,
        reach=reach,
        on_iterate=on_iterate,
    )
    search.models.seconds["lumped"] += time.perf_counter() - began
    if optimum is not None:
        search.boundaries = optimum.boundaries
    return optimum


def _report(search: _Search, iterate: Iterate) -> None:
    """Report the progress of the phase and its best objective."""
    phase, goals = search.phase, search.problem.goals
    if iterate.violation <= TOLERANCE:
        phase.best = min(phase.best, float(iterate.values[0]))
    text = phase.text
    if not np.isfinite(phase.best):
        text += f", requirements violated by {100.0 * iterate.violation:.2g} %"
    elif goals:
        figure, best = goals[0].figure, float(search.program.goal_figure(phase.best))
        text += f", best {figure.name} {figure.text(best)}"
    progress.update(text, (search.used - phase.before) / phase.share)


def _rounded(search: _Search, optimum: LocalOptimum) -> LocalOptimum:
    """Return an optimum with rounded dimensions, and remember the unrounded one."""
    unrounded, rounded = round_optimum(search.program, optimum)
    search.unrounded[rounded.point.tobytes()] = unrounded
    return rounded


# -------------------------------------------------------------------------- correction by finer
# models


def _candidate(
    search: _Search, optimum: LocalOptimum, fine_figures: Array | None = None
) -> _Candidate:
    """Return an optimum with objective and violation by the finest model so far."""
    program, x = search.program, optimum.point[None]
    figures = program.figures(x)[0] if fine_figures is None else fine_figures
    values = program.scaled(x, figures[None])[0]
    violation = violation_of(values[1:], program.low, program.high)
    return _Candidate(
        optimum=optimum,
        correction=program.correction,
        figures=figures,
        violation=float(np.max(violation, initial=0.0)),
        objective=float(values[0]),
    )


def _best(problem: Problem, candidates: Sequence[_Candidate]) -> _Candidate:
    """Return the candidate of least violation; of the feasible ones that of least objective."""
    least = TOLERANCE / 2.0 if problem.goals else 0.0
    return min(candidates, key=lambda c: (max(c.violation, least), c.objective))


def _agree(predicted: Array, computed: Array, tolerance: float) -> bool:
    limits = tolerance * np.maximum(np.abs(computed), 1e-12)
    return bool(np.all(np.abs(computed - predicted) <= limits))


def _iterate(search: _Search, optimum: LocalOptimum) -> list[_Candidate]:
    """Correct the lumped model and search it again, until it agrees with the finer model.

    A point without figures by the finer model is rejected.
    """
    model, reach = search.options.model, _EFFORT.reach
    candidates: list[_Candidate] = []
    points = [optimum.point]
    correction = Correction.none(len(optimum.point), len(search.problem.figures))
    for number in range(_EFFORT.iterations):
        # most searches converge in a few iterations: each has a third of the remaining progress
        ends = (1.0 - _EFFORT.remaining_work**n for n in (number, number + 1))
        with progress.subtask(*ends):
            name = f"iteration {number + 1}"
            search.begin(
                f"{name}: search of the lumped model corrected by {model}",
                _EFFORT.iteration_share * search.remaining,
            )
            with progress.subtask(0.0, 0.5):
                progress.update(f"{name}: {model} model")
                computed = search.models.at(model, optimum.point)
            x, current = optimum.point[None], search.program.correction
            lumped = search.program.uncorrected(x)
            predicted = (lumped if current is None else current.at_points(x, lumped))[0]
            search.compare(model, optimum, predicted, computed)
            possible = bool(np.all(np.isfinite(computed)))
            feasible = converged = False
            if possible:
                correction = correction.updated(optimum.point, lumped[0], computed)
                converged = _agree(predicted, computed, _EFFORT.agreement)
                search.program = search.program.corrected(correction)
                candidates.append(_candidate(search, optimum, computed))
                feasible = candidates[-1].violation <= TOLERANCE
            if (converged and feasible and number > 0) or search.remaining <= 0.0:
                break
            # the search range shrinks after a poor prediction, and after a violated requirement if
            # the correction should have predicted it
            good = possible and _agree(predicted, computed, _EFFORT.good_agreement)
            wider = good and (feasible or number < _EFFORT.learning)
            reach = min(1.0, 2.0 * reach) if wider else (0.3 if good else 0.5) * reach
            with progress.subtask(0.5, 1.0):
                following = _next_optimum(
                    search, optimum if possible else None, candidates, feasible, points, reach
                )
            if following is None:
                break
            optimum = following
            points.append(optimum.point)
    return candidates


def _next_optimum(
    search: _Search,
    optimum: LocalOptimum | None,
    candidates: list[_Candidate],
    feasible: bool,
    points: list[Array],
    reach: float,
) -> LocalOptimum | None:
    """Search from the last optimum; if that fails, from the best candidate and the start.

    None if all of these searches end at known points.
    """
    starts = [] if optimum is None else [(optimum.point, reach)]
    if not feasible:
        # no feasible point near the last one: search elsewhere
        best = [_best(search.problem, candidates).optimum.point] if candidates else []
        starts += [(x, 0.5 * reach) for x in best if optimum is None or x is not optimum.point]
        starts.append((search.start, reach if optimum is None else 1.0))
    for start, start_reach in starts:
        evaluations = _EFFORT.iteration_share * search.remaining
        following = _local_optimum(search, start, evaluations, start_reach)
        following = None if following is None else _rounded(search, following)
        if following is not None and all(
            np.max(np.abs(following.point - x)) >= 1e-6 for x in points
        ):
            return following
    return None


def _best_or_start(search: _Search, best: _Candidate | None) -> _Candidate:
    """Return the best candidate, or the start if that is better.

    Without a goal the start is better only if the candidate has a larger violation.

    Raises
    ------
    ModelError
        Neither has figures.
    """
    options = search.options
    confirmed = best is not None and best.confirmed and options.confirm is not None
    model = (options.confirm or "") if confirmed else options.model
    start = None if search.program.fault(search.start) else _start_candidate(search, model)
    if best is None and start is None:
        raise ModelError(
            f"the {model} model has no figures of the optima of the lumped model, nor of the "
            f"start: {search.models.faults.get(model, 'the start is impossible')}"
        )
    if best is None or start is None:
        return best or start  # type: ignore[return-value]
    violation, at_start = (c.violation if c.violation > TOLERANCE else 0.0 for c in (best, start))
    by_goal = bool(search.problem.goals) and at_start == violation
    better = at_start < violation or (by_goal and start.objective < best.objective)
    return start if better else best


def _start_candidate(search: _Search, model: str) -> _Candidate | None:
    """Return the start as a candidate by a model; None without figures."""
    program, x = search.program, search.start
    figures = search.models.at(model, x)
    if not np.all(np.isfinite(figures)):
        return None
    correction = _correction_at(search, x, figures, program.correction)
    values = program.scaled(x[None], figures[None])[0]
    violation = violation_of(values[1:], program.low, program.high)
    start = LocalOptimum(
        point=x,
        values=values,
        violation=float(violation.sum()),
        slopes=np.zeros((len(values), len(x))),
        boundaries=search.boundaries,
        converged=False,
    )
    confirmed = model == search.options.confirm
    return replace(_candidate(search, start, figures), correction=correction, confirmed=confirmed)


def _correction_at(
    search: _Search, x: Array, computed: Array, previous: Correction | None
) -> Correction:
    """Return the correction that is exact at a point, with the gradients of a previous one."""
    lumped = search.program.uncorrected(x[None])[0]
    exact = Correction.none(len(x), len(computed)).updated(x, lumped, computed)
    return exact if previous is None else replace(exact, slope=previous.slope)


def _confirm(search: _Search, model: str, best: _Candidate) -> _Candidate:
    """Evaluate the confirming model; correct and search again if it violates a requirement."""
    predicted, last = best.figures, _EFFORT.repairs
    candidates: list[_Candidate] = []
    for number in range(1 + last):
        with progress.subtask(number / (1 + last), (number + 0.8) / (1 + last)):
            progress.update(f"confirmation by {model}")
            computed = search.models.at(model, best.optimum.point)
        search.compare(model, best.optimum, predicted, computed)
        x, possible = best.optimum.point, bool(np.all(np.isfinite(computed)))
        # the gradients of the confirming model are taken as those of the corrected one
        exact = _correction_at(search, x, computed, best.correction)
        if possible:
            search.program = search.program.corrected(exact)
        best = replace(_candidate(search, best.optimum, computed), confirmed=True)
        candidates.append(best)
        if best.violation <= TOLERANCE or not possible or number == last:
            break
        # only few points of the confirming model are known: search nearby
        evaluations = max(search.remaining, _EFFORT.repair_share * search.budget)
        search.begin(f"search of the lumped model corrected by {model}", evaluations)
        with progress.subtask((number + 0.8) / (1 + last), (number + 1.0) / (1 + last)):
            repaired = _local_optimum(search, x, evaluations, _EFFORT.repair_reach / 2**number)
        if repaired is None:
            break
        best = replace(best, optimum=_rounded(search, repaired))
        predicted = search.program.figures(best.optimum.point[None])[0]
    return _best(search.problem, candidates)


# ------------------------------------------------------------------------------------------ the
# result


def _result(search: _Search, best: _Candidate) -> Optimum:
    problem, options, models, notes = search.problem, search.options, search.models, search.notes
    if best.correction is not None:
        search.program = search.program.corrected(best.correction)
    x = best.optimum.point
    # constraints are active at the unrounded optimum: rounding moves it off them
    unrounded = search.unrounded.get(x.tobytes(), best.optimum)
    values, slopes = search.program.slopes(unrounded.point)
    at_optimum = replace(unrounded, values=values, slopes=slopes)
    constraints, free_directions, residual = find_active_constraints(search.program, at_optimum)
    if x is search.start:
        notes.append("no better stage than the start was found")
    elif best.optimum.violation > TOLERANCE >= unrounded.violation:
        notes.append(_VIOLATION_BY_ROUNDING)
    start, point = rounded_point(problem, search.start), rounded_point(problem, x)
    if x is not search.start and not is_rounded(problem, point):
        notes.append(_UNROUNDED)
    name, title = new_names(problem)
    stage = replace(problem.family.stage(point), name=name, title=title)
    notes += [issue.message for issue in check(stage) if issue.severity == "error"]
    names = [m for m in ("lumped", options.model, options.confirm) if m is not None]
    levels = [
        Level(model=m, start=models.at(m, search.start), best=models.at(m, x))
        for m in dict.fromkeys(names)
    ]
    notes += _stack_notes(problem, np.array([start, point]))
    return Optimum(
        problem=problem,
        stage=stage,
        text=problem.family.text(point, name=name, title=title),
        start=start,
        point=point,
        levels=tuple(levels),
        active_constraints=constraints,
        free_directions=free_directions,
        stationarity_residual=residual,
        iterations=tuple(search.iterations),
        history=tuple(search.history),
        evaluations=dict(search.program.counts),
        seconds=dict(models.seconds),
        seed=options.seed,
        notes=tuple(notes),
        provenance=provenance(stage),
    )


def _stack_notes(problem: Problem, points: Array) -> Iterator[str]:
    """Yield the natural frequency with stack of each axis whose frequency without it is used."""
    figures = [
        Figure(quantity="natural_frequency_with_stack_hz", axis=f.axis)
        for f in problem.figures
        if f.quantity == "natural_frequency_hz"
    ]
    values = evaluate(problem.family, points, figures, "lumped").values
    for figure, row in zip(figures, values.T, strict=True):
        # NaN for an axis without stacks, and for a start with a published frequency
        ends = zip(row.tolist(), ("the start", "the optimum"), strict=True)
        texts = [f"{figure.text(v)} at {end}" for v, end in ends if np.isfinite(v)]
        if texts:
            yield (
                f"natural_frequency.{figure.axis} is without stack; with stack it is "
                f"{' and '.join(texts)}, by the lumped model ({figure.name})"
            )
