"""The jobs of the commands as functions: each takes the fields of its request by name."""

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexstage.base.errors import StageError
from flexstage.files.request import request_of
from flexstage.quantities.comparison import Comparison
from flexstage.quantities.comparison import compare as side_by_side
from flexstage.report.notebook.show import stage_of
from flexstage.report.notebook.stage_analysis import StageAnalysis, analyse
from flexstage.report.page import table_html
from flexstage.stage import Issue, Stage
from flexstage.stage import check as check_stage
from flexstage.studies.explore.workers import open_workers

if TYPE_CHECKING:
    from flexstage.centring.from_records import CentredRecords
    from flexstage.experiments import Campaign, Characterisation
    from flexstage.measure.frf import DecayResult, FrfResult
    from flexstage.records import Record
    from flexstage.stage.designs import StageTemplate
    from flexstage.studies.explore import Front, Optimum, Sensitivities, Sweep, ToleranceStudy

_Path = str | os.PathLike[str]
_Settings = Mapping[str, str] | None


class StageComparison(Comparison):
    """Stages side by side, to look at."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return table_html(self.table())


def check(stage: Stage | _Path) -> tuple[Issue, ...]:
    """Return what is wrong with a stage: geometry, hinges, supports and drives."""
    return check_stage(stage_of(stage))


def compare(*stages: Stage | StageAnalysis | _Path, model: str = "superelement") -> StageComparison:
    """Set stages side by side, a column each: analyses of them, or what the model gives."""
    runs = [s if isinstance(s, StageAnalysis) else analyse(s, model) for s in stages]
    names = [run.system.name for run in runs]
    if len(set(names)) < len(names):
        names = [f"{k}: {run.system.name}, {run.system.model}" for k, run in enumerate(runs, 1)]
    columns = zip(names, (run.characteristics for run in runs), strict=True)
    found = side_by_side((), dict(columns))
    return StageComparison(published=found.published, ours=found.ours, rows=found.rows)


def sensitivity(stage: _Path, *, set: _Settings = None, **asked: Any) -> "Sensitivities":
    """Return which parameter moves which figure, by the fields of a `SensitivityRequest`."""
    return _ready("sensitivity", _template(stage, set), asked)()


def sweep(
    stage: _Path,
    *,
    set: _Settings = None,
    workers: int = 1,
    folder: Path | None = None,
    **asked: Any,
) -> "Sweep":
    """Return figures over parameters, by the fields of a `SweepRequest`."""
    run = _ready("sweep", _template(stage, set), asked)
    with open_workers(workers) as shared:
        return run(workers=shared, keep=folder)


def optimise(
    stage: _Path, *, set: _Settings = None, workers: int = 1, **asked: Any
) -> "Optimum | Front":
    """Return the best stage, or the front of several goals, by an `OptimiseRequest`."""
    run = _ready("optimise", _template(stage, set), asked)
    with open_workers(workers) as shared:
        return run(shared)


def tolerance(
    stage: Stage | _Path, *, workers: int = 1, folder: Path | None = None, **asked: Any
) -> "ToleranceStudy":
    """Return the spread of a lot, and its `choice` for a yield, by a `ToleranceRequest`."""
    run = _ready("tolerance", stage_of(stage), asked)
    with open_workers(workers) as shared:
        return run(shared, folder)


def frf(
    records: "Record | Sequence[Record]",
    input: str | int | None = None,
    output: str | int | Sequence[str | int] | None = None,
    **asked: Any,
) -> "FrfResult | DecayResult":
    """Return responses and `modes` of records over time, or of responses that were measured.

    By the fields of a `FrfRequest`, such as ``resolution=0.5`` or ``band=(100, 300)``.
    """
    from flexstage.measure.frf import frf as evaluated
    from flexstage.measure.requests import FrfRequest

    given = list(records) if isinstance(records, Sequence) else [records]
    columns = {"input": input, "output": output}
    named = {name: _columns(column) for name, column in columns.items() if column is not None}
    return evaluated(given, request_of(FrfRequest, None, {**named, **asked}))


def _columns(given: str | int | Sequence[str | int]) -> tuple[str | int, ...]:
    return (given,) if isinstance(given, str | int) else tuple(given)


def characterise(tests: "Campaign | _Path") -> "Characterisation":
    """Return the figures of tests: of a description (`Campaign`), or of the file of one."""
    from flexstage.experiments import Campaign, read_campaign
    from flexstage.experiments import characterise as evaluated

    if isinstance(tests, Campaign):
        return evaluated(tests)
    return evaluated(read_campaign(Path(tests)), Path(tests).parent)


def centre(records: "_Path | Record | Sequence[Record]", **asked: Any) -> "CentredRecords":
    """Return a scale's eccentricity and the move against it, by the fields of `CentreRequest`."""
    from flexstage.centring.from_records import centre_files, centre_records
    from flexstage.centring.requests import CentreRequest
    from flexstage.records import Record

    request = request_of(CentreRequest, None, asked)
    if isinstance(records, str | os.PathLike):
        return centre_files([Path(records)], request)
    return centre_records([records] if isinstance(records, Record) else records, request)


def _ready(job: str, subject: Any, asked: Mapping[str, Any]) -> Callable[..., Any]:
    """Return what carries out a request of `flexstage.studies.explore`."""
    from flexstage.studies.explore import prepare, requests

    request = request_of(getattr(requests, f"{job.capitalize()}Request"), None, asked)
    return getattr(prepare, f"ready_{job}")(request, subject)


def _template(source: _Path, settings: _Settings) -> "StageTemplate":
    from flexstage.stage.designs import StageTemplate

    if isinstance(source, Stage):
        raise StageError(
            f"'{source.name}' as it was read has no parameters to vary: give its file or design"
        )
    return StageTemplate.of(source, settings)
