"""`flexstage tolerance`: what the workshop makes of a stage, and which tolerance to tighten."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexstage.cli.options import (
    USUAL_WORKERS,
    JsonOption,
    QuietOption,
    WorkerOptions,
    from_docstring,
    one_of,
    refuse,
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
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions

if TYPE_CHECKING:
    from flexstage.explore.tolerance import ToleranceStudy
    from flexstage.explore.tolerance_choice import ToleranceChoice


@from_docstring
def tolerance(
    stage: StageArgument,
    taken: StageOptions = AS_DESCRIBED,
    samples: Annotated[int, typer.Option(min=2)] = 10_000,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    scatter: list[str] | None = None,
    require: list[str] | None = None,
    of: list[str] | None = None,
    target_yield: str | None = None,
    cost: list[str] | None = None,
    model: Annotated[str, one_of(("superelement", "lumped"))] = "superelement",
    follow_necks: bool = False,
    figure: FigureFile = None,
    folder: OutputFolder = None,
    every_sample: bool = False,
    sharing: WorkerOptions = USUAL_WORKERS,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Compute what the workshop makes of a stage: spread, yield.

    Parameters
    ----------
    samples
        NUMBER: Stages that are drawn.
    seed
        NUMBER: Random seed; a stage of the lot is the same whatever their number.
    scatter
        NAME=SIZE: Standard deviation of a deviation, such as neck_own="1 um" or modulus="0.5 %"; a
        pattern is for several ("*=0"); may be repeated. Names: neck_common, neck_own, radius,
        position, thickness, modulus, density, temperature, stroke, drive. The usual scatter of wire
        erosion where not given.
    require
        REQUIREMENT: What a good stage has, such as "natural_frequency.x >= 300 Hz" or
        "ratio.x = 1.7 +- 1 %"; may be repeated.
    of
        FIGURE: A figure that is looked at, such as natural_frequency.x, stress (of every axis) or
        mass; may be repeated (default: ratio, stroke, frequency, stress and coupling of each axis).
    target_yield
        SHARE: Find the cheapest scatter by which so many stages are good, such as "99 %".
    cost
        NAME=WEIGHT: Weight of the cost of a tolerance for --target-yield (default: 1 of each); may
        be repeated.
    model
        Model whose figures of the drawing correct those of the lumped one, which follows the
        samples; lumped for none.
    follow_necks
        Have that model say as well how figures follow an offset of all necks: two more analyses,
        each of notches that it has not met.
    figure
        Draw the distribution of every figure. (.svg, .png or .pdf)
    folder
        Folder of tolerance.html, tolerance.json and pictures; finished batches are kept there while
        it works, and the same run goes on from them.
    every_sample
        Write the figures of every sample as well, samples.csv.
    """
    from flexstage.explore.batches import finished_batches
    from flexstage.explore.requests.tolerance import ToleranceRequest
    from flexstage.report.explored_files import tolerance_files
    from flexstage.report.figures.tolerance import draw_spreads

    refuse(every_sample and folder is None, "--every-sample writes a file: give a --folder for it")
    run = ToleranceRequest(
        samples=samples,
        seed=seed,
        scatter=tuple(scatter or ()),
        require=tuple(require or ()),
        of=tuple(of or ()),
        target_yield=target_yield,
        cost=tuple(cost or ()),
        model=model,
        follow_necks=follow_necks,
    ).ready(taken.stage(stage))
    with finished_batches(folder) as keep:
        with progress_bar("tolerance", quiet=quiet), sharing.open() as workers:
            study, choice = run(workers, keep)
        files = write_folder(folder, lambda: tolerance_files(study, choice, every=every_sample))
    files += write_picture(figure, lambda: draw_spreads(study))
    if json:
        from flexstage.explore.results import tolerance_results

        print_json(tolerance_results(study, choice) | {"files": [str(file) for file in files]})
        return
    _print(study, choice, files)


def _print(study: "ToleranceStudy", choice: "ToleranceChoice | None", files: list[Path]) -> None:
    from flexstage.report.tolerance import choice_table, share_table, spread_table, yield_table

    screen = console()
    print_shown(screen, spread_table(study))
    if study.yields:
        print_shown(screen, yield_table(study.yields))
    if study.shares:
        print_shown(screen, share_table(study))
    if choice is not None:
        if choice.found:
            print_shown(screen, choice_table(choice))
        screen.print(choice.verdict, markup=False)
    print_notes(screen, (f"figures by the {study.model}", *study.notes), files)
