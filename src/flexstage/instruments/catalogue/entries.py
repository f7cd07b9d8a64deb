"""Entries of a catalogue: stages, runs, calibrations, models."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Literal, get_args

from flexstage.base.errors import RecordError
from flexstage.instruments.recording.metadata import RunOrigin

#: Status of a run: complete, recovered from an incomplete stream, or still a stream.
RunStatus = Literal["complete", "recovered", "failed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class StageEntry:
    """A stage: one description of one physical stage."""

    name: str
    """Name of the stage."""
    serial_number: str = ""
    """Its serial number; empty where unknown."""
    design: str = ""
    """Built-in design, or file, of its description."""
    hash: str = ""
    """SHA-256 of its description. A changed description is a new entry."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEntry(RunOrigin):
    """A run: one measurement on one stage."""

    identifier: str
    """Unique identifier, 32 hexadecimal digits."""
    stage: StageEntry
    """The stage."""
    started: datetime
    """Date and time of its start, with its zone."""
    step: str = ""
    """The step of the plan."""
    kind: str = ""
    """Kind of test."""
    axis: str = ""
    """The axis that moves."""
    instrument: str = ""
    """Identity of the instrument."""
    simulated: bool = False
    """Whether it was a simulation."""
    folder: str = ""
    """The folder of the run."""
    file: str = ""
    """The file of its samples, relative to the folder."""
    sha256: str = ""
    """Hash of that file."""
    status: RunStatus = "complete"
    """Status: complete, recovered from an incomplete stream, or still a stream."""
    samples: int = 0
    """Number of samples of each channel."""
    sample_rate_hz: float = 0.0
    """Samples in a second [Hz]."""
    seed: int | None = None
    """Seed of a simulation, or of a designed command."""
    lost: str = ""
    """Lost and duplicate samples, as text; empty where there are none."""

    def __post_init__(self) -> None:
        _require_zone(self.started, "the start of a run")
        if self.status not in get_args(RunStatus):
            raise RecordError(
                f"the status of a run must be one of {', '.join(get_args(RunStatus))}, got "
                f"{self.status!r}"
            )
        if self.samples < 0 or not 0.0 <= self.sample_rate_hz < math.inf:
            raise RecordError(
                f"a run of {self.samples} samples at {self.sample_rate_hz:g} Hz is impossible"
            )

    @property
    def duration(self) -> float:
        """Duration [s]; 0 where the rate is unknown."""
        return self.samples / self.sample_rate_hz if self.sample_rate_hz else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationEntry:
    """A calibrated quantity of a stage, with its uncertainty."""

    what: str
    """The quantity: ``gain of sensor x``."""
    value: float
    """Its value, in `unit`."""
    unit: str
    """Its unit; empty for a ratio."""
    standard_uncertainty: float
    """Its standard uncertainty, in `unit`."""
    valid_from: datetime
    """Start of its validity, with time zone."""
    stage: StageEntry
    """The stage."""
    run: str = ""
    """Identifier of the run of the calibration; empty where there is none."""
    note: str = ""
    """Remark."""

    def __post_init__(self) -> None:
        _require_zone(self.valid_from, "the start of a calibration")
        if not self.what.strip():
            raise RecordError("a calibration must name its quantity, got an empty text")
        if not math.isfinite(self.value) or not 0.0 <= self.standard_uncertainty < math.inf:
            raise RecordError(
                "a calibration needs a finite value and a standard uncertainty that is not "
                f"negative, got {self.value!r} and {self.standard_uncertainty!r}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelEntry:
    """An identified model."""

    kind: str
    """Kind of model: ``bouc-wen``, ``preisach``..."""
    file: str
    """Its file."""
    stage: StageEntry
    """The stage."""
    created: datetime = field(default_factory=lambda: datetime.now(UTC))
    """Date and time of the identification, with time zone."""
    axis: str = ""
    """Its axis."""
    figures: Mapping[str, float] = field(default_factory=dict)
    """Errors of the model, by name."""
    run: str = ""
    """Identifier of the run of the identification; empty where there is none."""
    sha256: str = ""
    """Hash of its file."""

    def __post_init__(self) -> None:
        _require_zone(self.created, "the date of a model")
        for name, value in self.figures.items():
            if not math.isfinite(value):
                raise RecordError(f"figure '{name}' of a model must be finite, got {value!r}")


def _require_zone(time: datetime, what: str) -> None:
    if time.tzinfo is None:
        raise RecordError(
            f"{what} must have a time zone, got {time.isoformat()}: add tzinfo, as in datetime.UTC"
        )
