"""What the steps of a plan gave."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage.characteristic import QUANTITIES, Characteristics
from flexstage.errors import PlanError
from flexstage.experiment.campaign import Characterisation, Figure
from flexstage.hysteresis import DriveModel, Tracking
from flexstage.instruments.protocol import Identity
from flexstage.plans.plan import Plan
from flexstage.records import Record
from flexstage.stage import Stage

__all__ = [
    "CentredMove",
    "CentredStep",
    "CharacterisedStep",
    "CommandedStep",
    "CompensatedStep",
    "FollowedRun",
    "IdentifiedStep",
    "MeasuredStep",
    "PlanResult",
    "StepResult",
    "VerifiedStep",
]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CommandedStep:
    """A command that was designed.

    Parameters
    ----------
    name : str
        Name of the step.
    axis : str
        The axis, or both such as ``xy``.
    kind : str
        Kind of the command.
    time : numpy.ndarray
        Times of its samples [s], shape (n,); empty of blows.
    values : Mapping
        Its samples by axis [V or m], each of shape (n,).
    unit : str
        Unit of the samples.
    notes : tuple of str
        What a reader should know.
    """

    name: str
    axis: str
    kind: str
    time: Array
    values: Mapping[str, Array]
    unit: str
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredStep:
    """A record that was taken.

    Parameters
    ----------
    name : str
        Name of the step.
    axis : str
        The axis, or both such as ``xy``.
    test : str
        Kind of test that it is; empty where it only serves to identify.
    record : Record
        All samples.
    first : int
        Number of samples at its beginning that prepare, and are not evaluated.
    period : int
        Samples of a cycle; 0 where there are none.
    file : pathlib.Path
        The file that holds it.
    repeated : bool
        Whether it was taken now; False where an earlier run of the same plan had taken it.
    notes : tuple of str
        What a reader should know.
    """

    name: str
    axis: str
    test: str
    record: Record
    first: int
    period: int
    file: Path
    repeated: bool
    notes: tuple[str, ...] = ()

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
    """Figures of tests.

    Parameters
    ----------
    name : str
        Name of the step.
    found : Characterisation
        What the tests gave, with the curves behind each figure.
    ratios : tuple of Figure
        Motion of the platform over that of the drive, of the motions that were commanded in metres.
    """

    name: str
    found: Characterisation
    ratios: tuple[Figure, ...] = ()

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All figures, test by test."""
        own = tuple(figure for result in self.found.results for figure in result.figures)
        return (*own, *self.ratios)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentifiedStep:
    """A model that was identified.

    Parameters
    ----------
    name : str
        Name of the step.
    axis : str
        The axis.
    model : DriveModel
        The model.
    kind : str
        Name of the hysteresis model.
    file : pathlib.Path
        Its file.
    errors_percent : Mapping
        Errors of the fit by what they are, over the stroke [%].
    time : numpy.ndarray
        Times of the record that it was identified from, the last of them where there were several
        [s], shape (n,).
    voltage, measured, modelled : numpy.ndarray
        Command [V], reading and model [m] there, each of shape (n,); the model's mean is set to
        that of the reading.
    deviation : float
        Largest difference of the two, after the first tenth of the record [m].
    warnings : tuple of str
        What the records cannot tell.
    """

    name: str
    axis: str
    model: DriveModel
    kind: str
    file: Path
    errors_percent: Mapping[str, float]
    time: Array
    voltage: Array
    measured: Array
    modelled: Array
    deviation: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompensatedStep:
    """A command that was made from the inverse of a model.

    Parameters
    ----------
    name : str
        Name of the step.
    axis : str
        The axis.
    time : numpy.ndarray
        Times [s], shape (n,).
    reference : numpy.ndarray
        What shall be followed [m], shape (n,).
    voltage : numpy.ndarray
        The command [V], shape (n,).
    predicted : numpy.ndarray
        What the model says will come [m], shape (n,).
    notes : tuple of str
        What was changed.
    """

    name: str
    axis: str
    time: Array
    reference: Array
    voltage: Array
    predicted: Array
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FollowedRun:
    """A reference that was followed in one way.

    Parameters
    ----------
    way : str
        ``open loop``, ``inverse``, ``feedback``, ``both`` or ``learning``.
    time : numpy.ndarray
        Times of the compared cycles [s], shape (n,).
    reference : numpy.ndarray
        What was wanted [m], shape (n,).
    output : numpy.ndarray
        What the sensor read [m], shape (n,); in open loop less the mean difference from the
        reference.
    voltage : numpy.ndarray
        Voltage at the drive [V], shape (n,).
    tracking : Tracking
        Width of the loop, and errors [m].
    widths : tuple of float
        Width of the loop of each cycle [m].
    reduction_percent : float or None
        By how much the loop is narrower than in open loop [%]; None without that.
    errors : tuple of float
        Of learning: rms of the error at each trial [m].
    file : pathlib.Path
        The file of the record.
    notes : tuple of str
        What a reader should know.
    """

    way: str
    time: Array
    reference: Array
    output: Array
    voltage: Array
    tracking: Tracking
    widths: tuple[float, ...]
    reduction_percent: float | None
    errors: tuple[float, ...] = ()
    file: Path
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VerifiedStep:
    """A reference that was followed in several ways.

    Parameters
    ----------
    name : str
        Name of the step.
    axis : str
        The axis.
    model : str
        Step that identified the model.
    kind : str
        Name of its hysteresis model.
    stroke : float
        Range of the reference [m].
    rate_hz : float
        Cycles in a second [Hz].
    runs : tuple of FollowedRun
        One of each way.
    figures : tuple of Figure
        Width of the loop in open loop, and compensated.
    """

    name: str
    axis: str
    model: str
    kind: str
    stroke: float
    rate_hz: float
    runs: tuple[FollowedRun, ...]
    figures: tuple[Figure, ...]

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


