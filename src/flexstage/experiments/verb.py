"""What a verb of a plan is: what a step of it describes, refuses, shows, does and gives.

And what the steps of a plan share, while it is looked at and while it is carried out.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, TypeVar

from flexstage.base.errors import PlanError
from flexstage.experiments.command import BASE_RATE_HZ, Command
from flexstage.files.ranges import Range, require_ranges
from flexstage.instruments.protocol import Capability, Instrument, Signal
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.quantities.sensor import SensorSpecification
from flexstage.quantities.units import Frequency
from flexstage.stage.limits import AxisLimits

if TYPE_CHECKING:
    from flexstage.experiments.campaign.results import TestResult
    from flexstage.instruments.catalogue.entries import ModelEntry, StageEntry
    from flexstage.quantities.characteristic import MeasuredCharacteristic
    from flexstage.quantities.section import Section
    from flexstage.quantities.table import Table
    from flexstage.stage import Stage


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

    sample_rate: _Rate = 1000.0
    """Rate of samples of records [Hz]."""
    command_rate: _Rate = 1000.0
    """Rate of samples of commands [Hz]; straight lines between them."""
    lowest_frequency: _Rate | None = None
    """Lowest natural frequency of the stage with its drives in place [Hz]; that of the lumped model
    where not given.
    """

    def __post_init__(self) -> None:
        require_ranges(self, PlanError, "the defaults")


class PlanLookup(Protocol):
    """What a step looks up in the plan that it belongs to."""

    @property
    def stage(self) -> str:
        """Stage file, or name of a built-in design."""
        ...

    @property
    def sensors(self) -> tuple[SensorEntry, ...]:
        """The sensors."""
        ...

    @property
    def defaults(self) -> Defaults:
        """What holds for all steps."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks that belong to every figure."""
        ...

    def sensor(self, name: str) -> SensorEntry:
        """Return a sensor by name; refused where there is none."""
        ...

    def action_of(self, name: str) -> "Verb":
        """Return what a step does; refused where there is none."""
        ...

    def axis_of(self, name: str) -> str:
        """Return the axis that a step is about; both, such as ``xy``, where it is about two."""
        ...


