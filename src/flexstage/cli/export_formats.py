"""The formats of `flexstage export`: what each is, and what writes it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from flexstage.cli.export_request import ExportRequest
from flexstage.errors import StageError

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
    from flexstage.export.fields import field_files

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
