"""What `flexstage export` was asked for, with models made where needed, and what it can write."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

from flexstage.errors import ModelError, StageError
from flexstage.files.names import file_name

if TYPE_CHECKING:
    from flexstage.hysteresis import DriveModel, DynamicModel, LogCreep, Sensor
    from flexstage.stage import Stage
    from flexstage.studies.models import ModelRun
    from flexstage.system import MechanicalSystem


@dataclass(kw_only=True, eq=False)
class ExportRequest:
    """A stage and the choices for it."""

    stage: "Stage"
    """The stage."""
    model: str
    """Name of its model."""
    plane: str
    """Plane state of the notches."""
    step: float
    """Step between samples [s]."""
    hysteresis: Sequence[str]
    """What `read_hysteresis` takes."""
    creep: float | None
    """Creep of the stacks in a decade of time, over the step [1]."""
    bandwidth_hz: float | None
    """Bandwidth of the amplifiers [Hz]."""
    current_limit: float | None
    """Largest current of an amplifier [A]."""
    sensor_bandwidth_hz: float | None
    """Bandwidth of the sensors [Hz]."""
    mode_count: int | None
    """Number of modes that are kept."""
    precision: str
    """``double`` or ``single``, of the C header."""
    fmi: tuple[Literal["2.0", "3.0"], ...]
    """Versions of FMI, of ``2.0`` and ``3.0``."""
    source_only: bool
    """Whether an FMU holds no compiled library."""
    kerf: float | None
    """Width of the cut by the wire [m]."""
    remarks: list[str] = field(default_factory=list)
    """What the user should know about the files that were made."""

    @property
    def name(self) -> str:
        """Name of the stage, as files can have it."""
        return file_name(self.stage.name)

    @cached_property
    def run(self) -> "ModelRun":
        """The analysis by the chosen model, and its mesh."""
        from flexstage.studies import run_model
        from flexstage.studies.models import ModelOptions

        return run_model(self.stage, self.model, ModelOptions(plane=self.plane))  # type: ignore[arg-type]

    @property
    def system(self) -> "MechanicalSystem":
        """The mechanical system of the chosen model."""
        return self.run.analysis.system

    @cached_property
    def dynamic(self) -> "DynamicModel":
        """The stage with its drives, as other programs run it."""
        return self._dynamic(self.system)

    @cached_property
    def dynamic_of_bodies(self) -> "DynamicModel":
        """The same by rigid bodies on hinges, which is what a diagram of blocks shows."""
        from flexstage.lumped import lumped_system

        return self._dynamic(lumped_system(self.stage, plane=self.plane))  # type: ignore[arg-type]

    def require_hysteresis(self) -> None:
        """Refuse a hysteresis that the stacks cannot have, before the mechanics are computed."""
        from flexstage.hysteresis.stack_models import models_by_drive

        models_by_drive(self.stage, self.drive_hysteresis)

    @cached_property
    def drive_hysteresis(self) -> "Mapping[str, DriveModel] | Literal['usual', 'none']":
        """The hysteresis of each stack, from its file or as a word."""
        return read_hysteresis(self.hysteresis)

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
            hysteresis=self.drive_hysteresis,
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


def read_hysteresis(
    given: Sequence[str],
) -> "Mapping[str, DriveModel] | Literal['usual', 'none']":
    """Return the identified model of each drive, of texts ``NAME=FILE``.

    A text may be ``usual`` or ``none`` alone, which is returned.
    """
    from flexstage.hysteresis.model_file import read_model_file

    if len(given) == 1 and given[0] in ("usual", "none"):
        return cast(Literal["usual", "none"], given[0])
    models: dict[str, DriveModel] = {}
    for text in given:
        name, sign, path = text.partition("=")
        if not (name and sign and path):
            raise ModelError(
                f"--hysteresis is usual, none, or NAME=FILE for each drive, got '{text[:80]}'"
            )
        if name in models:
            raise ModelError(f"--hysteresis gives a model for '{name}' twice: give it once")
        models[name] = read_model_file(Path(path)).model
    return models


Files = dict[str, bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportFormat:
    """A format."""

    about: str
    """What it is, in a few words."""
    write: Callable[[ExportRequest], Files]
    """Content by file name, from what was asked for."""
    in_time: bool = False
    """Whether it runs in time, by the hysteresis of the stacks."""


def _diagram(request: ExportRequest) -> Files:
    from flexstage.export.diagram.svg import diagram_files

    return diagram_files(request.stage, model=request.dynamic_of_bodies)


def _simulink(request: ExportRequest) -> Files:
    from flexstage.export.diagram.stage_diagram import stage_diagram
    from flexstage.export.simulink.files import model_name, simulink_files

    model = request.dynamic_of_bodies
    diagram = stage_diagram(request.stage, model=model, collapse=False)
    return simulink_files(diagram, name=model_name(request.stage.name), model=model)


def _fmu(request: ExportRequest) -> Files:
    from flexstage.export.fmu.compiled import compiler
    from flexstage.export.fmu.fmu_file import fmu_files

    if not request.source_only and compiler() is None:
        request.remarks.append(
            "No C compiler was found: the FMU holds its sources alone, which few programs run. "
            "Install gcc or clang and export again."
        )
    files: Files = {}
    for version in request.fmi:
        made = fmu_files(
            request.dynamic,
            version=version,
            binary=False if request.source_only else None,
            stage=request.stage,
        )
        for name, content in made.items():
            # both versions may be asked for at once
            stem, dot, suffix = name.rpartition(".")
            files[f"{stem}-fmi{version[0]}{dot}{suffix}"] = content
    return files


def _mat(request: ExportRequest) -> Files:
    from flexstage.export.matlab.files import matlab_files

    return matlab_files(request.stage, request.system, model=request.dynamic)


def _c(request: ExportRequest) -> Files:
    from flexstage.export.realtime.files import realtime_files

    return realtime_files(request.dynamic, precision=request.precision)  # type: ignore[arg-type]


def _step(request: ExportRequest) -> Files:
    from flexstage.export.step import step_files

    return step_files(request.stage)


def _dxf(request: ExportRequest) -> Files:
    from flexstage.export.drawing.dxf import dxf_files

    return dxf_files(request.stage, kerf=request.kerf)


def _drawing(request: ExportRequest) -> Files:
    from flexstage.export.drawing.sheet import drawing_svg

    return {f"{request.name}-drawing.svg": drawing_svg(request.stage)}


def _vtu(request: ExportRequest) -> Files:
    from flexstage.export.vtu.fields import field_files

    return field_files(request.stage, request.run.analysis, mesh=request.run.mesh)


def _uff(request: ExportRequest) -> Files:
    from flexstage.export.modal_file import universal_files

    return universal_files(request.stage, request.system)


def _table(suffix: str) -> Callable[[ExportRequest], Files]:
    def write(request: ExportRequest) -> Files:
        from flexstage.export.tables.files import table_files

        analysis = request.run.analysis
        figures = (*request.stage.published, *analysis.characteristics)
        if not figures:
            raise StageError(
                f"stage '{request.stage.name}' has no axis and so no characteristics: name a drive "
                "and a probe under 'axes' in the stage file"
            )
        files = table_files(
            figures,
            name=request.name,
            title=request.stage.title,
            provenance=analysis.provenance,
            notes=analysis.validity,
        )
        return {name: content for name, content in files.items() if name.endswith(suffix)}

    return write


#: The formats by name.
FORMATS: Mapping[str, ExportFormat] = {
    "diagram": ExportFormat(about="structural diagram, SVG", write=_diagram, in_time=True),
    "simulink": ExportFormat(
        about="MATLAB script that builds a Simulink model", write=_simulink, in_time=True
    ),
    "fmu": ExportFormat(about="Functional Mock-up Unit", write=_fmu, in_time=True),
    "mat": ExportFormat(about="matrices for MATLAB and Octave", write=_mat, in_time=True),
    "c": ExportFormat(
        about="C header with a step function for a real-time target", write=_c, in_time=True
    ),
    "step": ExportFormat(about="solid, STEP", write=_step),
    "dxf": ExportFormat(about="contours for cutting, DXF", write=_dxf),
    "drawing": ExportFormat(about="drawing with dimensions, SVG", write=_drawing),
    "vtu": ExportFormat(about="statics and modes for ParaView", write=_vtu),
    "uff": ExportFormat(about="modes and responses, universal file", write=_uff),
    "csv": ExportFormat(about="characteristics, CSV", write=_table(".csv")),
    "excel": ExportFormat(about="characteristics, Excel", write=_table(".xlsx")),
    "latex": ExportFormat(about="characteristics, LaTeX table", write=_table(".tex")),
}
