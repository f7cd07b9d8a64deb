"""Models that are differential equations, as C: the Bouc-Wen family, Dahl, Duhem."""

import numpy as np

from flexstage.export.source.hysteresis_code_parts import HysteresisCode, code_of, tunable_of
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.models.asymmetric_bouc_wen import AsymmetricBoucWen
from flexstage.hysteresis.models.bouc_wen import BoucWen
from flexstage.hysteresis.models.dahl import Dahl
from flexstage.hysteresis.models.duhem import TERMS, Duhem
from flexstage.hysteresis.models.generalised_bouc_wen import GeneralisedBoucWen
from flexstage.hysteresis.models.power_law import power_table

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
    "stiffness": "slope of the friction at zero",
    "limit": "friction at which sliding goes on",
    "rate": "how fast the output comes to its curve",
    "exponent": "how sharply the loop saturates",
}


def power_numbers(n: float) -> Array:
    """Return the table of the power law as C takes it: four rows of coefficients, then constants.

    Empty where closed forms do without.
    """
    if n in {1.0, 2.0}:
        return np.empty(0)
    table = power_table(n)
    return np.concatenate([table[:_ROWS].ravel(), table[_CONSTANTS, :_COUNT]])


def bouc_wen_code(model: BoucWen) -> HysteresisCode:
    """Return the code of Bouc-Wen, with pieces where the exponent is 1."""
    names = ("gain", "hysteresis_gain", "beta", "gamma")
    return _family(model, names, (), 2 if model.exponent == 1.0 else 0)


def asymmetric_bouc_wen_code(model: AsymmetricBoucWen) -> HysteresisCode:
    """Return the code of asymmetric Bouc-Wen, without pieces and without limits of the input."""
    names = ("gain", "quadratic", "cubic", "hysteresis_gain", "beta", "gamma")
    return _family(model, names, (), 0)


def generalised_bouc_wen_code(model: GeneralisedBoucWen) -> HysteresisCode:
    """Return the code of generalised Bouc-Wen, with pieces where the exponent is 1."""
    names = ("gain", "hysteresis_gain", *(f"shape[{k}]" for k in range(6)))
    return _family(model, names, ("centre",), 4 if model.exponent == 1.0 else 0)


def dahl_code(model: Dahl) -> HysteresisCode:
    """Return the code of Dahl, with pieces where the exponent is 1, which is then fixed."""
    names = ("gain", "stiffness", "limit")
    numbers = [float(getattr(model, name)) for name in (*names, "exponent")]
    straight = model.exponent == 1.0
    tunable = [tunable_of(model, name, k, _DESCRIPTIONS[name]) for k, name in enumerate(names)]
    place = None if straight else len(names)
    tunable.append(tunable_of(model, "exponent", place, _DESCRIPTIONS["exponent"]))
    return code_of(model, numbers, tunable, 2 if straight else 0)


def duhem_code(model: Duhem) -> HysteresisCode:
    """Return the code of Duhem, without the range of its input.

    It has one piece where the curve is straight and the tangent constant; then only the
    coefficients of these can be changed.
    """
    curve = np.pad(model.anhysteretic, (0, TERMS - model.anhysteretic.size))
    tangent = np.pad(model.tangent, (0, TERMS - model.tangent.size))
    closed = not (np.any(curve[2:] != 0.0) or np.any(tangent[1:] != 0.0))
    tunable = [tunable_of(model, "rate", 0, _DESCRIPTIONS["rate"])]
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


def _family(
    model: BoucWen | AsymmetricBoucWen | GeneralisedBoucWen,
    names: tuple[str, ...],
    more: tuple[str, ...],
    pieces: int,
) -> HysteresisCode:
    """Return the code of a model of the Bouc-Wen family: numbers, exponent, table."""
    n = model.exponent
    # h to the power n - 1 is in the unit of what multiplies it.
    unit = "1/V" if n == 1.0 else f"1/(V m^{n - 1.0:g})".replace("m^1)", "m)")
    tunable = []
    for k, name in enumerate((*names, *more)):
        shape = name.startswith("shape")
        what = f"parameter b{name[6:-1]} of the shape function" if shape else _DESCRIPTIONS[name]
        given = unit if shape or name in {"beta", "gamma"} else ""
        tunable.append(tunable_of(model, name, k, what, given))
    numbers = [parameter.value for parameter in tunable]
    tunable.append(tunable_of(model, "exponent", None, _DESCRIPTIONS["exponent"]))
    return code_of(model, [*numbers, n, *power_numbers(n)], tunable, pieces)
