"""The description of a stage, its file, and the checks of its geometry."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.stage.bench import Bench
    from flexstage.stage.checks import Issue, check
    from flexstage.stage.contour import Root, root_widths
    from flexstage.stage.drawing.drawn_stage import DrawnStage, read_drawing
    from flexstage.stage.drawing.requests import ContourOptions, DrawingOptions
    from flexstage.stage.drive import Drive, Force, PiezoStack, Screw
    from flexstage.stage.file import read_stage, stage_from_text, stage_to_text, write_stage
    from flexstage.stage.mass import MassProperties, mass_properties
    from flexstage.stage.model import Axis, Body, ExtraMass, Hinge, Manufacture, Probe, Stage
    from flexstage.stage.outline import Circle, Loop, Point
    from flexstage.stage.transform import PlaneMotion, moved

__all__ = [
    "Axis",
    "Bench",
    "Body",
    "Circle",
    "ContourOptions",
    "DrawingOptions",
    "DrawnStage",
    "Drive",
    "ExtraMass",
    "Force",
    "Hinge",
    "Issue",
    "Loop",
    "Manufacture",
    "MassProperties",
    "PiezoStack",
    "PlaneMotion",
    "Point",
    "Probe",
    "Root",
    "Screw",
    "Stage",
    "check",
    "mass_properties",
    "moved",
    "read_drawing",
    "read_stage",
    "root_widths",
    "stage_from_text",
    "stage_to_text",
    "write_stage",
]

import_on_use(__name__)
