"""What the steps of a plan gave."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from flexstage.characteristic import (
    Characteristic,
    Characteristics,
    MeasuredCharacteristic,
    in_order,
    one_of_each,
)
from flexstage.errors import PlanError
from flexstage.experiments.excite import Blows
from flexstage.experiments.plan import Plan
from flexstage.experiments.step_results import (
    CentredStep,
    CharacterisedStep,
    CommandedStep,
    CompensatedStep,
    IdentifiedStep,
    MeasuredStep,
    VerifiedStep,
)
from flexstage.experiments.verbs import Measure
from flexstage.instruments.protocol import Identity
from flexstage.stage import Stage

#: Figures that depend on whether the drives hold the stage.
_OF_MODES = ("natural_frequency_hz", "damping_ratio")

StepResult = (
    CommandedStep
    | MeasuredStep
    | CharacterisedStep
    | IdentifiedStep
    | CompensatedStep
    | VerifiedStep
    | CentredStep
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanResult:
    """What a plan gave."""

    plan: Plan
    """The plan."""
    stage: Stage
    """The stage."""
    instrument: Identity
    """What it was carried out on."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Settings of the instrument, as text."""
    serial_number: str = ""
    """Serial number of the stage."""
    operator: str = ""
    """Who carried it out."""
    note: str = ""
    """What they said about it."""
    started: str
    """Date and time of the start, UTC, ISO 8601."""
    finished: str
    """Date and time of the end, UTC, ISO 8601."""
    duration: float
    """How long it took [s]."""
    folder: Path
    """Where everything was written."""
    steps: tuple[StepResult, ...]
    """What each step gave, in their order."""
    title: str = ""
    """What the plan is called."""
    notes: tuple[str, ...] = ()
    """What belongs to every figure."""

    @property
    def origin(self) -> Literal["measured", "virtual"]:
        """``measured``, or ``virtual`` where the instrument is a simulation."""
        return "virtual" if self.instrument.simulated else "measured"

    @property
    def figures(self) -> tuple[MeasuredCharacteristic, ...]:
        """One figure for each quantity and axis: that of the first step that gives it."""
        return one_of_each(self.all_figures)

    @property
    def all_figures(self) -> tuple[MeasuredCharacteristic, ...]:
        """The figures of all steps, in their order."""
        found: list[MeasuredCharacteristic] = []
        for step in self.steps:
            if isinstance(step, CharacterisedStep | VerifiedStep):
                found += step.figures
        return tuple(found)

    @property
    def further_figures(self) -> tuple[MeasuredCharacteristic, ...]:
        """Figures of tests that repeat a quantity of an axis: not those of references followed."""
        own = {id(f) for f in self.figures}
        found: list[MeasuredCharacteristic] = []
        for step in self.steps:
            if isinstance(step, CharacterisedStep):
                # a test that two steps evaluate has the same figures in both
                known = {(f.quantity, f.axis, f.test) for f in (*self.figures, *found)}
                found += [
                    f
                    for f in step.figures
                    if id(f) not in own and (f.quantity, f.axis, f.test) not in known
                ]
        return in_order(found)

    def drives_in_place(self, figure: MeasuredCharacteristic) -> bool:
        """Say whether a natural frequency or damping is that of the stage with its drives in place.

        Parameters
        ----------
        figure : MeasuredCharacteristic
            A figure of this result.

        Returns
        -------
        bool
            Whether it is, and so no figure to set beside those of the stage with its drives taken
            out, which is what is published and computed under that name.
        """
        if figure.quantity not in _OF_MODES:
            return False
        action = self.plan.step(figure.test).action
        source = self.plan.step(action.of).action if isinstance(action, Measure) else action
        return not isinstance(source, Blows)

    def published_of(self, figure: MeasuredCharacteristic) -> tuple[Characteristic, ...]:
        """Return what was published of the same thing as a figure.

        Parameters
        ----------
        figure : MeasuredCharacteristic
            A figure of this result.

        Returns
        -------
        tuple of Characteristic
            The rows; none of a mode with the drives in place.
        """
        if self.drives_in_place(figure):
            return ()
        return tuple(Characteristics(self.stage.published).select(figure.quantity, figure.axis))

    @property
    def published(self) -> Characteristics:
        """What was published of the quantities and axes that were measured here."""
        asked = {(f.quantity, f.axis) for f in self.all_figures}
        return Characteristics(
            row for row in self.stage.published if (row.quantity, row.axis) in asked
        )

    @property
    def records(self) -> tuple[MeasuredStep, ...]:
        """The records that were taken."""
        return tuple(step for step in self.steps if isinstance(step, MeasuredStep))

    @property
    def models(self) -> tuple[IdentifiedStep, ...]:
        """The models that were identified."""
        return tuple(step for step in self.steps if isinstance(step, IdentifiedStep))

    def figure(self, quantity: str, axis: str) -> MeasuredCharacteristic:
        """Return one figure.

        Parameters
        ----------
        quantity : str
            The quantity.
        axis : str
            The axis.

        Returns
        -------
        MeasuredCharacteristic
            The figure.

        Raises
        ------
        PlanError
            No step gave it.
        """
        for figure in self.figures:
            if (figure.quantity, figure.axis) == (quantity, axis):
                return figure
        given = ", ".join(f"{f.quantity} of {f.axis}" for f in self.figures) or "nothing"
        raise PlanError(f"no step gave {quantity} of axis '{axis}': there is {given}")

    def step(self, name: str) -> StepResult:
        """Return what a step gave.

        Parameters
        ----------
        name : str
            Name of the step.

        Returns
        -------
        StepResult
            What it gave.

        Raises
        ------
        PlanError
            There is no such step, or it was not run.
        """
        for step in self.steps:
            if step.name == name:
                return step
        raise PlanError(
            f"no step '{name}' was run: there is {', '.join(s.name for s in self.steps)}"
        )
