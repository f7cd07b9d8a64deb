"""Preparation of requests: names and ranges are resolved for a stage, and jobs are returned."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any

from flexstage.base.choose import unknown
from flexstage.base.errors import ModelError
from flexstage.control.dynamic_budget import open_rms
from flexstage.files.request import read_number
from flexstage.lumped import lumped_system
from flexstage.quantities.units import parse
from flexstage.stage import Stage
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.deviations import KINDS, scatter_dimensions
from flexstage.studies.explore.ensemble import Ensemble, observation_of
from flexstage.studies.explore.family import Family, batched_figures, known_figures
from flexstage.studies.explore.figures import (
    NOISE_FIGURES,
    Figure,
    Requirement,
    default_figures,
    figure_of,
    requested_figures,
    requirement_of,
    requirements_of,
)
from flexstage.studies.explore.manufactured_samples import seated_figures
from flexstage.studies.explore.optimise.default_requirements import (
    CHECK,
    default_requirements,
    default_variables,
    fixed_dimensions_note,
    free_variables,
    published_targets,
)
from flexstage.studies.explore.optimise.front import Front, find_front
from flexstage.studies.explore.optimise.multi_fidelity import SearchOptions, find_optimum
from flexstage.studies.explore.optimise.optimum import Optimum
from flexstage.studies.explore.optimise.problem import Goal, Problem
from flexstage.studies.explore.reconstruct import dimension_of, reconstruct
from flexstage.studies.explore.requests import (
    OptimiseRequest,
    ReconstructRequest,
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
from flexstage.studies.models import analyse_model
from flexstage.system.environment import Environment, read_environment
from flexstage.virtual.imperfections import Scatter
from flexstage.virtual.neck_widths import measured_necks

_PUBLISHED = "published"


def ready_sweep(request: SweepRequest, template: StageTemplate) -> Callable[..., Sweep]:
    """Return the function that runs a sweep with given workers and folder."""
    family, figures, plan = swept(request, template)
    run = partial(sweep, family, figures, plan, model=request.model)

    def swept_stage(**options: Any) -> Sweep:
        result = run(**options)
        notes = (*result.notes, *_rms_note(family.environment, figures))
        return replace(result, request=request, notes=notes)

    return swept_stage


def swept(
    request: SweepRequest, template: StageTemplate
) -> tuple[Family, tuple[Figure, ...], SweepPlan]:
    """Return family, figures and sampling plan of a sweep."""
    if not request.over:
        raise ModelError(nothing_varied(template))
    family = Family(
        template=template,
        variables=variables_of(template, request.over),
        environment=_environment(request.environment),
    )
    plan = usual_plan(
        family.variables,
        request.model,
        sampling=request.plan,
        samples=request.samples,
        seed=request.seed,
        indices=request.indices,
    )
    known = known_figures(family.stage(family.usual), family.environment)
    return family, requested_figures(request.of, known), plan


def _environment(path: Path | None) -> Environment | None:
    # its spectra are read: the same batches belong to it in any folder
    return None if path is None else replace(read_environment(path), folder=Path())


def _rms_note(environment: Environment | None, figures: Iterable[Figure]) -> tuple[str, ...]:
    """Return the validity of an rms among figures."""
    if environment is None or not any(figure.quantity in NOISE_FIGURES for figure in figures):
        return ()
    (low, high), name = environment.band, environment.name
    return (
        f"rms in the environment '{name}' from {low:g} to {high:g} Hz, without position control "
        "(flexstage budget has it); it depends most on the damping of the stage: measure it",
    )


def nothing_varied(template: StageTemplate) -> str:
    """Return the message for a sweep without parameters."""
    variables = every_variable(template)
    if not variables:
        return (
            f"{template.source} has no parameter that can be varied: give its dimensions names "
            "under 'parameters' in the stage file"
        )
    neck = next((v for v in variables if "neck" in v.name), variables[0])
    return (
        f'name a parameter and its range, such as --over "{neck.name}={neck.range_text}": the '
        f"parameters of {template.source} are {listed([v.name for v in variables])}"
    )


def ready_optimise(
    request: OptimiseRequest, template: StageTemplate
) -> Callable[[Workers], Optimum | Front]:
    """Return the function that computes the optimum, or the front of several goals."""
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
    # a search for one optimum runs in one process
    return lambda _: replace(find_optimum(problem, options), request=request)


def problem_of(request: OptimiseRequest, template: StageTemplate) -> Problem:
    """Return the optimisation problem of a request."""
    explicit = bool(request.over)
    variables = variables_of(template, request.over) if explicit else default_variables(template)
    if not variables:
        raise ModelError(
            f"{template.source} has no parameter that can be varied: give its dimensions names "
            "under 'parameters' in the stage file"
        )
    described = template.stage()
    environment = _environment(request.environment)
    known = known_figures(described, environment)
    goals = (
        *(Goal(figure=figure_of(name, known), direction="maximise") for name in request.maximise),
        *(Goal(figure=figure_of(name, known), direction="minimise") for name in request.minimise),
    )
    if goals and request.match:
        raise ModelError(
            "--match cannot be combined with a goal: use --keep for a constraint on a goal"
        )
    constraints = requirements_of(
        (*request.keep, *_needs_of(request.for_, described, known)), known
    )
    targets: tuple[Requirement, ...] = ()
    for target in request.match:
        targets += _targets(target, described, known)
    if not goals and not targets:
        raise ModelError(
            "the objective is missing: use --maximise or --minimise for a figure, or --match for "
            f"values, such as --maximise {_first_goal(known)}"
        )
    requirements = (*targets, *constraints)
    notes = () if explicit or not (note := fixed_dimensions_note(template)) else (note,)
    named = (*(goal.figure for goal in goals), *(r.figure for r in requirements))
    return Problem(
        family=Family(template=template, variables=variables, environment=environment),
        goals=goals,
        requirements=requirements,
        defaults=default_requirements(
            described, known, requirements, request.without, goals=[g.figure for g in goals]
        ),
        checked=CHECK not in request.without,
        notes=(*notes, *_rms_note(environment, named)),
    )


def _first_goal(known: dict[tuple[str, str], float]) -> str:
    figures = default_figures(known)
    return next((f.name for f in figures if f.quantity == "natural_frequency_hz"), "mass")


def _needs_of(path: str | None, stage: Stage, known: Iterable[tuple[str, str]]) -> list[str]:
    """Return the needs of a rotary table that are figures of a stage, as constraints."""
    if path is None:
        return []
    from flexstage.centring.table_file import read_table
    from flexstage.studies.scale import needs_as_constraints

    names = {quantity for quantity, _ in known}
    return [text for name, text in needs_as_constraints(read_table(path), stage) if name in names]


def _targets(text: str | Requirement, described: Any, known: Any) -> tuple[Requirement, ...]:
    if isinstance(text, Requirement):
        return (text,)
    if text.strip() == _PUBLISHED:
        return published_targets(described, known)
    target = requirement_of(text, known)
    if target.low is None or target.high is None:
        raise ModelError(
            f'--match needs a figure and its value, such as "stroke.x = 60 um", got '
            f"'{text[:60]}': use --keep for a limit"
        )
    return (target,)


def ready_reconstruct(
    request: ReconstructRequest, template: StageTemplate
) -> Callable[[Workers], Ensemble]:
    """Return the function that computes an ensemble of stages from given figures."""
    described = template.stage()
    variables = variables_of(template, request.free) or free_variables(template)
    if not variables:
        raise ModelError(
            f"{template.source} has no parameter that can be varied: give its dimensions names "
            "under 'parameters' in the stage file"
        )
    analysis = analyse_model(described, request.model)
    known = {(row.quantity, row.axis) for row in analysis.characteristics}
    targets: tuple[Requirement, ...] = ()
    for text in request.match or (_PUBLISHED,):
        targets += _targets(text, described, known)
    names = [target.figure.name for target in targets]
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise ModelError(f"{', '.join(repeated)} is given twice: remove one")
    run = partial(
        reconstruct,
        template,
        [observation_of(target) for target in targets],
        [dimension_of(variable) for variable in variables],
        model=request.model,
        members=request.members,
        seed=request.seed,
        seconds=request.time_limit,
    )
    return lambda workers: replace(run(workers=workers), request=request)


def ready_sensitivity(
    request: SensitivityRequest, template: StageTemplate
) -> Callable[[], Sensitivities]:
    """Return the function that computes sensitivities."""
    if request.hinges and request.model != "lumped":
        raise ModelError(
            "--hinges needs --model lumped: finite elements cut notches from the edges of bodies, "
            "so that a single notch cannot move"
        )
    figures = requested_figures(request.of, known_figures(template.stage()))
    if request.hinges:
        family, skipped = hinge_variables(template, request.by), {}
    else:
        variables, skipped = variables_by(template, request.by)
        family = Family(template=template, variables=variables)
        if not variables:
            raise ModelError(
                f"{template.source} has no parameter that changes continuously: give its "
                "dimensions names under 'parameters' in the stage file, or use --hinges"
            )
    run = partial(sensitivities, family, figures, request.model, skipped)
    return lambda: replace(run(), request=request)


def ready_tolerance(
    request: ToleranceRequest, stage: Stage
) -> Callable[[Workers, Path | None], ToleranceStudy]:
    """Return the function that runs a tolerance analysis, and the search of tolerances."""
    if request.follow_necks and request.model == "lumped":
        raise ModelError("--follow-necks needs a --model other than lumped")
    process, measured = scatter_of(request.scatter), measured_necks(request.widths, stage)
    if measured is not None:
        names = {text.partition("=")[0].strip() for text in request.scatter}
        if both := sorted(names & {"neck_common", "neck_own"}):
            raise ModelError(f"--widths gives the scatter of necks: omit --scatter {both[0]}=…")
        stage, process = measured.biased(stage), measured.scattered(process)
    weights = {name: _weight(name, text) for name, text in _pairs(request.cost, "--cost")}
    if request.cost and request.target_yield is None:
        raise ModelError(
            "--cost needs --target-yield: it weights the costs of tolerances for that yield"
        )
    target = request.target_yield
    if target is not None and not request.require:
        raise ModelError(
            "--target-yield needs at least one --require: a requirement on a good stage"
        )
    environment = _environment(request.environment)
    known = (*batched_figures(stage), *seated_figures(stage))
    if environment is not None:
        known += tuple(open_rms(stage, lumped_system(stage), environment))
    figures = requested_figures(request.of, known)
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
            environment=environment,
            workers=workers,
            keep=keep,
        )
        choice = None
        if target is not None:
            choice = choose_tolerances(study, target, weights=weights, workers=workers)
        notes = (*study.notes, *_rms_note(environment, study.monte_carlo.figures))
        notes = notes if measured is None else (measured.note(), *notes)
        return replace(study, choice=choice, request=request, notes=notes)

    return run


def scatter_of(texts: Iterable[str]) -> Scatter:
    """Return the scatter of texts, applied in their order; the default one for other fields.

    Examples
    --------
    >>> scatter_of(["neck_own=2 um", "modulus=0.5 %"]).neck_own
    2e-06
    """
    names, dimensions = [kind.name for kind in KINDS], scatter_dimensions()
    scatter = Scatter()
    for pattern, text in _pairs(texts, "--scatter"):
        matches = [name for name in names if fnmatchcase(name, pattern)]
        if not matches:
            raise ModelError(unknown("deviation", pattern, names))
        for name in matches:
            dimension = dimensions[name]
            if text.strip() == "0":
                value = 0.0
            elif dimension is None:
                value = read_number(text, 'a share, such as "0.5 %" or 0.005')
            else:
                value = parse(text, dimension.name)
            scatter = replace(scatter, **{name: value})
    return scatter


def _pairs(texts: Iterable[str], option: str) -> list[tuple[str, str]]:
    pairs = []
    for text in texts:
        name, equals, value = text.partition("=")
        if not name.strip() or not equals or not value.strip():
            raise ModelError(
                f"{option} needs a name and a value, such as neck_own=\"2 um\", got '{text[:60]}'"
            )
        pairs.append((name.strip(), value.strip()))
    return pairs


def _weight(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ModelError(f"the cost of {name} must be a number, got '{text[:40]}'") from None
