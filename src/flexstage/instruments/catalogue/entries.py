"""What a catalogue keeps: stages, runs, calibrations, models, each as a plain description."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Literal, get_args

from flexstage.base.errors import RecordError
from flexstage.instruments.recording.metadata import RunOrigin

#: Whether a run ended as it should, was read from a broken stream, or is still one.
RunStatus = Literal["complete", "recovered", "failed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class StageEntry:
    """A stage: one description of one piece of metal."""

    name: str
    """Name of the stage."""
    serial_number: str = ""
    """Its serial number; empty where nobody gave one."""
    design: str = ""
    """Built-in design, or file, that its description comes from."""
    hash: str = ""
    """SHA-256 of its description. A stage that is described anew is another entry."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEntry(RunOrigin):
    """A run: one measurement on one stage."""

    identifier: str
    """32 hexadecimal digits that no other run has."""
    stage: StageEntry
    """The stage."""
    started: datetime
    """Date and time of its start, with its zone."""
    step: str = ""
    """The step of the plan."""
    kind: str = ""
    """Which kind of test it is."""
    axis: str = ""
    """The axis that moves."""
    instrument: str = ""
    """What the instrument says it is."""
    simulated: bool = False
    """Whether it was a simulation."""
    folder: str = ""
    """The folder of the run."""
    file: str = ""
    """The file of its samples, from there."""
    sha256: str = ""
    """Hash of that file."""
    status: RunStatus = "complete"
    """Whether it ended as it should, was read from a broken stream, or still is one."""
    samples: int = 0
    """Samples of each channel."""
    sample_rate_hz: float = 0.0
    """Samples in a second [Hz]."""
    seed: int | None = None
    """Seed of a simulation, or of a designed command."""
    lost: str = ""
    """What was lost, or came twice, in words; empty where nothing was."""

    def __post_init__(self) -> None:
        _require_zone(self.started, "the start of a run")
        if self.status not in get_args(RunStatus):
            raise RecordError(
                f"the status of a run is one of {', '.join(get_args(RunStatus))}, got "
                f"{self.status!r}"
            )
        if self.samples < 0 or not 0.0 <= self.sample_rate_hz < math.inf:
            raise RecordError(
                f"a run of {self.samples} samples at {self.sample_rate_hz:g} Hz is impossible"
            )

    @property
    def duration(self) -> float:
        """How long it took [s]; 0 where the rate is not known."""
        return self.samples / self.sample_rate_hz if self.sample_rate_hz else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationEntry:
    """A value that was found for a stage, with its uncertainty."""

    what: str
    """What it is of: ``gain of sensor x``."""
    value: float
    """Its value, in `unit`."""
    unit: str
    """Its unit; empty for a ratio."""
    standard_uncertainty: float
    """Its standard uncertainty, in `unit`."""
    valid_from: datetime
    """From when it holds, with its zone."""
    stage: StageEntry
    """The stage."""
    run: str = ""
    """Identifier of the run that it comes from; empty where there is none."""
    note: str = ""
    """What else is to be said."""

    def __post_init__(self) -> None:
        _require_zone(self.valid_from, "the start of a calibration")
        if not self.what.strip():
            raise RecordError("a calibration must say what it is of, got an empty text")
        if not math.isfinite(self.value) or not 0.0 <= self.standard_uncertainty < math.inf:
            raise RecordError(
                "a calibration needs a finite value and a standard uncertainty that is not "
                f"negative, got {self.value!r} and {self.standard_uncertainty!r}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelEntry:
    """A model that was identified."""

    kind: str
    """Which model: ``bouc-wen``, ``preisach``..."""
    file: str
    """Its file."""
    stage: StageEntry
    """The stage."""
    created: datetime = field(default_factory=lambda: datetime.now(UTC))
    """When it was made, with its zone."""
    axis: str = ""
    """The axis that it is of."""
    figures: Mapping[str, float] = field(default_factory=dict)
    """How good it is: numbers by name."""
    run: str = ""
    """Identifier of the run that it was identified from; empty where there is none."""
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
