"""What an export was asked for, with models made where a format needs them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal

from flexstage.files.names import file_name

if TYPE_CHECKING:
    from flexstage.fem import StageModel
    from flexstage.hysteresis import DriveModel, DynamicModel, LogCreep, Sensor
    from flexstage.stage import Stage
    from flexstage.system import Analysis, MechanicalSystem

    HysteresisByDrive = Mapping[str, DriveModel] | Literal["usual", "none"]


@dataclass(kw_only=True, eq=False)
class ExportRequest:
    """A stage and the choices for it."""

    stage: "Stage"
    """The stage."""
    analyse: "Callable[[], tuple[Analysis, StageModel | None]]"
    """Analyses it by the chosen model; also returns the mesh, where there is one."""
    hysteresis: "Callable[[], HysteresisByDrive]" = field(default_factory=lambda: lambda: "usual")
    """Reads the hysteresis of each stack."""
    plane: str = "auto"
    """Plane state of the notches."""
    step: float = 1e-4
    """Step between samples [s]."""
    creep: float | None = None
    """Creep of the stacks in a decade of time, over the step [1]."""
    bandwidth_hz: float | None = None
    """Bandwidth of the amplifiers [Hz]."""
    current_limit: float | None = None
    """Largest current of an amplifier [A]."""
    sensor_bandwidth_hz: float | None = None
    """Bandwidth of the sensors [Hz]."""
    mode_count: int | None = None
    """Number of modes that are kept."""
    precision: Literal["double", "single"] = "double"
    """Precision of the C header."""
    fmi: tuple[Literal["2.0", "3.0"], ...] = ("2.0", "3.0")
    """Versions of FMI, of ``2.0`` and ``3.0``."""
    source_only: bool = False
    """Whether an FMU holds no compiled library."""
    kerf: float | None = None
    """Width of the cut by the wire [m]."""
    remarks: list[str] = field(default_factory=list)
    """What the user should know about the files that were made."""

    @property
    def name(self) -> str:
        """Name of the stage, as files can have it."""
        return file_name(self.stage.name)

    @property
    def analysis(self) -> "Analysis":
        """The analysis by the chosen model."""
        return self._analysed[0]

    @property
    def mesh(self) -> "StageModel | None":
        """Its mesh, of a model that has one."""
        return self._analysed[1]

    @cached_property
    def _analysed(self) -> "tuple[Analysis, StageModel | None]":
        return self.analyse()

    @cached_property
    def dynamic(self) -> "DynamicModel":
        """The stage with its drives, as other programs run it."""
        return self._dynamic(self.analysis.system)

    @cached_property
    def dynamic_of_bodies(self) -> "DynamicModel":
        """The same by rigid bodies on hinges, which is what a diagram of blocks shows."""
        from flexstage.lumped import lumped_system

        return self._dynamic(lumped_system(self.stage, plane=self.plane))  # type: ignore[arg-type]

    def require_hysteresis(self) -> None:
        """Refuse a hysteresis that the stacks cannot have, before the mechanics are computed."""
        from flexstage.hysteresis.stack_models import models_by_drive

        models_by_drive(self.stage, self._hysteresis)

    @cached_property
    def _hysteresis(self) -> "HysteresisByDrive":
        return self.hysteresis()

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks, and where the models that were made stop being valid, each note once."""
        found = dict.fromkeys(self.remarks)
        chosen = self.__dict__.get("dynamic")
        if chosen is not None:
            found |= dict.fromkeys(chosen.notes)
        bodies = self.__dict__.get("dynamic_of_bodies")
        if bodies is not None:
            # another model than the chosen one, perhaps
            before = "" if chosen is None else "Diagram and Simulink: "
            found |= {f"{before}{note}": None for note in bodies.notes if note not in found}
        return tuple(found)

    def _dynamic(self, system: "MechanicalSystem") -> "DynamicModel":
        from flexstage.hysteresis import dynamic_model

        return dynamic_model(
            self.stage,
            system,
            step=self.step,
            hysteresis=self._hysteresis,
            creep=self._creep(),
            bandwidth_hz=self.bandwidth_hz,
            current_limit=self.current_limit,
            sensors=self._sensors(system),
            mode_count=self.mode_count,
        )

    def _creep(self) -> "LogCreep | None":
        from flexstage.hysteresis import LogCreep

        return None if self.creep is None else LogCreep(rate_per_decade=self.creep)

    def _sensors(self, system: "MechanicalSystem") -> "Mapping[str, Sensor]":
        from flexstage.hysteresis import Sensor

        if self.sensor_bandwidth_hz is None:
            return {}
        return {p.name: Sensor(bandwidth_hz=self.sensor_bandwidth_hz) for p in system.probes}
