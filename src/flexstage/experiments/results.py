"""Result of a plan."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

from flexstage.base.errors import PlanError
from flexstage.base.provenance import provenance
from flexstage.experiments.campaign.results import Characterisation, TestResult
from flexstage.experiments.plan import Plan
from flexstage.experiments.verb import StepResult
from flexstage.files.plain import picked, plain
from flexstage.files.result import Result
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.quantities.characteristic import (
    Characteristic,
    Characteristics,
    MeasuredCharacteristic,
    in_order,
    kind_of,
    one_of_each,
)
from flexstage.stage import Stage

#: Figures that depend on whether the drives are in place.
_OF_MODES = ("natural_frequency_hz", "damping_ratio")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanResult(Result):
    """Result of a plan."""

    table_key: ClassVar[str] = "figures"

    plan: Plan
    """The plan."""
    stage: Stage
    """The stage."""
    run: RunMetadata
    """Metadata: operator, instrument, start."""
    finished: str
    """Date and time of the end, UTC, ISO 8601."""
    duration: float
    """Duration [s]."""
    folder: Path
    """Folder of the run."""
    steps: tuple[StepResult, ...]
    """Results of the steps, in their order."""
    notes: tuple[str, ...] = ()
    """Remarks on all figures."""

    @property
    def origin(self) -> Literal["measured", "virtual"]:
        """``measured``, or ``virtual`` where the instrument is a simulation."""
        return "virtual" if self.run.instrument.simulated else "measured"

    @property
    def figures(self) -> tuple[MeasuredCharacteristic, ...]:
        """One figure for each quantity and axis: that of the first step that gives it."""
        return one_of_each(self.all_figures)

    @property
    def all_figures(self) -> tuple[MeasuredCharacteristic, ...]:
        """The figures of all steps, in their order."""
        return tuple(figure for step in self.steps for figure in step.figures)

    @property
    def further_figures(self) -> tuple[MeasuredCharacteristic, ...]:
        """Figures of tests that repeat a quantity of an axis, without those of verify."""
        first_figures = {id(f) for f in self.figures}
        further: list[MeasuredCharacteristic] = []
        for step in (step for step in self.steps if step.tests):
            # a test that two steps evaluate has the same figures in both
            listed = {(f.quantity, f.axis, f.test) for f in (*self.figures, *further)}
            further += [
                f
                for f in step.figures
                if id(f) not in first_figures and (f.quantity, f.axis, f.test) not in listed
            ]
        return in_order(further)

    def drives_in_place(self, figure: MeasuredCharacteristic) -> bool:
        """Return whether a natural frequency or damping is that with the drives in place.

        Such a figure cannot be compared with published and computed values, which apply to the
        stage with its drives removed.
        """
        if figure.quantity not in _OF_MODES:
            return False
        (source,) = self.plan.step(figure.test).needs
        return not self.plan.action_of(source).by_hammer

    def published_of(self, figure: MeasuredCharacteristic) -> tuple[Characteristic, ...]:
        """Return the published values of a figure; none for a mode with drives in place."""
        if self.drives_in_place(figure):
            return ()
        key = (figure.quantity, figure.axis)
        return tuple(row for row in self.stage.published if (row.quantity, row.axis) == key)

    @property
    def published(self) -> Characteristics:
        """Published values of the quantities and axes that the plan measured."""
        measured = {(f.quantity, f.axis) for f in self.all_figures}
        return Characteristics(
            row for row in self.stage.published if (row.quantity, row.axis) in measured
        )

    def of(self, verb: str) -> tuple[StepResult, ...]:
        """Return the results of all steps of a verb."""
        return tuple(step for step in self.steps if self.plan.step(step.name).verb == verb)

    @property
    def characterisation(self) -> Characterisation:
        """All figures as the result of one campaign."""
        tests: dict[str, TestResult] = {}
        for test in (test for step in self.steps for test in step.tests):
            tests.setdefault(test.test.name, test)
        return Characterisation(
            stage=self.plan.stage,
            origin=self.origin,
            results=tuple(tests.values()),
            figures=self.figures,
            sources={name: digest for s in self.steps for name, digest in s.sources.items()},
        )

    def figure(self, quantity: str, axis: str) -> MeasuredCharacteristic:
        """Return one figure; refused where no step measured it."""
        for figure in self.figures:
            if (figure.quantity, figure.axis) == (quantity, axis):
                return figure
        available = ", ".join(f"{f.quantity} of {f.axis}" for f in self.figures) or "nothing"
        raise PlanError(f"no step measured {quantity} of axis '{axis}': available: {available}")

    def step(self, name: str) -> StepResult:
        """Return the result of a step; refused where it was not run."""
        for step in self.steps:
            if step.name == name:
                return step
        raise PlanError(
            f"step '{name}' was not run: the steps are {', '.join(s.name for s in self.steps)}"
        )

    def relative(self, file: Path) -> str:
        """Return the name of a file, relative to the folder of the run."""
        return file.relative_to(self.folder).as_posix()

    def plain_figure(self, figure: MeasuredCharacteristic) -> dict[str, Any]:
        """Return a figure of this result as plain data."""
        in_place = self.drives_in_place(figure)
        published = self.published_of(figure)
        return {
            **picked(figure, "quantity", "axis", "value", "unit", "uncertainty"),
            **picked(figure, "degrees_of_freedom", "interval=estimate.interval"),
            "origin": self.origin,
            "kind": kind_of(figure),
            "step": figure.test,
            "note": f"{figure.note}, drives in place".lstrip(", ") if in_place else figure.note,
            "published": [picked(row, "origin", "value") for row in published],
        }

    def data(self) -> dict[str, Any]:
        origin_of_run = provenance(self.plan, dict(self.run.settings))
        steps = (
            {"name": s.name, "verb": self.plan.step(s.name).verb, **s.plain(self)}
            for s in self.steps
        )
        return {
            **picked(self.run, "plan", "stage", "serial_number"),
            "origin": self.origin,
            **picked(self.run, "instrument", "operator", "note", "started"),
            **picked(self, "finished", "duration", "folder"),
            "figures": [self.plain_figure(f) for f in self.figures],
            "further_figures": [self.plain_figure(f) for f in self.further_figures],
            "steps": plain(list(steps)),
            "notes": list(self.notes),
            "provenance": {k: v for k, v in plain(origin_of_run).items() if k != "created"},
        }
