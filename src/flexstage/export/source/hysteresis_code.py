"""A hysteresis model as C: which header computes it, and with which parameters.

Differential equations (the Bouc-Wen family, Dahl, Duhem), and sums of plays (Prandtl-Ishlinskii,
Preisach, Maxwell-slip).
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from flexstage.errors import ModelError
from flexstage.export.source.hysteresis_code_parts import (
    HysteresisCode,
    TunableParameter,
    code_of,
    tunable_of,
)
from flexstage.hysteresis.model import Array, HysteresisModel
from flexstage.hysteresis.models.asymmetric_bouc_wen.law import AsymmetricBoucWen
from flexstage.hysteresis.models.bouc_wen.law import BoucWen
from flexstage.hysteresis.models.dahl.law import Dahl
from flexstage.hysteresis.models.duhem.law import TERMS, Duhem
from flexstage.hysteresis.models.generalised_bouc_wen.law import GeneralisedBoucWen
from flexstage.hysteresis.models.maxwell_slip.law import GeneralisedMaxwellSlip
from flexstage.hysteresis.models.modified_prandtl_ishlinskii.law import ModifiedPrandtlIshlinskii
from flexstage.hysteresis.models.play_model import Sum
from flexstage.hysteresis.models.power_law import power_table
from flexstage.hysteresis.models.prandtl_ishlinskii.law import PrandtlIshlinskii
from flexstage.hysteresis.models.preisach.law import Preisach

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
_GAIN = "slope just after the voltage turns back"
_THRESHOLD = "half the gap of a play"
_WEIGHT = "weight of a play"


def prandtl_ishlinskii_code(model: PrandtlIshlinskii) -> HysteresisCode:
    """Return the code of Prandtl-Ishlinskii, whose gain and weights can be changed.

    Thresholds cannot, since the memory belongs to them.
    """
    return code_of(
        model, _numbers(model.play_terms()), _play_parameters(model), model.thresholds.size + 1
    )


def modified_prandtl_ishlinskii_code(model: ModifiedPrandtlIshlinskii) -> HysteresisCode:
    """Return the code of modified Prandtl-Ishlinskii; gain and weights of plays can be changed."""
    line = model.line()
    count = line.knots.size
    numbers = np.concatenate(
        [_numbers(model.play_terms()), [count], line.knots, line.slopes, line.offsets()]
    )
    tunable = [
        *_play_parameters(model),
        *_elements(model, "dead_zones", "where the slope of the second function changes"),
        *_elements(model, "dead_zone_weights", "by how much it changes there"),
    ]
    # Each piece of the plays may meet each knot, since the weights may have any sign.
    return code_of(model, numbers, tunable, (model.thresholds.size + 1) * (count + 1))


def maxwell_slip_code(model: GeneralisedMaxwellSlip) -> HysteresisCode:
    """Return the code of Maxwell-slip, all fixed: the state must fit to every parameter."""
    total = model.play_terms()
    tunable = [
        tunable_of(model, "stiffness", None, "stiffness of the spring that never slides"),
        *_elements(model, "thresholds", "displacement from which an element slides"),
        *_elements(model, "element_stiffness", "stiffness of an element before it slides"),
        *_elements(model, "dead_zones", "where the stiffness of the spring changes", "m"),
        *_elements(model, "dead_zone_weights", "by how much it changes there"),
    ]
    return code_of(model, _numbers(total), tunable, _largest(total))


def preisach_code(model: Preisach) -> HysteresisCode:
    """Return the code of Preisach; the gain alone can be changed.

    A table is derived from knots and slopes.
    """
    total = model.play_terms()
    slopes = [
        tunable_of(model, f"slopes[{i},{j}]", None, "density of the memory")
        for i, j in np.ndindex(*model.slopes.shape)
    ]
    tunable = [
        tunable_of(model, "gain", 2, "part of the voltage itself"),
        *_elements(model, "thresholds", _THRESHOLD),
        *_elements(model, "knots", "mean where the density changes"),
        *slopes,
    ]
    return code_of(model, _numbers(total), tunable, _largest(total))


def _numbers(total: Sum) -> Array:
    """Return a sum of functions of plays as C takes it."""
    gain, thresholds, knots, slopes, offsets = total
    sizes = [thresholds.size, knots.size, gain]
    return np.concatenate([sizes, thresholds, knots, slopes.ravel(), offsets.ravel()])


def _largest(total: Sum) -> int:
    """Return the largest number of pieces: each play may start, and pass each knot."""
    return total[1].size * (total[2].size + 1) + 1


def _play_parameters(
    model: PrandtlIshlinskii | ModifiedPrandtlIshlinskii,
) -> list[TunableParameter]:
    """Return gain, thresholds and weights; the weights stand after the thresholds."""
    m = model.thresholds.size
    return [
        tunable_of(model, "gain", 2, _GAIN),
        *_elements(model, "thresholds", _THRESHOLD),
        *(tunable_of(model, f"weights[{i}]", 3 + m + i, _WEIGHT) for i in range(m)),
    ]


def _elements(
    model: PrandtlIshlinskii | ModifiedPrandtlIshlinskii | GeneralisedMaxwellSlip | Preisach,
    name: str,
    description: str,
    unit: str = "",
) -> list[TunableParameter]:
    """Return the elements of a list that cannot be changed."""
    return [
        tunable_of(model, f"{name}[{i}]", None, description, unit)
        for i in range(len(getattr(model, name)))
    ]


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


_CODES: Mapping[str, Callable[[Any], HysteresisCode]] = {
    "bouc-wen": bouc_wen_code,
    "asymmetric-bouc-wen": asymmetric_bouc_wen_code,
    "generalised-bouc-wen": generalised_bouc_wen_code,
    "dahl": dahl_code,
    "duhem": duhem_code,
    "prandtl-ishlinskii": prandtl_ishlinskii_code,
    "modified-prandtl-ishlinskii": modified_prandtl_ishlinskii_code,
    "maxwell-slip": maxwell_slip_code,
    "preisach": preisach_code,
}


def hysteresis_code(model: HysteresisModel) -> HysteresisCode:
    """Return what C needs to compute a hysteresis model from volts to metres.

    Notes
    -----
    Validity: in double precision, without contraction of products and sums, the C functions do the
    operations of the model in their order. Results are the same bits where both take exponentials
    and logarithms from one mathematical library; elsewhere they differ by its rounding. In single
    precision they are within 1e-6 of the stroke (Duhem 2e-6) where the voltage moves by turns.
    Very slow motion one way, 10 uV a step, costs models that keep a displacement as memory
    (Bouc-Wen, Dahl) 1e-4 of the stroke over 3 V, and Duhem 7e-3; sums of plays lose nothing.
    Exponents above 6 do not fit into single precision for lengths in metres.

    Examples
    --------
    >>> from flexstage.hysteresis import BoucWen
    >>> stack = BoucWen(gain=0.593e-6, hysteresis_gain=0.441e-6, beta=0.05, gamma=0.03)
    >>> code = hysteresis_code(stack)
    >>> code.header, code.function, code.memory, code.pieces
    ('hysteresis_bouc_wen.h', 'fs_bouc_wen', 2, 2)
    >>> [f"{p.name} [{p.unit}] = p[{p.index}]" for p in code.tunable][:2]
    ['gain [m/V] = p[0]', 'hysteresis_gain [m/V] = p[1]']
    """
    if model.kind not in _CODES:
        raise ModelError(
            f"there is no C for hysteresis of the kind '{model.kind}': take one of "
            f"{', '.join(_CODES)}"
        )
    return _CODES[model.kind](model)
