"""What a step of a plan does with commands, records and models."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from flexstage.errors import PlanError
from flexstage.experiments.campaign.plan import KINDS
from flexstage.files.ranges import INNER_SHARE, POSITIVE, Count, Range, Seed, Whole, require_ranges
from flexstage.units import DIMENSIONS, Angle, Frequency, Length

#: Sensors by what they read in a test.
ROLES: tuple[str, ...] = ("along", "across", "vertical", "roll", "pitch", "yaw", "x", "y")
_TESTS = ("motion", "positioning", "staircase", "hold", "response", "workspace")
#: Ways in which a reference can be followed.
WAYS: tuple[str, ...] = ("open loop", "inverse", "feedback", "both", "learning")

_SIZE = Range(low=0.0, high=1e3, above=True)
_Rate = Annotated[Frequency, Range(low=1e-3, high=1e7)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """Runs a command, and records what sensors read."""

    verb: ClassVar[str] = "measure"

    of: str
    """The earlier step whose command is run."""
    test: str | None = None
    """Kind of test that the record is, as `characterise` takes it; none where it is only used to
    identify.
    """
    along: str | None = None
    """The sensor that reads along the axis."""
    across: str | None = None
    """The sensor that reads across it, in the plane."""
    vertical: str | None = None
    """The sensor that reads out of the plane."""
    roll: str | None = None
    """The sensor that reads the roll."""
    pitch: str | None = None
    """The sensor that reads the pitch."""
    yaw: str | None = None
    """The sensor that reads the yaw."""
    x: str | None = None
    """The sensor that reads along x, of a workspace."""
    y: str | None = None
    """The sensor that reads along y, of a workspace."""
    output: tuple[str, ...] = ()
    """Of a response: the sensors that follow. Of a blow: the axes whose acceleration is read."""
    also: tuple[str, ...] = ()
    """Further sensors to record."""
    rate: _Rate | None = None
    """Rate of samples [Hz]; that of the plan where not given."""
    confidence: Annotated[float, INNER_SHARE] = 0.95
    """Of a staircase: confidence at which steps are told apart [1]."""
    smallest_steps: bool = False
    """Of a staircase: whether its steps are the smallest that the drive makes."""
    smallest_step: Annotated[Length, POSITIVE] | None = None
    """Of a motion commanded in metres: the smallest step of the drive [m]."""
    modes: Annotated[int, Range(low=1, high=100)] | None = None
    """Of a response: how many modes are fitted."""
    band: Annotated[tuple[float, float], DIMENSIONS["frequency"]] | None = None
    """Of a response: the band that is fitted [Hz]."""

    def __post_init__(self) -> None:
        if self.test is not None and self.test not in _TESTS:
            known = "cannot be made here" if self.test in KINDS else "is not known"
            raise PlanError(
                f"the kind of test '{self.test}' {known}: choose from {', '.join(_TESTS)}"
            )
        require_ranges(self, PlanError, self.verb)
        if self.band is not None and not 0.0 <= self.band[0] < self.band[1]:
            raise PlanError(
                f"the band of a response must rise from 0 Hz or more, got {self.band[0]:g} to "
                f"{self.band[1]:g} Hz"
            )

    @property
    def roles(self) -> dict[str, str]:
        """Sensors by what they read."""
        return {r: s for r in ROLES if (s := getattr(self, r)) is not None}

    @property
    def needs(self) -> tuple[str, ...]:
        """Earlier steps that it uses."""
        return (self.of,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Characterise:
    """Evaluates records as the tests that they are."""

    verb: ClassVar[str] = "characterise"

    of: tuple[str, ...]
    """Steps that measured, each with a kind of test."""

    def __post_init__(self) -> None:
        if not self.of:
            raise PlanError("characterise needs one step at least that measures, got none")
        if twice := sorted({name for name in self.of if self.of.count(name) > 1}):
            raise PlanError(f"characterise names '{twice[0]}' twice: name it once")

    @property
    def needs(self) -> tuple[str, ...]:
        """Earlier steps that it uses."""
        return self.of


@dataclass(frozen=True, slots=True, kw_only=True)
class Identify:
    """Finds the model of a drive in records."""

    verb: ClassVar[str] = "identify"

    of: tuple[str, ...]
    """Steps that measured the same axis."""
    output: str
    """The sensor that follows the drive."""
    models: tuple[str, ...] = ("preisach",)
    """Models of hysteresis that are tried; the simplest that is as good as the best is taken."""
    resonance: str | None = None
    """The step of characterise that found natural frequency and damping of the axis with its drive
    in place; looked for in the records where not given.
    """

    def __post_init__(self) -> None:
        if not self.of or not self.models:
            raise PlanError("identify needs a step that measures and a model at least")
        from flexstage.hysteresis.identification.model_fit import fits

        for name in self.models:
            if name != "auto" and name not in fits():
                raise PlanError(
                    f"the model '{name}' is not known: choose from auto, {', '.join(fits())}"
                )

    @property
    def needs(self) -> tuple[str, ...]:
        """Earlier steps that it uses."""
        return self.of if self.resonance is None else (*self.of, self.resonance)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Positions that shall be followed, over and over."""

    rate: Annotated[Frequency, Range(low=0.0, high=1e6, above=True)] = 1.0
    """Cycles in a second [Hz]."""
    cycles: Count = 3
    """How many are evaluated."""
    settle: Whole = 3
    """How many run before them."""
    shape: Literal["cosine", "triangle"] = "cosine"
    """How each runs; a triangle has rounded corners."""
    share: Annotated[float, Range(low=0.0, high=1.0, above=True)] = 0.99
    """Range, as a share of what the model was identified on [1]."""

    def __post_init__(self) -> None:
        require_ranges(self, PlanError, "a reference")


