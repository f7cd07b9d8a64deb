"""The ladder: a quick model is searched, finer ones correct it and confirm what is found."""

import math
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from flexstage import progress
from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.explore.family import evaluate
from flexstage.explore.figures import Figure
from flexstage.explore.optimise.correction import Correction
from flexstage.explore.optimise.local_search import (
    FEASIBLE,
    Iterate,
    LocalOptimum,
    local_search,
    violation_of,
)
from flexstage.explore.optimise.multipliers import held_by
from flexstage.explore.optimise.optimum import (
    TOLERANCE,
    Level,
    Optimum,
    Rung,
    SearchStep,
    Trace,
    new_names,
)
from flexstage.explore.optimise.problem import Problem, StageProgram
from flexstage.explore.optimise.rounding import drawn, drawn_point, is_drawn
from flexstage.explore.optimise.walls import Wall
from flexstage.provenance import provenance
from flexstage.stage import Stage, check

Start = Literal["described", "middle"]

#: Starts of the search beside the given one, turns of the ladder at most, and evaluations at most
#: for each variable.
OTHER_STARTS, TURNS, EVALUATIONS = 3, 12, 250
# steps of a search at most and at least; share of the evaluations that is kept for the ladder
_STEPS, _FEWEST, _RESERVE = 60, 4, 0.4
# share of the evaluations left that a turn of the ladder may use
_AGAIN = 0.4
# how often what the finest model finds missed is mended, share of all evaluations that is left for
# each time, and how far that search may go at first, in parts of the bounds
_MENDED, _MENDING, _CLOSE = 3, 0.1, 0.1
# points that starts are chosen from; agreement of two models at which the ladder ends
_SAMPLE, _AGREED = 64, 1e-3
# turns after which the correction has seen how the models differ nearby
_ALIKE = 2
# what a turn leaves of the work that is left, as it is shown
_LEFT = 0.67
_ROUNDED_OFF = (
    "rounded to 0.001 mm and 0.001 deg the stage misses what is required, and so do those beside it"
)
_UNROUNDED = (
    "no stage nearby of whole 0.001 mm and 0.001 deg is possible: the dimensions are as they were "
    "found, with all their digits"
)
# how far the second turn may go, in parts of the bounds, and the agreement that widens it again
_REACH, _NEAR = 0.4, 1e-2


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchOptions:
    """How it is searched."""

    start: Start = "described"
    """``described``: the stage as it is; ``middle`` of all bounds."""
    model: str = "superelement"
    """The model that corrects the lumped one; ``lumped`` for none."""
    confirm: str | None = None
    """A finer model that confirms the best, ``plane``, ``superelement-3d`` or ``solid``; None for
    none.
    """
    evaluations: int | None = None
    """Evaluations of the lumped model at most; `EVALUATIONS` for each variable, and for two more,
    where None.
    """
    starts: int = OTHER_STARTS
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
            raise ModelError(f"the ladder goes to lumped or superelement, got '{self.model}'")
        if self.confirm not in (None, "superelement", "plane", "superelement-3d", "solid"):
            raise ModelError(
                "superelement, plane, superelement-3d or solid can confirm the best stage, got "
                f"'{self.confirm}'"
            )

    def budget(self, variables: int) -> int:
        """Return how many evaluations of the lumped model there may be."""
        return EVALUATIONS * (variables + 2) if self.evaluations is None else self.evaluations


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
    return _Climb(problem, options or SearchOptions(), start).run()


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


def _same(one: Array, other: Array) -> bool:
    return float(np.max(np.abs(one - other))) < 1e-6


