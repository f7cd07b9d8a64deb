"""`flexstage optimise`: the best stage of a family, or the one that has stated figures."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import JsonOption, QuietOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    OutputFolder,
    console,
    on_terminal,
    picture,
    print_json,
    print_notes,
    progress_bar,
    write_file,
)
from flexstage.cli.stage_options import NOTHING_SET, ParameterOptions, TemplateArgument
from flexstage.cli.worker_options import USUAL_WORKERS, WorkerOptions
from flexstage.errors import ModelError

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure

    from flexstage.designs import StageTemplate
    from flexstage.explore import Front, Goal, Optimum, Problem, Requirement

_PUBLISHED = "published"


@from_docstring
def optimise(
    stage: TemplateArgument,
    maximise: list[str] | None = None,
    minimise: list[str] | None = None,
    keep: list[str] | None = None,
    match: list[str] | None = None,
    over: list[str] | None = None,
    without: list[str] | None = None,
    start: str = "described",
    model: str = "superelement",
    confirm: str | None = None,
    evaluations: Annotated[int | None, typer.Option(min=1)] = None,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    folder: OutputFolder = None,
    figure: FigureFile = None,
    taken: ParameterOptions = NOTHING_SET,
    sharing: WorkerOptions = USUAL_WORKERS,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Find the best dimensions, or those of stated figures.

    The lumped model is searched, finer ones correct it and confirm what is found. Printed are the
    figures before and after, which limit holds the best stage, and what it would give to relax it.

    Parameters
    ----------
    maximise
        FIGURE: A figure to make as large as possible, such as natural_frequency.x; several goals,
        with --minimise, give a Pareto front; may be repeated.
    minimise
        FIGURE: A figure to make as small as possible, such as mass; may be repeated.
    keep
        REQUIREMENT: What is required, such as "stroke.x >= 60 um", "stress.x <= 200 MPa" or
        "ratio.x = 1.7 +- 1 %"; smallest_slot, stroke_left, drive_force and buckling_factor take up
        to half of the time again, each; may be repeated.
    match
        VALUE: A figure to reach, such as "natural_frequency.x = 320 Hz", by the dimensions nearest
        to the start; or published, for the finite-element figures published of STAGE; may be
        repeated.
    over
        NAME=RANGE: A parameter and its bounds, such as leg_neck="0.3..0.8 mm"; or "x.*=20 %", every
        parameter of such a name by 20 % to either side; may be repeated (default: every dimension
        by 30 %, but nothing of bought parts and bolts, and not the thickness of the plate).
    without
        NAME: What is required without being asked, and shall not be here: check (what can be made),
        safety_factor (1.5 against yield), input_stiffness (no stiffer than the actuator, and full
        stroke within its blocking force), smallest_wall (1 mm of any body) or output_wall (3.3 mm
        of the body that moves the load; both no more than the stage has); may be repeated.
    start
        described|middle: Start from the stage as it is described, or from the middle of the bounds,
        which is the same for bounds in per cent.
    model
        superelement|lumped: The model whose figures count; the lumped one alone is quick, and some
        per cent off.
    confirm
        plane|superelement-3d|solid: Have a finer model confirm the best stage, and correct it up to
        three times.
    evaluations
        N: Evaluations of the lumped model at most (default: 250 for each parameter and two more).
    seed
        NUMBER: Random seed of the starts, and of the front.
    folder
        Write the best stage as best.yaml, its dimensions rounded to 0.001 mm, the result as
        optimise.json, and pictures.
    figure
        Draw the stage before and after, or the Pareto front. (.svg, .png or .pdf)
    """
    from flexstage.explore.optimise.ladder import SearchOptions

    problem = _problem(taken.template(stage), maximise, minimise, keep, match, over, without)
    options = SearchOptions(
        start=_word("--start", start, ("described", "middle")),
        model=_word("--model", model, ("superelement", "lumped")),
        confirm=None
        if confirm is None
        else _word("--confirm", confirm, ("plane", "superelement-3d", "solid")),
        evaluations=evaluations,
        seed=seed,
    )
    if len(problem.goals) > 1:
        from flexstage.explore import find_front

        with progress_bar("optimise", quiet=quiet), sharing.open() as workers:
            front = find_front(problem, options, workers)
        _tell_front(front, folder, figure, json=json)
        _end(front.optimum)
        return
    from flexstage.explore import find_optimum

    # one search is one process's work: a wrong number of workers is told all the same
    with progress_bar("optimise", quiet=quiet), sharing.open():
        found = find_optimum(problem, options)
    _tell(found, folder, figure, json=json)
    _end(found)


def _end(found: "Optimum") -> None:
    """Fail where a requirement is missed."""
    if not found.met:
        raise typer.Exit(1)


def _word(option: str, given: str, words: tuple[str, ...]) -> Any:
    if given not in words:
        from flexstage.choose import did_you_mean

        raise ModelError(
            f"{option} must be {' or '.join(words)}, got '{given[:60]}'{did_you_mean(given, words)}"
        )
    return given


