"""Units of functions in a universal file: by their labels, else by the units of the file."""

from dataclasses import dataclass

from flexstage.errors import UnitError
from flexstage.records.columns import GRAVITY, measured_unit
from flexstage.records.universal_sets import Function, FunctionAxis, UnitSystem

_ACCELERATION = 12
# kinds of quantity that set 164 has units for: powers of length and force, SI unit; of a rotation
_BY_SYSTEM = {
    8: ((1, 0, "m"), (0, 0, "rad")),
    9: ((0, 1, "N"), (1, 1, "N*m")),
    11: ((1, 0, "m/s"), (0, 0, "rad/s")),
    12: ((1, 0, "m/s^2"), (0, 0, "rad/s^2")),
    13: ((0, 1, "N"), (1, 1, "N*m")),
    17: ((0, 0, "s"), (0, 0, "s")),
    18: ((0, 0, "Hz"), (0, 0, "Hz")),
}
# kinds of functions whose values are in the unit of the ordinate: all squares are left open
_PLAIN = frozenset((1, 12))
_RATIOS = frozenset((4, 5))
_COHERENCE = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class FunctionUnits:
    """What the units of a function are in SI."""

    text: str = ""
    """The unit of its values as the file has it."""
    si: tuple[float, str] | None = None
    """Number of SI units that one of it is, and the SI unit; None where that is not known."""
    output: str = ""
    """SI units of output and input; empty where they are not known."""
    input: str = ""
    """SI units of output and input; empty where they are not known."""
    note: str = ""
    """What a reader should know."""


def axis_unit(axis: FunctionAxis, system: UnitSystem | None) -> tuple[float, str] | None:
    """Return what the unit of an axis is in SI.

    Examples
    --------
    >>> axis_unit(FunctionAxis(quantity=12, label="g"), None), axis_unit(FunctionAxis(quantity=12), None)
    ((9.80665, 'm/s^2'), None)
    """
    if axis.label in GRAVITY:
        return (GRAVITY[axis.label], "m/s^2") if axis.quantity == _ACCELERATION else None
    if axis.label:
        try:
            return measured_unit(axis.label)
        except UnitError:
            return None
    if axis.quantity in (17, 18):
        return 1.0, _BY_SYSTEM[axis.quantity][0][2]
    if system is None or axis.quantity not in _BY_SYSTEM:
        return None
    length, force, unit = _BY_SYSTEM[axis.quantity][int(axis.rotational)]
    return 1.0 / (system.length**length * system.force**force), unit


def function_units(function: Function) -> FunctionUnits:
    """Return what the units of a function are in SI.

    Validity
    --------
    Spectra of power and correlations are left without a unit: programs differ in whether a label
    means the quantity or its square.
    """
    if function.kind == _COHERENCE:
        return FunctionUnits(text="1", si=(1.0, "1"))
    numerator = axis_unit(function.ordinate, function.system)
    if function.kind in _PLAIN or (function.kind == 0 and function.denominator.quantity == 0):
        return FunctionUnits(
            text=function.ordinate.label or (numerator[1] if numerator else ""),
            si=numerator,
            output=numerator[1] if numerator else "",
            note=_unknown(function.ordinate, numerator),
        )
    if function.kind in _RATIOS or function.kind == 0:
        return _ratio(function, numerator)
    return FunctionUnits()


def _ratio(function: Function, numerator: tuple[float, str] | None) -> FunctionUnits:
    """Return the units of an output over an input."""
    above, below = function.ordinate, function.denominator
    denominator = axis_unit(below, function.system)
    if numerator is not None and _is_whole(above, numerator[1], below, denominator):
        output, _, per = numerator[1].rpartition("/") if "(" not in numerator[1] else ("", "", "")
        return FunctionUnits(text=above.label, si=numerator, output=output, input=per)
    output = numerator[1] if numerator else ""
    per = denominator[1] if denominator else ""
    if numerator is None or denominator is None:
        notes = (_unknown(above, numerator), _unknown(below, denominator))
        return FunctionUnits(output=output, input=per, note="; ".join(n for n in notes if n))
    return FunctionUnits(
        text=_quotient(above.label or output, below.label or per),
        si=(numerator[0] / denominator[0], _quotient(output, per)),
        output=output,
        input=per,
    )


def _is_whole(
    above: FunctionAxis, unit: str, below: FunctionAxis, denominator: tuple[float, str] | None
) -> bool:
    """Say whether the label of the ordinate is that of the quotient already."""
    kinds = _BY_SYSTEM.get(above.quantity)
    plain = kinds[int(above.rotational)][2] if kinds else ""
    if denominator is not None:
        return bool(plain) and unit == _quotient(plain, denominator[1])
    # "m/s" is a speed, and no length over a time that drives
    return not below.label and unit != plain and "/" in unit and not unit.endswith(("/s", "/s^2"))


def _quotient(above: str, below: str) -> str:
    if above == below:
        return "1"
    return f"{above}/({below})" if "/" in below else f"{above}/{below}"


def _unknown(axis: FunctionAxis, unit: tuple[float, str] | None) -> str:
    return f"'{axis.label}' is no known unit" if axis.label and unit is None else ""
