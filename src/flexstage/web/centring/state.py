"""What is open in the view Centring: what was measured, where the stage stood, what is next."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from flexstage.centring.procedure import trial_length, trial_position
from flexstage.centring.requests import CentreRequest
from flexstage.files.request import request_fields
from flexstage.records.likely_columns import LikelyTurn
from flexstage.web.centring.work import (
    EXAMPLE_HEADS,
    EXAMPLE_RADIUS,
    CentreFiles,
    CentreFound,
)
from flexstage.web.jobs import BackgroundJob

Source = Literal["records", "gauge", "example"]
_FAR = 1.0  # where nobody says how far a stage goes [m]


@dataclass(frozen=True, slots=True)
class Measured:
    """A turn of the scale that was measured."""

    kind: Literal["start", "trial", "move"]
    """What was done before it."""
    at: tuple[float, float]
    """Where the stage stood, x and y [m]."""
    file: Path
    """Its record."""


@dataclass
class CentringState:
    """What one person has open in the view Centring."""

    source: Source = "records"
    """Where records come from."""
    measured: list[Measured] = field(default_factory=list)
    """What was measured, in sequence."""
    at: tuple[float, float] = (0.0, 0.0)
    """Where the stage stands for the next measurement, x and y [m]."""
    limits: tuple[tuple[float, float], tuple[float, float]] = ((-_FAR, _FAR), (-_FAR, _FAR))
    """How far the axes of the stage go [m]."""
    noise: tuple[float, float] = (0.0, 0.0)
    """What the sensors of the stage do not tell from rest [m]."""
    found: CentreFound | None = None
    """What the measurements say."""
    columns: tuple[str, ...] = ()
    """Columns of the first record."""
    angle: str = "angle"
    """Its column of the angle."""
    errors: tuple[str, ...] = ()
    """Its columns of errors."""
    is_reading: bool = False
    """Whether those are what the heads read, and not less the true angle."""
    unit: str = ""
    """Unit of angle and errors, where the file does not say it."""
    heads: str = ""
    """Where the heads stand, in degrees."""
    radius: float | None = 50e-3
    """Radius of the scale [m]."""
    kind: Literal["disc", "drum", "magnet"] = "disc"
    """Kind of scale."""
    clockwise: bool = False
    """Whether the heads travel clockwise round the scale."""
    mount: float = 0.0
    """Direction of the stage's x axis in the frame that turns with the table [rad]."""
    gauge_text: str = ""
    """Readings of a gauge, as they are typed."""
    gauge_unit: str = "µm"
    """Their unit."""
    jobs: dict[str, BackgroundJob] = field(default_factory=dict)
    """Long work whose result nobody has taken."""

    @property
    def origin(self) -> tuple[float, float]:
        """Where the stage stood at first, x and y [m]."""
        return self.measured[0].at if self.measured else self.at

    @property
    def step(self) -> int:
        """Which step of the procedure is next: 1 measure, 2 trial moves, 3 move and 4 verify."""
        return (1, 2, 2)[len(self.measured)] if len(self.measured) < 3 else 3

    @property
    def asked(self) -> CentreFiles:
        """What is to be evaluated."""
        request = CentreRequest(
            error=() if self.is_reading else self.errors,
            reading=self.errors if self.is_reading else (),
            angle=self.angle,
            unit=self.unit or None,
            heads=request_fields(CentreRequest)["heads"].read(self.heads) if self.heads else (),
            radius=None if self.kind == "magnet" else self.radius,
            kind=self.kind,
            head_direction="cw" if self.clockwise else "ccw",
            mounting_angle=self.mount,
        )
        if len(self.measured) > 2:  # enough to say how the stage moves
            request = replace(request, stage_at=tuple(each.at for each in self.measured))
        return CentreFiles(files=tuple(each.file for each in self.measured), request=request)

    @property
    def next_kind(self) -> Literal["start", "trial", "move"]:
        """What is done before the next measurement."""
        return "start" if self.step == 1 else "trial" if self.step == 2 else "move"

    @property
    def up_to_date(self) -> bool:
        """Whether what was found is of all that was measured."""
        return self.found is not None and self.found.of == self.asked

    def take(self, file: Path) -> None:
        """Take a record of the scale with the stage where it stands."""
        self.measured.append(Measured(self.next_kind, self.at, file))

    def take_back(self) -> None:
        """Forget the last record."""
        self.at = self.measured.pop().at
        self.found = None

    def begin(self, source: Source, at: tuple[float, float] | None = None) -> None:
        """Begin anew, with the stage at a place; in the middle where that is not known."""
        fresh = CentringState(at=at or (0.0, 0.0), radius=self.radius, kind=self.kind)
        fresh.source = source
        if source == "example":
            fresh.columns = ("angle", *(f"head {j + 1}" for j in range(len(EXAMPLE_HEADS))))
            fresh.heads = ",".join(f"{math.degrees(alpha):g}" for alpha in EXAMPLE_HEADS)
            fresh.radius, fresh.kind = EXAMPLE_RADIUS, "disc"
        elif source == "gauge":
            fresh.columns = ("angle", "gauge")
        fresh.errors = fresh.columns[1:]
        self.__dict__.update(fresh.__dict__)

    def look(self, likely: LikelyTurn) -> None:
        """Take the columns of the first record."""
        self.columns, self.angle, self.errors = likely.columns, likely.angle, likely.errors
        self.unit = "" if likely.has_units else "deg"
        if len(self.errors) > 1 and not self.heads:
            apart = 360.0 / len(self.errors)
            self.heads = ",".join(f"{apart * j:g}" for j in range(len(self.errors)))

    def target(self) -> tuple[float, float] | None:
        """Where the stage shall stand for the next measurement [m]; None where it is not known."""
        if self.found is None or not self.up_to_date:
            return None
        if self.step == 3:
            centre = self.found.result["trial"].get("centre")
            if centre is None:
                return None
            # a step that no sensor would see is not asked for
            x, y = (
                at if abs(centre[name] - at) <= noise else centre[name]
                for name, at, noise in zip("xy", self.measured[-1].at, self.noise, strict=True)
            )
            return x, y
        axis, to = len(self.measured) - 1, list(self.measured[-1].at)
        to[axis] = trial_position(to[axis], self.limits[axis], self._trial_length())
        return to[0], to[1]

    def _trial_length(self) -> float:
        """Length of a trial move [m], to two digits; 20 µm of a scale without a radius."""
        found = self.found.settings[0].get("eccentricity") if self.found else None
        if found is None:
            return 20e-6
        return float(f"{trial_length(found['value'], found['uncertainty']):.1e}")
