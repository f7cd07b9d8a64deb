"""Finite elements of the parallelogram, made once in a test process; tests change none of them."""

import functools

from flexstage.fem import MeshSettings, StageModel, plane_model, solid_model
from flexstage.stage.designs import design
from flexstage.system import Analysis, analyse

STAGE = design("parallelogram")


@functools.cache
def plane(settings: MeshSettings) -> StageModel:
    """The model in the plane on one mesh."""
    return plane_model(STAGE, settings)


@functools.cache
def coarse_solid() -> StageModel:
    """The model in space on a coarse mesh."""
    return solid_model(STAGE, MeshSettings(order=2, neck_size=1.5), modes=(4, 4))


@functools.cache
def analysed(model: StageModel) -> Analysis:
    """What is computed of one of these models."""
    return analyse(STAGE, model.system)
