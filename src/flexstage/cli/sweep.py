"""`flexstage sweep`: figures of a stage over its parameters."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexstage.cli.options import JsonOption, ModelOption, QuietOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    OutputFolder,
    console,
    on_terminal,
    picture,
    print_json,
    print_notes,
    progress_bar,
)
from flexstage.cli.stage_options import NOTHING_SET, ParameterOptions, TemplateArgument
from flexstage.cli.worker_options import USUAL_WORKERS, WorkerOptions, finished_batches
from flexstage.errors import ModelError

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure as Drawing

    from flexstage.designs import StageTemplate
    from flexstage.explore import Sweep


@from_docstring
def sweep(
    stage: TemplateArgument,
    over: list[str] | None = None,
    of: list[str] | None = None,
    plan: str | None = None,
    samples: Annotated[int | None, typer.Option(min=1)] = None,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    indices: bool = False,
    model: ModelOption = "lumped",
    folder: OutputFolder = None,
    figure: FigureFile = None,
    taken: ParameterOptions = NOTHING_SET,
    sharing: WorkerOptions = USUAL_WORKERS,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Vary parameters of a stage, and see what its figures do.

    Parameters
    ----------
    over
        NAME=RANGE: A parameter and its range, such as leg_neck="0.3..0.8 mm", with /6 behind it for
        six values; or "x.*=20 %", every parameter of such a name by 20 % to either side; may be
        repeated.
    of
        FIGURE: A figure that is looked at, such as natural_frequency.x, stroke (of every axis) or
        mass; may be repeated (default: ratio, stroke, frequency, stress and coupling of each axis).
    plan
        grid|latin-hypercube|sobol: How points are spread: on a grid, as a Latin hypercube, or as a
        Sobol' sequence (default: a grid of one or two parameters, a sequence of more).
    samples
        NUMBER: Number of points; a grid has at most so many, a Sobol' sequence the next power of 2.
        With --indices the number of base samples, each of which takes as many points as there are
        parameters and two more.
    seed
        NUMBER: Seed of Latin hypercube and Sobol' sequence.
    indices
        Estimate Sobol' indices: which parameter has which share in the variation of each figure.
    folder
        Write all points as sweep.csv and sweep.parquet, the summary as sweep.json, pictures, and
        sweep.html with parallel coordinates. A sweep that was interrupted goes on from there.
    figure
        Draw the figures over the parameters: curves, maps or diagrams. (.svg, .png or .pdf)
    """
    from flexstage.choose import unknown
    from flexstage.explore import Family, known_figures, usual_plan, variables_of
    from flexstage.explore import sweep as run_sweep
    from flexstage.explore.figures import chosen_figures
    from flexstage.explore.sampling import SAMPLINGS
    from flexstage.studies.models import known_model

    known_model(model)
    if plan is not None and plan not in SAMPLINGS:
        raise ModelError(unknown("plan", plan, SAMPLINGS))
    template = taken.template(stage)
    if not over:
        raise ModelError(_nothing_varied(template))
    family = Family(template=template, variables=variables_of(template, over))
    wanted = usual_plan(
        family.variables,
        model,
        sampling=plan,  # type: ignore[arg-type]
        samples=samples,
        seed=seed,
        indices=indices,
    )
    figures = chosen_figures(of, known_figures(family.stage(family.usual)))
    with finished_batches(folder) as keep:
        with progress_bar("sweep", quiet=quiet), sharing.open() as workers:
            found = run_sweep(family, figures, wanted, model=model, workers=workers, keep=keep)
        files, notes = _written(found, folder, figure)
    if json:
        from flexstage.explore.sweep_files import sweep_results

        result = sweep_results(found, columns=True)
        result["notes"] += notes
        print_json(result | {"files": [str(file) for file in files]})
        return
    from flexstage.report.sweep import sweep_notes, sweep_tables

    screen = console()
    for shown in sweep_tables(found):
        screen.print(on_terminal(shown))
    print_notes(screen, (*sweep_notes(found), *notes), files)


def _nothing_varied(template: "StageTemplate") -> str:
    """Say how a parameter of this stage is varied."""
    from flexstage.explore.variables import every_variable, listed

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


def _written(
    found: "Sweep", folder: Path | None, figure: Path | None
) -> tuple[list[Path], list[str]]:
    """Write what was asked for; return the files, and what could not be made."""
    from flexstage.explore.sweep_files import sweep_csv, sweep_parquet, sweep_results
    from flexstage.files.plain import json_text
    from flexstage.files.write import write_files
    from flexstage.report.figures.sweep import draw_indices, draw_sweep
    from flexstage.report.sweep import sweep_html

    files: list[Path] = []
    notes: list[str] = []

    def made(path: Path, make: "Callable[[], Drawing | bytes | str]") -> dict[str, bytes]:
        """Content of a file by its name; a note where it cannot be made."""
        try:
            content = make()
        except ModelError as error:
            notes.append(f"{path.name} was not written: {error}")
            return {}
        if isinstance(content, str):
            return {path.name: content.encode()}
        return {path.name: content if isinstance(content, bytes) else picture(path, content)}

    if figure is not None:
        files += write_files(figure.parent, made(figure, lambda: draw_sweep(found)))
    if folder is None:
        return files, notes
    contents = {
        "sweep.csv": lambda: sweep_csv(found),
        "sweep.parquet": lambda: sweep_parquet(found),
        "sweep.json": lambda: json_text(sweep_results(found)),
        "sweep.svg": lambda: draw_sweep(found),
        **({} if found.indices is None else {"indices.svg": lambda: draw_indices(found)}),
        "sweep.html": lambda: sweep_html(found),
    }
    whole: dict[str, bytes] = {}
    for name, make in contents.items():
        whole |= made(Path(name), make)
    return files + write_files(folder, whole), notes
