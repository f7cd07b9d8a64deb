"""A stage for other programs: block diagram, Simulink, FMU, C, MATLAB, STEP, DXF, ParaView."""

from flexstage.export.build_model import dynamic_model
from flexstage.export.drive_models import usual_hysteresis
from flexstage.export.dynamic_model import DynamicModel, ModelDrive, ModelMemory, ModelProbe

__all__ = [
    "DynamicModel",
    "ModelDrive",
    "ModelMemory",
    "ModelProbe",
    "dynamic_model",
    "usual_hysteresis",
]
