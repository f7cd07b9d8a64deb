"""The study's method: rigid bodies joined by three-degree-of-freedom hinges."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.lumped.assemble import hinge_springs, lumped_system
    from flexstage.lumped.batch import assemble_batch, lumped_characteristics, system_tangents
    from flexstage.lumped.derivation import equation_sheet
    from flexstage.lumped.finite_rotation import nonlinear
    from flexstage.lumped.large_displacement import equilibrium, stroke_path
    from flexstage.lumped.latex import mathml
    from flexstage.lumped.reduction import (
        TransferFunction,
        condense,
        reduce_by_symmetry,
        transfer_function,
    )
    from flexstage.lumped.rigid_bodies import Mechanism, RigidBody, Sight, SpringHinge, mechanism
    from flexstage.lumped.stage_arrays import (
        StageArrays,
        StageTangents,
        parameter_tangents,
        stage_arrays,
    )
    from flexstage.lumped.symbolic import SymbolicModel, symbolic_model
    from flexstage.lumped.time_integration import Motion, motion

__all__ = [
    "Mechanism",
    "Motion",
    "RigidBody",
    "Sight",
    "SpringHinge",
    "StageArrays",
    "StageTangents",
    "SymbolicModel",
    "TransferFunction",
    "assemble_batch",
    "condense",
    "equation_sheet",
    "equilibrium",
    "hinge_springs",
    "lumped_characteristics",
    "lumped_system",
    "mathml",
    "mechanism",
    "motion",
    "nonlinear",
    "parameter_tangents",
    "reduce_by_symmetry",
    "stage_arrays",
    "stroke_path",
    "symbolic_model",
    "system_tangents",
    "transfer_function",
]

import_on_use(__name__)
