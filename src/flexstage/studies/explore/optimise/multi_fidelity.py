"""The ladder: a quick model is searched, finer ones correct it and confirm what is found."""

import math
import time
from collections import defaultdict
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
    Iterate,
    LocalOptimum,
    Wall,
    local_search,
    violation_of,
)
from flexstage.studies.explore.optimise.optimum import (
    TOLERANCE,
    Level,
    Optimum,
    Rung,
    SearchStep,
    Trace,
    held_by,
    new_names,
)
from flexstage.studies.explore.optimise.problem import Correction, Problem, StageProgram
from flexstage.studies.explore.optimise.rounding import drawn, drawn_point, is_drawn
from flexstage.studies.models import known_model

Start = Literal["described", "middle"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Effort:
    """How the evaluations are divided; tried on both stages of the study and on a guide."""

    each: int = 250
    """Evaluations at most for each variable, where the options say nothing."""
    sample: int = 64
    """Points that starts are chosen from."""
    steps: int = 60
    """Steps of a search at most."""
    fewest_steps: int = 4
    """Steps of a search at least."""
    reserve: float = 0.4
    """Share of the evaluations that is kept for the ladder."""
    turns: int = 12
    """Turns of the ladder at most."""
    again: float = 0.4
    """Share of the evaluations left that a turn of the ladder may use."""
    reach: float = 0.4
    """How far the second turn may go, in parts of the bounds."""
    near: float = 1e-2
    """Agreement of two models that lets the next turn go further."""
    agreed: float = 1e-3
    """Agreement of two models at which the ladder ends."""
    alike: int = 2
    """Turns after which the correction has seen how the models differ nearby."""
    rest: float = 0.67
    """What a turn leaves of the work that is left, as it is shown."""
    mended: int = 3
    """How often what the finest model finds missed is mended."""
    mending: float = 0.1
    """Share of all evaluations that is left for each time."""
    close: float = 0.1
    """How far that search may go at first, in parts of the bounds."""


_EFFORT = _Effort()
_ROUNDED_OFF = (
    "rounded to 0.001 mm and 0.001 deg the stage misses what is required, and so do those beside it"
)
_UNROUNDED = (
    "no stage nearby of whole 0.001 mm and 0.001 deg is possible: the dimensions are as they were "
    "found, with all their digits"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchOptions:
    """How it is searched."""

    start: Start = "described"
    """``described``: the stage as it is; ``middle`` of all bounds."""
    model: str = "superelement"
    """The model that corrects the lumped one; ``lumped`` for none."""
    confirm: str | None = None
    """A finer model that confirms the best, of `flexstage.studies.models`; None for none."""
    evaluations: int | None = None
    """Evaluations of the lumped model at most; 250 for each variable, and for two more, where None.
    """
    starts: int = 3
    """Starts beside the given one, for a goal."""
    seed: int = 0
    """Seed of the other starts."""

    def __post_init__(self) -> None:
        if (self.evaluations is not None and self.evaluations < 1) or self.starts < 0:
            raise ModelError(
                f"a search needs at least one evaluation, and no fewer than 0 other starts, got "
                f"{self.evaluations} and {self.starts}"
            )
        if self.model not in ("lumped", "superelement"):
            raise ModelError(f"lumped or superelement corrects a search, got '{self.model}'")
        if self.confirm is not None:
            known_model(self.confirm)
        if self.confirm == "lumped":
            raise ModelError("a finer model than lumped confirms what a search finds")

    def budget(self, variables: int) -> int:
        """Return how many evaluations of the lumped model there may be."""
        return _EFFORT.each * (variables + 2) if self.evaluations is None else self.evaluations


def find_optimum(
    problem: Problem, options: SearchOptions | None = None, start: Array | None = None
) -> Optimum:
    """Return the best stage of a family by one goal, or the nearest that meets what is required.

    The lumped model is searched from the start and from the best of a Sobol' sample
    (`local_search`). The finer model is asked at the optimum only; the ratio of both, to first
    order about there, corrects the lumped figures, which are searched again, until the finer model
    says what was expected (Bandler et al. 1994, IEEE Trans. MTT 42, 2536: space mapping;
    Echeverria, Hemker 2005: manifold mapping).

    Parameters
    ----------
    problem : Problem
        What is sought; with one goal or none.
    options : SearchOptions, optional
        How it is searched.
    start : array, optional
        Where to start, in SI, shape (d,), instead of what the options say.

    Returns
    -------
    Optimum
        The best stage that was found. Where not all requirements can be met it is the one that
        misses them least, and says so.

    Raises
    ------
    ModelError
        No stage is possible between the bounds, as far as was looked.

    Notes
    -----
    Validity: a local optimum, the best of several starts. Multipliers are those of the corrected
    model, for small changes.
    """
    if len(problem.goals) > 1:
        raise ModelError("several goals have no single best: ask for their Pareto front")
    search = _begun(problem, options or SearchOptions(), start)
    lumped, confirm = search.options.model == "lumped", search.options.confirm
    ends = (0.9 if lumped else 0.5), (0.9 if confirm is None else 0.6)
    with progress.subtask(0.0, ends[0]):
        best = _drawn(search, _first(search))
    with progress.subtask(*ends):
        visited = [_visit(search, best)] if lumped else _climb(search, best)
    with progress.subtask(ends[1], ends[1] + 0.1):
        chosen = _or_start(search, _best_of(problem, visited) if visited else None)
    if confirm is not None:
        with progress.subtask(ends[1] + 0.1, 0.9):
            chosen = _confirm(search, confirm, chosen)
        with progress.subtask(0.9, 1.0):
            chosen = _or_start(search, chosen)
    return _optimum(search, chosen)


def start_notes(problem: Problem, options: SearchOptions) -> tuple[str, ...]:
    """Say where the middle of the bounds is the stage as it is described."""
    family = problem.family
    if options.start != "middle" or not np.allclose(family.middle, family.usual, rtol=1e-9):
        return ()
    return (
        "--start middle begins where the stage is already: bounds in per cent lie evenly about the "
        "described values, so give ranges such as NAME=LOW..HIGH for another start",
    )


@dataclass(slots=True, kw_only=True, eq=False)
class _Visited:
    """A point that the finest model was asked about."""

    optimum: LocalOptimum
    correction: Correction | None
    fine: Array
    violation: float
    objective: float
    confirmed: bool = False


@dataclass(slots=True, kw_only=True)
class _Phase:
    """A part of the work, as progress tells it."""

    text: str
    """What is done."""
    before: int
    """Evaluations of the searched model before it."""
    share: float
    """Evaluations that it may use."""
    best: float = math.inf
    """Least objective so far that keeps the limits, by the model as it is corrected in it."""


@dataclass(slots=True, kw_only=True, eq=False)
class _Ladder:
    """What is searched, and what has been found so far."""

    problem: Problem
    options: SearchOptions
    start: Array
    """Where it begins, variables from 0 to 1."""
    program: StageProgram
    """The searched model, as it is corrected by now."""
    budget: int
    """Evaluations of the searched model in all."""
    notes: list[str]
    phase: _Phase = field(default_factory=lambda: _Phase(text="", before=0, share=1.0))
    searches: int = 0
    trace: list[Trace] = field(default_factory=list)
    rungs: list[Rung] = field(default_factory=list)
    walls: tuple[Wall, ...] = ()
    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    known: dict[tuple[str, bytes], Array] = field(default_factory=dict)
    """Figures of points by the models that were asked."""
    why: dict[str, str] = field(default_factory=dict)
    """Why a model had no figures of a point."""
    exact: dict[bytes, LocalOptimum] = field(default_factory=dict)
    """Optima before they were rounded, by the point that a drawing has."""

    @property
    def used(self) -> int:
        """Evaluations of the searched model so far."""
        return self.program.counts["lumped"]

    @property
    def left(self) -> float:
        """Evaluations of the searched model that are left."""
        return float(self.budget - self.used)

    def begin(self, text: str, evaluations: float) -> None:
        """Begin a phase in which so many evaluations may be used."""
        self.phase = _Phase(text=text, before=self.used, share=max(evaluations, 1.0))


def _begun(problem: Problem, options: SearchOptions, start: Array | None) -> _Ladder:
    family, notes = problem.family, [*problem.notes]
    if start is None:
        notes += start_notes(problem, options)
        start = family.usual if options.start == "described" else family.middle
    at = problem.position(start)
    outside = (at < -1e-9) | (at > 1.0 + 1e-9)
    if outside.any():
        names = [family.names[k] for k in np.flatnonzero(outside)]
        raise ModelError(
            f"the stage as described lies outside the bounds of {', '.join(names[:3])}: "
            "widen them, or start from their middle with --start middle"
        )
    at = np.clip(at, 0.0, 1.0)
    return _Ladder(
        problem=problem,
        options=options,
        start=at,
        program=StageProgram(problem=problem, nearest_to=at),
        budget=options.budget(len(at)),
        notes=notes,
    )


# ---------------------------------------------------------------------- searching the quick model


def _first(search: _Ladder) -> LocalOptimum:
    """Search from the start, and from others where that may find better."""
    options, program = search.options, search.program
    wanted = 1 + (options.starts if search.problem.goals else 0)
    reserve = 0.0 if options.model == "lumped" else _EFFORT.reserve * search.budget
    found: list[LocalOptimum] = []
    search.begin("", search.budget - reserve)
    for start in _starts(search):
        share = (search.left - reserve) / max(wanted - len(found), 1)
        search.phase.text = f"lumped search {len(found) + 1} of {wanted}"
        one = None if program.fault(start) else _searched(search, start, share)
        if one is not None:
            found.append(one)
        if len(found) >= wanted and any(f.feasible for f in found):
            break
        if len(found) >= 2 * wanted or (found and search.left <= reserve):
            break
    if not found:
        raise ModelError(
            "no search could begin: around every possible start some stages are impossible; "
            "widen the bounds or start elsewhere"
        )
    return min(found, key=lambda f: (max(f.violation, 10.0 * FEASIBLE), f.values[0]))


def _starts(search: _Ladder) -> Iterator[Array]:
    """Yield the given start, then others: the best of a sample, without a goal the nearest."""
    from scipy.stats import qmc

    start, program, goals = search.start, search.program, search.problem.goals
    first = program.figures(start[None])
    possible = bool(np.all(np.isfinite(first)))
    if possible:
        _measure_goal(search, first)
        yield start
    count = min(_EFFORT.sample, max(search.budget // 20, 1))
    sampler = qmc.Sobol(len(start), rng=search.options.seed)
    sample = sampler.random(2 ** int(np.log2(count)))
    figures = program.figures(sample)
    ok = np.all(np.isfinite(figures), axis=1)
    if not possible and not ok.any():
        fault = program.fault(start) or "its figures cannot be computed"
        raise ModelError(
            f"none of {1 + len(sample)} stages between the bounds is possible; of the start: "
            f"{fault}"
        )
    if not possible:
        _measure_goal(search, figures[ok])
    values = search.program.scaled(sample, figures)
    if goals:
        off = violation_of(values[:, 1:], program.low, program.high).sum(axis=1)
        rank = np.where(off > 0.5, 10.0 + off, values[:, 0] + off)
    else:
        rank = np.linalg.norm(sample - start, axis=1)
    yield from (sample[i] for i in np.argsort(rank, kind="stable") if ok[i])


def _measure_goal(search: _Ladder, figures: Array) -> None:
    """Measure the goal by what it is at first."""
    if search.problem.goals and figures[0, 0] != 0.0:
        search.program = replace(search.program, goal_reference=abs(float(figures[0, 0])))


def _searched(
    search: _Ladder, start: Array, evaluations: float, reach: float = 1.0
) -> LocalOptimum | None:
    """Search from a start with so many evaluations, as far as `reach`."""
    number, program, problem = search.searches, search.program, search.problem
    search.searches += 1

    def on_iterate(iterate: Iterate) -> None:
        _tell(search, iterate)
        value = iterate.values[0]
        objective = program.goal_figure(value) if problem.goals else np.sqrt(2.0 * value)
        step = Trace(
            search=number,
            evaluations=search.used,
            objective=float(objective),
            violation=iterate.violation,
        )
        search.trace.append(step)
        progress.hand_over(SearchStep(trace=step, point=problem.point(iterate.point)))

    began, d = time.perf_counter(), len(start)
    found = local_search(
        program,
        start,
        steps=max(min(_EFFORT.steps, int(evaluations / (2 * d + 3))), _EFFORT.fewest_steps),
        curvature=None if problem.goals else np.eye(d),
        walls=search.walls,
        reach=reach,
        told=on_iterate,
    )
    search.seconds["lumped"] += time.perf_counter() - began
    if found is not None:
        search.walls = found.walls
    return found


def _tell(search: _Ladder, iterate: Iterate) -> None:
    """Say how far the work has come, and the figure that it has come to."""
    phase, goals = search.phase, search.problem.goals
    if iterate.violation <= TOLERANCE:
        phase.best = min(phase.best, float(iterate.values[0]))
    text = phase.text
    if not np.isfinite(phase.best):
        text += f", requirements missed by {100.0 * iterate.violation:.2g} %"
    elif goals:
        figure, best = goals[0].figure, float(search.program.goal_figure(phase.best))
        text += f", best {figure.name} {figure.text(best)}"
    progress.update(text, (search.used - phase.before) / phase.share)


def _drawn(search: _Ladder, found: LocalOptimum) -> LocalOptimum:
    """Return an optimum as a drawing has it, and keep it as it was found."""
    exact, drawing = drawn(search.program, found)
    search.exact[drawing.point.tobytes()] = exact
    return drawing


# ------------------------------------------------------------------------------ asking finer models


def _asked(search: _Ladder, model: str, x: Array) -> Array:
    """Return the figures of a point by a model, which is asked once."""
    key = (model, x.tobytes())
    if key not in search.known:
        began, problem = time.perf_counter(), search.problem
        point = drawn_point(problem, x)[None]
        found = evaluate(problem.family, point, problem.figures, model)
        search.known[key] = found.values[0]
        if not np.all(np.isfinite(found.values)):
            search.why[model] = found.faults[0] or "it has not all figures"
        search.seconds[model] += time.perf_counter() - began
        search.program.counts[model] += 1
    return search.known[key]


def _visit(search: _Ladder, best: LocalOptimum, fine: Array | None = None) -> _Visited:
    """Say how good a point is by the finest model that was asked."""
    program, x = search.program, best.point[None]
    figures = program.figures(x)[0] if fine is None else fine
    values = program.scaled(x, figures[None])[0]
    # constraints as found, slopes by the corrected model
    off = violation_of(values[1:], program.low, program.high)
    return _Visited(
        optimum=best,
        correction=program.correction,
        fine=figures,
        violation=float(np.max(off, initial=0.0)),
        objective=float(values[0]),
    )


def _best_of(problem: Problem, visited: Sequence[_Visited]) -> _Visited:
    """Return the point that misses least, of those that miss nothing the best by the goal."""
    least = TOLERANCE / 2.0 if problem.goals else 0.0
    return min(visited, key=lambda one: (max(one.violation, least), one.objective))


def _record(search: _Ladder, model: str, best: LocalOptimum, expected: Array, fine: Array) -> None:
    search.rungs.append(
        Rung(
            model=model,
            point=search.problem.point(best.point),
            expected=expected,
            found=fine,
            evaluations=search.used,
        )
    )


def _agree(expected: Array, fine: Array, within: float) -> bool:
    return bool(np.all(np.abs(fine - expected) <= within * np.maximum(np.abs(fine), 1e-12)))


def _climb(search: _Ladder, best: LocalOptimum) -> list[_Visited]:
    """Correct and search again until the models agree.

    What the finer one has no figures of is no stage, and is gone back from.
    """
    model, reach = search.options.model, _EFFORT.reach
    visited: list[_Visited] = []
    seen = [best.point]
    correction = Correction.none(len(best.point), len(search.problem.figures))
    for turn in range(_EFFORT.turns):
        # most end within some turns: each takes a third of what is left
        with progress.subtask(1.0 - _EFFORT.rest**turn, 1.0 - _EFFORT.rest ** (turn + 1)):
            name = f"ladder, turn {turn + 1}"
            search.begin(f"{name}, corrected by {model}", _EFFORT.again * search.left)
            with progress.subtask(0.0, 0.5):
                progress.update(f"{name}, {model}")
                fine = _asked(search, model, best.point)
            # by the searched model, corrected and not
            x, known = best.point[None], search.program.correction
            coarse = search.program.coarse(x)
            expected = (coarse if known is None else known.at_points(x, coarse))[0]
            _record(search, model, best, expected, fine)
            possible = bool(np.all(np.isfinite(fine)))
            kept = agreed = False
            if possible:
                correction = correction.updated(best.point, coarse[0], fine)
                agreed = _agree(expected, fine, _EFFORT.agreed)
                search.program = search.program.corrected(correction)
                visited.append(_visit(search, best, fine))
                kept = visited[-1].violation <= TOLERANCE
            if (agreed and kept and turn > 0) or search.left <= 0.0:
                break
            # a prediction that was far off is not to be followed far
            near = possible and _agree(expected, fine, _EFFORT.near)
            # nor one by which a requirement was missed, once the models are alike
            wider = near and (kept or turn < _EFFORT.alike)
            reach = min(1.0, 2.0 * reach) if wider else (0.3 if near else 0.5) * reach
            with progress.subtask(0.5, 1.0):
                again = _again(search, best if possible else None, visited, kept, seen, reach)
            if again is None:
                break
            best = again
            seen.append(best.point)
    return visited


def _again(
    search: _Ladder,
    best: LocalOptimum | None,
    visited: list[_Visited],
    kept: bool,
    seen: list[Array],
    reach: float,
) -> LocalOptimum | None:
    """Search on from the last stage; from the best before it, or the start, where that fails.

    None where it leads to stages that were asked about, all of them.
    """
    ways = [] if best is None else [(best.point, reach)]
    if not kept:
        # where nothing near the last keeps the limits, others lie elsewhere
        before = [_best_of(search.problem, visited).optimum.point] if visited else []
        ways += [(x, 0.5 * reach) for x in before if best is None or x is not best.point]
        ways.append((search.start, reach if best is None else 1.0))
    for x, far in ways:
        found = _searched(search, x, _EFFORT.again * search.left, far)
        found = None if found is None else _drawn(search, found)
        if found is not None and all(np.max(np.abs(found.point - x)) >= 1e-6 for x in seen):
            return found
    return None


def _or_start(search: _Ladder, chosen: _Visited | None) -> _Visited:
    """Return a point that was asked about, or the start where that is better.

    Without a goal the start is better only where the other misses what is required by more.

    Raises
    ------
    ModelError
        There is neither.
    """
    options = search.options
    confirmed = chosen is not None and chosen.confirmed and options.confirm is not None
    model = (options.confirm or "") if confirmed else options.model
    start = None if search.program.fault(search.start) else _began(search, model)
    if chosen is None and start is None:
        raise ModelError(
            f"the {model} model has no figures of the stages that the lumped one finds best, "
            f"nor of the start: {search.why.get(model, 'the start is impossible')}"
        )
    if chosen is None or start is None:
        return chosen or start  # type: ignore[return-value]
    off, was = (one.violation if one.violation > TOLERANCE else 0.0 for one in (chosen, start))
    sought = bool(search.problem.goals) and was == off
    return start if was < off or (sought and start.objective < chosen.objective) else chosen


def _began(search: _Ladder, model: str) -> _Visited | None:
    """Return the start as a point that a model was asked about; None without figures."""
    program, x = search.program, search.start
    fine = _asked(search, model, x)
    if not np.all(np.isfinite(fine)):
        return None
    at = _exact_at(search, x, fine, program.correction)
    values = program.scaled(x[None], fine[None])[0]
    off = violation_of(values[1:], program.low, program.high)
    here = LocalOptimum(
        point=x,
        values=values,
        violation=float(off.sum()),
        slopes=np.zeros((len(values), len(x))),
        walls=search.walls,
        converged=False,
    )
    confirmed = model == search.options.confirm
    return replace(_visit(search, here, fine), correction=at, confirmed=confirmed)


def _exact_at(search: _Ladder, x: Array, fine: Array, known: Correction | None) -> Correction:
    """Return the correction that is exact at a point, and changes as a known one does."""
    coarse = search.program.coarse(x[None])[0]
    anew = Correction.none(len(x), len(fine)).updated(x, coarse, fine)
    return anew if known is None else replace(anew, slope=known.slope)


def _confirm(search: _Ladder, model: str, chosen: _Visited) -> _Visited:
    """Ask the finest model; where it finds a requirement missed, feed that back."""
    expected, last = chosen.fine, _EFFORT.mended
    found: list[_Visited] = []
    for turn in range(1 + last):
        with progress.subtask(turn / (1 + last), (turn + 0.8) / (1 + last)):
            progress.update(f"confirm by {model}")
            fine = _asked(search, model, chosen.optimum.point)
        _record(search, model, chosen.optimum, expected, fine)
        x, possible = chosen.optimum.point, bool(np.all(np.isfinite(fine)))
        # the finer model changes as the corrected one does
        exact = _exact_at(search, x, fine, chosen.correction)
        if possible:
            search.program = search.program.corrected(exact)
        chosen = replace(_visit(search, chosen.optimum, fine), confirmed=True)
        found.append(chosen)
        if chosen.violation <= TOLERANCE or not possible or turn == last:
            break
        # a little is to be mended, where nothing but some points is known of the finest model
        allowed = max(search.left, _EFFORT.mending * search.budget)
        search.begin(f"corrected by {model}", allowed)
        with progress.subtask((turn + 0.8) / (1 + last), (turn + 1.0) / (1 + last)):
            again = _searched(search, x, allowed, _EFFORT.close / 2**turn)
        if again is None:
            break
        chosen = replace(chosen, optimum=_drawn(search, again))
        expected = search.program.figures(chosen.optimum.point[None])[0]
    return _best_of(search.problem, found)


# -------------------------------------------------------------------------------------- the result


def _optimum(search: _Ladder, chosen: _Visited) -> Optimum:
    problem, options, notes = search.problem, search.options, search.notes
    if chosen.correction is not None:
        search.program = search.program.corrected(chosen.correction)
    x = chosen.optimum.point
    # what holds it is told of the optimum itself: rounded, it stands beside its limits
    exact = search.exact.get(x.tobytes(), chosen.optimum)
    values, slopes = search.program.slopes(exact.point)
    held, free, left = held_by(search.program, replace(exact, values=values, slopes=slopes))
    if x is search.start:
        notes.append("no better stage was found than the one that it began with")
    elif chosen.optimum.violation > TOLERANCE >= exact.violation:
        notes.append(_ROUNDED_OFF)
    start, point = drawn_point(problem, search.start), drawn_point(problem, x)
    if x is not search.start and not is_drawn(problem, point):
        notes.append(_UNROUNDED)
    name, title = new_names(problem)
    stage = replace(problem.family.stage(point), name=name, title=title)
    notes += [issue.message for issue in check(stage) if issue.severity == "error"]
    models = [m for m in ("lumped", options.model, options.confirm) if m is not None]
    levels = [
        Level(model=m, start=_asked(search, m, search.start), best=_asked(search, m, x))
        for m in dict.fromkeys(models)
    ]
    notes += _with_stacks(problem, np.array([start, point]))
    return Optimum(
        problem=problem,
        stage=stage,
        text=problem.family.text(point, name=name, title=title),
        start=start,
        point=point,
        levels=tuple(levels),
        held=held,
        free=free,
        unexplained=left,
        rungs=tuple(search.rungs),
        trace=tuple(search.trace),
        evaluations=dict(search.program.counts),
        seconds=dict(search.seconds),
        seed=options.seed,
        notes=tuple(notes),
        provenance=provenance(stage),
    )


def _with_stacks(problem: Problem, points: Array) -> Iterator[str]:
    """Say the frequency with its stack of each axis whose frequency without it is sought."""
    figures = [
        Figure(quantity="natural_frequency_with_stack_hz", axis=f.axis)
        for f in problem.figures
        if f.quantity == "natural_frequency_hz"
    ]
    found = evaluate(problem.family, points, figures, "lumped").values
    for figure, values in zip(figures, found.T, strict=True):
        # none of an axis without stacks, nor of a start whose frequency was published
        ends = zip(values.tolist(), ("the start", "the best stage"), strict=True)
        known = [f"{figure.text(v)} at {end}" for v, end in ends if np.isfinite(v)]
        if known:
            yield (
                f"natural_frequency.{figure.axis} is without stack; with stack it is "
                f"{' and '.join(known)}, by the lumped model ({figure.name})"
            )
