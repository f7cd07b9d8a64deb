"""The formats that a stage can be written in, each one line."""

from collections.abc import Mapping
from dataclasses import dataclass


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