@dataclass(frozen=True, slots=True, kw_only=True)
class CentredMove:
    """One measurement of the eccentricity, and what was done before it.

    Parameters
    ----------
    kind : str
        ``start``, ``trial`` or ``move``.
    command : tuple of float
        Commands of the axes, from the middle of their ranges [m].
    eccentricity : tuple of float
        Centre of the scale that was measured then, x and y on the table [m].
    length, uncertainty : float
        Its distance from the centre, and the expanded uncertainty of that at 95 % [m].
    predicted : float or None
        What the move was expected to leave [m]; None before the moves were known.
    true_length : float
        Where the centre of the simulated scale really was [m].
    """

    kind: str
    command: tuple[float, float]
    eccentricity: tuple[float, float]
    length: float
    uncertainty: float
    predicted: float | None
    true_length: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentredStep:
    """A scale that was centred.

    Parameters
    ----------
    name : str
        Name of the step.
    axes : tuple of str
        The axes that moved it.
    target : float
        Eccentricity that was asked for [m].
    reached : bool
        Whether the upper end of the 95 % interval of what was measured last is below it.
    reason : str
        Why it ended.
    moves : tuple of CentredMove
        Every measurement and move.
    notes : tuple of str
        What a reader should know.
    """

    name: str
    axes: tuple[str, str]
    target: float
    reached: bool
    reason: str
    moves: tuple[CentredMove, ...]
    notes: tuple[str, ...] = ()


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
    """What a plan gave.

    Parameters
    ----------
    plan : Plan
        The plan.
    stage : Stage
        The stage.
    instrument : Identity
        What it was carried out on.
    settings : Mapping
        Settings of the instrument, as text.
    serial_number : str
        Serial number of the stage.
    operator, note : str
        Who carried it out, and what they said about it.
    started, finished : str
        Dates and times, UTC, ISO 8601.
    duration : float
        How long it took [s].
    folder : pathlib.Path
        Where everything was written.
    steps : tuple of StepResult
        What each step gave, in their order.
    notes : tuple of str
        What belongs to every figure.
    """

    plan: Plan
    stage: Stage
    instrument: Identity
    settings: Mapping[str, str] = field(default_factory=dict)
    serial_number: str = ""
    operator: str = ""
    note: str = ""
    started: str
    finished: str
    duration: float
    folder: Path
    steps: tuple[StepResult, ...]
    notes: tuple[str, ...] = ()

    @property
    def origin(self) -> str:
        """``measured``, or ``virtual`` where the instrument is a simulation."""
        return "virtual" if self.instrument.simulated else "measured"

    @property
    def figures(self) -> tuple[Figure, ...]:
        """One figure for each quantity and axis: that of the first step that gives it."""
        first: dict[tuple[str, str], Figure] = {}
        for figure in self.all_figures:
            first.setdefault((figure.quantity, figure.axis), figure)
        order = {quantity: i for i, quantity in enumerate(QUANTITIES)}
        return tuple(sorted(first.values(), key=lambda f: (order[f.quantity], f.axis)))

    @property
    def all_figures(self) -> tuple[Figure, ...]:
        """The figures of all steps, in their order."""
        found: list[Figure] = []
        for step in self.steps:
            if isinstance(step, CharacterisedStep | VerifiedStep):
                found += step.figures
        return tuple(found)

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

    def figure(self, quantity: str, axis: str) -> Figure:
        """Return one figure.

        Parameters
        ----------
        quantity : str
            The quantity.
        axis : str
            The axis.

        Returns
        -------
        Figure
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
