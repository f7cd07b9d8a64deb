"""Parametric stages, one family to a file, and the built-in stages made from them."""

from flexstage.designs.find import find_stage
from flexstage.designs.registry import DESIGNS, TOPOLOGIES, Topology, build, design

__all__ = ["DESIGNS", "TOPOLOGIES", "Topology", "build", "design", "find_stage"]
