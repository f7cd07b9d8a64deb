"""`flexstage tolerance`: what the workshop makes of a stage, and which tolerance to tighten."""

from dataclasses import replace
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Annotated

import typer

from flexstage.cli.options import JsonOption, QuietOption, from_docstring, one_of
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
from flexstage.cli.stage_options import AS_DESCRIBED, StageArgument, StageOptions
from flexstage.cli.worker_options import USUAL_WORKERS, WorkerOptions, finished_batches
from flexstage.errors import ModelError

if TYPE_CHECKING:
    from pathlib import Path

    from flexstage.explore.tolerance import ToleranceStudy
    from flexstage.explore.tolerance_choice import ToleranceChoice
    from flexstage.virtual.imperfections import Scatter


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
    from flexstage.explore.family import batched_figures
    from flexstage.explore.figures import chosen_figures, requirements_of
    from flexstage.explore.tolerance import tolerance as draw_lot
    from flexstage.explore.tolerance_choice import choose_tolerances

    if model not in ("superelement", "lumped"):
        raise ModelError(f"--model is superelement or lumped, got '{model[:40]}'")
    if follow_necks and model == "lumped":
        raise ModelError("--follow-necks needs another --model than lumped, which says it then")
    if every_sample and folder is None:
        raise ModelError("--every-sample writes a file: give a --folder for it")
    process = scatter_of(scatter or ())
    weights = {name: _weight(name, text) for name, text in _pairs(cost or (), "--cost")}
    if cost and target_yield is None:
        raise ModelError("--cost needs --target-yield: it weighs what is chosen for that")
    target = None if target_yield is None else _yield_share(target_yield)
    if target is not None and not require:
        raise ModelError("--target-yield needs at least one --require: what a good stage has")
    described = taken.stage(stage)
    known = batched_figures(described)
    figures = chosen_figures(of, known)
    requirements = requirements_of(require or (), known)
    choice = None
    with finished_batches(folder) as keep:
        with progress_bar("tolerance", quiet=quiet), sharing.open() as workers:
            study = draw_lot(
                described,
                process,
                figures=figures,
                requirements=requirements,
                samples=samples,
                seed=seed,
                model=model,
                follow_necks=follow_necks,
                workers=workers,
                keep=keep,
            )
            if target is not None:
                choice = choose_tolerances(study, target, weights=weights, workers=workers)
        files = [] if folder is None else _written(folder, study, choice, every=every_sample)
    if figure is not None:
        from flexstage.report.figures.tolerance import draw_spreads

        write_file(figure, picture(figure, draw_spreads(study)))
        files.append(figure)
    if json:
        from flexstage.explore.tolerance_files import tolerance_results

        print_json(tolerance_results(study, choice) | {"files": [str(file) for file in files]})
        return
    _print(study, choice, files)


def scatter_of(texts: "list[str] | tuple[str, ...]") -> "Scatter":
    """Return the scatter that words say, one after the other; the usual one of what they leave."""
    from flexstage.choose import unknown
    from flexstage.explore.deviations import KINDS
    from flexstage.report.tolerance import scatter_dimensions
    from flexstage.units import parse
    from flexstage.virtual.imperfections import Scatter

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
                value = _share(text)
            else:
                value = parse(text, dimension.name)
            found = replace(found, **{name: value})
    return found


def _pairs(texts: "list[str] | tuple[str, ...]", option: str) -> list[tuple[str, str]]:
    pairs = []
    for text in texts:
        name, equals, value = text.partition("=")
        if not name.strip() or not equals or not value.strip():
            raise ModelError(
                f"{option} is a name and a value, such as neck_own=\"2 um\", got '{text[:60]}'"
            )
        pairs.append((name.strip(), value.strip()))
    return pairs


def _share(text: str) -> float:
    words, percent = text.strip().removesuffix("%"), text.strip().endswith("%")
    try:
        return float(words) * (0.01 if percent else 1.0)
    except ValueError:
        raise ModelError(
            f"expected a share, such as \"0.5 %\" or 0.005, got '{text[:40]}'"
        ) from None


def _yield_share(text: str) -> float:
    share = _share(text)
    if 1.0 < share < 100.0 and not text.strip().endswith("%"):
        raise ModelError(
            f"--target-yield is a share, such as \"99 %\" or 0.99, got '{text.strip()[:40]}': "
            f'write "{share:g} %"'
        )
    return share


def _weight(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ModelError(f"the cost of {name} is a number, got '{text[:40]}'") from None


def _written(
    folder: "Path", study: "ToleranceStudy", choice: "ToleranceChoice | None", *, every: bool
) -> "list[Path]":
    from flexstage.explore.tolerance_files import samples_csv, tolerance_results
    from flexstage.files.plain import json_text
    from flexstage.files.write import write_files
    from flexstage.report.figures.style import encode
    from flexstage.report.figures.tolerance import draw_shares, draw_spreads
    from flexstage.report.tolerance import tolerance_page

    files = {
        "tolerance.html": tolerance_page(study, choice).encode(),
        "tolerance.json": json_text(tolerance_results(study, choice)).encode(),
        "figures.svg": encode(draw_spreads(study), "svg"),
    }
    if study.shares:
        files["shares.svg"] = encode(draw_shares(study), "svg")
    if every:
        files["samples.csv"] = samples_csv(study)
    return write_files(folder, files)


def _print(study: "ToleranceStudy", choice: "ToleranceChoice | None", files: "list[Path]") -> None:
    from flexstage.report.tolerance import choice_table, share_table, spread_table, yield_table

    screen = console()
    screen.print(on_terminal(spread_table(study)))
    if study.yields:
        screen.print(on_terminal(yield_table(study.yields)))
    if study.shares:
        screen.print(on_terminal(share_table(study)))
    if choice is not None:
        if choice.found:
            screen.print(on_terminal(choice_table(choice)))
        screen.print(choice.verdict, markup=False)
    print_notes(screen, (f"figures by the {study.model}", *study.notes), files)
