"""Duhem in C and MATLAB."""

import numpy as np

from flexstage.hysteresis.model import Array
from flexstage.hysteresis.models.duhem.law import TERMS, Duhem
from flexstage.hysteresis.models.source_code import (
    HysteresisCode,
    MatlabCode,
    code_of,
    tunable_of,
)


def c_code(model: Duhem) -> HysteresisCode:
    """Return the code in C, without the range of the input.

    It has one piece where the curve is straight and the tangent constant; then only the
    coefficients of these can be changed.
    """
    curve, tangent = _padded(model.anhysteretic), _padded(model.tangent)
    closed = not (np.any(curve[2:] != 0.0) or np.any(tangent[1:] != 0.0))
    tunable = [tunable_of(model, "rate", 0, "how fast the output comes to its curve")]
    for name, what, first, last in (
        ("anhysteretic", "curve to which the output tends", 1, 2),
        ("tangent", "slope of the output on its curve", 1 + TERMS, 1),
    ):
        for k in range(getattr(model, name).size):
            slope = f"/V^{k + (name == 'tangent')}".removesuffix("^1")
            tunable.append(
                tunable_of(
                    model,
                    f"{name}[{k}]",
                    first + k if k < last or not closed else None,
                    f"coefficient {k} of the {what}",
                    "m" if slope == "/V^0" else f"m{slope}",
                )
            )
    return code_of(model, [model.rate, *curve, *tangent], tunable, 1 if closed else 0)


def matlab_code(model: Duhem) -> MatlabCode:
    """Return the code in MATLAB."""
    curve, tangent = _padded(model.anhysteretic), _padded(model.tangent)
    numbers = {
        "rate": (model.rate, "how fast the output comes to its curve [per unit of u]"),
        "f": (curve, "coefficients of the curve, from the constant up"),
        "g": (tangent, "coefficients of the slope on the curve, from the constant up"),
    }
    return MatlabCode(parts=("duhem",), parameters=numbers)


def _padded(coefficients: Array) -> Array:
    return np.pad(coefficients, (0, TERMS - coefficients.size))
