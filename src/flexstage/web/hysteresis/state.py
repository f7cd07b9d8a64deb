"""What is open in the view Hysteresis: records, a model, a motion, and what came of them."""

from dataclasses import dataclass, field
from typing import Literal

from flexstage.hysteresis import ModelFile
from flexstage.hysteresis.requests import IdentifyRequest
from flexstage.web.hysteresis.requests import Reading, WantedMotion
from flexstage.web.hysteresis.work import Compensation, FilePreview, IdentifiedModel, PredictionSet
from flexstage.web.jobs import BackgroundJob

Step = Literal["record", "model", "compensate", "predict"]


@dataclass
class MeasuredFiles:
    """Files, how they are read, and what is in them."""

    reading: Reading = field(default_factory=Reading)
    """How they are read."""
    looked: FilePreview | None = None
    """What is in them, as far as it could be read."""
    wrong: str = ""
    """Why they cannot be read."""
    before: "MeasuredFiles | None" = None
    """What was open before them, and could be read."""

    def open(self, reading: Reading) -> None:
        """Open other files; what could be read before can be gone back to."""
        if self.looked is not None and not self.wrong:
            self.before = MeasuredFiles(self.reading, self.looked)
        self.reading, self.looked, self.wrong = reading, None, ""

    def go_back(self) -> None:
        """Open what was open before."""
        if self.before is not None:
            self.reading, self.looked = self.before.reading, self.before.looked
            self.before, self.wrong = None, ""

    def missing(self, *, reference: bool = False) -> str:
        """Say what is missing before anything can be asked of the files; empty where nothing is.

        A reference has one column.
        """
        if not self.reading.files:
            if reference:
                return "Drop a record of the wanted readings here."
            return "Drop a record here, or take the example."
        if self.wrong:
            return self.wrong
        if self.looked is None:
            return "The file is being read."
        columns = self.reading.columns
        if not (columns.input or reference):
            return "Choose the column that drives as Input."
        if not (columns.output or columns.branches):
            if reference:
                return "Choose the Column of the wanted readings."
            return "Choose the column that follows as Output."
        if self.looked.contents[0]["over"] == "point" and not columns.is_table:
            return (
                "Give the Sample rate, or the column of Time: the file does not say when its "
                "samples were taken."
            )
        return ""


@dataclass
class OpenModel:
    """The model that commands are made with."""

    name: str
    """What it is of: the records, or its file."""
    file: ModelFile
    """The model with its errors and warnings."""
    text: str
    """Its file."""
    identified: IdentifiedModel | None = None
    """How it was found; None for one that was opened."""

    @property
    def sample_rate_hz(self) -> float | None:
        """Samples in a second of the record that it is of [Hz], where there is one."""
        return None if self.identified is None else self.identified.sample_rate_hz


@dataclass
class HysteresisState:
    """What one person has open in the view Hysteresis."""

    step: Step = "record"
    """Which step is shown."""
    source: MeasuredFiles = field(default_factory=MeasuredFiles)
    """The record that a model is identified from."""
    search: IdentifyRequest = IdentifyRequest()
    """What is identified."""
    asking: tuple[Reading, IdentifyRequest] | None = None
    """With what a model is being identified."""
    asked: tuple[Reading, IdentifyRequest] | None = None
    """With what the models that are listed were identified."""
    tried: dict[str, IdentifiedModel] = field(default_factory=dict)
    """Models of that by kind: first the one that was chosen of all."""
    model: OpenModel | None = None
    """The model that is shown, and that commands are made with."""
    motion: WantedMotion = field(default_factory=WantedMotion)
    """What the drive shall follow."""
    reference: MeasuredFiles = field(default_factory=MeasuredFiles)
    """A reference out of a file."""
    compensated: Compensation | None = None
    """The command for that."""
    other: MeasuredFiles = field(default_factory=MeasuredFiles)
    """Another record, on which the model is tried."""
    start: Literal["auto", "rested", "moved"] = "auto"
    """What the drive did before that."""
    moved_for: float = 30.0
    """For how long it had moved [s], where it had."""
    predicted: PredictionSet | None = None
    """How the model predicts it."""
    jobs: dict[str, BackgroundJob] = field(default_factory=dict)
    """Long work whose result nobody has taken yet, by what it is for."""

    def take(self, model: OpenModel) -> None:
        """Show another model; what was made with the one before is gone."""
        self.model, self.compensated, self.predicted = model, None, None
        self.motion = WantedMotion(shape=self.motion.shape, periods=self.motion.periods)
