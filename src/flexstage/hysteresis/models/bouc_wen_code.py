"""What the Bouc-Wen models have in common in C and MATLAB."""

from flexstage.hysteresis.model import Array
from flexstage.hysteresis.models.bouc_wen_common import BoucWenModel
from flexstage.hysteresis.models.source_code import (
    HysteresisCode,
    MatlabCode,
    code_of,
    tunable_of,
)

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
    """Return the code of a model of the Bouc-Wen family: its numbers, then the exponent.

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
    return code_of(model, [*numbers, n], tunable, pieces)


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
        return MatlabCode(
            parts=("bouc_wen_common", "power_closed", f"power_{exponent:g}"), parameters=numbers
        )
    numbers["n"] = (exponent, "exponent [1]")
    return MatlabCode(parts=("bouc_wen_common", "power_n"), parameters=numbers)