def _problem(
    template: "StageTemplate",
    maximise: list[str] | None,
    minimise: list[str] | None,
    keep: list[str] | None,
    match: list[str] | None,
    over: list[str] | None,
    without: list[str] | None,
) -> "Problem":
    from flexstage.explore import Family, Problem, known_figures, requirement_of, variables_of
    from flexstage.explore.optimise.usual import (
        CHECK,
        held_dimensions,
        usual_requirements,
        usual_variables,
    )

    variables = variables_of(template, over) if over else usual_variables(template)
    if not variables:
        raise ModelError(
            f"{template.source} has no parameter that can be varied: give its dimensions names "
            "under 'parameters' in the stage file"
        )
    described = template.stage()
    known = known_figures(described)
    goals = _goals(maximise, "maximise", known) + _goals(minimise, "minimise", known)
    if goals and match:
        raise ModelError("--match seeks stated figures, and has no goal: use --keep beside a goal")
    asked = tuple(requirement_of(text, known) for text in keep or ())
    targets: tuple[Requirement, ...] = ()
    for text in match or ():
        targets += _targets(text, described, known)
    if not goals and not targets:
        raise ModelError(
            "say what is sought: --maximise or --minimise a figure, or --match values, such as "
            f"--maximise {next(iter(_names(known)))}"
        )
    requirements = (*targets, *asked)
    return Problem(
        family=Family(template=template, variables=variables),
        goals=goals,
        requirements=requirements,
        usual=usual_requirements(described, known, requirements, without or ()),
        checked=CHECK not in (without or ()),
        notes=() if over or not (held := held_dimensions(template)) else (held,),
    )


def _names(known: dict[tuple[str, str], float]) -> list[str]:
    from flexstage.explore.figures import usual_figures

    return [f.name for f in usual_figures(known) if f.quantity == "natural_frequency_hz"] or [
        "mass"
    ]


def _goals(names: list[str] | None, way: Any, known: Any) -> "tuple[Goal, ...]":
    from flexstage.explore import Goal, figure_of

    return tuple(Goal(figure=figure_of(name, known), way=way) for name in names or ())


def _targets(text: str, described: Any, known: Any) -> "tuple[Requirement, ...]":
    from flexstage.explore import requirement_of
    from flexstage.explore.optimise.usual import published_targets

    if text.strip() == _PUBLISHED:
        return published_targets(described, known)
    target = requirement_of(text, known)
    if target.low is None or target.high is None:
        raise ModelError(
            f'--match is a figure and the value to reach, such as "stroke.x = 60 um", got '
            f"'{text[:60]}': give a limit with --keep"
        )
    return (target,)


def _tell(found: "Optimum", folder: Path | None, figure: Path | None, *, json: bool) -> None:
    from flexstage.explore.optimise.results import optimum_results
    from flexstage.report.figures.optimum import draw_before_after
    from flexstage.report.optimise import optimum_notes, optimum_tables

    result = optimum_results(found)
    drawn = _drawn(found) if folder is not None else {}
    files = _written(folder, found.text, result, drawn)
    files += _figure(figure, draw_before_after, found)
    if json:
        print_json(result | {"files": files})
        return
    _print(optimum_tables(found), optimum_notes(found), files)


def _tell_front(found: "Front", folder: Path | None, figure: Path | None, *, json: bool) -> None:
    from flexstage.explore.optimise.results import front_results
    from flexstage.report.figures.optimum import draw_front
    from flexstage.report.optimise import front_html, front_notes, front_tables

    result = front_results(found)
    drawn: dict[str, bytes] = {}
    if folder is not None:
        drawn = {"front.svg": picture(Path("front.svg"), draw_front(found))} | _drawn(found.optimum)
        if len(found.problem.goals) > 2:
            drawn["front.html"] = front_html(found).encode()
    files = _written(folder, found.optimum.text, result, drawn)
    files += _figure(figure, draw_front, found)
    if json:
        print_json(result | {"files": files})
        return
    _print(front_tables(found), front_notes(found), files)


def _drawn(found: "Optimum") -> dict[str, bytes]:
    from flexstage.report.figures.optimum import draw_before_after, draw_figures, draw_history

    pictures = {
        "history.svg": draw_history,
        "before-after.svg": draw_before_after,
        "figures.svg": draw_figures,
    }
    return {name: picture(Path(name), draw(found)) for name, draw in pictures.items()}


def _figure(figure: Path | None, draw: "Callable[[Any], Figure]", found: Any) -> list[str]:
    if figure is None:
        return []
    write_file(figure, picture(figure, draw(found)))
    return [str(figure)]


def _written(
    folder: Path | None, text: str, result: dict[str, Any], drawn: dict[str, bytes]
) -> list[str]:
    from flexstage.files.plain import json_text
    from flexstage.files.write import write_files

    if folder is None:
        return []
    files = {"best.yaml": text.encode(), "optimise.json": json_text(result).encode()} | drawn
    return [str(file) for file in write_files(folder, files)]


def _print(tables: Any, notes: tuple[str, ...], files: list[str]) -> None:
    screen = console()
    for shown in tables:
        screen.print(on_terminal(shown))
    print_notes(screen, notes, files)
