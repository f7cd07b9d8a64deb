"""What the view Explore has computed, in a process of its own: what the commands compute."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexstage.designs import StageTemplate
from flexstage.explore.batches import finished_batches
from flexstage.explore.family import Family
from flexstage.explore.figures import Figure
from flexstage.explore.optimise.front import Front
from flexstage.explore.optimise.optimum import Optimum
from flexstage.explore.optimise.problem import Problem
from flexstage.explore.requests.optimise import OptimiseRequest
from flexstage.explore.requests.sensitivity import SensitivityRequest
from flexstage.explore.requests.sweep import SweepRequest
from flexstage.explore.requests.tolerance import Found as LotFound
from flexstage.explore.requests.tolerance import ToleranceRequest
from flexstage.explore.sampling import SweepPlan
from flexstage.explore.sensitivity import Sensitivities
from flexstage.explore.sweep import Sweep
from flexstage.explore.workers import Workers
from flexstage.files.write import write_files
from flexstage.web.explore.command import Request
from flexstage.web.pictures import inline

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

#: What is varied, which figures are computed and where; or what is sought; None of other work.
Question = tuple[Family, tuple[Figure, ...], SweepPlan] | Problem | None
#: Title of the picture that says most of an optimum.
BEFORE_AFTER = "Before and after"


@dataclass(frozen=True, slots=True, kw_only=True)
class Explored:
    """What came out, with the files of the command and its pictures for a page."""

    result: Sweep | Front | Optimum | Sensitivities | LotFound
    """What the library returns."""
    files: tuple[Path, ...]
    """What was written."""
    pictures: tuple[tuple[str, str], ...]
    """Title and SVG of each picture."""
    notes: tuple[str, ...]
    """What is to be known of the files."""


def ready(template: StageTemplate, request: Request) -> Callable[..., Any]:
    """Read the words of a request; what is wrong is told."""
    if isinstance(request, ToleranceRequest):
        return request.ready(template.stage())
    return request.ready(template)


def question_of(template: StageTemplate, request: Request) -> Question:
    """Return what a sweep or an optimisation is about; what is wrong with a request is told."""
    match request:
        case SweepRequest():
            return request.question(template)
        case OptimiseRequest():
            return request.problem(template)
    ready(template, request)
    return None


def explored(folder: Path, template: StageTemplate, request: Request, key: str) -> Explored:
    """Do what is asked of a stage, and write what the command writes into a folder.

    Finished batches are kept there until then, so that what was cancelled goes on from them. Ids in
    the pictures begin with `key`. This process does all of the work: the panel has others to serve.
    """
    run = ready(template, request)
    with finished_batches(folder) as keep:
        match request:
            case SweepRequest():
                result = run(workers=Workers(1), keep=keep)
            case ToleranceRequest():
                result = run(Workers(1), keep)
            case OptimiseRequest():
                result = run(Workers(1))
            case SensitivityRequest():
                result = run()
        files, notes = _files(result, request)
        written = write_files(folder, files)
    pictures = tuple(
        (title, inline(draw, f"{key}{k}", title))
        for k, (title, draw) in enumerate(_pictures(result, request))
    )
    return Explored(result=result, files=tuple(written), pictures=pictures, notes=tuple(notes))


def _files(result: Any, request: Request) -> tuple[dict[str, bytes], list[str]]:
    from flexstage.report import explored_files as files

    match request:
        case SweepRequest():
            return files.sweep_files(result)
        case ToleranceRequest():
            return files.tolerance_files(*result, every=True), []
        case SensitivityRequest():
            return files.sensitivity_files(result, request.length), []
        case OptimiseRequest():
            if isinstance(result, Front):
                return files.front_files(result), []
            return files.optimum_files(result), []


def _pictures(result: Any, request: Request) -> "Iterator[tuple[str, Callable[[], Drawing]]]":
    """Yield what each picture shows, and what draws it."""
    from flexstage.report.figures.optimum import (
        draw_before_after,
        draw_figures,
        draw_front,
        draw_history,
    )
    from flexstage.report.figures.sensitivity import draw_sensitivities
    from flexstage.report.figures.sweep import draw_sweep
    from flexstage.report.figures.tolerance import draw_shares, draw_spreads

    match request:
        case SweepRequest():
            if not result.still.all():
                yield "All figures that vary, over what was varied", partial(draw_sweep, result)
        case ToleranceRequest():
            study = result[0]
            yield "Distribution of every figure", partial(draw_spreads, study)
            if study.shares:
                yield "What the variance of every figure consists of", partial(draw_shares, study)
        case SensitivityRequest():
            yield "Changes of the figures", partial(draw_sensitivities, result, request.length)
        case OptimiseRequest():
            best = result.optimum if isinstance(result, Front) else result
            if isinstance(result, Front):
                yield "Pareto front", partial(draw_front, result)
            yield BEFORE_AFTER, partial(draw_before_after, best)
            yield "Figures, each in parts of its limit", partial(draw_figures, best)
            yield "Way to the optimum", partial(draw_history, best)
