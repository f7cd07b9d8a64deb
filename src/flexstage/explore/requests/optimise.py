"""What an optimisation is asked for."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from flexstage.choose import did_you_mean
from flexstage.designs.template import StageTemplate
from flexstage.errors import ModelError
from flexstage.explore.family import Family, known_figures
from flexstage.explore.figures import (
    Requirement,
    figure_of,
    requirement_of,
    requirements_of,
    usual_figures,
)
from flexstage.explore.optimise.front import Front, find_front
from flexstage.explore.optimise.ladder import SearchOptions, find_optimum
from flexstage.explore.optimise.optimum import Optimum
from flexstage.explore.optimise.problem import Goal, Problem
from flexstage.explore.optimise.usual import (
    CHECK,
    held_dimensions,
    published_targets,
    usual_requirements,
    usual_variables,
)
from flexstage.explore.variables import variables_of
from flexstage.explore.workers import Workers

_PUBLISHED = "published"


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimiseRequest:
    """An optimisation in words, as the options of `flexstage optimise`, which say what each is."""

    maximise: tuple[str, ...] = ()
    """Figures to make as large as possible."""
    minimise: tuple[str, ...] = ()
    """Figures to make as small as possible."""
    keep: tuple[str, ...] = ()
    """What is required."""
    match: tuple[str, ...] = ()
    """Figures to reach."""
    over: tuple[str, ...] = ()
    """Parameters and their bounds; the dimensions of the flexure where none is named."""
    without: tuple[str, ...] = ()
    """What is required unasked, and shall not be."""
    start: str = "described"
    """Where the search starts."""
    model: str = "superelement"
    """The model whose figures count."""
    confirm: str | None = None
    """A finer model that confirms the best stage."""
    evaluations: int | None = None
    """Evaluations of the lumped model at most."""
    seed: int = 0
    """Seed of the starts, and of the front."""

    def ready(self, template: StageTemplate) -> Callable[[Workers], Optimum | Front]:
        """Read the words; return what finds the best stage, or the front of several goals."""
        problem = self.problem(template)
        options = SearchOptions(
            start=_word("--start", self.start, ("described", "middle")),
            model=_word("--model", self.model, ("superelement", "lumped")),
            confirm=None
            if self.confirm is None
            else _word("--confirm", self.confirm, ("plane", "superelement-3d", "solid")),
            evaluations=self.evaluations,
            seed=self.seed,
        )
        if len(problem.goals) > 1:
            return partial(find_front, problem, options)
        # one search is one process's work
        return lambda _: find_optimum(problem, options)

    def problem(self, template: StageTemplate) -> Problem:
        """Return what is sought, and of which stages."""
        given = bool(self.over)
        variables = variables_of(template, self.over) if given else usual_variables(template)
        if not variables:
            raise ModelError(
                f"{template.source} has no parameter that can be varied: give its dimensions names "
                "under 'parameters' in the stage file"
            )
        described = template.stage()
        known = known_figures(described)
        goals = (
            *(Goal(figure=figure_of(name, known), way="maximise") for name in self.maximise),
            *(Goal(figure=figure_of(name, known), way="minimise") for name in self.minimise),
        )
        if goals and self.match:
            raise ModelError(
                "--match seeks stated figures, and has no goal: use --keep beside a goal"
            )
        asked = requirements_of(self.keep, known)
        targets: tuple[Requirement, ...] = ()
        for text in self.match:
            targets += _targets(text, described, known)
        if not goals and not targets:
            raise ModelError(
                "say what is sought: --maximise or --minimise a figure, or --match values, such as "
                f"--maximise {_first_goal(known)}"
            )
        requirements = (*targets, *asked)
        return Problem(
            family=Family(template=template, variables=variables),
            goals=goals,
            requirements=requirements,
            usual=usual_requirements(
                described, known, requirements, self.without, goals=[g.figure for g in goals]
            ),
            checked=CHECK not in self.without,
            notes=() if given or not (held := held_dimensions(template)) else (held,),
        )


def _word(option: str, given: str, words: tuple[str, ...]) -> Any:
    if given not in words:
        raise ModelError(
            f"{option} must be {' or '.join(words)}, got '{given[:60]}'{did_you_mean(given, words)}"
        )
    return given


def _first_goal(known: dict[tuple[str, str], float]) -> str:
    found = usual_figures(known)
    return next((f.name for f in found if f.quantity == "natural_frequency_hz"), "mass")


def _targets(text: str, described: Any, known: Any) -> tuple[Requirement, ...]:
    if text.strip() == _PUBLISHED:
        return published_targets(described, known)
    target = requirement_of(text, known)
    if target.low is None or target.high is None:
        raise ModelError(
            f'--match is a figure and the value to reach, such as "stroke.x = 60 um", got '
            f"'{text[:60]}': give a limit with --keep"
        )
    return (target,)
