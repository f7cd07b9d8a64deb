"""What the Bouc-Wen models have in common in C and MATLAB."""

import numpy as np

from flexstage.hysteresis.model import Array
from flexstage.hysteresis.models.bouc_wen_common import BoucWenModel
from flexstage.hysteresis.models.power_law import power_table
from flexstage.hysteresis.models.source_code import (
    HysteresisCode,
    MatlabCode,
    code_of,
    tunable_of,
)

#: Rows of coefficients in the table of the power law, and where its constants are.
_ROWS, _CONSTANTS, _COUNT = 4, 5, 7
_DESCRIPTIONS = {
    "gain": "gain of the straight part",
    "quadratic": "factor of the square of the voltage",
    "cubic": "factor of the cube of the voltage",
    "hysteresis_gain": "slope of the hysteretic displacement at zero",
    "beta": "dissipation of the loop",
    "gamma": "shape of the loop",
    "centre": "voltage about which the shape function tells below from above",
}


def bouc_wen_c_code(model: BoucWenModel, names: tuple[str, ...], pieces: int) -> HysteresisCode:
    """Return the code of a model of the Bouc-Wen family: numbers, exponent, table.

    `names` are the parameters in the order of the header, `pieces` as in `code_of`.
    """
    n = model.exponent
    # h to the power n - 1 is in the unit of what multiplies it.
    unit = "1/V" if n == 1.0 else f"1/(V m^{n - 1.0:g})".replace("m^1)", "m)")
    tunable = []
    for k, name in enumerate(names):
        shape = name.startswith("shape")
        what = f"parameter b{name[6:-1]} of the shape function" if shape else _DESCRIPTIONS[name]
        given = unit if shape or name in {"beta", "gamma"} else ""
        tunable.append(tunable_of(model, name, k, what, given))
    numbers = [parameter.value for parameter in tunable]
    tunable.append(tunable_of(model, "exponent", None, "how sharply the loop saturates"))
    return code_of(model, [*numbers, n, *_power_numbers(n)], tunable, pieces)


def _power_numbers(n: float) -> Array:
    """Return the table of the power law as C takes it: four rows of coefficients, then constants.

    Empty where closed forms do without.
    """
    if n in {1.0, 2.0}:
        return np.empty(0)
    table = power_table(n)
    return np.concatenate([table[:_ROWS].ravel(), table[_CONSTANTS, :_COUNT]])


def bouc_wen_matlab_code(cubic: list[float], law: Array, exponent: float) -> MatlabCode:
    """Return the code of a polynomial less the hysteretic displacement of a law.

    The law is A, n, the centre, and psi by direction, loaded or not, side of the centre.
    """
    numbers = {
        "cubic": (cubic, "factors of u, u^2 and u^3 [unit of y per unit of u, u^2, u^3]"),
        "A": (law[0], "slope dh/du at h = 0 [unit of y per unit of u]"),
        "centre": (law[2], "input at which the shape function changes [unit of u]"),
        "unloaded": (
            law[[4, 5, 8, 9]],
            "shape function where h unloads: u falls below, above the centre; rises below, above",
        ),
        "loaded": (law[[6, 7, 10, 11]], "shape function where h is loaded, in the same order"),
    }
    if exponent in (1.0, 2.0):
        return MatlabCode(parts=("bouc_wen_common", f"power_{exponent:g}"), parameters=numbers)
    table = power_table(exponent)
    powers = {
        "n": (exponent, "exponent [1]"),
        "low": (table[0], "series in z below z = exp(-1.1)"),
        "middle": (table[1:3], "series in ln z about z = 1: towards saturation, away from zero"),
        "high": (table[3], "series in 1/z above z = exp(1.1)"),
        "at_zero": (table[5, 1:3], "n times the distance at z = 1"),
        "at_low": (table[5, 3:5], "n times the distance at z = exp(-1.1)"),
        "at_high": (table[5, 5:7], "n times the distance at z = exp(1.1)"),
    }
    return MatlabCode(parts=("bouc_wen_common", "power_n"), parameters=numbers | powers)
