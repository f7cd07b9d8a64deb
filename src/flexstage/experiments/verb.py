"""Base class of the steps of a plan, with their previews, results and shared context."""

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
    from flexstage.quantities.table import Section, Table
    from flexstage.stage import Stage


_Rate = Annotated[Frequency, Range(low=0.0, high=1e7, above=True, below=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorEntry(SensorSpecification):
    """A sensor of the instrument: its channel, and its errors."""

    channel: Annotated[int, Range(low=1)]
    """Number of the channel, from 1."""
    unit: Literal["m", "rad"] = "m"
    """Unit of its readings."""

    def __post_init__(self) -> None:
        SensorSpecification.__post_init__(self)
        require_ranges(self, PlanError, f"sensor '{self.name}'")

    @property
    def instrument(self) -> SensorSpecification:
        """The sensor without its channel."""
        return SensorSpecification(
            **{f.name: getattr(self, f.name) for f in fields(SensorSpecification)}
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Defaults:
    """Defaults of all steps."""

    sample_rate: _Rate = 1000.0
    """Sample rate of records [Hz]."""
    command_rate: _Rate = 1000.0
    """Sample rate of commands [Hz]; they are interpolated linearly."""
    lowest_frequency: _Rate | None = None
    """Lowest natural frequency of the stage with its drives in place [Hz] (default: that of the
    lumped model).
    """

    def __post_init__(self) -> None:
        require_ranges(self, PlanError, "the defaults")


class PlanLookup(Protocol):
    """Parts of a plan that its steps use."""

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
        """Defaults of all steps."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on all figures."""
        ...

    def sensor(self, name: str) -> SensorEntry:
        """Return a sensor by name; refused where there is none."""
        ...

    def action_of(self, name: str) -> "Verb":
        """Return the action of a step; refused where there is none."""
        ...

    def axis_of(self, name: str) -> str:
        """Return the axis of a step; both, such as ``xy``, for two axes."""
        ...


class ResultLookup(Protocol):
    """Parts of the result of a plan that the report of a step uses."""

    @property
    def stage(self) -> "Stage":
        """The stage."""
        ...

    def relative(self, file: Path) -> str:
        """Return the name of a file, relative to the folder of the run."""
        ...

    def plain_figure(self, figure: "MeasuredCharacteristic") -> dict[str, Any]:
        """Return a figure of this result as plain data."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedMotion:
    """Planned motion of one axis."""

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
    """Lowest and highest allowed value [V or m]."""
    rate_limit: float | None
    """Largest allowed slope [V/s or m/s]."""
    estimated: bool
    """Whether the limits are only estimated; those of an instrument may be narrower."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedStep:
    """Preview of a step."""

    name: str
    """Name of the step."""
    verb: str
    """Its verb."""
    what: str
    """Description."""
    duration: float = 0.0
    """Time of motion and recording [s]; 0 for a step that only computes."""
    command_duration: float = 0.0
    """Duration of the command that the step designs [s]."""
    samples: int = 0
    """Number of samples of the command."""
    signals: int = 0
    """Number of recorded signals."""
    motions: tuple[PlannedMotion, ...] = ()
    """Planned motion of each axis."""
    notes: tuple[str, ...] = ()
    """Notes for the report."""
    problem: str = ""
    """Reason why the step cannot be carried out; empty where it can."""


@dataclass(slots=True, kw_only=True)
class PlanContext:
    """Context that the steps of a plan share in a dry run, without an instrument."""

    plan: PlanLookup
    """The plan."""
    stage: "Stage"
    """The stage."""
    base_rate_hz: float
    """Highest sample rate of a command [Hz]."""
    frequency: float | None = None
    """Lowest natural frequency, which commands must not excite [Hz]."""
    planned: dict[str, PlannedStep] = field(default_factory=dict)
    """Previews of the earlier steps, by name."""

    def limits(self, axis: str) -> AxisLimits | None:
        """Return the instrument's limits of an axis; None without an instrument."""
        del axis
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Verb:
    """Base class of the steps of a plan.

    A new verb is a subclass in its own file, and a line in `flexstage.experiments.verbs`.
    """

    verb: ClassVar[str]
    """The verb in a plan file."""
    uses: ClassVar[tuple[str, ...]] = ()
    """Verbs of the steps that it can use."""
    moving: ClassVar[bool] = False
    """Whether the stage moves; then its result depends on instrument and sensors too."""
    needs_frequency: ClassVar[bool] = False
    """Whether its command needs the lowest natural frequency, which it must not excite."""
    response: ClassVar[str] = "auto"
    """Excitation of a frequency response by its command, one of `campaign.plan.EXCITATIONS`."""
    visits_corners: ClassVar[bool] = False
    """Whether its command dwells at the corners of the workspace."""

    @property
    def needs(self) -> tuple[str, ...]:
        """Earlier steps that it uses."""
        return ()

    @property
    def by_hammer(self) -> bool:
        """Whether a hammer excites the stage, with its drives removed."""
        return self.response == "hammer"

    @property
    def motion_cycles(self) -> int | None:
        """Number of equal cycles in its command; None where there are none."""
        return None

    def axis_of(self, plan: PlanLookup) -> str:
        """Return its axis; both, such as ``xy``, for two axes."""
        return plan.axis_of(self.needs[0])

    def reads(self, before: "Mapping[str, Verb]") -> tuple[str, ...]:
        """Return the sensors of the plan that it reads, given the steps before it."""
        del before
        return ()

    def problems(
        self, name: str, before: "Mapping[str, Verb]", sensors: Sequence[str]
    ) -> Iterator[str]:
        """Yield messages about missing steps and sensors, given the steps before it."""
        for other in self.needs:
            if other not in before:
                listed = ", ".join(before) or "none"
                yield (
                    f"step '{name}' uses '{other}', which is not an earlier step (earlier steps: "
                    f"{listed})"
                )
                return
            if message := self.refused(name, other, before[other]):
                yield message
        for sensor in self.reads(before):
            if sensor not in sensors:
                listed = ", ".join(sensors) or "none"
                yield (
                    f"step '{name}' reads the sensor '{sensor}', which is not described "
                    f"(described: {listed}): list it under 'sensors'"
                )
        if message := self.missing(name, before):
            yield message

    def refused(self, name: str, other: str, used: "Verb") -> str:
        """Return the reason why it cannot use another step, or an empty text."""
        if used.verb in self.uses:
            return ""
        return (
            f"step '{name}' of {self.verb} uses '{other}', which is a step of {used.verb}: name "
            f"a step of {' or '.join(self.uses)}"
        )

    def missing(self, name: str, before: "Mapping[str, Verb]") -> str:
        """Return a message about data that the steps before it do not provide."""
        del name, before
        return ""

    def preview(self, context: PlanContext, name: str) -> PlannedStep:
        """Return its preview; raise an error where it cannot be carried out."""
        del context
        return PlannedStep(name=name, verb=self.verb, what=f"of {', '.join(self.needs)}")

    def depends_on(self, plan: PlanLookup) -> tuple[object, ...]:
        """Return further parts of the plan, besides itself and the defaults, that it depends on."""
        del plan
        return ()

    def run(self, context: "RunContext", name: str) -> list[Path]:
        """Carry it out, and return the files that it wrote."""
        del context, name
        return []

    def result(
        self, context: "RunContext", name: str, files: list[Path], *, now: bool
    ) -> "StepResult":
        """Return its result, from the files that it wrote now or in an earlier run."""
        raise NotImplementedError

    @staticmethod
    def section(steps: "Sequence[Any]", result: ResultLookup) -> "Section | None":
        """Return the section of the report on all steps of this verb."""
        del steps, result
        return None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepResult:
    """Result of a step."""

    name: str
    """Name of the step."""

    @property
    def figures(self) -> "tuple[MeasuredCharacteristic, ...]":
        """Measured figures of the stage."""
        return ()

    @property
    def tests(self) -> "tuple[TestResult, ...]":
        """Evaluated tests."""
        return ()

    @property
    def sources(self) -> Mapping[str, str]:
        """SHA-256 of each evaluated record, by its name."""
        return {}

    def plain(self, result: ResultLookup) -> dict[str, Any]:
        """Return its entry in ``results.json``, without name and verb."""
        raise NotImplementedError

    @property
    def line(self) -> str:
        """Line for a terminal, below the figures."""
        return ""

    @property
    def table(self) -> "Table | None":
        """Table for a terminal, below the figures."""
        return None

    def model_entry(
        self, context: "RunContext", stage: "StageEntry", runs: Mapping[str, str]
    ) -> "ModelEntry | None":
        """Return the catalogue entry of a model; `runs` are identifiers of records by file."""
        del context, stage, runs
        return None


_Result = TypeVar("_Result", bound=StepResult)


@dataclass(slots=True, kw_only=True)
class RunContext(PlanContext):
    """Context of a plan that is being carried out; it is mutable."""

    instrument: Instrument
    """The instrument."""
    folder: Path
    """Folder of the run."""
    run: RunMetadata
    """Metadata at the start: stage, instrument and its settings, plan, operator."""
    results: dict[str, StepResult] = field(default_factory=dict)
    """Results of the steps so far, by name."""
    commands: dict[str, Command] = field(default_factory=dict)
    """Designed commands, by their step."""

    @property
    def origin(self) -> Literal["measured", "virtual"]:
        """``measured``, or ``virtual`` where the instrument is a simulation."""
        return "virtual" if self.instrument.identity.simulated else "measured"

    def limits(self, axis: str) -> AxisLimits | None:
        mover = self.instrument.axes.get(axis)
        return None if mover is None else mover.limits

    def result_of(self, name: str, kind: type[_Result]) -> _Result:
        """Return the result of an earlier step; the plan has ensured its kind."""
        result = self.results[name]
        assert isinstance(result, kind)
        return result

    def signal(self, sensor: str) -> Signal:
        """Return the signal of a sensor of the plan."""
        entry = self.plan.sensor(sensor)
        return Signal(kind="channel", source=str(entry.channel), name=sensor, unit=entry.unit)

    def metadata(self, step: str, kind: str, axis: str) -> RunMetadata:
        """Return the metadata of a record."""
        settings = dict(self.instrument.settings())
        return replace(self.run, settings=settings, kind=kind, axis=axis, step=step)


def base_rate_of(instrument: Instrument) -> float:
    """Return the highest sample rate of a command [Hz]."""
    if Capability.WAVE_GENERATOR in instrument.capabilities:
        return instrument.waves.base_rate_hz
    return BASE_RATE_HZ
