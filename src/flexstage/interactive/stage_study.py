"""A stage studied by several models."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from flexstage.characteristic import Characteristics
from flexstage.errors import ModelError
from flexstage.interactive.show import headline, stage_of
from flexstage.interactive.stage_analysis import StageAnalysis
from flexstage.lazy import data_frame
from flexstage.report.page import table_html
from flexstage.stage import Stage
from flexstage.studies.models import Plane

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from flexstage.studies.study import Study


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StageStudy:
    """Several models of a stage beside what was published of it, to look at."""

    study: "Study"
    """The study: what other functions take."""

    @property
    def characteristics(self) -> Characteristics:
        """What was published, then what each model gives; SI units."""
        return self.study.characteristics

    def analysis(self, model: str) -> StageAnalysis:
        """Return the analysis by one of the models."""
        if model not in self.study.runs:
            why = self.study.left_out.get(model)
            ran = f"the study ran {', '.join(self.study.runs)}"
            raise ModelError(f"there is no analysis by '{model}': {why or ran}")
        # the study adds what it found over the stroke to the analysis of the run
        analysis = self.study.analyses[model]
        return StageAnalysis(run=replace(self.study.runs[model], analysis=analysis))

    def plot(
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
    models: Sequence[str] = ("lumped", "superelement"),
    *,
    plane: Plane = "auto",
    hysteresis: bool = False,
    virtual: bool = False,
    traditional: bool = False,
    seed: int = 1,
) -> StageStudy:
    """Run several models of a stage, beside what was published of it.

    Parameters
    ----------
    stage : Stage or str or os.PathLike
        The stage, or what `read` takes.
    models : sequence of str
        Some of ``lumped``, ``superelement``, ``plane``, ``superelement-3d`` and ``solid``; the last
        takes a minute or more.
    plane : str
        ``stress``, ``strain``, or ``auto`` to choose by width of each notch against its neck.
    hysteresis : bool
        Whether to identify and compensate piezo drives on the virtual stage.
    virtual : bool
        Whether to measure a virtual stage, and to centre an encoder scale with it.
    traditional : bool
        Whether to set a stage of the study against traditional ones.
    seed : int
        Seed of that stage and its measurement, and of stages as they are made.

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

    if isinstance(models, str):
        models = [models]
    found = run_study(
        stage_of(stage),
        models,
        plane=plane,
        hysteresis=hysteresis,
        virtual=virtual,
        traditional=traditional,
        seed=seed,
    )
    return StageStudy(study=found)
