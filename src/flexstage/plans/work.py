"""What the steps of a plan share while it is carried out."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from flexstage.errors import PlanError
from flexstage.instruments.protocol import Capability, Instrument, Signal
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.plans.command import Command, Strike
from flexstage.plans.design import BASE_RATE_HZ
from flexstage.plans.plan import Plan
from flexstage.plans.results import IdentifiedStep, MeasuredStep, StepResult
from flexstage.provenance import content_hash
from flexstage.stage import Stage

__all__ = ["Work", "base_rate_of"]


@dataclass(slots=True, kw_only=True)
class Work:
    """A plan that is being carried out: the one thing here that changes.

    Parameters
    ----------
    plan : Plan
        The plan.
    title : str
        What it is called.
    stage : Stage
        The stage.
    instrument : Instrument
        The instrument.
    folder : pathlib.Path
        Where everything is written.
    serial_number, operator, note : str
        The stage's serial number, who works, and what they say about it.
    settings : Mapping
        Settings of the instrument at the start, as text.
    frequency : float or None
        Lowest natural frequency that commands keep clear of [Hz].
    results : dict
        What the steps gave so far, by name.
    commands : dict
        Commands that are ready to run, by the step that made them.
    """

    plan: Plan
    title: str
    stage: Stage
    instrument: Instrument
    folder: Path
    serial_number: str = ""
    operator: str = ""
    note: str = ""
    settings: Mapping[str, str] = field(default_factory=dict)
    frequency: float | None = None
    results: dict[str, StepResult] = field(default_factory=dict)
    commands: dict[str, Command | Strike] = field(default_factory=dict)

    @property
    def base_rate_hz(self) -> float:
        """Highest rate of samples of a command [Hz]."""
        return base_rate_of(self.instrument)

    def measured(self, name: str) -> MeasuredStep:
        """Return what an earlier step measured.

        Parameters
        ----------
        name : str
            Name of the step.

        Returns
        -------
        MeasuredStep
            The record.
        """
        found = self.results[name]
        if not isinstance(found, MeasuredStep):
            raise PlanError(f"step '{name}' has measured nothing")
        return found

    def identified(self, name: str) -> IdentifiedStep:
        """Return the model that an earlier step identified.

        Parameters
        ----------
        name : str
            Name of the step.

        Returns
        -------
        IdentifiedStep
            The model.
        """
        found = self.results[name]
        if not isinstance(found, IdentifiedStep):
            raise PlanError(f"step '{name}' has identified nothing")
        return found

    def signal(self, sensor: str) -> Signal:
        """Return the signal of a sensor of the plan.

        Parameters
        ----------
        sensor : str
            Name of the sensor.

        Returns
        -------
        Signal
            What the recorder records.
        """
        own = self.plan.sensor(sensor)
        return Signal(kind="channel", source=str(int(own.channel)), name=sensor, unit=own.unit)

    def metadata(self, step: str, kind: str, axis: str) -> RunMetadata:
        """Return what is written at the head of a record.

        Parameters
        ----------
        step : str
            Name of the step.
        kind : str
            Kind of test.
        axis : str
            The axis, or both.

        Returns
        -------
        RunMetadata
            What is known of the run.
        """
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
    """Return the highest rate of samples of a command.

    Parameters
    ----------
    instrument : Instrument
        The instrument.

    Returns
    -------
    float
        The rate [Hz].
    """
    if Capability.WAVE_GENERATOR in instrument.capabilities:
        return instrument.waves.base_rate_hz
    return BASE_RATE_HZ
