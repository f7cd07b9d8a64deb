"""Finite elements of a whole stage: the same description, as the continuum it is cut from."""

from flexstage.fem.accuracy import LADDERS, Refinement, Step, refine
from flexstage.fem.geometry import StageFaces, stage_faces
from flexstage.fem.mesh import MeshSettings, plane_mesh, prism_mesh
from flexstage.fem.model import Half, StageModel
from flexstage.fem.plane import plane_model
from flexstage.fem.solid import solid_model

__all__ = [
    "LADDERS",
    "Half",
    "MeshSettings",
    "Refinement",
    "StageFaces",
    "StageModel",
    "Step",
    "plane_mesh",
    "plane_model",
    "prism_mesh",
    "refine",
    "solid_model",
    "stage_faces",
]
