"""What the models that sum functions of plays have in common in C and MATLAB."""

from collections.abc import Iterable

import numpy as np

from flexstage.hysteresis.model import Array, HysteresisModel
from flexstage.hysteresis.models.play_model import Sum
from flexstage.hysteresis.models.source_code import MatlabCode, TunableParameter, tunable_of

#: What is said of a threshold and of a list of them.
THRESHOLD = "half the gap of a play"
_THRESHOLDS = "half the gap of each play [unit of u]"


def sum_numbers(total: Sum) -> Array:
    """Return a sum of functions of plays as C takes it."""
    gain, thresholds, knots, slopes, offsets = total
    sizes = [thresholds.size, knots.size, gain]
    return np.concatenate([sizes, thresholds, knots, slopes.ravel(), offsets.ravel()])


def largest_pieces(total: Sum) -> int:
    """Return the largest number of pieces: each play may start, and pass each knot."""
    return total[1].size * (total[2].size + 1) + 1


def play_parameters(model: HysteresisModel, thresholds: Array) -> list[TunableParameter]:
    """Return gain, thresholds and weights; the weights stand after the thresholds.

    Thresholds cannot be changed, since the memory belongs to them.
    """
    m = thresholds.size
    return [
        tunable_of(model, "gain", 2, "slope just after the voltage turns back"),
        *elements(model, "thresholds", thresholds, THRESHOLD),
        *(tunable_of(model, f"weights[{i}]", 3 + m + i, "weight of a play") for i in range(m)),
    ]


def elements(
    model: HysteresisModel, name: str, values: Array, description: str
) -> Iterable[TunableParameter]:
    """Return the elements of a list that cannot be changed."""
    return [tunable_of(model, f"{name}[{i}]", None, description) for i in range(values.size)]


def plays_matlab_code(
    total: Sum,
    knots: Array | None = None,
    slopes: Array | None = None,
    offsets: Array | None = None,
) -> MatlabCode:
    """Return the code of a sum of functions of plays, and of a line with kinks after it."""
    gain, thresholds, inner, by_play, constants = total
    none = np.zeros(0)
    numbers = {
        "gain": (gain, "part of the input itself [unit of y per unit of u]"),
        "thresholds": (thresholds, _THRESHOLDS),
        "knots": (inner, "where the functions of the plays change their slope [unit of u]"),
        "slopes": (by_play, "slopes of these functions, one row a play [unit of y per unit of u]"),
        "offsets": (constants, "their values at zero, continued from each interval [unit of y]"),
        "line_knots": (none if knots is None else knots, "where the line after them has kinks"),
        "line_slopes": (np.ones(1) if slopes is None else slopes, "slopes of this line [1]"),
        "line_offsets": (np.zeros(1) if offsets is None else offsets, "its values at zero"),
    }
    return MatlabCode(parts=("plays",), parameters=numbers)
