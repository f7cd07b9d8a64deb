"""Optimising the piezo stage: the search by slopes against Optuna and differential evolution.

`python -m benchmarks.optimise` runs it alone. All three maximise the first frequency of the piezo
stage by the lumped model at the same stroke, stress and outline, between the same bounds, from the
same start, with the same number of evaluations; a difference quotient counts as what it evaluates.
Printed is the best frequency of a stage that keeps all requirements, by evaluations.
"""

import argparse
import time
import warnings
from collections.abc import Iterator

import numpy as np

from flexstage.base.arrays import Array
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore import (
    Family,
    Goal,
    Problem,
    SearchOptions,
    evaluate,
    figure_of,
    find_optimum,
    known_figures,
    requirement_of,
    variables_of,
)

__all__ = ["compare"]

#: Dimensions that are varied by 30 % to either side.
OVER = (
    *("x.lever_*", "x.link_length", "x.leg_*", "x.input_position", "y.lever_arm_*"),
    *("y.lever_neck", "y.lever_width", "y.leg_neck", "y.leg_bar_length", "y.input_position"),
    "platform_wall*",
)
#: Evaluations at which the best is read.
AT = (250, 500, 1000, 2000, 4000)
# what a requirement may be off, in parts of its limit, and what an impossible stage is off
_KEPT, _IMPOSSIBLE = 1e-4, 10.0
# individuals of differential evolution for each variable: fewer than usual, for more generations
_POPULATION = 3

Found = list[tuple[int, float]]


def piezo() -> Problem:
    """Return the problem: the first frequency, the rest no worse than it is."""
    template = StageTemplate.of("vgtu-piezo")
    known = known_figures(template.stage())
    frequency = figure_of("natural_frequency.x", known)
    kept = [
        f"{name} {sign} {known[figure_of(name, known).key]!r} {unit}"
        for name, sign, unit in (
            ("stroke.x", ">=", "m"),
            ("stroke.y", ">=", "m"),
            ("stress.x", "<=", "Pa"),
            ("stress.y", "<=", "Pa"),
            ("width", "<=", "m"),
            ("height", "<=", "m"),
            ("natural_frequency.y", ">=", "Hz"),
        )
    ]
    kept.append("input_stiffness.x <= 8.8 N/um")  # 85 % of the free stroke are left
    return Problem(
        family=Family(
            template=template, variables=variables_of(template, [f"{name}=30 %" for name in OVER])
        ),
        goals=(Goal(figure=frequency, direction="maximise"),),
        requirements=tuple(requirement_of(text, known) for text in kept),
        checked=False,
    )


class Counted:
    """The problem as peers see it: cost and violations of points from 0 to 1, counted."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.count, self.best = problem, 0, -np.inf
        self.found: Found = []
        self._known: dict[bytes, tuple[float, Array]] = {}

    def rows(self, points: Array) -> list[tuple[float, Array]]:
        """Return frequency and violations of points (S, d), each evaluated once."""
        new = [x for x in points if x.tobytes() not in self._known]
        if new:
            problem = self.problem
            found = evaluate(problem.family, problem.point(np.array(new)), problem.figures)
            at = {figure: i for i, figure in enumerate(problem.figures)}
            for x, row in zip(new, found.values, strict=True):
                off = np.array(
                    [float(r.excess(row[at[r.figure]])) for r in problem.all_requirements]
                )
                ok = bool(np.all(np.isfinite(row)))
                kept = (float(row[0]), off) if ok else (0.0, np.full(len(off), _IMPOSSIBLE))
                self._known[x.tobytes()] = kept
                self.count += 1
                if ok and off.max() <= _KEPT and row[0] > self.best:
                    self.best = float(row[0])
                    self.found.append((self.count, self.best))
        return [self._known[x.tobytes()] for x in points]


def flexstage(problem: Problem, evaluations: int, seed: int) -> Found:
    """Search by slopes."""
    options = SearchOptions(model="lumped", evaluations=evaluations, seed=seed)
    steps = find_optimum(problem, options).history
    return [(s.evaluations, s.objective) for s in steps if s.violation <= _KEPT]


def optuna(problem: Problem, evaluations: int, seed: int) -> Found:
    """Search by Optuna's usual sampler, a tree of Parzen estimators, told of the requirements."""
    import optuna as peer

    peer.logging.set_verbosity(peer.logging.ERROR)
    counted = Counted(problem)
    names = problem.family.names

    def objective(trial: "peer.Trial") -> float:
        x = np.array([trial.suggest_float(name, 0.0, 1.0) for name in names])
        frequency, off = counted.rows(x[None])[0]
        trial.set_user_attr("off", off.tolist())
        return frequency

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # telling it of constraints is called experimental
        sampler = peer.samplers.TPESampler(
            seed=seed, constraints_func=lambda trial: trial.user_attrs["off"]
        )
    study = peer.create_study(direction="maximize", sampler=sampler)
    start = problem.position(problem.family.usual)
    study.enqueue_trial(dict(zip(names, map(float, start), strict=True)))
    study.optimize(objective, n_trials=evaluations)
    return counted.found


def evolution(problem: Problem, evaluations: int, seed: int) -> Found:
    """Search by SciPy's differential evolution, by its own way with constraints."""
    from scipy.optimize import NonlinearConstraint, differential_evolution

    counted = Counted(problem)
    d, m = len(problem.family.variables), len(problem.all_requirements)

    def cost(columns: Array) -> Array:
        return np.array([-frequency for frequency, _ in counted.rows(np.atleast_2d(columns.T))])

    def off(columns: Array) -> Array:
        return np.array([v for _, v in counted.rows(np.atleast_2d(columns.T))]).T

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it ends by the number of generations, as it shall
        differential_evolution(
            cost,
            [(0.0, 1.0)] * d,
            constraints=NonlinearConstraint(off, -np.inf, np.zeros(m)),
            popsize=_POPULATION,
            maxiter=max(evaluations // (_POPULATION * d) - 1, 1),
            x0=problem.position(problem.family.usual),
            rng=seed,
            tol=0.0,
            polish=False,
            vectorized=True,
            updating="deferred",
        )
    return counted.found


def best_at(found: Found, evaluations: int) -> float:
    """Return the best frequency after so many evaluations [Hz]; not a number where none."""
    return max((value for count, value in found if count <= evaluations), default=np.nan)


def compare(evaluations: int, seeds: int) -> Iterator[str]:
    """Yield the lines of the table: best feasible frequency by evaluations, median and range."""
    problem = piezo()
    start = known_figures(problem.family.template.stage())["natural_frequency_hz", "x"]
    at = [count for count in AT if count <= evaluations]
    yield f"{len(problem.family.variables)} dimensions, start {start:.1f} Hz, {seeds} seeds"
    yield f"{'':22}" + "".join(f"{count:>20}" for count in at) + f"{'time':>9}"
    for name, search in (
        ("flexstage", flexstage),
        ("Optuna, TPE", optuna),
        ("SciPy, evolution", evolution),
    ):
        began = time.perf_counter()
        runs = [search(problem, evaluations, seed) for seed in range(seeds)]
        took = (time.perf_counter() - began) / seeds
        cells = []
        for count in at:
            values = [best_at(run, count) for run in runs]
            known = [value for value in values if np.isfinite(value)]
            text = f"{np.median(known):.1f} ({min(known):.0f}-{max(known):.0f})" if known else "-"
            cells.append(f"{text:>20}")
        yield f"{name:22}" + "".join(cells) + f"{took:7.0f} s"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--evaluations", type=int, default=AT[-1])
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    for line in compare(given.evaluations, given.seeds):
        print(line, flush=True)
