"""Dahl in C and MATLAB."""

from flexstage.hysteresis.models.dahl.law import Dahl
from flexstage.hysteresis.models.source_code import (
    HysteresisCode,
    MatlabCode,
    code_of,
    tunable_of,
)


def c_code(model: Dahl) -> HysteresisCode:
    """Return the code in C, with pieces where the exponent is 1, which is then fixed."""
    straight = model.exponent == 1.0
    tunable = [
        tunable_of(model, "gain", 0, "gain of the straight part"),
        tunable_of(model, "stiffness", 1, "slope of the friction at zero"),
        tunable_of(model, "limit", 2, "friction at which sliding goes on"),
        tunable_of(model, "exponent", None if straight else 3, "how sharply the loop saturates"),
    ]
    return code_of(model, [p.value for p in tunable], tunable, 2 if straight else 0)


def matlab_code(model: Dahl) -> MatlabCode:
    """Return the code in MATLAB."""
    numbers = {
        "gain": (model.gain, "gain of the straight part [unit of y per unit of u]"),
        "stiffness": (model.stiffness, "slope of the friction at zero [unit of y per unit of u]"),
        "limit": (model.limit, "friction that is approached [unit of y]"),
        "exponent": (model.exponent, "exponent [1]"),
    }
    return MatlabCode(parts=("dahl",), parameters=numbers)
