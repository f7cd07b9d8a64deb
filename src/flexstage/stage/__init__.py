"""The description of a stage, its file, and the checks of its geometry."""

from flexstage.stage.drive import Drive, Force, PiezoStack, Screw
from flexstage.stage.mass import MassProperties, mass_properties
from flexstage.stage.model import Axis, Body, ExtraMass, Hinge, Manufacture, Probe, Stage
from flexstage.stage.outline import AreaIntegrals, Circle, Loop, Point
from flexstage.stage.roots import Root, hinge_root, root_widths

__all__ = [
    "AreaIntegrals",
    "Axis",
    "Body",
    "Circle",
    "Drive",
    "ExtraMass",
    "Force",
    "Hinge",
    "Loop",
    "Manufacture",
    "MassProperties",
    "PiezoStack",
    "Point",
    "Probe",
    "Root",
    "Screw",
    "Stage",
    "hinge_root",
    "mass_properties",
    "root_widths",
]
