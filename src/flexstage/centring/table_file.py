"""A rotary table with its scale, heads, axis of rotation and tolerance, and its file."""

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from flexstage.base.errors import ModelError
from flexstage.centring.geometry import ScaleKind
from flexstage.centring.requests import HeadAngles
from flexstage.files.decoder import read, read_file
from flexstage.files.format import Format
from flexstage.files.ranges import NOT_NEGATIVE, POSITIVE, Count, Range, Size, require_ranges
from flexstage.quantities.units import DIMENSIONS, Angle, Length

#: An angle of 0 or more [rad].
_Spread = Annotated[Angle, NOT_NEGATIVE]
#: A length of 0 or more [m].
_Motion = Annotated[Length, NOT_NEGATIVE]


@dataclass(frozen=True, slots=True, kw_only=True)
class Graduation:
    """An error of the lines of a scale that repeats every turn."""

    order: Count
    """Number of periods in a turn."""
    amplitude: _Spread
    """Its amplitude [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeTracks:
    """Absolute code on the face of a scale, in tracks of their own or along one."""

    code: Literal["gray", "binary", "pseudo-random"]
    """gray or binary on one track for each bit, binary ones read by two sensors (V-scan); or
    pseudo-random on one track, with a second one that clocks it.
    """
    bits: Annotated[int, Range(low=1, high=32)]
    """Number of bits in a turn."""
    inner: Size
    """Radius of the innermost track [m]."""
    outer: Size
    """Radius of the outermost track [m]."""

    @property
    def step(self) -> float:
        """Angle of one code [rad]."""
        return 2.0 * math.pi / 2**self.bits


@dataclass(frozen=True, slots=True, kw_only=True)
class MountedScale:
    """The scale as it is mounted, before it is centred."""

    kind: ScaleKind = "disc"
    """disc, read on a face, or drum, read on a rim."""
    radius: Size
    """Radius at which it is read [m]."""
    lines: Count | None = None
    """Periods of its signal in a turn."""
    tracks: CodeTracks | None = None
    """Its absolute code; None for a raster scale."""
    diameter: Size | None = None
    """Outer diameter [m]; twice the radius where not given."""
    mass: Annotated[float, DIMENSIONS["mass"], NOT_NEGATIVE] = 0.0
    """Mass of the scale with its carrier [kg]."""
    eccentricity: Size
    """Largest distance of its centre from the axis after mounting [m]."""
    ellipticity: _Motion = 0.0
    """Amplitude of an oval deformation: half the difference of its largest and smallest radius
    [m].
    """
    tilt: _Spread = 0.0
    """Angle between its axis and the axis of rotation [rad]."""
    graduation: tuple[Graduation, ...] = ()
    """Known errors of its lines."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Heads:
    """The reading heads."""

    angles: HeadAngles
    """Their angles in the room [rad]."""
    noise: _Spread = 0.0
    """Standard deviation of one reading [rad]."""
    interpolation: _Spread = 0.0
    """Amplitude of the error within a period of the signal [rad]."""
    angle_uncertainty: _Spread = 0.0
    """Standard uncertainty of the angle of each head [rad]."""
    gap_change: Size | None = None
    """Largest change of distance between head and scale over a turn [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RotationAxis:
    """Error motion of the axis of rotation (ISO 230-7:2015), and its speed."""

    radial_synchronous: _Motion = 0.0
    """Range of the synchronous radial error motion, without eccentricity [m]."""
    radial_asynchronous: _Motion = 0.0
    """Range of the asynchronous radial error motion [m]."""
    axial: _Motion = 0.0
    """Range of the axial error motion [m]."""
    tilt: _Spread = 0.0
    """Range of the tilt error motion [rad]."""
    overhang: _Motion = 0.0
    """Distance along the axis from the plane of the radial error motion to the scale [m]."""
    speed: Annotated[float, DIMENSIONS["angular speed"], NOT_NEGATIVE] = 0.0
    """Highest speed of rotation [rad/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Space:
    """Space of the stage between table and scale."""

    diameter: Size | None = None
    """Diameter of the circle about the axis that the stage must not exceed [m]."""
    height: Size | None = None
    """Largest thickness of the stage [m]."""
    hole: Size | None = None
    """Diameter of the hole about the axis that must stay free [m]."""
    mass: Annotated[float, DIMENSIONS["mass"], POSITIVE] | None = None
    """Largest mass of the stage [kg]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """What the table must reach."""

    error: Annotated[Angle, POSITIVE]
    """Largest expanded uncertainty of the angle, 95 % [rad]."""
    reading: Literal["mean", "each"] = "mean"
    """The angle is the mean of all heads, or that of each head."""
    eccentricity: Size | None = None
    """Largest eccentricity after centring [m], besides what the error allows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RotaryTable:
    """A rotary table whose scale is centred by a stage.

    Raises
    ------
    ModelError
        The scale does not surround the axis, or there is no head.
    """

    name: str
    """Name."""
    scale: MountedScale
    """The scale."""
    heads: Heads
    """The heads."""
    axis: RotationAxis = RotationAxis()
    """The axis of rotation."""
    mounting_angle: Annotated[Angle, Range()] = 0.0
    """Direction of the x axis of the stage in the frame that turns with the table [rad]."""
    space: Space = Space()
    """Space of the stage."""
    tolerance: Tolerance
    """What the table must reach."""

    def __post_init__(self) -> None:
        parts = (self.scale, self.heads, self.axis, self.space, self.tolerance)
        for part in (self, *parts, *((self.scale.tracks,) if self.scale.tracks else ())):
            require_ranges(part, ModelError, "the table")
        if not self.heads.angles:
            raise ModelError("a table needs at least one head, got none: give heads.angles")
        if not self.scale.eccentricity < self.scale.radius:
            raise ModelError(
                "the eccentricity of the scale must be smaller than its radius of "
                f"{self.scale.radius:g} m, got {self.scale.eccentricity:g} m"
            )
        tracks = self.scale.tracks
        if tracks is not None and not tracks.inner < tracks.outer:
            raise ModelError(
                "the inner radius of the code must be smaller than the outer one, got "
                f"{tracks.inner:g} and {tracks.outer:g} m"
            )
        diameter = self.scale.diameter
        if diameter is not None and diameter < 2.0 * self.scale.radius:
            raise ModelError(
                f"the scale is read at a radius of {self.scale.radius:g} m, so its diameter must "
                f"be {2.0 * self.scale.radius:g} m or more, got {diameter:g} m"
            )


#: Format of the description of a table.
TABLE_FILE = Format(noun="description of a table", key="table", error=ModelError, only=True)


def read_table(path: str | os.PathLike[str]) -> RotaryTable:
    """Read the description of a rotary table from a YAML file whose first key is ``table: 1``.

    Messages about mistakes name the line.
    """
    decoder, root = read_file(Path(path), TABLE_FILE)
    return decoder.build(RotaryTable, root, "")


def table_from_text(text: str, source: str = "table") -> RotaryTable:
    """Read the description of a rotary table from text.

    Examples
    --------
    >>> table = table_from_text('''
    ... table: 1
    ... name: comparator
    ... scale: {radius: 48 mm, eccentricity: 50 um}
    ... heads: {angles: [0 deg, 180 deg], noise: 0.05 arcsec}
    ... tolerance: {error: 0.5 arcsec}
    ... ''')
    >>> table.heads.angles
    (0.0, 3.14159)
    """
    decoder, root = read(text, source, TABLE_FILE)
    return decoder.build(RotaryTable, root, "")
