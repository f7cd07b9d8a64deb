"""From requests to jobs: names and ranges are looked up in the stage that is asked about."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any

from flexstage.base.choose import unknown
from flexstage.base.errors import ModelError
from flexstage.files.request import read_number
from flexstage.quantities.units import parse
from flexstage.stage import Stage
from flexstage.stage.designs.template import StageTemplate
from flexstage.studies.explore.deviations import KINDS, scatter_dimensions
from flexstage.studies.explore.family import Family, batched_figures, known_figures
from flexstage.studies.explore.figures import (
    Figure,
    Requirement,
    chosen_figures,
    figure_of,
    requirement_of,
    requirements_of,
    usual_figures,
)
from flexstage.studies.explore.optimise.front import Front, find_front
from flexstage.studies.explore.optimise.multi_fidelity import SearchOptions, find_optimum
from flexstage.studies.explore.optimise.optimum import Optimum
from flexstage.studies.explore.optimise.problem import Goal, Problem
from flexstage.studies.explore.optimise.default_requirements import (
    CHECK,
    held_dimensions,
    published_targets,
    usual_requirements,
    usual_variables,
)
from flexstage.studies.explore.requests import (
    OptimiseRequest,
    SensitivityRequest,
    SweepRequest,
    ToleranceRequest,
)
from flexstage.studies.explore.sampling import SweepPlan, usual_plan
from flexstage.studies.explore.sensitivity import (
    Sensitivities,
    hinge_variables,
    sensitivities,
    variables_by,
)
from flexstage.studies.explore.sweep import Sweep, sweep
from flexstage.studies.explore.tolerance import ToleranceStudy, tolerance
from flexstage.studies.explore.tolerance_choice import choose_tolerances
from flexstage.studies.explore.variables import every_variable, listed, variables_of
from flexstage.studies.explore.workers import Workers
from flexstage.virtual.imperfections import Scatter

_PUBLISHED = "published"


def ready_sweep(request: SweepRequest, template: StageTemplate) -> Callable[..., Sweep]:
    """Return `flexstage.studies.explore.sweep` of a request; it then needs workers and folder."""
    run = partial(sweep, *swept(request, template), model=request.model)
    return lambda **how: replace(run(**how), request=request)


def swept(
    request: SweepRequest, template: StageTemplate
) -> tuple[Family, tuple[Figure, ...], SweepPlan]:
    """Return what is varied, which figures are computed, and at which points."""
    if not request.over:
        raise ModelError(nothing_varied(template))
    family = Family(template=template, variables=variables_of(template, request.over))
    plan = usual_plan(
        family.variables,
        request.model,
        sampling=request.plan,
        samples=request.samples,
        seed=request.seed,
        indices=request.indices,
    )
    figures = chosen_figures(request.of, known_figures(family.stage(family.usual)))
    return family, figures, plan


def nothing_varied(template: StageTemplate) -> str:
    """Say how a parameter of this stage is varied."""
    variables = every_variable(template)
    if not variables:
        return (
            f"{template.source} has no parameter that can be varied: give its dimensions names "
            "under 'parameters' in the stage file"
        )
    neck = next((v for v in variables if "neck" in v.name), variables[0])
    return (
        f'name what is varied, such as --over "{neck.name}={neck.range_text}": the '
        f"parameters of {template.source} are {listed([v.name for v in variables])}"
    )


def ready_optimise(
    request: OptimiseRequest, template: StageTemplate
) -> Callable[[Workers], Optimum | Front]:
    """Return what finds the best stage, or the front of several goals."""
    problem = problem_of(request, template)
    options = SearchOptions(
        start=request.start,
        model=request.model,
        confirm=request.confirm,
        evaluations=request.evaluations,
        seed=request.seed,
    )
    if len(problem.goals) > 1:
        return lambda workers: replace(find_front(problem, options, workers), request=request)
    # one search is one process's work
    return lambda _: replace(find_optimum(problem, options), request=request)


def problem_of(request: OptimiseRequest, template: StageTemplate) -> Problem:
    """Return what is sought, and of which stages."""
    given = bool(request.over)
    variables = variables_of(template, request.over) if given else usual_variables(template)
    if not variables:
        raise ModelError(
            f"{template.source} has no parameter that can be varied: give its dimensions names "
            "under 'parameters' in the stage file"
        )
    described = template.stage()
    known = known_figures(described)
    goals = (
        *(Goal(figure=figure_of(name, known), way="maximise") for name in request.maximise),
        *(Goal(figure=figure_of(name, known), way="minimise") for name in request.minimise),
    )
    if goals and request.match:
        raise ModelError("--match seeks stated figures, and has no goal: use --keep beside a goal")
    asked = requirements_of(request.keep, known)
    targets: tuple[Requirement, ...] = ()
    for target in request.match:
        targets += _targets(target, described, known)
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
            described, known, requirements, request.without, goals=[g.figure for g in goals]
        ),
        checked=CHECK not in request.without,
        notes=() if given or not (held := held_dimensions(template)) else (held,),
    )


def _first_goal(known: dict[tuple[str, str], float]) -> str:
    found = usual_figures(known)
    return next((f.name for f in found if f.quantity == "natural_frequency_hz"), "mass")


def _targets(text: str | Requirement, described: Any, known: Any) -> tuple[Requirement, ...]:
    if isinstance(text, Requirement):
        return (text,)
    if text.strip() == _PUBLISHED:
        return published_targets(described, known)
    target = requirement_of(text, known)
    if target.low is None or target.high is None:
        raise ModelError(
            f'--match is a figure and the value to reach, such as "stroke.x = 60 um", got '
            f"'{text[:60]}': give a limit with --keep"
        )
    return (target,)


def ready_sensitivity(
    request: SensitivityRequest, template: StageTemplate
) -> Callable[[], Sensitivities]:
    """Return what computes sensitivities."""
    if request.hinges and request.model != "lumped":
        raise ModelError(
            "--hinges goes with --model lumped: a notch that is moved by itself leaves the "
            "edges that finite elements cut it from"
        )
    figures = chosen_figures(request.of, known_figures(template.stage()))
    if request.hinges:
        family, left_out = hinge_variables(template, request.by), {}
    else:
        variables, left_out = variables_by(template, request.by)
        family = Family(template=template, variables=variables)
        if not variables:
            raise ModelError(
                f"{template.source} has no parameter that changes continuously: give its "
                "dimensions names under 'parameters' in the stage file, or look at its --hinges"
            )
    run = partial(sensitivities, family, figures, request.model, left_out)
    return lambda: replace(run(), request=request)


def ready_tolerance(
    request: ToleranceRequest, stage: Stage
) -> Callable[[Workers, Path | None], ToleranceStudy]:
    """Return what draws the lot, and chooses tolerances where asked to."""
    if request.follow_necks and request.model == "lumped":
        raise ModelError("--follow-necks needs another --model than lumped, which says it then")
    process = scatter_of(request.scatter)
    weights = {name: _weight(name, text) for name, text in _pairs(request.cost, "--cost")}
    if request.cost and request.target_yield is None:
        raise ModelError("--cost needs --target-yield: it weighs what is chosen for that")
    target = request.target_yield
    if target is not None and not request.require:
        raise ModelError("--target-yield needs at least one --require: what a good stage has")
    known = batched_figures(stage)
    figures = chosen_figures(request.of, known)
    requirements = requirements_of(request.require, known)

    def run(workers: Workers, keep: Path | None) -> ToleranceStudy:
        study = tolerance(
            stage,
            process,
            figures=figures,
            requirements=requirements,
            samples=request.samples,
            seed=request.seed,
            model=request.model,
            follow_necks=request.follow_necks,
            workers=workers,
            keep=keep,
        )
        choice = None
        if target is not None:
            choice = choose_tolerances(study, target, weights=weights, workers=workers)
        return replace(study, choice=choice, request=request)

    return run


def scatter_of(texts: Iterable[str]) -> Scatter:
    """Return the scatter that words say, one after the other; the usual one of what they leave.

    Examples
    --------
    >>> scatter_of(["neck_own=2 um", "modulus=0.5 %"]).neck_own
    2e-06
    """
    names, dimensions = [kind.name for kind in KINDS], scatter_dimensions()
    found = Scatter()
    for pattern, text in _pairs(texts, "--scatter"):
        fitting = [name for name in names if fnmatchcase(name, pattern)]
        if not fitting:
            raise ModelError(unknown("deviation", pattern, names))
        for name in fitting:
            dimension = dimensions[name]
            if text.strip() == "0":
                value = 0.0
            elif dimension is None:
                value = read_number(text, 'a share, such as "0.5 %" or 0.005')
            else:
                value = parse(text, dimension.name)
            found = replace(found, **{name: value})
    return found


def _pairs(texts: Iterable[str], option: str) -> list[tuple[str, str]]:
    pairs = []
    for text in texts:
        name, equals, value = text.partition("=")
        if not name.strip() or not equals or not value.strip():
            raise ModelError(
                f"{option} is a name and a value, such as neck_own=\"2 um\", got '{text[:60]}'"
            )
        pairs.append((name.strip(), value.strip()))
    return pairs


def _weight(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ModelError(f"the cost of {name} is a number, got '{text[:40]}'") from None
