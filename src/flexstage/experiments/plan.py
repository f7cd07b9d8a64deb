"""A plan of experiments: sensors, and steps that use what earlier ones gave."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Literal

from flexstage.choose import has_no
from flexstage.errors import PlanError
from flexstage.experiments.excite import Blows, Corners, EqualCycles, Excite
from flexstage.experiments.verbs import (
    Centre,
    Characterise,
    Compensate,
    Identify,
    Measure,
    Verify,
)
from flexstage.files.ranges import Range, require_ranges
from flexstage.sensor import SensorSpecification
from flexstage.units import Frequency

_Rate = Annotated[Frequency, Range(low=0.0, high=1e7, above=True, below=True)]

Action = Excite | Measure | Characterise | Identify | Compensate | Verify | Centre


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
        raise PlanError(has_no("the plan", "step", name, (step.name for step in self.steps)))

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
        raise PlanError(has_no("the plan", "sensor", name, (s.name for s in self.sensors)))

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


def problems(
    steps: tuple[Step, ...], sensors: tuple[SensorEntry, ...]
) -> Iterator[tuple[int, str]]:
    """Say what steps use that is not there."""
    before: dict[str, Step] = {}
    known = [s.name for s in sensors]
    # files are named after steps, and some systems do not tell large letters from small ones
    taken: dict[str, str] = {}
    for k, step in enumerate(steps):
        other = taken.setdefault(step.name.casefold(), step.name)
        if step.name in before:
            yield k, f"two steps are called '{step.name}': give each its own name"
        elif other != step.name:
            yield k, f"the steps '{other}' and '{step.name}' differ in capitals only: rename one"
        for name in step.needs:
            if name not in before:
                listed = ", ".join(before) or "none"
                yield (
                    k,
                    f"step '{step.name}' uses '{name}', which is no earlier step (there are: "
                    f"{listed})",
                )
                return
            if said := _wrong(step, before[name]):
                yield k, said
        for sensor in _sensors_of(step, before):
            if sensor not in known:
                listed = ", ".join(known) or "none"
                yield (
                    k,
                    f"step '{step.name}' reads the sensor '{sensor}', which is not described "
                    f"(there are: {listed}): list it under 'sensors'",
                )
        if said := _unread(step, before):
            yield k, said
        before[step.name] = step


#: Cycles without which a motion and its drift cannot be told apart.
_FEWEST_CYCLES = 3
#: Sensors without which a test cannot be evaluated.
_NEEDED: dict[str, tuple[str, ...]] = {
    "motion": ("along",),
    "positioning": ("along",),
    "staircase": ("along",),
    "hold": ("along",),
    "workspace": ("x", "y"),
}


def _unread(step: Step, before: Mapping[str, Step]) -> str:
    """Say what a step needs that no sensor will have read."""
    own = step.action
    if isinstance(own, Measure) and own.test is not None:
        source = before[own.of].action
        if missing := [r for r in _NEEDED.get(own.test, ()) if r not in own.roles]:
            return (
                f"step '{step.name}' is a test of kind {own.test} and does not say which sensor "
                f"reads {' and '.join(missing)}"
            )
        if own.test == "workspace" and not isinstance(source, Corners):
            return f"step '{step.name}' is a test of kind workspace: it needs a step of corners"
        if own.test == "response" and not own.output and not isinstance(source, Blows):
            return f"step '{step.name}' is a test of kind response: name its sensors as 'output'"
    if isinstance(own, Characterise):
        for name in own.of:
            record = before[name].action
            if not isinstance(record, Measure) or record.test != "motion":
                continue
            source = before[record.of].action
            if isinstance(source, EqualCycles) and source.cycles < _FEWEST_CYCLES:
                return (
                    f"step '{step.name}' evaluates the motion '{name}', which needs "
                    f"{_FEWEST_CYCLES} cycles at least, got {source.cycles:g}"
                )
    if isinstance(own, Identify):
        for name in own.of:
            record = before[name].action
            if isinstance(record, Measure) and own.output not in _sensors_of(before[name], before):
                return (
                    f"step '{step.name}' identifies by the sensor '{own.output}', which step "
                    f"'{name}' does not record: add it there under 'also'"
                )
    return ""


#: Verbs of the steps that a step can use.
_USES: dict[str, tuple[str, ...]] = {
    "measure": ("excite", "compensate"),
    "characterise": ("measure",),
    "identify": ("measure", "characterise"),
    "compensate": ("identify",),
    "verify": ("identify",),
}


def _wrong(step: Step, used: Step) -> str:
    """Say why a step cannot use another."""
    if used.verb not in _USES[step.verb]:
        allowed = " or ".join(_USES[step.verb])
        return (
            f"step '{step.name}' of {step.verb} uses '{used.name}', which is a step of "
            f"{used.verb}: name one of {allowed}"
        )
    action, own = used.action, step.action
    if isinstance(own, Identify) and (used.verb == "characterise") != (used.name == own.resonance):
        return (
            f"step '{step.name}' of identify takes records from steps of measure and its resonance "
            f"from one of characterise, got '{used.name}' of {used.verb}"
        )
    if step.verb == "characterise" and isinstance(action, Measure) and action.test is None:
        return (
            f"step '{step.name}' evaluates '{used.name}', which does not say what kind of test it "
            "is: give it 'test'"
        )
    return ""


def _sensors_of(step: Step, before: Mapping[str, Step]) -> tuple[str, ...]:
    action = step.action
    if isinstance(action, Measure):
        source = before.get(action.of)
        struck = source is not None and isinstance(source.action, Blows)
        # the accelerations of a blow are not the sensors of the plan
        return (*action.roles.values(), *(() if struck else action.output), *action.also)
    if isinstance(action, Identify):
        return (action.output,)
    if isinstance(action, Verify):
        return (action.along,)
    if isinstance(action, Centre):
        return action.sensors
    return ()
