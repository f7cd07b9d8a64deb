"""What the view Explore has computed, in a process of its own: what the commands compute."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from flexstage.files.write import write_files
from flexstage.quantities.table import Table
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.batches import finished_batches
from flexstage.studies.explore.family import Family
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.optimise.front import Front
from flexstage.studies.explore.optimise.optimum import Optimum
from flexstage.studies.explore.optimise.problem import Problem
from flexstage.studies.explore.prepare import (
    problem_of,
    ready_optimise,
    ready_sensitivity,
    ready_sweep,
    ready_tolerance,
    swept,
)
from flexstage.studies.explore.requests import (
    ExploreRequest,
    OptimiseRequest,
    SensitivityRequest,
    SweepRequest,
    ToleranceRequest,
)
from flexstage.studies.explore.sampling import SweepPlan
from flexstage.studies.explore.sensitivity import Sensitivities
from flexstage.studies.explore.sweep import Sweep
from flexstage.studies.explore.tolerance import ToleranceStudy
from flexstage.studies.explore.workers import Workers
from flexstage.web.pictures import inline

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

#: What is varied, which figures are computed and where; or what is sought; None of other work.
Question = tuple[Family, tuple[Figure, ...], SweepPlan] | Problem | None
#: Title of the picture that says most of an optimum.
BEFORE_AFTER = "Before and after"


@dataclass(frozen=True, slots=True, kw_only=True)
class Explored:
    """What came out, as the command prints and writes it, with its pictures for a page."""

    result: Sweep | Front | Optimum | Sensitivities | ToleranceStudy
    """What the library returns."""
    files: tuple[Path, ...]
    """What was written."""
    pictures: tuple[tuple[str, str], ...]
    """Title and SVG of each picture."""
    tables: tuple[Table, ...]
    """Its tables."""
    notes: tuple[str, ...]
    """What is to be known of it and of its files."""


def question_of(template: StageTemplate, request: ExploreRequest) -> Question:
    """Return what a sweep or an optimisation is about; what is wrong with a request is told."""
    match request:
        case SweepRequest():
            return swept(request, template)
        case OptimiseRequest():
            return problem_of(request, template)
        case ToleranceRequest():
            ready_tolerance(request, template.stage())
        case SensitivityRequest():
            ready_sensitivity(request, template)
    return None


def explored(folder: Path, template: StageTemplate, request: ExploreRequest, key: str) -> Explored:
    """Do what is asked of a stage, and write what the command writes into a folder.

    Finished batches are kept there until then, so that what was cancelled goes on from them. Ids in
    the pictures begin with `key`. This process does all of the work: the panel has others to serve.
    """
    with finished_batches(folder) as keep:
        match request:
            case SweepRequest():
                result = ready_sweep(request, template)(workers=Workers(1), keep=keep)
                shown = _of_sweep(result)
            case ToleranceRequest():
                result = ready_tolerance(request, template.stage())(Workers(1), keep)
                shown = _of_lot(result)
            case OptimiseRequest():
                result = ready_optimise(request, template)(Workers(1))
                shown = _of_front(result) if isinstance(result, Front) else _of_optimum(result)
            case SensitivityRequest():
                result = ready_sensitivity(request, template)()
                shown = _of_sensitivities(result)
        written = write_files(folder, shown.files)
    pictures = tuple(
        (title, inline(draw, f"{key}{k}", title))
        for k, (title, draw) in enumerate(shown.pictures.items())
    )
    return Explored(
        result=result,
        files=tuple(written),
        pictures=pictures,
        tables=tuple(shown.tables),
        notes=tuple(shown.notes),
    )


class _Shown(NamedTuple):
    """What a command writes, prints and says, and what draws its pictures, by their titles."""

    files: Mapping[str, bytes]
    tables: Iterable[Table]
    notes: Iterable[str]
    pictures: "Mapping[str, Callable[[], Drawing]]"


def _of_sweep(found: Sweep) -> _Shown:
    from flexstage.report import sweep
    from flexstage.report.explored_files import sweep_files

    files, left_out = sweep_files(found)
    title = "All figures that vary, over what was varied"
    pictures = {} if found.constant.all() else {title: found.plot}
    notes = (*sweep.sweep_notes(found), *left_out)
    return _Shown(files, sweep.range_tables(found), notes, pictures)


def _of_lot(study: ToleranceStudy) -> _Shown:
    from flexstage.report import tolerance
    from flexstage.report.explored_files import tolerance_files

    choice = study.choice
    tables = [tolerance.yield_table(study.yields)] if study.yields else []
    tables.append(tolerance.spread_table(study))
    pictures: dict[str, Callable[[], Drawing]] = {"Distribution of every figure": study.plot}
    if choice is not None and choice.available:
        tables.append(tolerance.choice_table(choice))
    if study.shares:
        tables.append(tolerance.share_table(study))
        pictures["What the variance of every figure consists of"] = partial(study.plot, "shares")
    verdict = () if choice is None else (choice.conclusion,)
    notes = (*verdict, f"figures by the {study.model}", *study.notes)
    return _Shown(tolerance_files(study, every=True), tables, notes, pictures)


def _of_sensitivities(found: Sensitivities) -> _Shown:
    from flexstage.report.explored_files import sensitivity_files
    from flexstage.report.sensitivity import sensitivity_table, skipped_notes

    pictures = {"Changes of the figures": found.plot}
    tables = [sensitivity_table(found)]
    return _Shown(sensitivity_files(found), tables, skipped_notes(found), pictures)


def _of_optimum(found: Optimum) -> _Shown:
    from flexstage.report import optimise
    from flexstage.report.explored_files import optimum_files

    tables, notes = optimise.optimum_tables(found), optimise.optimum_notes(found)
    return _Shown(optimum_files(found), tables, notes, _drawings(found))


def _of_front(found: Front) -> _Shown:
    from flexstage.report import optimise
    from flexstage.report.explored_files import front_files

    pictures = {"Pareto front": found.plot, **_drawings(found.optimum)}
    tables, notes = optimise.front_tables(found), optimise.front_notes(found)
    return _Shown(front_files(found), tables, notes, pictures)


def _drawings(best: Optimum) -> "dict[str, Callable[[], Drawing]]":
    return {
        BEFORE_AFTER: best.plot,
        "Figures, each in parts of its limit": partial(best.plot, "figures"),
        "Way to the optimum": partial(best.plot, "history"),
    }
