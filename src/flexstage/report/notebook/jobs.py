"""The jobs of the commands as functions, which take the fields of their requests by name.

Results show themselves at a prompt and in a notebook.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import ModelError, StageError
from flexstage.base.lazy import data_frame
from flexstage.files.request import request_fields, request_of
from flexstage.files.result import Result
from flexstage.quantities.characteristic import Characteristics
from flexstage.quantities.comparison import Comparison
from flexstage.quantities.comparison import compare as side_by_side
from flexstage.quantities.quantity import display
from flexstage.quantities.table import table
from flexstage.report.notebook.show import headline, stage_of
from flexstage.report.page import table_html
from flexstage.stage import Issue, Stage
from flexstage.stage import check as check_stage
from flexstage.studies.explore.workers import open_workers
from flexstage.studies.models import ModelRun, run_model
from flexstage.studies.requests import AnalyseRequest, ModelOptions, StackOptions
from flexstage.studies.stacks import heated_by_stacks, stacks_at_work
from flexstage.system import Analysis, MechanicalSystem

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from flexstage.centring.from_records import CentredRecords
    from flexstage.experiments import Campaign, Characterisation
    from flexstage.measure.frf import DecayResult, FrfResult
    from flexstage.records import Record
    from flexstage.stage.designs import StageTemplate
    from flexstage.studies.explore import (
        Ensemble,
        Front,
        Optimum,
        Sensitivities,
        Sweep,
        ToleranceStudy,
    )
    from flexstage.studies.study import Study

_Path = str | os.PathLike[str]
_Settings = Mapping[str, str] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StageAnalysis(Result):
    """The analysis of a stage by one model, for a notebook."""

    run: ModelRun
    """The run of the model: the analysis, and the mesh behind it where there is one."""

    @property
    def analysis(self) -> Analysis:
        """Statics, modes, responses and characteristics, the input of other functions."""
        return self.run.analysis

    @property
    def system(self) -> MechanicalSystem:
        """The mechanical system that was analysed."""
        return self.analysis.system

    @property
    def characteristics(self) -> Characteristics:
        """The characteristics of the stage, in SI units."""
        return self.analysis.characteristics

    def data(self) -> dict[str, Any]:
        return self.run.data()

    def value(self, quantity: str, axis: str) -> float:
        """Return one figure, such as ``max_stress`` of an axis [SI]."""
        return self.characteristics.value(quantity, axis)

    def plot(  # type: ignore[override]
        self,
        kind: Literal["response", "shape", "stress", "modes"] = "response",
        axis: str | None = None,
    ) -> "Figure":
        """Draw the result; the default axis is the first.

        ``response``: Bode diagram of an axis; ``shape``: the stage at the full stroke of an axis;
        ``stress``: stress of every hinge; ``modes``: mode shapes, of the mesh if the model has one,
        otherwise of the bodies.

        Examples
        --------
        >>> import flexstage as fs
        >>> fs.analyse("vgtu-piezo", "lumped").plot("response", "y").axes[0].get_ylabel()
        'y / force [µm/N]'
        """
        return _figure(self.run, kind, axis)

    def to_frame(self) -> "pandas.DataFrame":
        """Return the characteristics as a data frame, in SI units; needs pandas.

        Columns quantity, axis, origin, value, unit, uncertainty, note and degrees_of_freedom.
        """
        return data_frame(self.characteristics.columns())

    def __repr__(self) -> str:
        title = f"{self.system.name}, {self.system.model} model"
        return "\n".join([title, *headline(self.characteristics)])

    def _repr_html_(self) -> str:
        axes = [axis.name for axis in self.system.axes]
        of_axes = [row for row in self.characteristics if row.axis in axes]
        values = {(row.quantity, row.axis): row.value for row in of_axes}
        rows = [
            [
                display(q).label,
                *(display(q).text(values.get((q, axis))) for axis in axes),
                display(q).shown_unit,
            ]
            for q in dict.fromkeys(row.quantity for row in of_axes)
        ]
        stage_rows = [
            [display(row.quantity).label, row.text(), display(row.quantity).shown_unit]
            for row in self.characteristics
            if row.axis not in axes
        ]
        caption = f"{self.system.name}, {self.system.model} model"
        tables = [table(caption, ["", *axes, "<"], rows), table("", ["", "stage", "<"], stage_rows)]
        return f"<div>{''.join(table_html(each) for each in tables if each.rows)}</div>"


def analyse(
    stage: Stage | str | os.PathLike[str], model: str = "superelement", **fields: Any
) -> StageAnalysis:
    """Analyse a stage by one model.

    Parameters
    ----------
    stage : Stage or str or os.PathLike
        The stage, or its source as for `read`.
    model : str
        ``lumped``: rigid bodies; ``superelement``: finite elements, condensed; ``plane``: finite
        elements of the whole; ``superelement-3d`` and ``solid``: the same two in three dimensions.
    **fields
        Fields of `flexstage.studies.requests.ModelOptions`, such as ``estimate=True``: plane,
        accuracy, quantity, estimate, supports and stroke; and of `StackOptions`, such as
        ``rate="50 Hz"``.

    Returns
    -------
    StageAnalysis
        The result.

    Raises
    ------
    ModelError
        There is no such model, or it does not know an option.

    Examples
    --------
    >>> import flexstage as fs
    >>> print(f"{fs.analyse('vgtu-piezo').value('natural_frequency_hz', 'x'):.1f} Hz")
    321.1 Hz
    """
    of_stacks = {name: fields.pop(name) for name in request_fields(StackOptions) if name in fields}
    stacks = request_of(StackOptions, None, of_stacks)
    options = request_of(ModelOptions, None, fields)
    run = run_model(heated_by_stacks(stage_of(stage), stacks), model, options)
    run = replace(run, stacks=stacks_at_work(run.analysis, stacks))
    parts = {"model": model, "options": options, "stacks": stacks}
    request = request_of(AnalyseRequest, None, parts)
    return StageAnalysis(request=request, run=run)


def _figure(run: ModelRun, kind: str, axis: str | None) -> "Figure":
    from flexstage.report.figures.body_motion import draw_modes, draw_static_shape
    from flexstage.report.figures.fields import draw_fe_modes
    from flexstage.report.figures.hinges import draw_stress
    from flexstage.report.figures.responses import draw_bode

    analysis, mesh = run.analysis, run.mesh
    draw: dict[str, Callable[[str], Figure]] = {
        "response": lambda axis: draw_bode(analysis, axis),
        "shape": lambda axis: draw_static_shape(analysis, axis),
        "stress": lambda _: draw_stress(analysis),
        "modes": lambda _: draw_fe_modes(mesh, analysis) if mesh else draw_modes(analysis),
    }
    if kind not in draw:
        raise ModelError(
            f"the {analysis.system.model} model has no plot '{kind}': choose from "
            f"{', '.join(draw)}{did_you_mean(kind, draw)}"
        )
    if axis is None and not analysis.axes:
        raise ModelError("the stage defines no axis, so there is nothing to draw: add 'axes' to it")
    return draw[kind](axis if axis is not None else analysis.axes[0].axis)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StageStudy(Result):
    """Several models of a stage compared with published values, for a notebook."""

    study: "Study"
    """The study, the input of other functions."""

    def data(self) -> dict[str, Any]:
        return self.study.data()

    @property
    def characteristics(self) -> Characteristics:
        """Published values, then those of each model, in SI units."""
        return self.study.characteristics

    def analysis(self, model: str) -> StageAnalysis:
        """Return the analysis by one of the models."""
        if model not in self.study.runs:
            why = self.study.skipped_models.get(model)
            models = f"the study ran {', '.join(self.study.runs)}"
            raise ModelError(f"there is no analysis by '{model}': {why or models}")
        # the study adds its results over the stroke to the analysis of the run
        analysis = self.study.analyses[model]
        return StageAnalysis(run=replace(self.study.runs[model], analysis=analysis))

    def plot(  # type: ignore[override]
        self,
        kind: Literal["response", "shape", "stress", "modes"] = "response",
        axis: str | None = None,
    ) -> "Figure":
        """Draw the result of the main model, as `StageAnalysis.plot` does."""
        return self.analysis(self.study.main.system.model).plot(kind, axis)

    def to_frame(self) -> "pandas.DataFrame":
        """Return all characteristics as a data frame, a row for each origin; needs pandas.

        The columns are those of `StageAnalysis.to_frame`, in SI units.
        """
        return data_frame(self.characteristics.columns())

    def write(self, folder: str | os.PathLike[str]) -> list[Path]:
        """Write the report and the figures behind it: ``report.html`` and ``results.json``."""
        from flexstage.files.write import write_files
        from flexstage.report.study import study_files

        return write_files(Path(folder), study_files(self.study))

    def __repr__(self) -> str:
        title = f"{self.study.stage.name}, {', '.join(self.study.runs)}"
        return "\n".join([title, *headline(self.study.main.characteristics)])

    def _repr_html_(self) -> str:
        return table_html(self.study.comparison.table(self.study.stage.name))


def study(
    stage: Stage | str | os.PathLike[str],
    model: str | Sequence[str] = ("lumped", "superelement"),
    **fields: Any,
) -> StageStudy:
    """Run several models of a stage, and compare them with published values.

    Parameters
    ----------
    stage : Stage or str or os.PathLike
        The stage, or its source as for `read`.
    model : str or sequence of str
        Some of ``lumped``, ``superelement``, ``plane``, ``superelement-3d`` and ``solid``; the last
        takes a minute or more.
    **fields
        Other fields of `flexstage.studies.requests.StudyRequest`: plane, seed, and parts, such as
        ``"virtual,traditional"``; without parts, only the models run.

    Returns
    -------
    StageStudy
        The result.

    Raises
    ------
    ModelError
        No model is named, or one that does not exist.

    Examples
    --------
    >>> import flexstage as fs
    >>> found = fs.study("vgtu-piezo", ["lumped"])
    >>> found.characteristics.value("natural_frequency_hz", "x", "published-analytic")
    339.0
    """
    from flexstage.studies import run_study

    result = run_study(stage_of(stage), model=model, **fields)
    return StageStudy(request=result.request, study=result)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class StageComparison(Comparison):
    """A comparison of stages, for a notebook."""

    def _repr_html_(self) -> str:
        return table_html(self.table())


def check(stage: Stage | _Path) -> tuple[Issue, ...]:
    """Return the issues of a stage: geometry, hinges, supports and drives."""
    return check_stage(stage_of(stage))


def compare(*stages: Stage | StageAnalysis | _Path, model: str = "superelement") -> StageComparison:
    """Compare stages, a column each: given analyses, or analyses by the model."""
    runs = [s if isinstance(s, StageAnalysis) else analyse(s, model) for s in stages]
    names = [run.system.name for run in runs]
    if len(set(names)) < len(names):
        names = [f"{k}: {run.system.name}, {run.system.model}" for k, run in enumerate(runs, 1)]
    columns = zip(names, (run.characteristics for run in runs), strict=True)
    comparison = side_by_side((), dict(columns))
    return StageComparison(
        published=comparison.published, ours=comparison.ours, rows=comparison.rows
    )


def sensitivity(stage: _Path, *, set: _Settings = None, **fields: Any) -> "Sensitivities":
    """Return the sensitivities of a stage, by the fields of a `SensitivityRequest`."""
    return _ready("sensitivity", _template(stage, set), fields)()


def sweep(
    stage: _Path,
    *,
    set: _Settings = None,
    workers: int = 1,
    folder: Path | None = None,
    **fields: Any,
) -> "Sweep":
    """Return figures over parameters, by the fields of a `SweepRequest`."""
    run = _ready("sweep", _template(stage, set), fields)
    with open_workers(workers) as shared:
        return run(workers=shared, keep=folder)


def optimise(
    stage: _Path, *, set: _Settings = None, workers: int = 1, **fields: Any
) -> "Optimum | Front":
    """Return the optimum, or the Pareto front of several goals, by an `OptimiseRequest`."""
    run = _ready("optimise", _template(stage, set), fields)
    with open_workers(workers) as shared:
        return run(shared)


def reconstruct(
    stage: _Path, *, set: _Settings = None, workers: int = 1, **fields: Any
) -> "Ensemble":
    """Return the stages that agree with given figures, by a `ReconstructRequest`."""
    run = _ready("reconstruct", _template(stage, set), fields)
    with open_workers(workers) as shared:
        return run(shared)


def tolerance(
    stage: Stage | _Path, *, workers: int = 1, folder: Path | None = None, **fields: Any
) -> "ToleranceStudy":
    """Return a tolerance analysis, and its `choice` for a yield, by a `ToleranceRequest`."""
    run = _ready("tolerance", stage_of(stage), fields)
    with open_workers(workers) as shared:
        return run(shared, folder)


def frf(
    records: "Record | Sequence[Record]",
    input: str | int | None = None,
    output: str | int | Sequence[str | int] | None = None,
    **fields: Any,
) -> "FrfResult | DecayResult":
    """Return responses and `modes` of records over time, or of measured responses.

    By the fields of a `FrfRequest`, such as ``resolution=0.5`` or ``band=(100, 300)``.
    """
    from flexstage.measure.frf import frf as evaluated
    from flexstage.measure.requests import FrfRequest

    record_list = list(records) if isinstance(records, Sequence) else [records]
    columns = {"input": input, "output": output}
    roles = {name: _columns(column) for name, column in columns.items() if column is not None}
    return evaluated(record_list, request_of(FrfRequest, None, {**roles, **fields}))


def _columns(column: str | int | Sequence[str | int]) -> tuple[str | int, ...]:
    return (column,) if isinstance(column, str | int) else tuple(column)


def characterise(tests: "Campaign | _Path") -> "Characterisation":
    """Return the results of tests, described by a `Campaign` or by its file."""
    from flexstage.experiments import Campaign, read_campaign
    from flexstage.experiments import characterise as evaluated

    if isinstance(tests, Campaign):
        return evaluated(tests)
    return evaluated(read_campaign(Path(tests)), Path(tests).parent)


def centre(records: "_Path | Record | Sequence[Record]", **fields: Any) -> "CentredRecords":
    """Return a scale's eccentricity and the correcting move, by the fields of `CentreRequest`."""
    from flexstage.centring.from_records import centre_files, centre_records
    from flexstage.centring.requests import CentreRequest
    from flexstage.records import Record

    request = request_of(CentreRequest, None, fields)
    if isinstance(records, str | os.PathLike):
        return centre_files([Path(records)], request)
    return centre_records([records] if isinstance(records, Record) else records, request)


def _ready(job: str, subject: Any, fields: Mapping[str, Any]) -> Callable[..., Any]:
    """Return the function that carries out a request of `flexstage.studies.explore`."""
    from flexstage.studies.explore import prepare, requests

    request = request_of(getattr(requests, f"{job.capitalize()}Request"), None, fields)
    return getattr(prepare, f"ready_{job}")(request, subject)


def _template(source: _Path, settings: _Settings) -> "StageTemplate":
    from flexstage.stage.designs import StageTemplate

    if isinstance(source, Stage):
        raise StageError(
            f"'{source.name}' as it was read has no parameters to vary: give its file or design"
        )
    return StageTemplate.of(source, settings)
