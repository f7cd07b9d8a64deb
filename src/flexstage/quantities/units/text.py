"""Quantities as text: read to the last digit, and written so that they are read back."""

import math
import re
from decimal import Context, Decimal
from fractions import Fraction
from functools import lru_cache
from typing import Any

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import UnitError
from flexstage.quantities.units.dimension import DIMENSIONS, MEASURED

_NUMBER = r"[+-]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][+-]?\d{1,3})?"
#: What a unit looks like.
UNIT = r"(?:1|[A-Za-zµμ°]{1,20}(?:\^?-?[1-4])?)(?:[*·/][A-Za-zµμ°]{1,20}(?:\^?-?[1-4])?){0,4}"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*({UNIT})?\s*")


@lru_cache(maxsize=1)
def units_library() -> Any:
    """Return the registry of the units library."""
    # pint is a third of a second to import and is needed only where text is read
    import pint

    decimal: Any = Decimal  # allowed by pint, but for its annotation
    return pint.UnitRegistry(non_int_type=decimal)


@lru_cache(maxsize=512)
def factor_of(unit: str, dimension: str) -> Decimal:
    """Return how many SI units of a dimension one `unit` is."""
    import pint

    wanted = DIMENSIONS.get(dimension) or MEASURED[dimension]
    spelled = unit.replace("°", "deg").replace("·", "*")
    spelled = re.sub(r"(?<=[A-Za-zµμ])(-?[1-4])(?![0-9])", r"^\1", spelled)
    known = sorted({u for d in DIMENSIONS.values() for u in d.units})
    allowed = f"{wanted.noun} in {', '.join(wanted.units)}"
    try:
        quantity = units_library().Quantity(Decimal(1), spelled)
    except Exception as error:  # pint raises tokenizer, attribute and assertion errors alike
        hint = did_you_mean(unit, known)
        raise UnitError(f"unknown unit '{unit}': expected {allowed}{hint}") from error
    angles = ("rad", "deg", "arc", "turn", "rev", "grad", "cycle", "rpm")
    is_angle = any(word in spelled.lower() for word in angles)
    # the radian is the number one to pint, so angles and frequencies are told apart by name
    if is_angle != (dimension in {"angle", "angular speed", "rotational stiffness"}):
        raise UnitError(f"'{unit}' is not a unit of {wanted.name}: expected {allowed}")
    try:
        return quantity.to(wanted.si).magnitude
    except (pint.DimensionalityError, pint.OffsetUnitCalculusError) as error:
        raise UnitError(f"'{unit}' is not a unit of {wanted.name}: expected {allowed}") from error


def parse(text: object, dimension: str, *, bare_unit: str | None = None) -> float:
    """Read a quantity such as ``"38 um"`` as an SI number.

    Parameters
    ----------
    text : object
        A text of a number and a unit; a bare number only where `bare_unit` is given.
    dimension : str
        One of `DIMENSIONS`.
    bare_unit : str, optional
        The unit of a number that comes without one.

    Returns
    -------
    float
        The value [SI], correctly rounded.

    Raises
    ------
    UnitError
        The text is no quantity, its unit is unknown, or it is of another dimension.

    Examples
    --------
    >>> parse("38 um", "length")
    3.8e-05
    >>> parse("71.7 GPa", "pressure")
    71700000000.0
    """
    wanted = DIMENSIONS.get(dimension) or MEASURED[dimension]
    example = f'"10 {wanted.units[0]}"'
    if isinstance(text, bool) or not isinstance(text, (str, int, float)):
        raise UnitError(f"expected {wanted.noun} such as {example}, got {shortened(text)}")
    # a number keeps its shortest digits: 0.1 is one tenth, and not its binary neighbour
    match = _QUANTITY.fullmatch(text if isinstance(text, str) else repr(text))
    if match is None:
        raise UnitError(f"expected {wanted.noun} such as {example}, got {shortened(text)}")
    number, unit = match.groups()
    if unit is None:
        if bare_unit is None:
            raise UnitError(
                f"the {wanted.name} {shortened(text)} has no unit: write it as "
                f'"{number} {wanted.units[0]}"'
            )
        unit = bare_unit
    value = float(Decimal(number) * factor_of(unit, dimension))
    if not math.isfinite(value):
        raise UnitError(f"the {wanted.name} {shortened(text)} is too large to be a number")
    return value


def exact_quantity(text: str) -> tuple[Fraction, str]:
    """Read a number, or a quantity of any dimension, without rounding it.

    Parameters
    ----------
    text : str
        A number, and a unit of one of `DIMENSIONS` if it has one.

    Returns
    -------
    value : Fraction
        The value [SI]; its float is what `parse` gives.
    dimension : str
        Its name; empty for a number.

    Raises
    ------
    UnitError
        The text is no quantity, or no dimension has the unit.

    Examples
    --------
    >>> exact_quantity("0.45 mm")
    (Fraction(9, 20000), 'length')
    """
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise UnitError(f'expected a quantity such as "10 mm", or a number, got {shortened(text)}')
    number, unit = match.groups()
    if unit is None:
        return Fraction(Decimal(number)), ""
    dimension = _dimension_of_unit(unit)
    return Fraction(Decimal(number) * factor_of(unit, dimension)), dimension


@lru_cache(maxsize=256)
def _dimension_of_unit(unit: str) -> str:
    for name in DIMENSIONS:
        try:
            factor_of(unit, name)
        except UnitError:
            continue
        return name
    known = sorted({u for d in DIMENSIONS.values() for u in d.units})
    hint = did_you_mean(unit, known)
    raise UnitError(f"unknown unit '{unit}': expected one such as mm, deg, N/um or MPa{hint}")


def to_text(value: float, dimension: str, unit: str | None = None) -> str:
    """Write an SI number as text that `parse` reads back to the same bits.

    Parameters
    ----------
    value : float
        The value [SI].
    dimension : str
        One of `DIMENSIONS`.
    unit : str, optional
        The unit to write in; the usual one of the dimension where not given.

    Returns
    -------
    str
        Number and unit. The SI unit is used where the wanted one would lose a bit.

    Examples
    --------
    >>> to_text(3.8e-05, "length", "um")
    '38 um'
    """
    wanted = DIMENSIONS[dimension]
    for name in (unit or wanted.units[0], wanted.si):
        number = Decimal(repr(float(value))) / factor_of(name, dimension)
        # the fewest digits that come back to the same bits: 90 deg, not 89.99999999999999889812643
        for digits in (12, 15, 17, 28):
            text = f"{_plain(Context(prec=digits).create_decimal(number))} {name}"
            if parse(text, dimension) == value:
                return text
    return f"{float(value)!r} {wanted.si}"


def _plain(number: Decimal) -> str:
    number = number.normalize()
    digits = f"{number:f}"
    return digits if len(digits) <= 24 else f"{number:e}"


def point_hint(text: str) -> str:
    """Return the end of a message on a text that has a decimal comma; nothing for any other.

    Examples
    --------
    >>> point_hint("0,5 mm"), point_hint("1, 2")
    (', whose decimal sign must be a point', '')
    """
    comma = re.fullmatch(r"\s*[+-]?\d+,\d+[^,]*", text)
    return ", whose decimal sign must be a point" if comma else ""


def shortened(value: object) -> str:
    """Write a value for a message."""
    text = repr(value)
    return (text if len(text) <= 60 else text[:57] + "...") + point_hint(str(value))
