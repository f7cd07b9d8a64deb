"""A stage for other programs: models are made where a format needs them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

from flexstage.errors import ModelError, StageError
from flexstage.export.formats import FORMATS
from flexstage.export.request import ExportRequest
from flexstage.files.names import file_name
from flexstage.progress import subtask

if TYPE_CHECKING:
    from flexstage.fem import StageModel
    from flexstage.hysteresis import DriveModel, DynamicModel, LogCreep, Sensor
    from flexstage.stage import Stage
    from flexstage.system import Analysis, MechanicalSystem

    HysteresisByDrive = Mapping[str, DriveModel] | Literal["usual", "none"]


@dataclass(kw_only=True, eq=False)
class StageExport:
    """A stage, what is asked of it, and the models that were made for it so far."""

    stage: "Stage"
    """The stage."""
    request: ExportRequest
    """What is asked."""
    remarks: list[str] = field(default_factory=list)
    """What the user should know about the files that were made."""

    def files(self, *, leave_out: bool = False) -> dict[str, dict[str, bytes]]:
        """Return the content of the files of each format, by its name and theirs.

        A format that the stage does not allow is refused; or left out with a remark where every
        format is asked for, or that is wanted. A stage that fits no format is refused.
        """
        names = self.request.formats
        leave_out = leave_out or self.request.every_format
        if not leave_out and any(FORMATS[name].in_time for name in names):
            self.require_hysteresis()
        made: dict[str, dict[str, bytes]] = {}
        for done, name in enumerate(names):
            with subtask(done / len(names), (done + 1) / len(names)):
                try:
                    made[name] = FORMATS[name].write(self)
                except (ModelError, StageError) as error:
                    if not leave_out:
                        raise
                    self.remarks.append(f"{name} was left out: {error}.")
        if not made:
            raise StageError(
                f"stage '{self.stage.name}' fits none of these formats: {self.remarks[0]}"
            )
        return made

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
        from flexstage.studies import run_model
        from flexstage.studies.models import ModelOptions

        run = run_model(self.stage, self.request.model, ModelOptions(plane=self.request.plane))
        return run.analysis, run.mesh

    @cached_property
    def dynamic(self) -> "DynamicModel":
        """The stage with its drives, as other programs run it."""
        return self._dynamic(self.analysis.system)

    @cached_property
    def dynamic_of_bodies(self) -> "DynamicModel":
        """The same by rigid bodies on hinges, which is what a diagram of blocks shows."""
        from flexstage.lumped import lumped_system

        return self._dynamic(lumped_system(self.stage, plane=self.request.plane))

    def require_hysteresis(self) -> None:
        """Refuse a hysteresis that the stacks cannot have, before the mechanics are computed."""
        from flexstage.hysteresis.stack_models import models_by_drive

        models_by_drive(self.stage, self._hysteresis)

    @cached_property
    def _hysteresis(self) -> "HysteresisByDrive":
        return read_hysteresis(self.request.time.hysteresis)

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
            self.request.time,
            hysteresis=self._hysteresis,
            creep=self._creep(),
            sensors=self._sensors(system),
        )

    def _creep(self) -> "LogCreep | None":
        from flexstage.hysteresis import LogCreep

        creep = self.request.time.creep
        return None if creep is None else LogCreep(rate_per_decade=creep)

    def _sensors(self, system: "MechanicalSystem") -> "Mapping[str, Sensor]":
        from flexstage.hysteresis import Sensor

        bandwidth = self.request.time.sensor_bandwidth
        if bandwidth is None:
            return {}
        return {p.name: Sensor(bandwidth_hz=bandwidth) for p in system.probes}


def read_hysteresis(texts: tuple[str, ...]) -> "HysteresisByDrive":
    """Return the identified model of each drive, of texts ``NAME=FILE``; none is the usual one.

    A text may be ``usual`` or ``none`` alone, which is returned.
    """
    from flexstage.hysteresis.model_file import read_model_file

    if texts in ((), ("usual",), ("none",)):
        return cast(Literal["usual", "none"], texts[0] if texts else "usual")
    models: dict[str, DriveModel] = {}
    for text in texts:
        name, sign, path = text.partition("=")
        if not (name and sign and path):
            raise ModelError(
                f"--hysteresis is usual, none, or NAME=FILE for each drive, got '{text[:80]}'"
            )
        if name in models:
            raise ModelError(f"--hysteresis gives a model for '{name}' twice: give it once")
        models[name] = read_model_file(Path(path)).model
    return models


def in_folders(made: Mapping[str, Mapping[str, bytes]]) -> dict[str, bytes]:
    """Return the files of formats by their names; several formats get a folder each."""
    return {
        file if len(made) == 1 else f"{name}/{file}": content
        for name, contents in made.items()
        for file, content in contents.items()
    }
