"""Stages that differ from a design in generic ways, so that nothing is symmetric."""

from dataclasses import replace

import numpy as np

from flexstage.stage import Stage


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
