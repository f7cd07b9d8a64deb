"""State of the view Centring in one browser: turns, stage positions, and the next step."""

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
    CentringResult,
)
from flexstage.web.jobs import BackgroundJob

Source = Literal["records", "gauge", "example"]
_FAR = 1.0  # limit of a stage with unknown travel [m]


@dataclass(frozen=True, slots=True)
class MeasuredTurn:
    """A measured turn of the scale."""

    kind: Literal["start", "trial", "move"]
    """Move before the turn."""
    position: tuple[float, float]
    """Stage position, x and y [m]."""
    file: Path
    """Record of the turn."""


@dataclass
class CentringState:
    """State of the view Centring in one browser."""

    source: Source = "records"
    """Source of the records."""
    turns: list[MeasuredTurn] = field(default_factory=list)
    """The measured turns, in sequence."""
    position: tuple[float, float] = (0.0, 0.0)
    """Stage position for the next turn, x and y [m]."""
    limits: tuple[tuple[float, float], tuple[float, float]] = ((-_FAR, _FAR), (-_FAR, _FAR))
    """Travel of the axes of the stage [m]."""
    noise: tuple[float, float] = (0.0, 0.0)
    """Noise of the position sensors, three standard deviations [m]."""
    result: CentringResult | None = None
    """Evaluation of the turns."""
    columns: tuple[str, ...] = ()
    """Columns of the first record."""
    request: CentreRequest = field(
        default_factory=lambda: CentreRequest(angle="angle", radius=50e-3, kind="disc")
    )
    """The request, without stage positions."""
    gauge_text: str = ""
    """Text of the readings of a gauge."""
    gauge_unit: str = "µm"
    """Unit of the readings."""
    errors: dict[str, FlexstageError] = field(default_factory=dict)
    """Errors of the fields whose text in the form is invalid."""
    radius: float | None = None
    """Radius of the last scale while a magnet, which has none, is selected [m]."""
    jobs: dict[str, BackgroundJob] = field(default_factory=dict)
    """Jobs whose result no page has taken."""

    @property
    def origin(self) -> tuple[float, float]:
        """Initial stage position, x and y [m]."""
        return self.turns[0].position if self.turns else self.position

    @property
    def step(self) -> int:
        """Next step of the procedure: 1 measure, 2 trial moves, 3 move and 4 verify."""
        return (1, 2, 2)[len(self.turns)] if len(self.turns) < 3 else 3

    @property
    def column_kind(self) -> Literal["error", "reading"]:
        """Quantity of the columns of the heads."""
        return "reading" if self.request.reading else "error"

    @property
    def evaluation(self) -> CentreFiles:
        """Records and request of the evaluation."""
        request = self.request
        if len(self.turns) > 2:  # enough to calibrate the axes
            request = replace(request, stage_at=tuple(each.position for each in self.turns))
        return CentreFiles(files=tuple(each.file for each in self.turns), request=request)

    @property
    def next_kind(self) -> Literal["start", "trial", "move"]:
        """Move before the next turn."""
        return "start" if self.step == 1 else "trial" if self.step == 2 else "move"

    @property
    def up_to_date(self) -> bool:
        """The evaluation includes all turns."""
        return self.result is not None and self.result.evaluation == self.evaluation

    def ask(self, **fields: Any) -> None:
        """Change fields of the request.

        Raises
        ------
        FlexstageError
            The fields are inconsistent.
        """
        kind = fields.get("kind", self.request.kind)
        if kind == MAGNET and self.request.radius is not None:
            self.radius = self.request.radius
            fields["radius"] = None  # a magnet has no radius
        elif kind != MAGNET and self.request.kind == MAGNET:
            fields.setdefault("radius", self.radius)
        self.request = replace(self.request, **fields)

    def add_turn(self, file: Path) -> None:
        """Add the record of a turn at the present stage position."""
        self.turns.append(MeasuredTurn(self.next_kind, self.position, file))

    def undo_turn(self) -> None:
        """Remove the last turn."""
        self.position = self.turns.pop().position
        self.result = None

    def begin(self, source: Source, position: tuple[float, float] | None = None) -> None:
        """Start again at a stage position; at zero if it is unknown."""
        new_state = CentringState(source=source, position=position or (0.0, 0.0))
        scale = {"radius": self.request.radius or self.radius, "kind": self.request.kind}
        if source == "gauge" and self.request.kind == MAGNET:
            scale["kind"] = "disc"  # a gauge measures at a rim
        if scale["kind"] == MAGNET:
            scale["radius"] = None
        if source == "example":
            new_state.columns = ("angle", *(f"head {j + 1}" for j in range(len(EXAMPLE_HEADS))))
            scale = {"radius": EXAMPLE_RADIUS, "kind": "disc", "heads": EXAMPLE_HEADS}
        elif source == "gauge":
            new_state.columns = ("angle", "gauge")
        new_state.request = replace(new_state.request, error=new_state.columns[1:], **scale)
        self.__dict__.update(new_state.__dict__)

    def use_columns(self, likely: LikelyTurn) -> None:
        """Use the likely columns of the first record."""
        heads, count = self.request.heads, len(likely.errors)
        if count > 1 and not heads:
            heads = tuple(math.radians(360.0 * j / count) for j in range(count))
        self.columns = likely.columns
        self.request = replace(
            self.request,
            angle=likely.angle,
            unit=None if likely.has_units else "deg",
            heads=heads,
            **{self.column_kind: likely.errors},
        )

    def target(self) -> tuple[float, float] | None:
        """Return the stage position for the next turn [m]; None if it is unknown."""
        if self.result is None or not self.up_to_date:
            return None
        if self.step == 3:
            centre = self.result.data["trial"].get("centre")
            if centre is None:
                return None
            # a step below the noise of the sensor is not requested
            x, y = (
                present if abs(centre[name] - present) <= noise else centre[name]
                for name, present, noise in zip(
                    "xy", self.turns[-1].position, self.noise, strict=True
                )
            )
            return x, y
        axis, position = len(self.turns) - 1, list(self.turns[-1].position)
        position[axis] = calibration_position(
            position[axis], self.limits[axis], self._trial_length()
        )
        return position[0], position[1]

    def _trial_length(self) -> float:
        """Return the trial move [m], to two digits; 20 µm for a scale without a radius."""
        eccentricity = self.result.setups[0].get("eccentricity") if self.result else None
        if eccentricity is None:
            return 20e-6
        return float(
            f"{calibration_length(eccentricity['value'], eccentricity['uncertainty']):.1e}"
        )
