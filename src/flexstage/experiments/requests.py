"""Requests of experiments: a run of a plan, and tests with the evaluation of their records."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from typing import Annotated, ClassVar, Literal

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import FlexstageError, ModelError, PlanError
from flexstage.files.ranges import (
    NOT_NEGATIVE,
    POSITIVE,
    Range,
    Written,
    require_ranges,
)
from flexstage.files.request import Request
from flexstage.quantities.units import DIMENSIONS, Length
from flexstage.records.read_options import ReadOptions

_BELOW_ONE = Range(low=0.0, high=1.0, below=True)
_CONFIDENCE = Range(low=0.5, high=1.0, above=True, below=True)
_TEXT = Annotated[str, Written("TEXT")]


# without slots: a test, or a step of a plan, has the fields of several of these
@dataclass(frozen=True, kw_only=True)
class Roles:
    """Column of a record, or sensor of a plan, for each motion."""

    along: str | None = None
    """Position along the axis."""
    across: str | None = None
    """Transverse motion in the plane."""
    vertical: str | None = None
    """Motion out of the plane."""
    roll: str | None = None
    """Rotation about the axis."""
    pitch: str | None = None
    """Rotation about the transverse direction."""
    yaw: str | None = None
    """Rotation about the normal."""
    x: str | None = None
    """x at the corners of a workspace."""
    y: str | None = None
    """y at the corners of a workspace."""

    @property
    def roles(self) -> dict[str, str]:
        """Columns or sensors by role."""
        return {f.name: name for f in fields(Roles) if (name := getattr(self, f.name)) is not None}


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns(Roles):
    """Column of each role, by number or name; or the unit of each."""

    command: str | None = None
    """Column of the command."""
    input: str | None = None
    """Column of the force or other excitation."""
    output: tuple[str, ...] = ()
    """Columns of the response."""
    corner: str | None = None
    """Column of the number of the corner, from 0 and anticlockwise."""
    spheres: tuple[str, ...] = ()
    """Names of the spheres, whose columns are called NAME.X, NAME.Y and NAME.Z."""
    angle: str | None = None
    """Column of the angle of an axis of rotation, wrapped or not."""
    radial: str | None = None
    """Column of an indicator that stands still, towards the axis."""
    radial_90: str | None = None
    """Column of a second one, 90 deg further as the angle grows, for the direction that turns."""
    axial: str | None = None
    """Column of an indicator along the axis."""
    tilt: str | None = None
    """Column of the tilt of the axis, in one plane."""
    direction: str | None = None
    """Column of the direction of approach: up or down, 1 or -1, or an arrow."""
    upward: tuple[str, ...] = ()
    """For a table with one row for each target: columns of the upward runs."""
    downward: tuple[str, ...] = ()
    """For such a table: columns of the downward runs."""

    @classmethod
    def of(cls, texts: Iterable[str], option: str) -> "Columns":
        """Return the columns of texts such as along=2 or output=3,4."""
        defaults, values = cls(), {}
        roles = [f.name for f in fields(cls)]
        for text in texts:
            role, _, column = (word.strip() for word in text.partition("="))
            if role not in roles or not column:
                raise ModelError(
                    f"{option}, got '{text[:60]}' (roles: {', '.join(roles)})"
                    f"{'' if role in roles else did_you_mean(role, roles)}"
                )
            several = isinstance(getattr(defaults, role), tuple)
            words = tuple(word.strip() for word in column.split(","))
            values[role] = words if several else column
        return cls(**values)

    def named(self) -> dict[str, str]:
        """Return the given single columns, by role."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {k: v for k, v in values.items() if isinstance(v, str)}


@dataclass(frozen=True, kw_only=True)
class StepOptions(Request):
    """Options of the evaluation of a staircase."""

    confidence: Annotated[float, _CONFIDENCE, Written("SHARE")] = 0.95
    """For a staircase: confidence level of a step."""


