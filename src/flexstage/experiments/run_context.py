"""What the steps of a plan share while it is carried out."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from flexstage.errors import PlanError
from flexstage.experiments.command import CommandWaveform, Strike
from flexstage.experiments.design import BASE_RATE_HZ
from flexstage.experiments.plan import Plan
from flexstage.experiments.results import IdentifiedStep, MeasuredStep, StepResult
from flexstage.instruments.protocol import Capability, Instrument, Signal
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.provenance import content_hash
from flexstage.stage import Stage


@dataclass(slots=True, kw_only=True)
class RunContext:
    """A plan that is being carried out: the one thing here that changes."""

    plan: Plan
    """The plan."""
    title: str
    """What it is called."""
    stage: Stage
    """The stage."""
    instrument: Instrument
    """The instrument."""
    folder: Path
    """Where everything is written."""
    serial_number: str = ""
    """The stage's serial number."""
    operator: str = ""
    """Who works."""
    note: str = ""
    """What they say about it."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Settings of the instrument at the start, as text."""
    frequency: float | None = None
    """Lowest natural frequency that commands keep clear of [Hz]."""
    results: dict[str, StepResult] = field(default_factory=dict)
    """What the steps gave so far, by name."""
    commands: dict[str, CommandWaveform | Strike] = field(default_factory=dict)
    """Commands that are ready to run, by the step that made them."""

    @property
    def origin(self) -> Literal["measured", "virtual"]:
        """``measured``, or ``virtual`` where the instrument is a simulation."""
        return "virtual" if self.instrument.identity.simulated else "measured"

    @property
    def base_rate_hz(self) -> float:
        """Highest rate of samples of a command [Hz]."""
        return base_rate_of(self.instrument)

    def measured(self, name: str) -> MeasuredStep:
        """Return what an earlier step measured."""
        found = self.results[name]
        if not isinstance(found, MeasuredStep):
            raise PlanError(f"step '{name}' has measured nothing")
        return found

    def identified(self, name: str) -> IdentifiedStep:
        """Return the model that an earlier step identified."""
        found = self.results[name]
        if not isinstance(found, IdentifiedStep):
            raise PlanError(f"step '{name}' has identified nothing")
        return found

    def signal(self, sensor: str) -> Signal:
        """Return the signal of a sensor of the plan."""
        own = self.plan.sensor(sensor)
        return Signal(kind="channel", source=str(own.channel), name=sensor, unit=own.unit)

    def metadata(self, step: str, kind: str, axis: str) -> RunMetadata:
        """Return what is written at the head of a record."""
        return RunMetadata(
            stage=self.stage.name,
            stage_hash=content_hash(self.stage),
            serial_number=self.serial_number,
            design=self.plan.stage,
            instrument=self.instrument.identity,
            settings=dict(self.instrument.settings()),
            kind=kind,
            axis=axis,
            plan=self.title,
            step=step,
            operator=self.operator,
            note=self.note,
        )


def base_rate_of(instrument: Instrument) -> float:
    """Return the highest rate of samples of a command [Hz]."""
    if Capability.WAVE_GENERATOR in instrument.capabilities:
        return instrument.waves.base_rate_hz
    return BASE_RATE_HZ
