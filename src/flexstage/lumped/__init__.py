"""The study's method: rigid bodies joined by three-degree-of-freedom hinges."""

from flexstage.lumped.assemble import HingeSpring, hinge_springs, layout_of, lumped_system
from flexstage.lumped.hinge_kinematics import Layout, hinge_matrix, point_matrix

__all__ = [
    "HingeSpring",
    "Layout",
    "hinge_matrix",
    "hinge_springs",
    "layout_of",
    "lumped_system",
    "point_matrix",
]