class ResultLookup(Protocol):
    """What a step looks up in the result of its plan, where it shows its own."""

    @property
    def stage(self) -> "Stage":
        """The stage."""
        ...

    def relative(self, file: Path) -> str:
        """Return the name of a file from the folder of the run."""
        ...

    def plain_figure(self, figure: "MeasuredCharacteristic") -> dict[str, Any]:
        """Return a figure of this result as plain data."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedMotion:
    """What one axis would be told."""

    axis: str
    """The axis."""
    unit: str
    """``V`` or ``m``."""
    low: float
    """Smallest value [V or m]."""
    high: float
    """Largest value [V or m]."""
    largest_rate: float
    """Largest slope [V/s or m/s]."""
    limits: tuple[float, float]
    """Lowest and highest value that is allowed [V or m]."""
    rate_limit: float | None
    """Largest slope that is allowed [V/s or m/s]."""
    estimated: bool
    """Whether the limits are only estimated, and an instrument will tell them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedStep:
    """What one step would do."""

    name: str
    """Name of the step."""
    verb: str
    """Its verb."""
    what: str
    """What it does, in words."""
    duration: float = 0.0
    """How long the stage moves or is recorded [s]; 0 of a step that only computes."""
    command_duration: float = 0.0
    """How long a command that is made here will take [s]."""
    samples: int = 0
    """Samples of the command."""
    signals: int = 0
    """Number of signals that are recorded."""
    motions: tuple[PlannedMotion, ...] = ()
    """What each axis would be told."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""
    problem: str = ""
    """Why it cannot be carried out; empty where it can."""


@dataclass(slots=True, kw_only=True)
class PlanContext:
    """What the steps of a plan share while it is looked at, without an instrument."""

    plan: PlanLookup
    """The plan."""
    stage: "Stage"
    """The stage."""
    base_rate_hz: float
    """Highest rate of samples of a command [Hz]."""
    frequency: float | None = None
    """Lowest natural frequency that commands keep clear of [Hz]."""
    planned: dict[str, PlannedStep] = field(default_factory=dict)
    """What the steps before would do, by name."""

    def limits(self, axis: str) -> AxisLimits | None:
        """Return what the instrument allows an axis; None where there is none to ask."""
        del axis
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Verb:
    """What a step does.

    A new verb is a subclass in a file of its own, and a line in `flexstage.experiments.verbs`.
    """

    verb: ClassVar[str]
    """The word for it in a plan file."""
    uses: ClassVar[tuple[str, ...]] = ()
    """Verbs of the steps that it can use."""
    moving: ClassVar[bool] = False
    """Whether the stage moves: then its result depends on instrument and sensors too."""
    needs_frequency: ClassVar[bool] = False
    """Whether its command keeps clear of the lowest natural frequency."""
    response: ClassVar[str] = "auto"
    """What its command excites a response with, as `campaign.plan.EXCITATIONS` has it."""
    corners: ClassVar[bool] = False
    """Whether both axes rest at the corners of the workspace in its command."""

    @property
    def needs(self) -> tuple[str, ...]:
        """Earlier steps that it uses."""
        return ()

    @property
    def struck(self) -> bool:
        """Whether the stage is struck by a hammer, its drives taken out."""
        return self.response == "hammer"

    @property
    def motion_cycles(self) -> int | None:
        """Equal cycles in its command; None where they are not counted."""
        return None

    def axis_of(self, plan: PlanLookup) -> str:
        """Return the axis that it is about; both, such as ``xy``, where it is about two."""
        return plan.axis_of(self.needs[0])

    def reads(self, before: "Mapping[str, Verb]") -> tuple[str, ...]:
        """Return the sensors of the plan that it reads, given the steps before it."""
        del before
        return ()

    def problems(
        self, name: str, before: "Mapping[str, Verb]", known: Sequence[str]
    ) -> Iterator[str]:
        """Say what it uses that is not there, given the steps before it and all sensors."""
        for other in self.needs:
            if other not in before:
                listed = ", ".join(before) or "none"
                yield (
                    f"step '{name}' uses '{other}', which is no earlier step (there are: {listed})"
                )
                return
            if said := self.refused(name, other, before[other]):
                yield said
        for sensor in self.reads(before):
            if sensor not in known:
                listed = ", ".join(known) or "none"
                yield (
                    f"step '{name}' reads the sensor '{sensor}', which is not described "
                    f"(there are: {listed}): list it under 'sensors'"
                )
        if said := self.missing(name, before):
            yield said

    def refused(self, name: str, other: str, used: "Verb") -> str:
        """Say why it cannot use another step."""
        if used.verb in self.uses:
            return ""
        return (
            f"step '{name}' of {self.verb} uses '{other}', which is a step of {used.verb}: name "
            f"one of {' or '.join(self.uses)}"
        )

    def missing(self, name: str, before: "Mapping[str, Verb]") -> str:
        """Say what it needs that the steps before it will not have given."""
        del name, before
        return ""

    def preview(self, context: PlanContext, name: str) -> PlannedStep:
        """Say what it would do; what it refuses is an error."""
        del context
        return PlannedStep(name=name, verb=self.verb, what=f"of {', '.join(self.needs)}")

    def depends_on(self, plan: PlanLookup) -> tuple[object, ...]:
        """Return parts of the plan, apart from itself and its defaults, that its result is of."""
        del plan
        return ()

    def run(self, context: "RunContext", name: str) -> list[Path]:
        """Do it, and return the files that it wrote."""
        del context, name
        return []

    def result(
        self, context: "RunContext", name: str, files: list[Path], *, now: bool
    ) -> "StepResult":
        """Return what it gave, from the files that it wrote now or in an earlier run."""
        raise NotImplementedError

    @staticmethod
    def section(steps: "Sequence[Any]", result: ResultLookup) -> "Section | None":
        """Return the section of the report on all steps of this verb."""
        del steps, result
        return None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepResult:
    """What a step gave."""

    name: str
    """Name of the step."""

    @property
    def figures(self) -> "tuple[MeasuredCharacteristic, ...]":
        """What it measured of the stage."""
        return ()

    @property
    def tests(self) -> "tuple[TestResult, ...]":
        """Tests that it evaluated."""
        return ()

    @property
    def sources(self) -> Mapping[str, str]:
        """SHA-256 of each record that it evaluated, by its name."""
        return {}

    def plain(self, result: ResultLookup) -> dict[str, Any]:
        """Return what ``results.json`` keeps of it beside its name and verb."""
        raise NotImplementedError

    @property
    def line(self) -> str:
        """What a terminal says of it beside its figures."""
        return ""

    @property
    def table(self) -> "Table | None":
        """What a terminal shows of it beside its figures."""
        return None

    def model_entry(
        self, context: "RunContext", stage: "StageEntry", runs: Mapping[str, str]
    ) -> "ModelEntry | None":
        """Return what the catalogue keeps of a model; `runs` are identifiers of records by file."""
        del context, stage, runs
        return None


_Result = TypeVar("_Result", bound=StepResult)


@dataclass(slots=True, kw_only=True)
class RunContext(PlanContext):
    """A plan that is being carried out: the one thing here that changes."""

    instrument: Instrument
    """The instrument."""
    folder: Path
    """Where everything is written."""
    run: RunMetadata
    """What is known at its start: stage, instrument and its settings, plan, operator."""
    results: dict[str, StepResult] = field(default_factory=dict)
    """What the steps gave so far, by name."""
    commands: dict[str, Command] = field(default_factory=dict)
    """Commands that are ready to run, by the step that made them."""

    @property
    def origin(self) -> Literal["measured", "virtual"]:
        """``measured``, or ``virtual`` where the instrument is a simulation."""
        return "virtual" if self.instrument.identity.simulated else "measured"

    def limits(self, axis: str) -> AxisLimits | None:
        own = self.instrument.axes.get(axis)
        return None if own is None else own.limits

    def result_of(self, name: str, kind: type[_Result]) -> _Result:
        """Return what an earlier step gave, of the kind that the plan has made sure of."""
        result = self.results[name]
        assert isinstance(result, kind)
        return result

    def signal(self, sensor: str) -> Signal:
        """Return the signal of a sensor of the plan."""
        own = self.plan.sensor(sensor)
        return Signal(kind="channel", source=str(own.channel), name=sensor, unit=own.unit)

    def metadata(self, step: str, kind: str, axis: str) -> RunMetadata:
        """Return what is written at the head of a record."""
        settings = dict(self.instrument.settings())
        return replace(self.run, settings=settings, kind=kind, axis=axis, step=step)


def base_rate_of(instrument: Instrument) -> float:
    """Return the highest rate of samples of a command [Hz]."""
    if Capability.WAVE_GENERATOR in instrument.capabilities:
        return instrument.waves.base_rate_hz
    return BASE_RATE_HZ
