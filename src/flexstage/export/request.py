"""Export of a stage: formats, request, and the models of an export."""

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
    """An export format."""

    about: str
    """Short description."""
    writer: str
    """Function of this package that returns the content of its files by name, from a `StageExport`.
    Its module is imported on first use.
    """
    in_time: bool = False
    """Simulated in time, with the hysteresis of the stacks."""
    in_all: bool = True
    """Written by ``all``; others are only written by name."""


#: Formats by name.
FORMATS: Mapping[str, ExportFormat] = {
    "diagram": ExportFormat(
        "structural diagram of each axis, SVG", "diagram.svg.export", in_time=True
    ),
    "simulink": ExportFormat(
        "MATLAB script that builds a Simulink model", "simulink.files.export", in_time=True
    ),
    "fmu": ExportFormat("Functional Mock-up Unit", "fmu.fmu_file.export", in_time=True),
    "mat": ExportFormat("matrices for MATLAB and Octave", "matlab.export", in_time=True),
    "c": ExportFormat(
        "C header with a step function for a real-time target",
        "realtime.export",
        in_time=True,
    ),
    "step": ExportFormat("solid, STEP", "step.export"),
    "dxf": ExportFormat("contours for cutting, DXF", "drawing.dxf.export"),
    "drawing": ExportFormat("drawing with dimensions, SVG", "drawing.sheet.export"),
    "vtu": ExportFormat("statics and modes for ParaView", "fields.export"),
    "uff": ExportFormat("modes and responses, universal file", "modal_file.export"),
    "csv": ExportFormat("characteristics, CSV", "tables.export"),
    "reduced": ExportFormat("reduced model with interface frames", "reduced.export", in_all=False),
}
_ALL = "all"


def read_formats(text: str) -> tuple[str, ...]:
    """Return the formats of a list without duplicates, in order; or ``all`` alone."""
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
    """Options of formats that are simulated in time."""

    heading: ClassVar[str] = "Time-domain formats (diagram, simulink, fmu, mat, c)"

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
    """Export of a stage for other programs."""

    to: Annotated[tuple[str, ...], Written("|".join(FORMATS), read=read_formats, write=",".join)]
    """Formats separated by commas; 'all' writes every format that is possible for the stage, except
    reduced, which needs finite elements in space.
    """
    model: ModelName = "superelement"
    """Model of the stage."""
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
    """Options of the simulation."""

    def __post_init__(self) -> None:
        super(ExportRequest, self).__post_init__()
        read_formats(",".join([self.to] if isinstance(self.to, str) else self.to))

    @property
    def fmi_versions(self) -> tuple[Literal["2.0", "3.0"], ...]:
        """FMI versions of the FMU."""
        return ("2.0", "3.0") if self.fmi == "both" else (self.fmi,)