class _Climb:
    """One way up the ladder."""

    def __init__(self, problem: Problem, options: SearchOptions, start: Array | None) -> None:
        self.problem, self.options = problem, options
        self.notes: list[str] = [*problem.notes]
        if start is None:
            self.notes += start_notes(problem, options)
            family = problem.family
            start = family.usual if options.start == "described" else family.middle
        self.start = problem.position(start)
        if not np.all((self.start >= -1e-9) & (self.start <= 1.0 + 1e-9)):
            outside = [
                v.name
                for v, x in zip(problem.family.variables, self.start, strict=True)
                if not -1e-9 <= x <= 1.0 + 1e-9
            ]
            raise ModelError(
                f"the stage as described lies outside the bounds of {', '.join(outside[:3])}: "
                "widen them, or start from their middle with --start middle"
            )
        self.start = np.clip(self.start, 0.0, 1.0)
        self.program = StageProgram(problem=problem, nearest_to=self.start)
        self.budget = options.budget(len(self.start))
        self.trace: list[Trace] = []
        self.rungs: list[Rung] = []
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.searches = 0
        self.known: dict[tuple[str, bytes], Array] = {}
        self.why: dict[str, str] = {}
        self.walls: tuple[Wall, ...] = ()
        self.undrawn: dict[bytes, LocalOptimum] = {}
        # what is said of progress: the rung, evaluations before it and in it, and the best so far
        self.stage_of_work, self.before, self.share, self.seen = "", 0, 1.0, math.inf

    def run(self) -> Optimum:
        lumped = self.options.model == "lumped"
        ends = (0.9 if lumped else 0.5), (0.9 if self.options.confirm is None else 0.6)
        with progress.subtask(0.0, ends[0]):
            best = self._drawn(self._first())
        with progress.subtask(*ends):
            visited = [self._visit(best)] if lumped else self._climb(best)
        with progress.subtask(ends[1], ends[1] + 0.1):
            chosen = self._or_start(min(visited, key=self._rank) if visited else None)
        if self.options.confirm is not None:
            with progress.subtask(ends[1] + 0.1, 0.9):
                chosen = self._confirm(chosen)
            with progress.subtask(0.9, 1.0):
                chosen = self._or_start(chosen)
        return self._optimum(chosen)

    # ------------------------------------------------------------------ searching the quick model

    def _first(self) -> LocalOptimum:
        """Search from the start, and from others where that may find better."""
        wanted = 1 + (self.options.starts if self.problem.goals else 0)
        reserve = 0.0 if self.options.model == "lumped" else _RESERVE * self.budget
        found: list[LocalOptimum] = []
        self._begin(self.budget - reserve)
        for start in self._starts():
            share = (self._left() - reserve) / max(wanted - len(found), 1)
            self.stage_of_work = f"lumped search {len(found) + 1} of {wanted}"
            one = None if self.program.fault(start) else self._search(start, share)
            if one is not None:
                found.append(one)
            if len(found) >= wanted and any(f.feasible for f in found):
                break
            if len(found) >= 2 * wanted or (found and self._left() <= reserve):
                break
        if not found:
            raise ModelError(
                "no search could begin: around every possible start some stages are impossible; "
                "widen the bounds or start elsewhere"
            )
        return min(found, key=lambda f: (max(f.violation, 10.0 * FEASIBLE), f.values[0]))

    def _starts(self) -> Iterator[Array]:
        """Yield the given start, then others: the best of a sample, without a goal the nearest."""
        first = self.program.figures(self.start[None])
        if np.all(np.isfinite(first)):
            self._measure_goal(first)
            yield self.start
        sample = self._sample()
        figures = self.program.figures(sample)
        ok = np.all(np.isfinite(figures), axis=1)
        if not ok.any() and not np.all(np.isfinite(first)):
            fault = self.program.fault(self.start) or "its figures cannot be computed"
            raise ModelError(
                f"none of {1 + len(sample)} stages between the bounds is possible; of the start: "
                f"{fault}"
            )
        if not np.all(np.isfinite(first)):
            self._measure_goal(figures[ok])
        values = self.program.scaled(sample, figures)
        if self.problem.goals:
            off = violation_of(values[:, 1:], self.program.low, self.program.high).sum(axis=1)
            rank = np.where(off > 0.5, 10.0 + off, values[:, 0] + off)
        else:
            rank = np.linalg.norm(sample - self.start, axis=1)
        yield from (sample[i] for i in np.argsort(rank, kind="stable") if ok[i])

    def _measure_goal(self, figures: Array) -> None:
        """Measure the goal by what it is at first."""
        if self.problem.goals and figures[0, 0] != 0.0:
            self.program = replace(self.program, goal_reference=abs(float(figures[0, 0])))

    def _sample(self) -> Array:
        from scipy.stats import qmc

        count = min(_SAMPLE, max(self.budget // 20, 1))
        sampler = qmc.Sobol(len(self.start), rng=self.options.seed)
        return sampler.random(2 ** int(np.log2(count)))

    def _search(self, start: Array, evaluations: float, reach: float = 1.0) -> LocalOptimum | None:
        self.searches += 1
        number = self.searches - 1

        def told(iterate: Iterate) -> None:
            self._tell(iterate)
            step = Trace(
                search=number,
                evaluations=self.program.counts["lumped"],
                objective=self._shown(iterate),
                violation=iterate.violation,
            )
            self.trace.append(step)
            point = self.problem.point(iterate.point)
            progress.hand_over(SearchStep(trace=step, point=point))

        began = time.perf_counter()
        d = len(start)
        found = local_search(
            self.program,
            start,
            steps=max(min(_STEPS, int(evaluations / (2 * d + 3))), _FEWEST),
            curvature=None if self.problem.goals else np.eye(d),
            walls=self.walls,
            reach=reach,
            told=told,
        )
        self.seconds["lumped"] += time.perf_counter() - began
        if found is not None:
            self.walls = found.walls
        return found

    def _tell(self, iterate: Iterate) -> None:
        """Say how far the work has come, and the figure that it has come to."""
        if iterate.violation <= TOLERANCE:
            self.seen = min(self.seen, float(iterate.values[0]))
        text = self.stage_of_work
        if not np.isfinite(self.seen):
            text += f", requirements missed by {100.0 * iterate.violation:.2g} %"
        elif self.problem.goals:
            figure = self.problem.goals[0].figure
            best = float(self.program.goal_figure(self.seen))
            text += f", best {figure.name} {figure.text(best)}"
        progress.update(text, (self.program.counts["lumped"] - self.before) / self.share)

    def _begin(self, evaluations: float) -> None:
        """Begin a rung on which so many evaluations may be used."""
        self.before, self.share = self.program.counts["lumped"], max(evaluations, 1.0)
        self.seen = math.inf  # what another model found best is none of this one

    def _drawn(self, found: LocalOptimum) -> LocalOptimum:
        """Return an optimum as a drawing has it, and keep it as it was found."""
        kept, drawing = drawn(self.program, found)
        self.undrawn[drawing.point.tobytes()] = kept
        return drawing

    def _shown(self, iterate: Iterate) -> float:
        if not self.problem.goals:
            return float(np.sqrt(2.0 * iterate.values[0]))
        return float(self.program.goal_figure(iterate.values[0]))

    def _left(self) -> float:
        """Return how many evaluations of the searched model are left."""
        return float(self.budget - self.program.counts["lumped"])

    # ------------------------------------------------------------------ climbing

    def _fine(self, model: str, x: Array) -> Array:
        """Return the figures of a point by a model, which is asked once."""
        key = (model, x.tobytes())
        if key not in self.known:
            began = time.perf_counter()
            point, figures = drawn_point(self.problem, x)[None], self.problem.figures
            found = evaluate(self.problem.family, point, figures, model)
            self.known[key] = found.values[0]
            if not np.all(np.isfinite(found.values)):
                self.why[model] = found.faults[0] or "it has not all figures"
            self.seconds[model] += time.perf_counter() - began
            self.program.counts[model] += 1
        return self.known[key]

    def _climb(self, best: LocalOptimum) -> list[_Visited]:
        """Correct and search again until the models agree.

        What the finer one has no figures of is no stage, and is gone back from.
        """
        model = self.options.model
        visited: list[_Visited] = []
        seen = [best.point]
        correction = Correction.none(len(best.point), len(self.problem.figures))
        reach = _REACH
        for turn in range(TURNS):
            # most end within some turns: each takes a third of what is left
            with progress.subtask(1.0 - _LEFT**turn, 1.0 - _LEFT ** (turn + 1)):
                self.stage_of_work = f"ladder, turn {turn + 1}, corrected by {model}"
                self._begin(_AGAIN * self._left())
                with progress.subtask(0.0, 0.5):
                    progress.update(f"ladder, turn {turn + 1}, {model}")
                    fine = self._fine(model, best.point)
                expected, coarse = self._expected(best.point)
                self._rung(model, best, expected, fine)
                possible = bool(np.all(np.isfinite(fine)))
                kept = agreed = False
                if possible:
                    correction = correction.updated(best.point, coarse, fine)
                    agreed = self._agree(expected, fine)
                    self.program = self.program.corrected(correction)
                    visited.append(self._visit(best, fine))
                    kept = visited[-1].violation <= TOLERANCE
                if (agreed and kept and turn > 0) or self._left() <= 0.0:
                    break
                # a prediction that was far off is not to be followed far
                near = possible and self._agree(expected, fine, _NEAR)
                # nor one by which a requirement was missed, once the models are alike
                wider = near and (kept or turn < _ALIKE)
                reach = min(1.0, 2.0 * reach) if wider else (0.3 if near else 0.5) * reach
                with progress.subtask(0.5, 1.0):
                    again = self._again(best if possible else None, visited, kept, seen, reach)
                if again is None:
                    break
                best = again
                seen.append(best.point)
        return visited

    def _again(
        self,
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
            before = [min(visited, key=self._rank).optimum.point] if visited else []
            ways += [(x, 0.5 * reach) for x in before if best is None or x is not best.point]
            ways.append((self.start, reach if best is None else 1.0))
        for x, far in ways:
            found = self._search(x, _AGAIN * self._left(), far)
            found = None if found is None else self._drawn(found)
            if found is not None and not any(_same(found.point, other) for other in seen):
                return found
        return None

    def _expected(self, x: Array) -> tuple[Array, Array]:
        """Return the figures of a point by the searched model, corrected and not."""
        coarse = self.program.coarse(x[None])
        known = self.program.correction
        return (coarse if known is None else known.at_points(x[None], coarse))[0], coarse[0]

    def _or_start(self, chosen: _Visited | None) -> _Visited:
        """Return a point that was asked about, or the start where that is better.

        Without a goal the start is better only where the other misses what is required by more.

        Raises
        ------
        ModelError
            There is neither.
        """
        model = self.options.model
        if chosen is not None and chosen.confirmed and self.options.confirm is not None:
            model = self.options.confirm
        start = None if self.program.fault(self.start) else self._began(model)
        if chosen is None and start is None:
            raise ModelError(
                f"the {model} model has no figures of the stages that the lumped one finds best, "
                f"nor of the start: {self.why.get(model, 'the start is impossible')}"
            )
        if chosen is None or start is None:
            return chosen or start  # type: ignore[return-value]
        off, was = (one.violation if one.violation > TOLERANCE else 0.0 for one in (chosen, start))
        better = was < off or (
            bool(self.problem.goals) and was == off and start.objective < chosen.objective
        )
        return start if better else chosen

    def _began(self, model: str) -> _Visited | None:
        """Return the start as a point that a model was asked about; None without figures."""
        fine = self._fine(model, self.start)
        if not np.all(np.isfinite(fine)):
            return None
        coarse = self.program.coarse(self.start[None])[0]
        known, d = self.program.correction, len(self.start)
        at = Correction.none(d, len(fine)).updated(self.start, coarse, fine)
        values = self.program.scaled(self.start[None], fine[None])[0]
        off = violation_of(values[1:], self.program.low, self.program.high)
        here = LocalOptimum(
            point=self.start,
            values=values,
            violation=float(off.sum()),
            slopes=np.zeros((len(values), d)),
            walls=self.walls,
            converged=False,
        )
        return replace(
            self._visit(here, fine),
            correction=at if known is None else replace(at, slope=known.slope),
            confirmed=model == self.options.confirm,
        )

    def _rung(self, model: str, best: LocalOptimum, expected: Array, fine: Array) -> None:
        self.rungs.append(
            Rung(
                model=model,
                point=self.problem.point(best.point),
                expected=expected,
                found=fine,
                evaluations=self.program.counts["lumped"],
            )
        )

    def _agree(self, expected: Array, fine: Array, within: float = _AGREED) -> bool:
        off = np.abs(fine - expected) <= within * np.maximum(np.abs(fine), 1e-12)
        return bool(np.all(off))

    def _visit(self, best: LocalOptimum, fine: Array | None = None) -> _Visited:
        """Say how good a point is by the finest model that was asked."""
        figures = self.program.figures(best.point[None])[0] if fine is None else fine
        values = self.program.scaled(best.point[None], figures[None])[0]
        # constraints as found, slopes by the corrected model
        off = violation_of(values[1:], self.program.low, self.program.high)
        return _Visited(
            optimum=best,
            correction=self.program.correction,
            fine=figures,
            violation=float(np.max(off, initial=0.0)),
            objective=float(values[0]),
        )

    def _rank(self, visited: _Visited) -> tuple[float, float]:
        if not self.problem.goals:
            return (visited.violation, visited.objective)
        return (max(visited.violation, TOLERANCE / 2.0), visited.objective)

    def _confirm(self, chosen: _Visited) -> _Visited:
        """Ask the finest model; where it finds a requirement missed, feed that back."""
        model = self.options.confirm
        assert model is not None
        expected, found = chosen.fine, [chosen]
        for turn in range(1 + _MENDED):
            with progress.subtask(turn / (1 + _MENDED), (turn + 0.8) / (1 + _MENDED)):
                progress.update(f"confirm by {model}")
                fine = self._fine(model, chosen.optimum.point)
            self._rung(model, chosen.optimum, expected, fine)
            chosen = self._confirmed(chosen, fine)
            found.append(chosen)
            if chosen.violation <= TOLERANCE or not np.all(np.isfinite(fine)) or turn == _MENDED:
                break
            self.stage_of_work = f"corrected by {model}"
            # a little is to be mended, where nothing but some points is known of the finest model
            allowed = max(self._left(), _MENDING * self.budget)
            self._begin(allowed)
            with progress.subtask((turn + 0.8) / (1 + _MENDED), (turn + 1.0) / (1 + _MENDED)):
                again = self._search(chosen.optimum.point, allowed, _CLOSE / 2**turn)
            if again is None:
                break
            chosen = replace(chosen, optimum=self._drawn(again))
            expected = self.program.figures(chosen.optimum.point[None])[0]
        return min(found[1:], key=self._rank)

    def _confirmed(self, chosen: _Visited, fine: Array) -> _Visited:
        x = chosen.optimum.point
        coarse = self.program.coarse(x[None])[0]
        known = chosen.correction or Correction.none(len(x), len(fine))
        if np.all(np.isfinite(fine)):
            # the finer model changes as the corrected one does
            anew = Correction.none(len(x), len(fine)).updated(x, coarse, fine)
            self.program = self.program.corrected(replace(anew, slope=known.slope))
        return replace(self._visit(chosen.optimum, fine), confirmed=True)

    # ------------------------------------------------------------------ the result

    def _optimum(self, chosen: _Visited) -> Optimum:
        problem = self.problem
        if chosen.correction is not None:
            self.program = self.program.corrected(chosen.correction)
        x = chosen.optimum.point
        # what holds it is told of the optimum itself: rounded, it stands beside its limits
        exact = self.undrawn.get(x.tobytes(), chosen.optimum)
        values, slopes = self.program.slopes(exact.point)
        held, free, left = held_by(self.program, replace(exact, values=values, slopes=slopes))
        if x is self.start:
            self.notes.append("no better stage was found than the one that it began with")
        elif chosen.optimum.violation > TOLERANCE >= exact.violation:
            self.notes.append(_ROUNDED_OFF)
        point = drawn_point(problem, x)
        if x is not self.start and not is_drawn(problem, point):
            self.notes.append(_UNROUNDED)
        name, title = new_names(problem)
        stage = replace(problem.family.stage(point), name=name, title=title)
        self._faults(stage)
        models = [m for m in ("lumped", self.options.model, self.options.confirm) if m is not None]
        levels = []
        for model in dict.fromkeys(models):
            start = self._fine(model, self.start)
            best = self._fine(model, x)
            levels.append(Level(model=model, start=start, best=best))
        self._with_stacks(point)
        settings = {
            "goals": "; ".join(g.text for g in problem.goals),
            "requirements": "; ".join(r.text for r in problem.limits),
            "start": self.options.start,
            "model": self.options.model,
            "confirm": self.options.confirm or "",
            "evaluations": str(self.budget),
            "seed": str(self.options.seed),
        }
        return Optimum(
            problem=problem,
            stage=stage,
            text=problem.family.text(point, name=name, title=title),
            start=drawn_point(problem, self.start),
            point=point,
            levels=tuple(levels),
            held=held,
            free=free,
            unexplained=left,
            rungs=tuple(self.rungs),
            trace=tuple(self.trace),
            evaluations=dict(self.program.counts),
            seconds=dict(self.seconds),
            seed=self.options.seed,
            notes=tuple(self.notes),
            provenance=provenance(stage, settings),
        )

    def _with_stacks(self, point: Array) -> None:
        """Say the frequency with its stack of each axis whose frequency without it is sought."""
        figures = [
            Figure(quantity="natural_frequency_with_stack_hz", axis=f.axis)
            for f in self.problem.figures
            if f.quantity == "natural_frequency_hz"
        ]
        points = np.array([drawn_point(self.problem, self.start), point])
        found = evaluate(self.problem.family, points, figures, "lumped").values
        for figure, values in zip(figures, found.T, strict=True):
            # none of an axis without stacks, nor of a start whose frequency was published
            ends = zip(values.tolist(), ("the start", "the best stage"), strict=True)
            known = [f"{figure.text(v)} at {end}" for v, end in ends if np.isfinite(v)]
            if known:
                self.notes.append(
                    f"natural_frequency.{figure.axis} is without stack; with stack it is "
                    f"{' and '.join(known)}, by the lumped model ({figure.name})"
                )

    def _faults(self, stage: Stage) -> None:
        self.notes += [issue.message for issue in check(stage) if issue.severity == "error"]
