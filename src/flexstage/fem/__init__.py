"""Finite elements of a whole stage: the same description, as the continuum it is cut from."""

from importlib.util import find_spec
from typing import TYPE_CHECKING

from flexstage.base.errors import NO_FINITE_ELEMENTS, ModelError
from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.fem.mesh import MeshSettings
    from flexstage.fem.model import StageModel, UncoupledProblem
    from flexstage.fem.stroke import follow_stroke
    from flexstage.fem.superelement import superelement_model
    from flexstage.fem.whole_stage import (
        REFINEMENT_MESHES,
        Refinement,
        RefinementStep,
        plane_model,
        refine,
        solid_model,
    )

__all__ = [
    "REFINEMENT_MESHES",
    "MeshSettings",
    "Refinement",
    "RefinementStep",
    "StageModel",
    "UncoupledProblem",
    "follow_stroke",
    "plane_model",
    "refine",
    "solid_model",
    "superelement_model",
]

if find_spec("ngsolve") is None:
    raise ModelError(NO_FINITE_ELEMENTS)
import_on_use(__name__)
