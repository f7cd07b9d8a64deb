"""Parametric stages, one family to a file, and the built-in stages made from them."""

from flexstage.designs.registry import DESIGNS, build, design, find_stage

__all__ = ["DESIGNS", "build", "design", "find_stage"]
