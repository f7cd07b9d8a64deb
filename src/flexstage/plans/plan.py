"""A plan of experiments: sensors, and steps that use what earlier ones gave."""

from dataclasses import dataclass, fields
from typing import Annotated

from flexstage.errors import PlanError
from flexstage.experiment.campaign.plan import SensorSpecification
from flexstage.experiment.uncertainty.sensor import SensorSetup
from flexstage.plans.excite import Excite
from flexstage.plans.plan_problems import problems
from flexstage.plans.verbs import (
    Centre,
    Characterise,
    Compensate,
    Identify,
    Measure,
    Verify,
)
from flexstage.units import DIMENSIONS

Action = Excite | Measure | Characterise | Identify | Compensate | Verify | Centre


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorEntry(SensorSpecification):
    """A sensor of the instrument: which channel it is, and what is known of its errors."""

    channel: float
    """Number of the channel, from 1."""
    unit: str = "m"
    """``m`` or ``rad``."""

    def __post_init__(self) -> None:
        _ = self.instrument  # checks them
        if not (self.channel >= 1 and self.channel == int(self.channel)):
            raise PlanError(
                f"the channel of sensor '{self.name}' must be a whole number from 1, got "
                f"{self.channel:g}"
            )
        if self.unit not in ("m", "rad"):
            raise PlanError(f"sensor '{self.name}' reads m or rad, got '{self.unit}'")

    @property
    def setup(self) -> SensorSetup:
        return self.instrument.setup

    @property
    def instrument(self) -> SensorSpecification:
        """What is known of its errors."""
        return SensorSpecification(
            **{f.name: getattr(self, f.name) for f in fields(SensorSpecification)}
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Defaults:
    """What holds for all steps that say nothing else."""

    rate: Annotated[float, DIMENSIONS["frequency"]] = 1000.0
    """Rate of samples of records [Hz]."""
    command_rate: Annotated[float, DIMENSIONS["frequency"]] = 1000.0
    """Rate of samples of commands [Hz]; straight lines between them."""
    lowest_frequency: Annotated[float, DIMENSIONS["frequency"]] | None = None
    """Lowest natural frequency of the stage with its drives in place [Hz]; that of the lumped model
    where not given.
    """

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if value is not None and not 0.0 < value < 1e7:
                raise PlanError(f"{f.name} must be positive, got {value:g} Hz")


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step."""

    name: str
    """Its name."""
    action: Action
    """What it does."""

    @property
    def verb(self) -> str:
        """What it does, in a word."""
        return "excite" if isinstance(self.action, Excite) else self.action.verb

    @property
    def needs(self) -> tuple[str, ...]:
        """Earlier steps that it uses."""
        return () if isinstance(self.action, Excite) else self.action.needs


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Steps to be carried out on an instrument, in their order.

    Raises
    ------
    PlanError
        Names are given twice, or a step uses what is not there.
    """

    stage: str
    """Stage file, or name of a built-in design."""
    title: str = ""
    """What the plan is for."""
    serial_number: str = ""
    """Serial number of the stage."""
    sensors: tuple[SensorEntry, ...] = ()
    """The sensors."""
    defaults: Defaults = Defaults()
    """What holds for all steps."""
    steps: tuple[Step, ...]
    """The steps."""
    notes: tuple[str, ...] = ()
    """Remarks that belong to every figure."""

    def __post_init__(self) -> None:
        if not self.steps:
            raise PlanError("a plan needs one step at least, got none")
        for _, message in problems(self.steps, self.sensors):
            raise PlanError(message)

    def step(self, name: str) -> Step:
        """Return a step.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        Step
            The step.

        Raises
        ------
        PlanError
            There is none of that name.
        """
        for step in self.steps:
            if step.name == name:
                return step
        known = ", ".join(step.name for step in self.steps)
        raise PlanError(f"the plan has no step '{name}': its steps are {known}")

    def sensor(self, name: str) -> SensorEntry:
        """Return a sensor.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        SensorEntry
            The sensor.

        Raises
        ------
        PlanError
            There is none of that name.
        """
        for sensor in self.sensors:
            if sensor.name == name:
                return sensor
        known = ", ".join(sensor.name for sensor in self.sensors) or "none"
        raise PlanError(f"the plan has no sensor '{name}': its sensors are {known}")

    def axis_of(self, name: str) -> str:
        """Return the axis that a step is about; both, such as ``xy``, where it is about two.

        Parameters
        ----------
        name : str
            Name of the step.

        Returns
        -------
        str
            The axis.
        """
        action = self.step(name).action
        if isinstance(action, Excite):
            return "".join(action.moved)
        if isinstance(action, Centre):
            return "".join(action.axes)
        return self.axis_of(action.needs[0])

    def chosen(self, names: tuple[str, ...] | None) -> tuple[Step, ...]:
        """Return steps with all that they use, in their order.

        Parameters
        ----------
        names : tuple of str or None
            Names of the steps that are wanted; all where None.

        Returns
        -------
        tuple of Step
            The steps.

        Raises
        ------
        PlanError
            There is none of that name.
        """
        if names is None:
            return self.steps
        wanted: set[str] = set()
        left = [self.step(name) for name in names]
        while left:
            step = left.pop()
            if step.name not in wanted:
                wanted.add(step.name)
                left += [self.step(name) for name in step.needs]
        return tuple(step for step in self.steps if step.name in wanted)
