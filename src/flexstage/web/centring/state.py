"""State of the view Centring in one browser: table, stage, turns, and the next move."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from flexstage.base.errors import FlexstageError
from flexstage.centring.calibration_moves import calibration_length, calibration_position
from flexstage.centring.requests import MAGNET, CalibrateRequest, CentreRequest
from flexstage.centring.table_file import RotaryTable, table_from_text
from flexstage.files.write import write_whole
from flexstage.records.contents import LikelyTurn
from flexstage.web.centring.work import EXAMPLE, CentreFiles, CentringResult, StudiedTable
from flexstage.web.jobs import BackgroundJob
from flexstage.web.live_history import LiveHistory
from flexstage.web.reports import WrittenReport

Source = Literal["simulated", "records", "magnet", "gauge"]
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

    step: str = "table"
    """The open step."""
    table_text: str = EXAMPLE
    """Description of the table, as it is in the page."""
    table: RotaryTable = field(default_factory=lambda: table_from_text(EXAMPLE))
    """The last valid description."""
    table_file: Path | None = None
    """File of that description."""
    own_stages: tuple[str, ...] = ()
    """Stage files that are judged with the built-in designs."""
    studied: StudiedTable | None = None
    """What the scale needs, and the judged stages; None until it is known."""
    stage: str = "vgtu-mechanical"
    """The chosen stage, a built-in design or a file."""
    by_trial: bool = False
    """Find direction, sense and gain of the stage by trial moves."""
    source: Source = "simulated"
    """Source of the records."""
    turns: list[MeasuredTurn] = field(default_factory=list)
    """The measured turns, in sequence."""
    position: tuple[float, float] = (0.0, 0.0)
    """Stage position for the next turn, x and y [m]."""
    turned_at: tuple[float, float] = (0.0, 0.0)
    """Stage position of the present turn of the simulated table [m]."""
    limits: tuple[tuple[float, float], tuple[float, float]] = ((-_FAR, _FAR), (-_FAR, _FAR))
    """Travel of the axes of the stage [m]."""
    noise: tuple[float, float] = (0.0, 0.0)
    """Noise of the position sensors, three standard deviations [m]."""
    history: LiveHistory | None = None
    """Readings of the last turn of the simulated table."""
    result: CentringResult | None = None
    """Evaluation of the turns."""
    columns: tuple[str, ...] = ()
    """Columns of the first record."""
    request: CentreRequest = field(default_factory=CentreRequest)
    """Columns and units of the records."""
    gauge_text: str = ""
    """Text of the readings of a gauge."""
    gauge_unit: str = "µm"
    """Unit of the readings."""
    method: CalibrateRequest = field(default_factory=lambda: CalibrateRequest(method="self"))
    """Method of the calibration, without columns."""
    stated: dict[str, str] = field(default_factory=dict)
    """Entered statements of the certificate."""
    certified: WrittenReport | None = None
    """The last certificate."""
    errors: dict[str, FlexstageError] = field(default_factory=dict)
    """Errors of the fields whose text in the form is invalid."""
    jobs: dict[str, BackgroundJob] = field(default_factory=dict)
    """Jobs whose result no page has taken."""

    @property
    def origin(self) -> tuple[float, float]:
        """Initial stage position, x and y [m]."""
        return self.turns[0].position if self.turns else self.position

    @property
    def needs_trial(self) -> bool:
        """Moves are found by trial moves: a magnet allows no other way."""
        return self.by_trial or self.source == "magnet"

    @property
    def next_kind(self) -> Literal["start", "trial", "move"]:
        """Move before the next turn."""
        if not self.turns:
            return "start"
        return "trial" if self.needs_trial and len(self.turns) < 3 else "move"

    @property
    def evaluation(self) -> CentreFiles:
        """Records and request of the evaluation, by the description of the table."""
        table, request = self.table, self.request
        if self.source == "magnet":
            request = replace(request, kind=MAGNET, heads=table.heads.angles)
        elif self.source == "gauge":
            request = replace(
                request,
                radius=table.scale.radius,
                kind=table.scale.kind,
                mounting_angle=table.mounting_angle,
            )
        else:
            request = replace(request, table=str(self.table_file))
        if self.needs_trial and len(self.turns) > 2:  # enough to calibrate the axes
            request = replace(request, stage_at=tuple(each.position for each in self.turns))
        is_move = self.next_kind == "move"
        return CentreFiles(
            files=tuple(each.file for each in self.turns),
            request=request,
            stage=self.stage if is_move else None,
        )

    @property
    def calibration(self) -> CalibrateRequest:
        """The request of a calibration by the last record."""
        request = self.request
        mirror = -1.0 if request.head_direction == "cw" else 1.0
        return replace(
            self.method,
            error=request.error,
            reading=request.reading,
            angle=request.angle,
            unit=request.unit,
            heads=tuple(mirror * angle for angle in self.table.heads.angles),
        )

    @property
    def facts(self) -> dict[str, str]:
        """What the certificate states."""
        prefix = "simulated " if self.source == "simulated" else ""
        names = ("item", "standard", "traceability", "conditions", "laboratory")
        usual = dict.fromkeys(names, "") | {"item": f"{prefix}scale of {self.table.name}"}
        return usual | self.stated

    @property
    def column_kind(self) -> Literal["error", "reading"]:
        """Quantity of the columns of the heads."""
        return "reading" if self.request.reading else "error"

    @property
    def up_to_date(self) -> bool:
        """The evaluation includes all turns."""
        return self.result is not None and self.result.evaluation == self.evaluation

    def use_table(self, text: str, folder: Path) -> None:
        """Use another description of the table, and write it to a file.

        Raises
        ------
        ModelError
            The description is invalid; the last one remains.
        """
        self.table_text = text
        table = table_from_text(text, "table.yaml")
        is_new = self.table_file is None or table != self.table
        self.table, self.table_file = table, folder / "table.yaml"
        write_whole(self.table_file, text)
        if is_new:
            self.studied = self.result = None
            if self.source == "simulated":  # another table turns
                self.begin(self.source, self.origin)

    def add_turn(self, file: Path) -> None:
        """Add the record of a turn at the present stage position."""
        self.turns.append(MeasuredTurn(self.next_kind, self.position, file))

    def undo_turn(self) -> None:
        """Remove the last turn."""
        self.position = self.turns.pop().position
        self.result = self.history = None

    def begin(self, source: Source, position: tuple[float, float] | None = None) -> None:
        """Start the turns again at a stage position; at zero if it is unknown."""
        self.source, self.position, self.turns = source, position or (0.0, 0.0), []
        self.result = self.history = None
        self.gauge_text, self.columns = "", ()
        self.errors.clear()
        if source == "simulated":
            heads = range(1, len(self.table.heads.angles) + 1)
            self.columns = ("angle", *(f"head {j}" for j in heads))
        elif source == "gauge":
            self.columns = ("angle", "gauge")
        self.request = CentreRequest(angle="angle", error=self.columns[1:])

    def ask(self, **fields: Any) -> None:
        """Change columns or units of the records.

        Raises
        ------
        FlexstageError
            The fields are inconsistent.
        """
        self.request = replace(self.request, **fields)

    def use_columns(self, likely: LikelyTurn) -> None:
        """Use the likely columns of the first record."""
        self.columns = likely.columns
        self.ask(
            angle=likely.angle,
            unit=None if likely.has_units else "deg",
            **{self.column_kind: likely.errors},
        )

    def target(self) -> tuple[float, float] | None:
        """Return the stage position for the next turn [m]; None if it is unknown."""
        if self.result is None or not self.up_to_date:
            return None
        present = self.turns[-1].position
        if self.next_kind == "trial":
            axis, position = len(self.turns) - 1, list(present)
            position[axis] = calibration_position(
                position[axis], self.limits[axis], self._trial_length()
            )
            return position[0], position[1]
        move = self.move()
        if move is None:
            return None
        # a step below the noise of the sensor is not requested
        x, y = (
            at if abs(by) <= noise else at + by
            for at, by, noise in zip(present, move, self.noise, strict=True)
        )
        return x, y

    def move(self) -> tuple[float, float] | None:
        """Return the move that centres the scale, along the axes of the stage [m], or None."""
        if self.result is None:
            return None
        if self.needs_trial:
            centre = self.result.data.get("trial", {}).get("centre")
            return None if centre is None else tuple(centre["move_from_last"])
        move = self.result.setups[-1].get("move")
        return None if move is None else (move["x"], move["y"])

    def _trial_length(self) -> float:
        """Return the trial move [m], to two digits; 20 µm if the eccentricity is unknown."""
        usual, least = 20e-6, 1e-12
        eccentricity = self.result.setups[0].get("eccentricity") if self.result else None
        # equal readings have neither an eccentricity nor a resolution
        if eccentricity is None or eccentricity["value"] + eccentricity["uncertainty"] < least:
            return usual
        return float(
            f"{calibration_length(eccentricity['value'], eccentricity['uncertainty']):.1e}"
        )
