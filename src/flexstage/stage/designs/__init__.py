"""Families of stages by parameters, and the built-in stages made from them."""

from flexstage.stage.designs.parameters import StageParameter
from flexstage.stage.designs.registry import DESIGNS, build, design
from flexstage.stage.designs.source import StageTemplate, find_stage, parameters_of

__all__ = [
    "DESIGNS",
    "StageParameter",
    "StageTemplate",
    "build",
    "design",
    "find_stage",
    "parameters_of",
]
