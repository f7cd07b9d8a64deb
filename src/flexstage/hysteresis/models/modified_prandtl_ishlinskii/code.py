"""Modified Prandtl-Ishlinskii in C and MATLAB."""

import numpy as np

from flexstage.hysteresis.models.modified_prandtl_ishlinskii.law import ModifiedPrandtlIshlinskii
from flexstage.hysteresis.models.play_code import (
    elements,
    play_parameters,
    plays_matlab_code,
    sum_numbers,
)
from flexstage.hysteresis.models.source_code import HysteresisCode, MatlabCode, code_of


def c_code(model: ModifiedPrandtlIshlinskii) -> HysteresisCode:
    """Return the code in C; gain and weights of plays can be changed."""
    line, zones = model.line(), model.dead_zones
    count = line.knots.size
    numbers = np.concatenate(
        [sum_numbers(model.play_terms()), [count], line.knots, line.slopes, line.offsets()]
    )
    tunable = [
        *play_parameters(model, model.thresholds),
        *elements(model, "dead_zones", zones, "where the slope of the second function changes"),
        *elements(model, "dead_zone_weights", zones, "by how much it changes there"),
    ]
    # Each piece of the plays may meet each knot, since the weights may have any sign.
    return code_of(model, numbers, tunable, (model.thresholds.size + 1) * (count + 1))


def matlab_code(model: ModifiedPrandtlIshlinskii) -> MatlabCode:
    """Return the code in MATLAB."""
    line = model.line()
    return plays_matlab_code(model.play_terms(), line.knots, line.slopes, line.offsets())
