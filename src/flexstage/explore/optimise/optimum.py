"""The best stage that was found: its figures by each model, and what holds it."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.explore.figures import Figure
from flexstage.explore.optimise.problem import Problem
from flexstage.provenance import Provenance
from flexstage.short_repr import short_repr
from flexstage.stage import Stage

Side = Literal["low", "high"]

#: Share of its limit by which a figure may be beyond it and still count as kept [1].
TOLERANCE = 2e-3
# longest name of a stage, how the name of an optimised one ends, and what its title is told by
_LONGEST, _OPTIMISED, _SOUGHT = 80, re.compile(r"(.+)-optimised(?:-(\d+))?"), ", optimised: "


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
    return name[: _LONGEST - len(ending)] + ending, f"{title}{_SOUGHT}{sought}"


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
class Optimum:
    """The best stage that was found."""

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
