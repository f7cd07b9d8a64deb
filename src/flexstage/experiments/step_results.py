"""What a step gave, one class for each verb."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from flexstage.arrays import Array
from flexstage.characteristic import MeasuredCharacteristic
from flexstage.errors import PlanError
from flexstage.experiments.campaign.results import Characterisation
from flexstage.hysteresis import DriveModel, Tracking
from flexstage.records import Record


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CommandedStep:
    """A command that was designed."""

    name: str
    """Name of the step."""
    axis: str
    """The axis, or both such as ``xy``."""
    kind: str
    """Kind of the command."""
    time: Array
    """Times of its samples [s], shape (n,); empty of blows."""
    values: Mapping[str, Array]
    """Its samples by axis [V or m], each of shape (n,)."""
    unit: str
    """Unit of the samples."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredStep:
    """A record that was taken."""

    name: str
    """Name of the step."""
    axis: str
    """The axis, or both such as ``xy``."""
    test: str
    """Kind of test that it is; empty where it only serves to identify."""
    record: Record
    """All samples."""
    first: int
    """Number of samples at its beginning that prepare, and are not evaluated."""
    period: int
    """Samples of a cycle; 0 where there are none."""
    file: Path
    """The file that holds it."""
    repeated: bool
    """Whether it was taken now; False where an earlier run of the same plan had taken it."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""

    @property
    def evaluated(self) -> Record:
        """The record without what prepares."""
        from dataclasses import replace

        if self.first == 0 or self.record.over != "time":
            return self.record
        kept = slice(self.first, None)
        return replace(
            self.record,
            channels=tuple(replace(c, values=c.values[kept]) for c in self.record.channels),
            time=self.record.time[kept] - self.record.time[self.first],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CharacterisedStep:
    """Figures of tests."""

    name: str
    """Name of the step."""
    found: Characterisation
    """What the tests gave, with the curves behind each figure."""
    ratios: tuple[MeasuredCharacteristic, ...] = ()
    """Motion of the platform over that of the drive, of the motions that were commanded in metres.
    """

    @property
    def figures(self) -> tuple[MeasuredCharacteristic, ...]:
        """All figures, test by test."""
        own = tuple(figure for result in self.found.results for figure in result.figures)
        return (*own, *self.ratios)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompensatedStep:
    """A command that was made from the inverse of a model."""

    name: str
    """Name of the step."""
    axis: str
    """The axis."""
    time: Array
    """Times [s], shape (n,)."""
    reference: Array
    """What shall be followed [m], shape (n,)."""
    voltage: Array
    """The command [V], shape (n,)."""
    predicted: Array
    """What the model says will come [m], shape (n,)."""
    notes: tuple[str, ...] = ()
    """What was changed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CentredMove:
    """One measurement of the eccentricity, and what was done before it."""

    kind: str
    """``start``, ``trial`` or ``move``."""
    command: tuple[float, float]
    """Commands of the axes, from the middle of their ranges [m]."""
    eccentricity: tuple[float, float]
    """Centre of the scale that was measured then, x and y on the table [m]."""
    length: float
    """Its distance from the centre [m]."""
    uncertainty: float
    """Expanded uncertainty of that at 95 % [m]."""
    predicted: float | None
    """What the move was expected to leave [m]; None before the moves were known."""
    true_length: float
    """Where the centre of the simulated scale really was [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentredStep:
    """A scale that was centred."""

    name: str
    """Name of the step."""
    axes: tuple[str, str]
    """The axes that moved it."""
    target: float
    """Eccentricity that was asked for [m]."""
    reached: bool
    """Whether the upper end of the 95 % interval of what was measured last is below it."""
    reason: str
    """Why it ended."""
    moves: tuple[CentredMove, ...]
    """Every measurement and move."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentifiedStep:
    """A model that was identified."""

    name: str
    """Name of the step."""
    axis: str
    """The axis."""
    model: DriveModel
    """The model."""
    kind: str
    """Name of the hysteresis model."""
    file: Path
    """Its file."""
    errors_percent: Mapping[str, float]
    """Errors of the fit by what they are, over the stroke [%]."""
    time: Array
    """Times of the record that it was identified from, the last of them where there were several
    [s], shape (n,).
    """
    voltage: Array
    """Command there [V], shape (n,)."""
    measured: Array
    """Reading there [m], shape (n,)."""
    modelled: Array
    """What the model says there [m], its mean set to that of the reading, shape (n,)."""
    deviation: float
    """Largest difference of reading and model, after the first tenth of the record [m]."""
    warnings: tuple[str, ...] = ()
    """What the records cannot tell."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FollowedRun:
    """A reference that was followed in one way."""

    way: str
    """``open loop``, ``inverse``, ``feedback``, ``both`` or ``learning``."""
    time: Array
    """Times of the compared cycles [s], shape (n,)."""
    reference: Array
    """What was wanted [m], shape (n,)."""
    output: Array
    """What the sensor read [m], shape (n,); in open loop less the mean difference from the
    reference.
    """
    voltage: Array
    """Voltage at the drive [V], shape (n,)."""
    tracking: Tracking
    """Width of the loop, and errors [m]."""
    widths: tuple[float, ...]
    """Width of the loop of each cycle [m]."""
    reduction_percent: float | None
    """By how much the loop is narrower than in open loop [%]; None without that."""
    errors: tuple[float, ...] = ()
    """Of learning: rms of the error at each trial [m]."""
    file: Path
    """The file of the record."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VerifiedStep:
    """A reference that was followed in several ways."""

    name: str
    """Name of the step."""
    axis: str
    """The axis."""
    model: str
    """Step that identified the model."""
    kind: str
    """Name of its hysteresis model."""
    stroke: float
    """Range of the reference [m]."""
    rate_hz: float
    """Cycles in a second [Hz]."""
    runs: tuple[FollowedRun, ...]
    """One of each way."""
    figures: tuple[MeasuredCharacteristic, ...]
    """Width of the loop in open loop, and compensated."""

    def run(self, way: str) -> FollowedRun:
        """Return one run.

        Parameters
        ----------
        way : str
            The way.

        Returns
        -------
        FollowedRun
            The run.

        Raises
        ------
        PlanError
            The reference was not followed in that way.
        """
        for run in self.runs:
            if run.way == way:
                return run
        done = ", ".join(run.way for run in self.runs)
        raise PlanError(f"step '{self.name}' was not run in the way '{way}': there is {done}")
