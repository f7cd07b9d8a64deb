"""The study's method: rigid bodies joined by three-degree-of-freedom hinges."""

from typing import TYPE_CHECKING, Any

from flexstage.lumped.assemble import HingeSpring, hinge_springs, layout_of, lumped_system
from flexstage.lumped.finite_rotation import NonlinearMechanism, nonlinear
from flexstage.lumped.hinge_kinematics import Layout, hinge_matrix, point_matrix
from flexstage.lumped.mirror import Mirror, find_mirror
from flexstage.lumped.rigid_bodies import Mechanism, RigidBody, Sight, SpringHinge, mechanism
from flexstage.lumped.stroke import Equilibrium, StrokePath, equilibrium, stroke_path
from flexstage.lumped.time_integration import Motion, motion

if TYPE_CHECKING:
    from flexstage.lumped.latex import latex_document, mathml, plain_text, sheet_data
    from flexstage.lumped.reduction import ReducedModel, condense, reduce_by_symmetry
    from flexstage.lumped.sheet import equation_sheet
    from flexstage.lumped.symbolic import SymbolicModel, symbolic_model
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

# the symbolic half needs SymPy, which takes longer to import than a whole numeric analysis
_SYMBOLIC = {
    "ReducedModel": "reduction",
    "SymbolicModel": "symbolic",
    "TransferFunction": "transfer",
    "condense": "reduction",
    "equation_sheet": "sheet",
    "latex_document": "latex",
    "mathml": "latex",
    "plain_text": "latex",
    "reduce_by_symmetry": "reduction",
    "sheet_data": "latex",
    "symbolic_model": "symbolic",
    "transfer_function": "transfer",
}


def __getattr__(name: str) -> Any:
    module = _SYMBOLIC.get(name)
    if module is None:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module(f"flexstage.lumped.{module}"), name)