@dataclass(frozen=True, slots=True, kw_only=True)
class Compensate:
    """Makes the command by which an axis follows a reference, from the inverse of its model.

    Notes
    -----
    Validity: the zero of the sensor is that of the record from which the model was identified. What
    the stage has crept and drifted since is an offset; `Verify` measures it, and takes it off.
    """

    verb: ClassVar[str] = "compensate"

    model: str
    """The step that identified it."""
    reference: Reference = field(default_factory=Reference)
    """What shall be followed."""

    @property
    def needs(self) -> tuple[str, ...]:
        """Earlier steps that it uses."""
        return (self.model,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verify:
    """Follows a reference in several ways, and compares what is left of the loop."""

    verb: ClassVar[str] = "verify"

    model: str
    """The step that identified the model."""
    along: str
    """The sensor that reads the position."""
    reference: Reference = field(default_factory=Reference)
    """What shall be followed."""
    ways: tuple[str, ...] = ("open loop", "inverse")
    """``open loop`` (the voltage in proportion to the reference), ``inverse``, ``feedback``,
    ``both``, ``learning``.
    """
    trials: Annotated[int, Range(low=1, high=100)] = 5
    """Trials of learning."""
    rate: _Rate | None = None
    """Rate of samples [Hz]; that of the plan where not given."""

    def __post_init__(self) -> None:
        for way in self.ways:
            if way not in WAYS:
                raise PlanError(
                    f"the way '{way}' to follow a reference is not known: choose from "
                    f"{', '.join(WAYS)}"
                )
        if not self.ways or len(set(self.ways)) < len(self.ways):
            raise PlanError(f"verify needs ways, each once, got {', '.join(self.ways) or 'none'}")
        require_ranges(self, PlanError, self.verb)

    @property
    def needs(self) -> tuple[str, ...]:
        """Earlier steps that it uses."""
        return (self.model,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Centre:
    """Centres an encoder scale on a turning table; table and heads are simulated."""

    verb: ClassVar[str] = "centre"

    axes: tuple[str, str] = ("x", "y")
    """The two axes that carry the scale."""
    sensors: tuple[str, str] = ("x", "y")
    """The sensors that read where they carry it."""
    radius: Annotated[Length, _SIZE] = 50e-3
    """Radius at which the scale is read [m]."""
    eccentricity: Annotated[tuple[float, float], DIMENSIONS["length"]] = (14e-6, -11e-6)
    """Centre of the scale on the table when both axes are in their middle [m]."""
    heads: tuple[Angle, ...] = (0.0, 1.6, 3.1, 4.8)
    """Where the heads stand [rad]."""
    mounting_angle: Angle = 0.4
    """Angle of the stage on the table [rad]."""
    noise: Annotated[Angle, _SIZE] = 4.8e-6
    """Standard deviation of a head's reading [rad]."""
    target: Annotated[Length, _SIZE] = 0.1e-6
    """Eccentricity that shall be reached [m]."""
    moves: Annotated[int, Range(low=1, high=100)] = 3
    """The most moves towards the centre."""
    closed_loop: bool = True
    """Whether the axes move under position control where they can."""
    seed: Seed = 0
    """Seed of the scale's errors and of the noise."""

    def __post_init__(self) -> None:
        require_ranges(self, PlanError, self.verb)
        if not max(abs(e) for e in self.eccentricity) < self.radius:
            raise PlanError(
                f"the eccentricity of centre must be smaller than its radius of {self.radius:g} m, "
                f"got {self.eccentricity[0]:g} and {self.eccentricity[1]:g} m"
            )
        for what, two in (("axes", self.axes), ("sensors", self.sensors)):
            if two[0] == two[1]:
                raise PlanError(f"centre needs two {what}, got '{two[0]}' twice")
        if not self.heads:
            raise PlanError("centre needs one head at least, got none")

    @property
    def needs(self) -> tuple[str, ...]:
        """Earlier steps that it uses."""
        return ()
