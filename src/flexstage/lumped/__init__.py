"""The study's method: rigid bodies joined by three-degree-of-freedom hinges."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.lumped.assemble import HingeSpring, hinge_springs, layout_of, lumped_system
    from flexstage.lumped.finite_rotation import NonlinearMechanism, nonlinear
    from flexstage.lumped.hinge_kinematics import Layout, hinge_matrix, point_matrix
    from flexstage.lumped.latex import latex_document, mathml, plain_text, sheet_data
    from flexstage.lumped.mirror import Mirror, find_mirror
    from flexstage.lumped.reduction import ReducedModel, condense, reduce_by_symmetry
    from flexstage.lumped.rigid_bodies import Mechanism, RigidBody, Sight, SpringHinge, mechanism
    from flexstage.lumped.sheet import equation_sheet
    from flexstage.lumped.stroke import Equilibrium, StrokePath, equilibrium, stroke_path
    from flexstage.lumped.symbolic import SymbolicModel, symbolic_model
    from flexstage.lumped.time_integration import Motion, motion
    from flexstage.lumped.transfer import TransferFunction, transfer_function

__all__ = [
    "Equilibrium",
    "HingeSpring",
    "Layout",
    "Mechanism",
    "Mirror",
    "Motion",
    "NonlinearMechanism",
    "ReducedModel",
    "RigidBody",
    "Sight",
    "SpringHinge",
    "StrokePath",
    "SymbolicModel",
    "TransferFunction",
    "condense",
    "equation_sheet",
    "equilibrium",
    "find_mirror",
    "hinge_matrix",
    "hinge_springs",
    "latex_document",
    "layout_of",
    "lumped_system",
    "mathml",
    "mechanism",
    "motion",
    "nonlinear",
    "plain_text",
    "point_matrix",
    "reduce_by_symmetry",
    "sheet_data",
    "stroke_path",
    "symbolic_model",
    "transfer_function",
]

import_on_use(__name__)
