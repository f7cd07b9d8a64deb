"""`flexstage optimise`: the best stage of a family, or the one that has stated figures."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import (
    USUAL_WORKERS,
    JsonOption,
    QuietOption,
    WorkerOptions,
    from_docstring,
)
from flexstage.cli.output import (
    FigureFile,
    OutputFolder,
    console,
    print_json,
    print_notes,
    print_shown,
    progress_bar,
    write_folder,
    write_picture,
)
from flexstage.cli.stage_options import NOTHING_SET, ParameterOptions, TemplateArgument

if TYPE_CHECKING:
    from flexstage.explore import Front, Optimum


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
        stroke (90 % of that as described), safety_factor (1.5 against yield), input_stiffness (no
        stiffer than the actuator, and full stroke within its blocking force), smallest_wall (1 mm
        of any body) or output_wall (3.3 mm of the body that moves the load; both no more than the
        stage has); may be repeated.
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
    from flexstage.explore.optimise.front import Front
    from flexstage.explore.requests.optimise import OptimiseRequest

    run = OptimiseRequest(
        maximise=tuple(maximise or ()),
        minimise=tuple(minimise or ()),
        keep=tuple(keep or ()),
        match=tuple(match or ()),
        over=tuple(over or ()),
        without=tuple(without or ()),
        start=start,
        model=model,
        confirm=confirm,
        evaluations=evaluations,
        seed=seed,
    ).ready(taken.template(stage))
    with progress_bar("optimise", quiet=quiet), sharing.open() as workers:
        found = run(workers)
    if isinstance(found, Front):
        _tell_front(found, folder, figure, json=json)
        found = found.optimum
    else:
        _tell(found, folder, figure, json=json)
    if not found.met:  # a requirement is missed
        raise typer.Exit(1)


def _tell(found: "Optimum", folder: Path | None, figure: Path | None, *, json: bool) -> None:
    from flexstage.explore.results import optimum_results
    from flexstage.report.explored_files import optimum_files
    from flexstage.report.figures.optimum import draw_before_after
    from flexstage.report.optimise import optimum_notes, optimum_tables

    files = write_folder(folder, partial(optimum_files, found))
    files += write_picture(figure, partial(draw_before_after, found))
    if json:
        print_json(optimum_results(found) | {"files": [str(file) for file in files]})
        return
    _print(optimum_tables(found), optimum_notes(found), files)


def _tell_front(found: "Front", folder: Path | None, figure: Path | None, *, json: bool) -> None:
    from flexstage.explore.results import front_results
    from flexstage.report.explored_files import front_files
    from flexstage.report.figures.optimum import draw_front
    from flexstage.report.optimise import front_notes, front_tables

    files = write_folder(folder, partial(front_files, found))
    files += write_picture(figure, partial(draw_front, found))
    if json:
        print_json(front_results(found) | {"files": [str(file) for file in files]})
        return
    _print(front_tables(found), front_notes(found), files)


def _print(tables: Any, notes: tuple[str, ...], files: list[Path]) -> None:
    screen = console()
    for shown in tables:
        print_shown(screen, shown)
    print_notes(screen, notes, files)
