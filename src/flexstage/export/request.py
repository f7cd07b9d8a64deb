"""A stage for other programs: the formats, what is asked, and the models that are made for it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, cast

from flexstage.base.errors import ModelError, StageError
from flexstage.base.progress import subtask
from flexstage.files.names import file_name
from flexstage.files.ranges import INNER_SHARE, PositiveFrequency, Size, Written
from flexstage.files.request import Request
from flexstage.hinges.requests import Plane
from flexstage.hysteresis.requests import DynamicRequest
from flexstage.system.requests import ModelName

if TYPE_CHECKING:
    from flexstage.fem import StageModel
    from flexstage.hysteresis import DriveModel, DynamicModel
    from flexstage.stage import Stage
    from flexstage.system import Analysis, MechanicalSystem

    HysteresisByDrive = Mapping[str, DriveModel] | Literal["usual", "none"]


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A format."""

    about: str
    """What it is, in a few words."""
    writer: str
    """Function of this room that writes it: from a `StageExport` the content of its files by
    name. Its module is imported when it is first used.
    """
    in_time: bool = False
    """Whether it runs in time, by the hysteresis of the stacks."""


#: The formats by name.
FORMATS: Mapping[str, ExportFormat] = {
    "diagram": ExportFormat(
        "structural diagram of each axis, SVG", "diagram.svg.export", in_time=True
    ),
    "simulink": ExportFormat(
        "MATLAB script that builds a Simulink model", "simulink.files.export", in_time=True
    ),
    "fmu": ExportFormat("Functional Mock-up Unit", "fmu.fmu_file.export", in_time=True),
    "mat": ExportFormat("matrices for MATLAB and Octave", "matlab.files.export", in_time=True),
    "c": ExportFormat(
        "C header with a step function for a real-time target",
        "realtime.files.export",
        in_time=True,
    ),
    "step": ExportFormat("solid, STEP", "step.export"),
    "dxf": ExportFormat("contours for cutting, DXF", "drawing.dxf.export"),
    "drawing": ExportFormat("drawing with dimensions, SVG", "drawing.sheet.export"),
    "vtu": ExportFormat("statics and modes for ParaView", "vtu.fields.export"),
    "uff": ExportFormat("modes and responses, universal file", "modal_file.export"),
    "csv": ExportFormat("characteristics, CSV", "tables.export"),
}
_ALL = "all"


def read_formats(text: str) -> tuple[str, ...]:
    """Return the formats of a list, each once, in the order of the list; or ``all`` alone."""
    names = tuple(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in names:
        if name not in FORMATS and names != (_ALL,):
            raise ModelError(
                f"must be one or more of {', '.join(FORMATS)}, separated by commas, or all, got "
                f"'{name[:40]}'"
            )
    return names


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeRequest(DynamicRequest):
    """A stage that runs in time, with what its stacks and sensors do."""

    heading: ClassVar[str] = "Formats that run in time (diagram, simulink, fmu, mat, c)"

    hysteresis: Annotated[tuple[str, ...], Written("usual|none|NAME=FILE")] = ()
    """Hysteresis of the piezo stacks: a Bouc-Wen loop of usual width, none, or the model file of
    'flexstage identify' for a drive or axis (default: usual).
    """
    creep: Annotated[float, INNER_SHARE, Written("SHARE")] | None = None
    """Creep of the stacks per decade of time, such as "1.5%" (default: no creep)."""
    sensor_bandwidth: PositiveFrequency | None = None
    """Bandwidth of the sensors (default: readings equal the true motion)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportRequest(Request):
    """A stage for other programs."""

    to: Annotated[tuple[str, ...], Written("|".join(FORMATS), read=read_formats, write=",".join)]
    """Format; several separated by commas; 'all' writes every format that the stage allows."""
    model: ModelName = "superelement"
    """The model."""
    plane: Plane = "auto"
    """Plane state of the notches."""
    fmi: Literal["2.0", "3.0", "both"] = "both"
    """FMI version of the FMU."""
    source_only: bool = False
    """Write the FMU with C sources only, without a compiled library."""
    precision: Literal["double", "single"] = "double"
    """Floating-point precision of the C header."""
    kerf: Annotated[Size, Written(bare="m")] | None = None
    """Kerf of wire cutting, such as "0.28 mm"; adds the wire path to the DXF."""
    time: TimeRequest = field(default_factory=TimeRequest)
    """How it runs in time."""

    def __post_init__(self) -> None:
        super(ExportRequest, self).__post_init__()
        read_formats(",".join([self.to] if isinstance(self.to, str) else self.to))

    @property
    def fmi_versions(self) -> tuple[Literal["2.0", "3.0"], ...]:
        """Versions of FMI of the FMU."""
        return ("2.0", "3.0") if self.fmi == "both" else (self.fmi,)


@dataclass(kw_only=True, eq=False)
class StageExport:
    """A stage, what is asked of it, and the models that were made for it so far."""

    stage: "Stage"
    """The stage."""
    request: ExportRequest
    """What is asked."""
    analyse: "Callable[[ExportRequest], tuple[Analysis, StageModel | None]]"
    """Analyses it by the model that is asked for; also returns the mesh, where there is one."""
    remarks: list[str] = field(default_factory=list)
    """What the user should know about the files that were made."""

    def files(self, *, leave_out: bool = False) -> dict[str, dict[str, bytes]]:
        """Return the content of the files of each format, by its name and theirs.

        A format that the stage does not allow is refused; or left out with a remark where every
        format is asked for, or that is wanted. A stage that fits no format is refused.
        """
        names = self.request.to
        if names == (_ALL,):
            names, leave_out = tuple(FORMATS), True
        if not leave_out and any(FORMATS[name].in_time for name in names):
            self.require_hysteresis()
        made: dict[str, dict[str, bytes]] = {}
        for done, name in enumerate(names):
            with subtask(done / len(names), (done + 1) / len(names)):
                try:
                    module, _, function = f"{__package__}.{FORMATS[name].writer}".rpartition(".")
                    made[name] = getattr(import_module(module), function)(self)
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
        return self.analyse(self.request)

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
        from flexstage.hysteresis import LogCreep, Sensor, dynamic_model

        asked = self.request.time
        sensors = {}
        if asked.sensor_bandwidth is not None:
            sensor = Sensor(bandwidth_hz=asked.sensor_bandwidth)
            sensors = {p.name: sensor for p in system.probes}
        return dynamic_model(
            self.stage,
            system,
            asked,
            hysteresis=self._hysteresis,
            creep=None if asked.creep is None else LogCreep(rate_per_decade=asked.creep),
            sensors=sensors,
        )


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
