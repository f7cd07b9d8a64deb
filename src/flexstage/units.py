"""Quantities with units as text, read and written at the edge and nowhere else.

Inside the package every number is SI (angles in rad, frequencies in Hz). A stage file or a command
line says ``"38 um"``; `parse` turns that into ``3.8e-05`` and `to_text` turns it back, digit for
digit: numbers are scaled as decimals, so no rounding is added by the unit.

Hertz is never converted to rad/s here: a units library treats the radian as the number one and
would say that 339 Hz is 339 rad/s.
"""

import difflib
import math
import re
from dataclasses import dataclass
from decimal import Context, Decimal
from functools import lru_cache
from typing import Any

from flexstage.errors import UnitError

__all__ = ["DIMENSIONS", "Dimension", "parse", "to_text"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Dimension:
    """A physical dimension that a field of a description can have.

    Parameters
    ----------
    name : str
        What it is called in messages.
    si : str
        The SI unit in which numbers of it are held.
    units : tuple of str
        Units that people write, the first of which files are written in.
    """

    name: str
    si: str
    units: tuple[str, ...]

    @property
    def noun(self) -> str:
        """Its name with the article."""
        return f"{'an' if self.name[0] in 'aeiou' else 'a'} {self.name}"


DIMENSIONS: dict[str, Dimension] = {
    d.name: d
    for d in (
        Dimension(name="length", si="m", units=("mm", "um", "nm", "m", "inch")),
        Dimension(name="angle", si="rad", units=("deg", "rad", "mrad", "urad", "arcsec", "arcmin")),
        Dimension(name="mass", si="kg", units=("g", "kg", "mg")),
        Dimension(name="inertia", si="kg*m^2", units=("g*mm^2", "kg*m^2")),
        Dimension(name="force", si="N", units=("N", "mN", "kN")),
        Dimension(name="stiffness", si="N/m", units=("N/um", "N/mm", "N/m", "kN/mm")),
        Dimension(name="pressure", si="Pa", units=("MPa", "GPa", "Pa", "kPa")),
        Dimension(name="density", si="kg/m^3", units=("kg/m^3", "g/cm^3")),
        Dimension(name="voltage", si="V", units=("V", "mV", "kV")),
        Dimension(name="capacitance", si="F", units=("uF", "nF", "F")),
        Dimension(name="frequency", si="Hz", units=("Hz", "kHz", "MHz")),
        Dimension(name="expansion", si="1/K", units=("1/K", "um/m/K")),
        Dimension(name="drift", si="m/K", units=("nm/K", "um/K", "m/K")),
        Dimension(name="conductivity", si="W/m/K", units=("W/m/K",)),
    )
}

_NUMBER = r"[+-]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][+-]?\d{1,3})?"
_UNIT = r"(?:1|[A-Za-zµμ°]{1,20}(?:\^?-?[1-4])?)(?:[*·/][A-Za-zµμ°]{1,20}(?:\^?-?[1-4])?){0,4}"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*({_UNIT})?\s*")


@lru_cache(maxsize=1)
def _registry() -> Any:
    # pint is a third of a second to import and is needed only where text is read
    import pint

    decimal: Any = Decimal  # allowed by pint, but for its annotation
    return pint.UnitRegistry(non_int_type=decimal)


@lru_cache(maxsize=512)
def _factor(unit: str, dimension: str) -> Decimal:
    """Return how many SI units of a dimension one `unit` is."""
    import pint

    wanted = DIMENSIONS[dimension]
    spelled = unit.replace("°", "deg").replace("·", "*")
    spelled = re.sub(r"(?<=[A-Za-zµμ])(-?[1-4])(?![0-9])", r"^\1", spelled)
    known = sorted({u for d in DIMENSIONS.values() for u in d.units})
    allowed = f"{wanted.noun} in {', '.join(wanted.units)}"
    try:
        quantity = _registry().Quantity(Decimal(1), spelled)
    except Exception as error:  # pint raises tokenizer, attribute and assertion errors alike
        near = difflib.get_close_matches(unit, known, n=1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        raise UnitError(f"unknown unit '{unit}': expected {allowed}{hint}") from error
    angles = ("rad", "deg", "arc", "turn", "rev", "grad", "cycle", "rpm")
    is_angle = any(word in spelled.lower() for word in angles)
    # the radian is the number one to pint, so angles and frequencies are told apart by name
    if is_angle != (dimension == "angle"):
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
    wanted = DIMENSIONS[dimension]
    example = f'"10 {wanted.units[0]}"'
    if isinstance(text, bool) or not isinstance(text, (str, int, float)):
        raise UnitError(f"expected {wanted.noun} such as {example}, got {_short(text)}")
    # a number keeps its shortest digits: 0.1 is one tenth, and not its binary neighbour
    match = _QUANTITY.fullmatch(text if isinstance(text, str) else repr(text))
    if match is None:
        raise UnitError(f"expected {wanted.noun} such as {example}, got {_short(text)}")
    number, unit = match.groups()
    if unit is None:
        if bare_unit is None:
            raise UnitError(
                f"the {wanted.name} {_short(text)} has no unit: write it as "
                f'"{number} {wanted.units[0]}"'
            )
        unit = bare_unit
    value = float(Decimal(number) * _factor(unit, dimension))
    if not math.isfinite(value):
        raise UnitError(f"the {wanted.name} {_short(text)} is too large to be a number")
    return value


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
        number = Decimal(repr(float(value))) / _factor(name, dimension)
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


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
