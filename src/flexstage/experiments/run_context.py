"""What the steps of a plan share while it is carried out."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

from flexstage.experiments.command import BASE_RATE_HZ, Command
from flexstage.experiments.verb import PlanContext, StepResult
from flexstage.instruments.protocol import Capability, Instrument, Signal
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.stage.limits import AxisLimits

if TYPE_CHECKING:
    from flexstage.experiments.verbs.identify import IdentifiedStep
    from flexstage.experiments.verbs.measure import MeasuredStep


@dataclass(slots=True, kw_only=True)
class RunContext(PlanContext):
    """A plan that is being carried out: the one thing here that changes."""

    instrument: Instrument
    """The instrument."""
    folder: Path
    """Where everything is written."""
    run: RunMetadata
    """What is known at its start: stage, instrument and its settings, plan, operator."""
    results: dict[str, StepResult] = field(default_factory=dict)
    """What the steps gave so far, by name."""
    commands: dict[str, Command] = field(default_factory=dict)
    """Commands that are ready to run, by the step that made them."""

    @property
    def origin(self) -> Literal["measured", "virtual"]:
        """``measured``, or ``virtual`` where the instrument is a simulation."""
        return "virtual" if self.instrument.identity.simulated else "measured"

    def limits(self, axis: str) -> AxisLimits | None:
        own = self.instrument.axes.get(axis)
        return None if own is None else own.limits

    def measured(self, name: str) -> "MeasuredStep":
        """Return what an earlier step measured, as the plan has made sure that it did."""
        return cast("MeasuredStep", self.results[name])

    def identified(self, name: str) -> "IdentifiedStep":
        """Return the model that an earlier step identified, as the plan has made sure."""
        return cast("IdentifiedStep", self.results[name])

    def signal(self, sensor: str) -> Signal:
        """Return the signal of a sensor of the plan."""
        own = self.plan.sensor(sensor)
        return Signal(kind="channel", source=str(own.channel), name=sensor, unit=own.unit)

    def metadata(self, step: str, kind: str, axis: str) -> RunMetadata:
        """Return what is written at the head of a record."""
        settings = dict(self.instrument.settings())
        return replace(self.run, settings=settings, kind=kind, axis=axis, step=step)


def base_rate_of(instrument: Instrument) -> float:
    """Return the highest rate of samples of a command [Hz]."""
    if Capability.WAVE_GENERATOR in instrument.capabilities:
        return instrument.waves.base_rate_hz
    return BASE_RATE_HZ
