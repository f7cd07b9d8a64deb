"""Stages that differ from a design in generic ways, so that nothing is symmetric."""

from dataclasses import replace

import numpy as np

from flexstage.lumped import StageTangents, parameter_tangents
from flexstage.quantities.quantity import QUANTITIES
from flexstage.stage import Stage

# What is nothing by symmetry is rounding of the motion that it is a part of.
_NOTHING = {"cross_coupling": 1e-12, "parasitic_rotation": 1e-14, "cross_rotation": 1e-14}


def rounding(quantity: str) -> float:
    """Return a magnitude below which a value is rounding."""
    return _NOTHING.get(quantity, 0.1 * QUANTITIES[quantity].zero)


def varied(stage: Stage, seed: int, share: float = 0.02) -> Stage:
    """Return a stage with every neck thinner by its own part, and another plate and material.

    Thinner necks grow from the same edges, so that every such stage can be built.
    """
    draw = np.random.default_rng(seed)

    def thinner(hinge):
        profile = hinge.profile
        neck = profile.neck_thickness * (1.0 - share * draw.uniform(0.1, 1.0))
        return replace(hinge, profile=replace(profile, neck_thickness=neck))

    material = stage.material
    return replace(
        stage,
        thickness=stage.thickness * (1.0 + share * draw.uniform(-1.0, 1.0)),
        hinges=tuple(thinner(hinge) for hinge in stage.hinges),
        material=replace(
            material,
            youngs_modulus=material.youngs_modulus * (1.0 + share * draw.uniform(-1.0, 1.0)),
            density=material.density * (1.0 + share * draw.uniform(-1.0, 1.0)),
        ),
    )


def tangents_of_necks(stage: Stage, count: int = 4) -> StageTangents:
    """Return derivatives by the thickness of the plate, and by the necks of some hinges."""

    def with_neck(i: int, t: float) -> Stage:
        hinge = stage.hinges[i]
        changed = replace(hinge, profile=replace(hinge.profile, neck_thickness=t))
        return replace(stage, hinges=(*stage.hinges[:i], changed, *stage.hinges[i + 1 :]))

    necks = [
        parameter_tangents(lambda t, i=i: with_neck(i, t), hinge.profile.neck_thickness)
        for i, hinge in enumerate(stage.hinges[:count])
    ]
    thickness = parameter_tangents(lambda t: replace(stage, thickness=t), stage.thickness)
    return thickness.joined(*necks)
