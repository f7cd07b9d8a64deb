"""Preisach in C and MATLAB."""

import numpy as np

from flexstage.hysteresis.models.play_code import (
    THRESHOLD,
    elements,
    largest_pieces,
    plays_matlab_code,
    sum_numbers,
)
from flexstage.hysteresis.models.preisach.law import Preisach
from flexstage.hysteresis.models.source_code import (
    HysteresisCode,
    MatlabCode,
    code_of,
    tunable_of,
)


def c_code(model: Preisach) -> HysteresisCode:
    """Return the code in C; the gain alone can be changed, as tables hold knots and slopes."""
    total = model.play_terms()
    tunable = [
        tunable_of(model, "gain", 2, "part of the voltage itself"),
        *elements(model, "thresholds", model.thresholds, THRESHOLD),
        *elements(model, "knots", model.knots, "mean where the density changes"),
        *(
            tunable_of(model, f"slopes[{i},{j}]", None, "density of the memory")
            for i, j in np.ndindex(*model.slopes.shape)
        ),
    ]
    return code_of(model, sum_numbers(total), tunable, largest_pieces(total))


def matlab_code(model: Preisach) -> MatlabCode:
    """Return the code in MATLAB."""
    return plays_matlab_code(model.play_terms())
