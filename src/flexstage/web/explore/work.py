"""Computations of the view Explore in a worker process, the same as those of the commands."""

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

#: Family, figures and points of a sweep; the problem of an optimisation; None for other requests.
StudyDefinition = tuple[Family, tuple[Figure, ...], SweepPlan] | Problem | None
#: Title of the main picture of an optimum.
BEFORE_AFTER = "Before and after"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExploreResult:
    """Result, files and tables of a command, and its pictures for a page."""

    result: Sweep | Front | Optimum | Sensitivities | ToleranceStudy
    """Result of the library."""
    files: tuple[Path, ...]
    """The written files."""
    pictures: tuple[tuple[str, str], ...]
    """Title and SVG of each picture."""
    tables: tuple[Table, ...]
    """Tables of the result."""
    notes: tuple[str, ...]
    """Notes on the result and its files."""


def define_study(template: StageTemplate, request: ExploreRequest) -> StudyDefinition:
    """Check a request; return the definition of a sweep or an optimisation."""
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


def run_exploration(
    folder: Path, template: StageTemplate, request: ExploreRequest, key: str
) -> ExploreResult:
    """Carry out a request for a stage, and write the files of the command into a folder.

    The folder keeps finished batches, so that a cancelled run can be resumed. Ids in the pictures
    begin with `key`. One process does all of the work, as the panel serves others as well.
    """
    with finished_batches(folder) as keep:
        match request:
            case SweepRequest():
                result = ready_sweep(request, template)(workers=Workers(1), keep=keep)
                output = _of_sweep(result)
            case ToleranceRequest():
                result = ready_tolerance(request, template.stage())(Workers(1), keep)
                output = _of_tolerance(result)
            case OptimiseRequest():
                result = ready_optimise(request, template)(Workers(1))
                output = _of_front(result) if isinstance(result, Front) else _of_optimum(result)
            case SensitivityRequest():
                result = ready_sensitivity(request, template)()
                output = _of_sensitivities(result)
        files = write_files(folder, output.files)
    pictures = tuple(
        (title, inline(draw, f"{key}{k}", title))
        for k, (title, draw) in enumerate(output.pictures.items())
    )
    return ExploreResult(
        result=result,
        files=tuple(files),
        pictures=pictures,
        tables=tuple(output.tables),
        notes=tuple(output.notes),
    )


class _Output(NamedTuple):
    """Files, tables and notes of a command, and the functions that draw its pictures, by title."""

    files: Mapping[str, bytes]
    tables: Iterable[Table]
    notes: Iterable[str]
    pictures: "Mapping[str, Callable[[], Drawing]]"


def _of_sweep(sweep_result: Sweep) -> _Output:
    from flexstage.report import sweep
    from flexstage.report.result_files import sweep_files

    files, omitted = sweep_files(sweep_result)
    title = "All figures that change over the varied parameters"
    pictures = {} if sweep_result.constant.all() else {title: sweep_result.plot}
    notes = (*sweep.sweep_notes(sweep_result), *omitted)
    return _Output(files, sweep.range_tables(sweep_result), notes, pictures)


def _of_tolerance(study: ToleranceStudy) -> _Output:
    from flexstage.report import tolerance
    from flexstage.report.result_files import tolerance_files

    choice = study.choice
    tables = [tolerance.yield_table(study.yields)] if study.yields else []
    tables.append(tolerance.spread_table(study))
    pictures: dict[str, Callable[[], Drawing]] = {"Distribution of every figure": study.plot}
    if choice is not None and choice.available:
        tables.append(tolerance.choice_table(choice))
    if study.shares:
        tables.append(tolerance.share_table(study))
        pictures["Contributions to the variance of every figure"] = partial(study.plot, "shares")
    assessment = () if choice is None else (choice.conclusion,)
    notes = (*assessment, f"figures by the {study.model}", *study.notes)
    return _Output(tolerance_files(study, every=True), tables, notes, pictures)


def _of_sensitivities(result: Sensitivities) -> _Output:
    from flexstage.report.result_files import sensitivity_files
    from flexstage.report.sensitivity import sensitivity_table, skipped_notes

    pictures = {"Changes of the figures": result.plot}
    tables = [sensitivity_table(result)]
    return _Output(sensitivity_files(result), tables, skipped_notes(result), pictures)


def _of_optimum(optimum: Optimum) -> _Output:
    from flexstage.report import optimise
    from flexstage.report.result_files import optimum_files

    tables, notes = optimise.optimum_tables(optimum), optimise.optimum_notes(optimum)
    return _Output(optimum_files(optimum), tables, notes, _drawings(optimum))


def _of_front(front: Front) -> _Output:
    from flexstage.report import optimise
    from flexstage.report.result_files import front_files

    pictures = {"Pareto front": front.plot, **_drawings(front.optimum)}
    tables, notes = optimise.front_tables(front), optimise.front_notes(front)
    return _Output(front_files(front), tables, notes, pictures)


def _drawings(best: Optimum) -> "dict[str, Callable[[], Drawing]]":
    return {
        BEFORE_AFTER: best.plot,
        "Figures relative to their limits": partial(best.plot, "figures"),
        "History of the search": partial(best.plot, "history"),
    }
