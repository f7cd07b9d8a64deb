"""What is asked of the records of a test: what is in them, and how they are evaluated."""

from dataclasses import dataclass, field, fields
from typing import Annotated, Any, ClassVar, Literal

from flexstage.errors import ModelError
from flexstage.files.ranges import NOT_NEGATIVE, Range, Written
from flexstage.files.request import Request
from flexstage.records.read_options import ReadOptions
from flexstage.units import DIMENSIONS, Length

_COLUMN = Annotated[str, Written("COLUMN")]
_COLUMNS = Annotated[tuple[str, ...], Written("COLUMNS", commas=True)]
_BELOW_ONE = Range(low=0.0, high=1.0, below=True)
_CONFIDENCE = Range(low=0.5, high=1.0, above=True, below=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns(Request):
    """Which column of a record is what, by number or name; or the unit of each."""

    heading: ClassVar[str] = "Columns"

    command: _COLUMN | None = None
    """Column of the command."""
    along: _COLUMN | None = None
    """Column of the position along the axis."""
    across: _COLUMN | None = None
    """Column of the transverse motion in the plane."""
    vertical: _COLUMN | None = None
    """Column of the motion out of the plane."""
    roll: _COLUMN | None = None
    """Column of the rotation about the axis."""
    pitch: _COLUMN | None = None
    """Column of the rotation about the transverse direction."""
    yaw: _COLUMN | None = None
    """Column of the rotation about the normal."""
    input: _COLUMN | None = None
    """Column of the force or other excitation."""
    output: _COLUMNS = ()
    """Columns of the response, separated by commas."""
    corner: _COLUMN | None = None
    """Column of the number of the corner, from 0 and anticlockwise."""
    x: _COLUMN | None = None
    """Column of the reading in x at the corners."""
    y: _COLUMN | None = None
    """Column of the reading in y at the corners."""
    spheres: Annotated[tuple[str, ...], Written("NAMES", commas=True)] = ()
    """Names of the spheres, separated by commas, whose columns are called NAME.X, NAME.Y and
    NAME.Z.
    """
    direction: _COLUMN | None = None
    """Column of the direction of approach: up or down, 1 or -1, or an arrow."""
    upward: _COLUMNS = ()
    """For a table with a row for each target: columns of the upward runs, separated by commas."""
    downward: _COLUMNS = ()
    """For such a table: columns of the downward runs."""

    def named(self) -> dict[str, str]:
        """Return the single columns that are given, by what they are."""
        given = {f.name: getattr(self, f.name) for f in fields(self)}
        return {k: v for k, v in given.items() if isinstance(v, str)}


@dataclass(frozen=True, slots=True, kw_only=True)
class TestOptions(Request):
    """How the records of a test are evaluated."""

    __test__ = False  # a name that the collector of tests would take for its own

    axis: Annotated[str, Written("NAME")]
    """The axis that moves or is excited; of a workspace both axes, such as xy."""
    cycle: Literal["auto", "standard", "step"] = "auto"
    """For positioning with a row for each approach: standard (series up and down) or step (each
    target from both sides in turn); auto also finds rests of several samples.
    """
    deviations: bool = False
    """For positioning: the readings are deviations from the targets, not positions."""
    commands: Annotated[tuple[Length, ...], Written("LENGTHS", commas=True)] = ()
    """For spheres: command at each station, separated by commas, if there is no such column, as in
    the report of a measuring machine: "0 um,5 um,10 um,5 um,0 um".
    """
    confidence: Annotated[float, _CONFIDENCE, Written("SHARE")] = 0.95
    """For a staircase: confidence level of a step."""
    columns: Columns = field(default_factory=Columns)
    """What is in which column."""
    reading: ReadOptions = field(default_factory=ReadOptions)
    """How the files are read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CharacteriseRequest(TestOptions):
    """The figures of a stage from the measured files of one test."""

    axis: Annotated[str, Written("NAME")] = "x"
    """The axis that moves or is excited; of a workspace both axes, such as xy."""
    test: Annotated[str, Written("KIND")] = "motion"
    """Kind of test: motion, spheres, positioning, staircase, hold, response, ring-down or
    workspace.
    """
    column_unit: Annotated[tuple[str, ...], Written("ROLE=UNIT")] = ()
    """Unit of a column without one, such as "along=um"."""
    calibration: Annotated[float, _BELOW_ONE, Written("SHARE")] = 0.0
    """Relative standard uncertainty of the sensor sensitivity, such as "0.05%"."""
    alignment: Annotated[float, DIMENSIONS["angle"], NOT_NEGATIVE] = 0.0
    """Standard uncertainty of the direction of the sensors, such as "1 mrad"."""

    @property
    def units(self) -> Columns:
        """The units of columns, by their roles."""
        roles = [f.name for f in fields(Columns)]
        found: dict[str, Any] = {}
        for text in self.column_unit:
            role, _, unit = (word.strip() for word in text.partition("="))
            if role not in roles or not unit:
                raise ModelError(
                    f'--column-unit must be a role and a unit such as "along=um", got "{text}" '
                    f"(roles: {', '.join(roles)})"
                )
            found[role] = (unit,) if isinstance(getattr(Columns(), role), tuple) else unit
        return Columns(**found)
