"""Families of stages by parameters, and the built-in stages made from them."""

from flexstage.designs.parameters import StageParameter
from flexstage.designs.registry import DESIGNS, build, design
from flexstage.designs.source import find_stage, parameters_of
from flexstage.designs.template import StageTemplate

__all__ = [
    "DESIGNS",
    "StageParameter",
    "StageTemplate",
    "build",
    "design",
    "find_stage",
    "parameters_of",
]
