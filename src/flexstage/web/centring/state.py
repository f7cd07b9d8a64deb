"""What is open in the view Centring: what was measured, where the stage stood, what is next."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from flexstage.base.errors import FlexstageError
from flexstage.centring.calibration_moves import calibration_length, calibration_position
from flexstage.centring.requests import MAGNET, CentreRequest
from flexstage.records.contents import LikelyTurn
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
    request: CentreRequest = field(
        default_factory=lambda: CentreRequest(angle="angle", radius=50e-3, kind="disc")
    )
    """What is asked for, without the places of the stage."""
    gauge_text: str = ""
    """Readings of a gauge, as they are typed."""
    gauge_unit: str = "µm"
    """Their unit."""
    wrong: dict[str, FlexstageError] = field(default_factory=dict)
    """Why fields of the request do not have the value that stands in the form."""
    radius: float | None = None
    """The radius of a scale that has one, while a magnet is chosen [m]."""
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
    def named(self) -> Literal["error", "reading"]:
        """What the columns of the heads are."""
        return "reading" if self.request.reading else "error"

    @property
    def asked(self) -> CentreFiles:
        """What is to be evaluated."""
        request = self.request
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

    def ask(self, **changed: Any) -> None:
        """Ask for something else.

        Raises
        ------
        FlexstageError
            It does not belong together.
        """
        kind = changed.get("kind", self.request.kind)
        if kind == MAGNET and self.request.radius is not None:
            self.radius = self.request.radius
            changed["radius"] = None  # it has none
        elif kind != MAGNET and self.request.kind == MAGNET:
            changed.setdefault("radius", self.radius)
        self.request = replace(self.request, **changed)

    def take(self, file: Path) -> None:
        """Take a record of the scale with the stage where it stands."""
        self.measured.append(Measured(self.next_kind, self.at, file))

    def take_back(self) -> None:
        """Forget the last record."""
        self.at = self.measured.pop().at
        self.found = None

    def begin(self, source: Source, at: tuple[float, float] | None = None) -> None:
        """Begin anew, with the stage at a place; in the middle where that is not known."""
        fresh = CentringState(source=source, at=at or (0.0, 0.0))
        scale = {"radius": self.request.radius or self.radius, "kind": self.request.kind}
        if source == "gauge" and self.request.kind == MAGNET:
            scale["kind"] = "disc"  # a gauge touches a rim
        if scale["kind"] == MAGNET:
            scale["radius"] = None
        if source == "example":
            fresh.columns = ("angle", *(f"head {j + 1}" for j in range(len(EXAMPLE_HEADS))))
            scale = {"radius": EXAMPLE_RADIUS, "kind": "disc", "heads": EXAMPLE_HEADS}
        elif source == "gauge":
            fresh.columns = ("angle", "gauge")
        fresh.request = replace(fresh.request, error=fresh.columns[1:], **scale)
        self.__dict__.update(fresh.__dict__)

    def look(self, likely: LikelyTurn) -> None:
        """Take the columns of the first record."""
        heads, count = self.request.heads, len(likely.errors)
        if count > 1 and not heads:
            heads = tuple(math.radians(360.0 * j / count) for j in range(count))
        self.columns = likely.columns
        self.request = replace(
            self.request,
            angle=likely.angle,
            unit=None if likely.has_units else "deg",
            heads=heads,
            **{self.named: likely.errors},
        )

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
        to[axis] = calibration_position(to[axis], self.limits[axis], self._trial_length())
        return to[0], to[1]

    def _trial_length(self) -> float:
        """Length of a trial move [m], to two digits; 20 µm of a scale without a radius."""
        found = self.found.setups[0].get("eccentricity") if self.found else None
        if found is None:
            return 20e-6
        return float(f"{calibration_length(found['value'], found['uncertainty']):.1e}")
