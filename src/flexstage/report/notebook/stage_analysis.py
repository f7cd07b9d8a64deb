"""A stage analysed by one model, or studied by several."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import ModelError
from flexstage.base.lazy import data_frame
from flexstage.files.request import request_of
from flexstage.files.result import Result
from flexstage.quantities.characteristic import Characteristics
from flexstage.quantities.quantity import display
from flexstage.quantities.table import table
from flexstage.report.notebook.show import headline, stage_of
from flexstage.report.page import table_html
from flexstage.stage import Stage
from flexstage.studies.models import ModelRun, run_model
from flexstage.studies.requests import AnalyseRequest, ModelOptions
from flexstage.system import Analysis, MechanicalSystem

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from flexstage.studies.study import Study


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StageAnalysis(Result):
    """A stage analysed by one model, to look at."""

    run: ModelRun
    """The run of the model: the analysis, and the mesh behind it where there is one."""

    @property
    def analysis(self) -> Analysis:
        """Statics, modes, responses and characteristics: what other functions take."""
        return self.run.analysis

    @property
    def system(self) -> MechanicalSystem:
        """The mechanical system that was analysed."""
        return self.analysis.system

    @property
    def characteristics(self) -> Characteristics:
        """The figures that an engineer quotes, in SI units."""
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
        """Draw the result; of the first axis where none is named.

        ``response``: Bode diagram of an axis; ``shape``: the stage at the full stroke of an axis;
        ``stress``: stress of every hinge; ``modes``: mode shapes, on the mesh where the model has
        one, else of the bodies.

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
        whole = [
            [display(row.quantity).label, row.text(), display(row.quantity).shown_unit]
            for row in self.characteristics
            if row.axis not in axes
        ]
        caption = f"{self.system.name}, {self.system.model} model"
        tables = [table(caption, ["", *axes, "<"], rows), table("", ["", "stage", "<"], whole)]
        return f"<div>{''.join(table_html(shown) for shown in tables if shown.rows)}</div>"


def analyse(
    stage: Stage | str | os.PathLike[str], model: str = "superelement", **asked: Any
) -> StageAnalysis:
    """Analyse a stage by one model.

    Parameters
    ----------
    stage : Stage or str or os.PathLike
        The stage, or what `read` takes.
    model : str
        ``lumped``: rigid bodies; ``superelement``: finite elements, condensed; ``plane``: finite
        elements of the whole; ``superelement-3d`` and ``solid``: the same two in three dimensions.
    **asked
        Fields of `flexstage.studies.requests.ModelOptions`, such as ``estimate=True``: plane,
        accuracy, quantity, estimate, supports and stroke.

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
    options = request_of(ModelOptions, None, asked)
    run = run_model(stage_of(stage), model, options)
    request = request_of(AnalyseRequest, None, {"model": model, "options": options})
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
        raise ModelError("the stage names no axis, so there is nothing to draw: add 'axes' to it")
    return draw[kind](axis if axis is not None else analysis.axes[0].axis)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StageStudy(Result):
    """Several models of a stage beside what was published of it, to look at."""

    study: "Study"
    """The study: what other functions take."""

    def data(self) -> dict[str, Any]:
        return self.study.data()

    @property
    def characteristics(self) -> Characteristics:
        """What was published, then what each model gives; SI units."""
        return self.study.characteristics

    def analysis(self, model: str) -> StageAnalysis:
        """Return the analysis by one of the models."""
        if model not in self.study.runs:
            why = self.study.skipped_models.get(model)
            ran = f"the study ran {', '.join(self.study.runs)}"
            raise ModelError(f"there is no analysis by '{model}': {why or ran}")
        # the study adds what it found over the stroke to the analysis of the run
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
    **asked: Any,
) -> StageStudy:
    """Run several models of a stage, beside what was published of it.

    Parameters
    ----------
    stage : Stage or str or os.PathLike
        The stage, or what `read` takes.
    model : str or sequence of str
        Some of ``lumped``, ``superelement``, ``plane``, ``superelement-3d`` and ``solid``; the last
        takes a minute or more.
    **asked
        Other fields of `flexstage.studies.requests.StudyRequest`: plane and seed, and parts, such
        as ``"virtual,traditional"``, of which none is done unless it is named here.

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

    found = run_study(stage_of(stage), model=model, **asked)
    return StageStudy(request=found.request, study=found)
