"""A plan of experiments: sensors, and steps that use what earlier ones gave."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Annotated, Literal

from flexstage.choose import has_no
from flexstage.errors import PlanError
from flexstage.experiments.verb import Verb
from flexstage.files.ranges import Range, require_ranges
from flexstage.sensor import SensorSpecification
from flexstage.units import Frequency

_Rate = Annotated[Frequency, Range(low=0.0, high=1e7, above=True, below=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorEntry(SensorSpecification):
    """A sensor of the instrument: which channel it is, and what is known of its errors."""

    channel: Annotated[int, Range(low=1)]
    """Number of the channel, from 1."""
    unit: Literal["m", "rad"] = "m"
    """What it reads in."""

    def __post_init__(self) -> None:
        SensorSpecification.__post_init__(self)
        require_ranges(self, PlanError, f"sensor '{self.name}'")

    @property
    def instrument(self) -> SensorSpecification:
        """The same without its channel."""
        return SensorSpecification(
            **{f.name: getattr(self, f.name) for f in fields(SensorSpecification)}
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Defaults:
    """What holds for all steps that say nothing else."""

    rate: _Rate = 1000.0
    """Rate of samples of records [Hz]."""
    command_rate: _Rate = 1000.0
    """Rate of samples of commands [Hz]; straight lines between them."""
    lowest_frequency: _Rate | None = None
    """Lowest natural frequency of the stage with its drives in place [Hz]; that of the lumped model
    where not given.
    """

    def __post_init__(self) -> None:
        require_ranges(self, PlanError, "the defaults")


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step."""

    name: str
    """Its name."""
    action: Verb
    """What it does."""

    @property
    def verb(self) -> str:
        """What it does, in a word."""
        return self.action.verb

    @property
    def needs(self) -> tuple[str, ...]:
        """Earlier steps that it uses."""
        return self.action.needs


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
        """Return a step by name; refused where there is none."""
        for step in self.steps:
            if step.name == name:
                return step
        raise PlanError(has_no("the plan", "step", name, (step.name for step in self.steps)))

    def sensor(self, name: str) -> SensorEntry:
        """Return a sensor by name; refused where there is none."""
        for sensor in self.sensors:
            if sensor.name == name:
                return sensor
        raise PlanError(has_no("the plan", "sensor", name, (s.name for s in self.sensors)))

    def axis_of(self, name: str) -> str:
        """Return the axis that a step is about; both, such as ``xy``, where it is about two."""
        return self.step(name).action.axis_of(self)

    def chosen(self, names: tuple[str, ...] | None) -> tuple[Step, ...]:
        """Return steps by name with all that they use, in their order; every step for None."""
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


def problems(
    steps: tuple[Step, ...], sensors: tuple[SensorEntry, ...]
) -> Iterator[tuple[int, str]]:
    """Say what steps use that is not there."""
    before: dict[str, Verb] = {}
    known = [s.name for s in sensors]
    # files are named after steps, and some systems do not tell large letters from small ones
    taken: dict[str, str] = {}
    for k, step in enumerate(steps):
        other = taken.setdefault(step.name.casefold(), step.name)
        if step.name in before:
            yield k, f"two steps are called '{step.name}': give each its own name"
        elif other != step.name:
            yield k, f"the steps '{other}' and '{step.name}' differ in capitals only: rename one"
        for said in step.action.problems(step.name, before, known):
            yield k, said
        before[step.name] = step.action