@dataclass(kw_only=True, eq=False)
class StageExport:
    """A stage with its export request and the models that the formats share."""

    stage: "Stage"
    """The stage."""
    request: ExportRequest
    """The request."""
    analyse: "Callable[[ExportRequest], tuple[Analysis, StageModel | None]]"
    """Returns the analysis by the requested model, and its mesh where there is one."""
    remarks: list[str] = field(default_factory=list)
    """Remarks about the files, for the user."""

    def files(self, *, skip_unsuitable: bool = False) -> dict[str, dict[str, bytes]]:
        """Return the content of the files by format and name.

        A format that is impossible for the stage is refused; if all formats are requested, or with
        `skip_unsuitable`, it is skipped with a remark. A stage that suits no format is refused.
        """
        names = self.request.to
        if names == (_ALL,):
            names, skip_unsuitable = tuple(n for n, f in FORMATS.items() if f.in_all), True
        if not skip_unsuitable and any(FORMATS[name].in_time for name in names):
            self.require_hysteresis()
        files: dict[str, dict[str, bytes]] = {}
        for number, name in enumerate(names):
            with subtask(number / len(names), (number + 1) / len(names)):
                try:
                    module, _, function = f"{__package__}.{FORMATS[name].writer}".rpartition(".")
                    files[name] = getattr(import_module(module), function)(self)
                except (ModelError, StageError) as error:
                    if not skip_unsuitable:
                        raise
                    self.remarks.append(f"{name} was skipped: {error}.")
        if not files:
            raise StageError(
                f"stage '{self.stage.name}' suits none of these formats: {self.remarks[0]}"
            )
        return files

    @property
    def name(self) -> str:
        """Name of the stage, valid for files."""
        return file_name(self.stage.name)

    @property
    def analysis(self) -> "Analysis":
        """Analysis by the requested model."""
        return self._analysed[0]

    @property
    def mesh(self) -> "StageModel | None":
        """Mesh of the requested model; None without one."""
        return self._analysed[1]

    @cached_property
    def _analysed(self) -> "tuple[Analysis, StageModel | None]":
        return self.analyse(self.request)

    @cached_property
    def dynamic(self) -> "DynamicModel":
        """Dynamic model of the stage with its drives, by the requested model."""
        return self._dynamic(self.analysis.system)

    @cached_property
    def dynamic_of_bodies(self) -> "DynamicModel":
        """Dynamic model by rigid bodies on hinges, for block diagrams."""
        from flexstage.lumped import lumped_system

        return self._dynamic(lumped_system(self.stage, plane=self.request.plane))

    def require_hysteresis(self) -> None:
        """Refuse an invalid hysteresis before the mechanics are computed."""
        from flexstage.hysteresis.stack_models import models_by_drive

        models_by_drive(self.stage, self._hysteresis)

    @cached_property
    def _hysteresis(self) -> "HysteresisByDrive":
        return read_hysteresis(self.request.time.hysteresis)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks, and limits of validity of the models of this export, without duplicates."""
        notes = dict.fromkeys(self.remarks)
        dynamic = self.__dict__.get("dynamic")
        if dynamic is not None:
            notes |= dict.fromkeys(dynamic.notes)
        bodies = self.__dict__.get("dynamic_of_bodies")
        if bodies is not None:
            # possibly not the requested model
            before = "" if dynamic is None else "Diagram and Simulink: "
            notes |= {f"{before}{note}": None for note in bodies.notes if note not in notes}
        return tuple(notes)

    def _dynamic(self, system: "MechanicalSystem") -> "DynamicModel":
        from flexstage.hysteresis import LogCreep, Sensor, dynamic_model

        request = self.request.time
        sensors = {}
        if request.sensor_bandwidth is not None:
            sensor = Sensor(bandwidth_hz=request.sensor_bandwidth)
            sensors = {p.name: sensor for p in system.probes}
        return dynamic_model(
            self.stage,
            system,
            request,
            hysteresis=self._hysteresis,
            creep=None if request.creep is None else LogCreep(rate_per_decade=request.creep),
            sensors=sensors,
        )


def read_hysteresis(texts: tuple[str, ...]) -> "HysteresisByDrive":
    """Return the identified models of texts ``NAME=FILE``, or ``usual`` (default) or ``none``."""
    from flexstage.hysteresis.model_file import read_model_file

    if texts in ((), ("usual",), ("none",)):
        return cast(Literal["usual", "none"], texts[0] if texts else "usual")
    models: dict[str, DriveModel] = {}
    for text in texts:
        name, sign, path = text.partition("=")
        if not (name and sign and path):
            raise ModelError(
                f"--hysteresis must be usual, none, or NAME=FILE for each drive, got '{text[:80]}'"
            )
        if name in models:
            raise ModelError(f"--hysteresis has two models for '{name}': give one")
        models[name] = read_model_file(Path(path)).model
    return models


def in_folders(formats: Mapping[str, Mapping[str, bytes]]) -> dict[str, bytes]:
    """Return the files by name; with several formats, in a folder for each."""
    return {
        file if len(formats) == 1 else f"{name}/{file}": content
        for name, contents in formats.items()
        for file, content in contents.items()
    }
