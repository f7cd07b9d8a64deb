"""Export of a stage: block diagram, Simulink, FMU, C, MATLAB, STEP, DXF, ParaView.

Simulations come from its `DynamicModel`: `fmu_files`, `realtime_files`, `simulink_files`,
`matlab_files`, `control_system`. Geometry comes from the stage: `step_files`, `dxf_files`;
diagrams from its equations: `stage_diagram`, `diagram_files`; results from an analysis:
`field_files`, `universal_files`, `table_files`; matrices with interface frames: `reduced_files`;
from identified drives: `coupled_files`. Functions
that end in ``_files`` return the content of each file by its name, and write nothing.
"""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.export.control_object import control_system
    from flexstage.export.coupled import coupled_files
    from flexstage.export.diagram.stage_diagram import stage_diagram
    from flexstage.export.diagram.svg import diagram_files
    from flexstage.export.drawing.dxf import dxf_files
    from flexstage.export.fields import field_files
    from flexstage.export.fmu.fmu_file import fmu_files
    from flexstage.export.matlab import matlab_files
    from flexstage.export.modal_file import universal_files
    from flexstage.export.realtime import realtime_files
    from flexstage.export.reduced import joined, read_reduced, reduced_files, reduced_model
    from flexstage.export.simulink.files import simulink_files
    from flexstage.export.step import step_files
    from flexstage.export.tables import table_files

__all__ = [
    "control_system",
    "coupled_files",
    "diagram_files",
    "dxf_files",
    "field_files",
    "fmu_files",
    "joined",
    "matlab_files",
    "read_reduced",
    "realtime_files",
    "reduced_files",
    "reduced_model",
    "simulink_files",
    "stage_diagram",
    "step_files",
    "table_files",
    "universal_files",
]

import_on_use(__name__)
