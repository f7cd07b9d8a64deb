"""Finite elements of a whole stage: the same description, as the continuum it is cut from."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.fem.accuracy import LADDERS, Refinement, Step, refine
    from flexstage.fem.geometry import StageFaces, stage_faces
    from flexstage.fem.legs import bar_buckling_load, two_notch_bars
    from flexstage.fem.mesh import MeshSettings, plane_mesh, prism_mesh
    from flexstage.fem.model import Half, StageModel
    from flexstage.fem.plane import plane_model
    from flexstage.fem.solid import solid_model
    from flexstage.fem.stroke import FiniteStroke, follow_stroke, with_stroke
    from flexstage.fem.superelement import SuperelementModel, superelement_model

__all__ = [
    "LADDERS",
    "FiniteStroke",
    "Half",
    "MeshSettings",
    "Refinement",
    "StageFaces",
    "StageModel",
    "Step",
    "SuperelementModel",
    "bar_buckling_load",
    "follow_stroke",
    "plane_mesh",
    "plane_model",
    "prism_mesh",
    "refine",
    "solid_model",
    "stage_faces",
    "superelement_model",
    "two_notch_bars",
    "with_stroke",
]

import_on_use(__name__)
