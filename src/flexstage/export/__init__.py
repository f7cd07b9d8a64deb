"""A stage for other programs: block diagram, Simulink, FMU, C, MATLAB, STEP, DXF, ParaView.

`dynamic_model` puts a stage together with its amplifiers, hysteresis, creep and sensors; what
simulates it elsewhere is made from that `DynamicModel`: `fmu_files`, `realtime_files`,
`simulink_files`, `matlab_files`, `control_system`. What is made of the stage itself: `step_files`,
`dxf_files`, `drawing_svg`; of its equations: `stage_diagram`, `diagram_files`; of an analysis:
`field_files`, `universal_files`, `table_files`. Functions that end in ``_files`` return the content
of each file by its name, and write nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from flexstage.export.build_model import dynamic_model
from flexstage.export.drive_models import usual_hysteresis
from flexstage.export.model import DynamicModel, ModelDrive, ModelMemory, ModelProbe

if TYPE_CHECKING:
    from flexstage.export.control_object import control_system
    from flexstage.export.diagram import diagram_files, diagram_svg, stage_diagram
    from flexstage.export.drawing import drawing_svg, dxf_files, offset_contours, plate_contours
    from flexstage.export.fields import field_files
    from flexstage.export.fmu import fmu_files
    from flexstage.export.matlab import matlab_files
    from flexstage.export.modal_file import universal_files
    from flexstage.export.realtime import realtime_files
    from flexstage.export.simulink import simulink_files
    from flexstage.export.source import c_variables, render_source
    from flexstage.export.step import step_files
    from flexstage.export.tables import table_files

__all__ = [
    "DynamicModel",
    "ModelDrive",
    "ModelMemory",
    "ModelProbe",
    "c_variables",
    "control_system",
    "diagram_files",
    "diagram_svg",
    "drawing_svg",
    "dxf_files",
    "dynamic_model",
    "field_files",
    "fmu_files",
    "matlab_files",
    "offset_contours",
    "plate_contours",
    "realtime_files",
    "render_source",
    "simulink_files",
    "stage_diagram",
    "step_files",
    "table_files",
    "universal_files",
    "usual_hysteresis",
]

# one format needs little of what another one needs
_MODULES = {
    "c_variables": "source",
    "control_system": "control_object",
    "diagram_files": "diagram",
    "diagram_svg": "diagram",
    "drawing_svg": "drawing",
    "dxf_files": "drawing",
    "field_files": "fields",
    "fmu_files": "fmu",
    "matlab_files": "matlab",
    "offset_contours": "drawing",
    "plate_contours": "drawing",
    "realtime_files": "realtime",
    "render_source": "source",
    "simulink_files": "simulink",
    "stage_diagram": "diagram",
    "step_files": "step",
    "table_files": "tables",
    "universal_files": "modal_file",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'flexstage.export' has no attribute '{name}'")
    return getattr(import_module(f"flexstage.export.{_MODULES[name]}"), name)
