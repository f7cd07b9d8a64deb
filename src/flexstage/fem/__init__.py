"""Finite elements of a whole stage: the same description, as the continuum it is cut from."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.fem.accuracy import LADDERS, Refinement, RefinementStep, refine
    from flexstage.fem.mesh import MeshSettings
    from flexstage.fem.model import StageModel, UncoupledProblem
    from flexstage.fem.plane import plane_model
    from flexstage.fem.solid import solid_model
    from flexstage.fem.stroke import follow_stroke
    from flexstage.fem.superelement import superelement_model

__all__ = [
    "LADDERS",
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

import_on_use(__name__)
