"""State of the view Hysteresis in one browser: records, model, motion and results."""

from dataclasses import dataclass, field, replace
from typing import Literal

from flexstage.hysteresis import ModelFile
from flexstage.hysteresis.requests import IdentifyRequest
from flexstage.web.hysteresis.requests import DesiredMotion, FileSelection
from flexstage.web.hysteresis.work import (
    CompensationResult,
    FilePreview,
    IdentifiedModel,
    PredictionSet,
)
from flexstage.web.jobs import BackgroundJob

Step = Literal["record", "model", "compensate", "predict"]


@dataclass
class MeasuredFiles:
    """Selected files with measured data, and a preview of them."""

    selection: FileSelection = field(default_factory=FileSelection)
    """The files, and the options of reading them."""
    preview: FilePreview | None = None
    """Preview of the files, if they could be read."""
    error: str = ""
    """Message of a failed reading."""
    previous: "MeasuredFiles | None" = None
    """The last readable files."""

    def open(self, selection: FileSelection) -> None:
        """Open other files, and remember the last readable ones."""
        if self.preview is not None and not self.error:
            self.previous = MeasuredFiles(self.selection, self.preview)
        self.selection, self.preview, self.error = selection, None, ""

    def go_back(self) -> None:
        """Open the last readable files again."""
        if self.previous is not None:
            self.selection, self.preview = self.previous.selection, self.previous.preview
            self.previous, self.error = None, ""

    def missing(self, *, reference: bool = False) -> str:
        """Return the next necessary input, or an empty text.

        A reference has one column.
        """
        if not self.selection.files:
            if reference:
                return "Drop a record of the desired motion here."
            return "Drop a record here, or load the example."
        if self.error:
            return self.error
        if self.preview is None:
            return "The file is being read."
        columns = self.selection.columns
        if not (columns.input or reference):
            return "Choose the column of the drive signal as Input."
        if not (columns.output or columns.branches):
            if reference:
                return "Choose the Column of the desired motion."
            return "Choose the column of the measured position as Output."
        if self.preview.contents[0]["over"] == "point" and not columns.is_table:
            return "Give the Sample rate, or the column of Time: the file has no times."
        return ""


@dataclass
class OpenModel:
    """The open model."""

    name: str
    """Name of its records or of its file."""
    file: ModelFile
    """The model with its errors and warnings."""
    text: str
    """Text of its file."""
    identified: IdentifiedModel | None = None
    """Result of the identification; None for a model from a file."""

    @property
    def sample_rate_hz(self) -> float | None:
        """Sample rate of the identified record [Hz], or None."""
        return None if self.identified is None else self.identified.sample_rate_hz


@dataclass
class HysteresisState:
    """State of the view Hysteresis in one browser."""

    step: Step = "record"
    """Open step."""
    source: MeasuredFiles = field(default_factory=MeasuredFiles)
    """Record for the identification."""
    options: IdentifyRequest = IdentifyRequest()
    """Options of the identification."""
    pending: tuple[FileSelection, IdentifyRequest] | None = None
    """Files and options of the running identification."""
    identified_from: tuple[FileSelection, IdentifyRequest] | None = None
    """Files and options of the identified models."""
    candidates: dict[str, IdentifiedModel] = field(default_factory=dict)
    """Identified models by kind, the best first."""
    model: OpenModel | None = None
    """The displayed model, which computes commands."""
    motion: DesiredMotion = field(default_factory=DesiredMotion)
    """The desired motion."""
    reference: MeasuredFiles = field(default_factory=MeasuredFiles)
    """File of a desired motion."""
    compensation: CompensationResult | None = None
    """Command for the desired motion."""
    validation: MeasuredFiles = field(default_factory=MeasuredFiles)
    """Independent record for the validation of the model."""
    after: float | str = "auto"
    """State of the drive before that record: auto, rest, the time of a motion [s], or the file of
    another record.
    """
    prediction: PredictionSet | None = None
    """Prediction of that record."""
    jobs: dict[str, BackgroundJob] = field(default_factory=dict)
    """Jobs whose result no page has taken, by purpose."""

    def files_before(self) -> dict[str, FileSelection]:
        """Return the records of the drive, each by its file, at whose end a motion can begin."""
        selections = (self.source.selection, self.validation.selection)
        return {
            file: replace(s, files=(file,), options=replace(s.options, rows=None))
            for s in selections
            for file in s.files
        }

    def open_model(self, model: OpenModel) -> None:
        """Open another model, and discard the results of the last one."""
        self.model, self.compensation, self.prediction = model, None, None
        self.motion = DesiredMotion(shape=self.motion.shape, periods=self.motion.periods)