@dataclass(frozen=True, kw_only=True)
class Evaluation(StepOptions):
    """Options of the evaluation of a test of a campaign or of a plan."""

    modes: Annotated[int, Range(low=1, high=100, remark="default: automatic")] | None = None
    """Of a response: number of fitted modes (default: by stabilisation)."""
    band: Annotated[tuple[float, float], DIMENSIONS["frequency"]] | None = None
    """Of a response: ends of the fitted band [Hz]."""
    smallest_steps: bool = False
    """Of a staircase: its steps are the smallest of the drive, so that they are the resolution, not
    the smallest step that is distinguishable from the noise.
    """
    smallest_step: Annotated[Length, POSITIVE] | None = None
    """Of a motion commanded in metres: smallest step of the drive; its product with the measured
    ratio is the resolution [m].
    """

    def require(self, error: type[FlexstageError], of: str) -> None:
        """Refuse invalid options; `of` is the owner, for messages."""
        require_ranges(self, error, of)
        if self.band is not None and not 0.0 <= self.band[0] < self.band[1] < math.inf:
            low, high = self.band
            raise error(
                f"the band of {of} must rise from 0 Hz or more, got {low:g} to {high:g} Hz: give "
                "its lower end first"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class TestOptions(StepOptions):
    """Options of the records of a test."""

    __test__ = False  # a name that the collector of tests would take for its own

    axis: Annotated[str, Written("NAME")]
    """The axis that moves or is excited; of a workspace both axes, such as xy."""
    cycle: Literal["auto", "standard", "step"] = "auto"
    """For positioning with one row for each approach: standard (series up and down) or step (each
    target from both sides in turn); auto also detects dwells of several samples.
    """
    deviations: bool = False
    """For positioning: the readings are deviations from the targets, not positions."""
    commands: Annotated[tuple[Length, ...], Written("LENGTHS", commas=True)] = ()
    """For spheres: command at each station, separated by commas, if there is no such column, as in
    the report of a measuring machine: "0 um,5 um,10 um,5 um,0 um".
    """
    reading: ReadOptions = field(default_factory=ReadOptions)
    """Options of reading the files."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorUncertainty(Request):
    """Standard uncertainties of the sensors."""

    one_value: ClassVar[bool] = True

    calibration: Annotated[float, _BELOW_ONE, Written("SHARE")] = 0.0
    """Relative standard uncertainty of the sensitivity."""
    alignment: Annotated[float, DIMENSIONS["angle"], NOT_NEGATIVE] = 0.0
    """Standard uncertainty of the direction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CharacteriseRequest(TestOptions):
    """The figures of a stage from the measured files of one test."""

    axis: Annotated[str, Written("NAME")] = "x"
    test: Annotated[str, Written("KIND")] = "motion"
    """Kind of test: motion, spheres, positioning, axis-of-rotation, staircase, hold, response,
    ring-down or workspace.
    """
    column: Annotated[tuple[str, ...], Written("ROLE=COLUMN")] = ()
    """Column of a role, by number or name, such as along=2; with a unit if the file has none,
    "along=2 um"; several separated by commas, output=3,4. Roles:
    command, along, across, vertical, roll, pitch and yaw of motions; input and output of responses;
    corner, x and y of a workspace; spheres, by their names; direction of an approach, or upward and
    downward for a table with one row for each target; angle, radial, radial_90, axial and tilt of
    an axis of rotation. In the direction that turns, of radial and radial_90, distrust order 2, not
    order 1: there unequal gains turn eccentricity into an error.
    """
    sensor: SensorUncertainty = SensorUncertainty()
    """Standard uncertainties of the sensors, such as "calibration=0.05 %,alignment=1 mrad"."""

    @property
    def columns(self) -> Columns:
        """The columns, by their roles."""
        return Columns.of(self.column, "--column must be a role and a column such as along=2")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRequest(Request):
    """Steps of a plan that are carried out, operator, and remark for the records."""

    refused_as: ClassVar[type[FlexstageError]] = PlanError

    only: Annotated[tuple[str, ...], Written("NAMES", commas=True)] | None = None
    """Steps to carry out, separated by commas; the steps that they need are included."""
    resume: bool = False
    """Continue the interrupted run in --folder."""
    operator: _TEXT = ""
    """Name of the operator, for the records."""
    note: _TEXT = ""
    """A remark for the records."""

    def __post_init__(self) -> None:
        super(RunRequest, self).__post_init__()
        if self.only == ():
            raise PlanError("--only names no step: give names separated by commas")


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchRequest(Request):
    """Instrument that carries out a plan, and catalogue of its records."""

    instrument: Annotated[str, Written("ADDRESS")] | None = None
    """Address: gcs://HOST:PORT, serial:///dev/ttyUSB0, ni://Dev1, or twin://?seed=3 for a
    simulation; required except with --dry-run.
    """
    catalogue: Annotated[str, Written("URL")] | None = None
    """Catalogue of the records: a file, or the URL of a database; 'none' for no catalogue (default:
    that of the user).
    """
    yes: bool = False
    """Do not ask for confirmation before a real instrument moves."""
