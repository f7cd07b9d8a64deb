"""Quantities with units as text, read and written at the edge and nowhere else.

Inside the package every number is SI (angles in rad, frequencies in Hz). A stage file or a command
line says ``"38 um"``; `parse` turns that into ``3.8e-05`` and `to_text` turns it back, digit for
digit: numbers are scaled as decimals, so no rounding is added by the unit.

Hertz is never converted to rad/s here: a units library treats the radian as the number one and
would say that 339 Hz is 339 rad/s.
"""

import math
import re
from dataclasses import dataclass
from decimal import Context, Decimal
from fractions import Fraction
from functools import lru_cache
from typing import Annotated, Any

from flexstage.choose import did_you_mean
from flexstage.errors import UnitError


@dataclass(frozen=True, slots=True, kw_only=True)
class Dimension:
    """A physical dimension that a field of a description can have."""

    name: str
    """What it is called in messages."""
    si: str
    """The SI unit in which numbers of it are held."""
    units: tuple[str, ...]
    """Units that people write, the first of which files are written in."""

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
        Dimension(name="rotational stiffness", si="N*m/rad", units=("N*m/rad",)),
        Dimension(name="pressure", si="Pa", units=("MPa", "GPa", "Pa", "kPa")),
        Dimension(name="density", si="kg/m^3", units=("kg/m^3", "g/cm^3")),
        Dimension(name="voltage", si="V", units=("V", "mV", "kV")),
        Dimension(name="capacitance", si="F", units=("uF", "nF", "F")),
        Dimension(name="frequency", si="Hz", units=("Hz", "kHz", "MHz")),
        Dimension(name="temperature", si="K", units=("K", "mK")),
        Dimension(name="expansion", si="1/K", units=("1/K", "um/m/K")),
        Dimension(name="drift", si="m/K", units=("nm/K", "um/K", "m/K")),
        Dimension(name="conductivity", si="W/m/K", units=("W/m/K",)),
        Dimension(name="area", si="m^2", units=("um^2", "mm^2", "m^2")),
        Dimension(name="speed", si="m/s", units=("nm/s", "um/s", "mm/s", "m/s")),
        Dimension(name="slew rate", si="V/s", units=("V/s", "V/ms")),
        Dimension(name="time", si="s", units=("s", "ms", "us", "min", "hour")),
    )
}

#: SI floats whose text at the edge carries a unit.
Angle = Annotated[float, DIMENSIONS["angle"]]
Frequency = Annotated[float, DIMENSIONS["frequency"]]
Length = Annotated[float, DIMENSIONS["length"]]
Stiffness = Annotated[float, DIMENSIONS["stiffness"]]
Time = Annotated[float, DIMENSIONS["time"]]
Voltage = Annotated[float, DIMENSIONS["voltage"]]

# dimensions of columns in measured files; no field of a description has them
_MEASURED: dict[str, Dimension] = {
    d.name: d
    for d in (
        Dimension(name="current", si="A", units=("A", "mA")),
        Dimension(name="charge", si="C", units=("C", "uC")),
        Dimension(name="resistance", si="ohm", units=("ohm", "kohm")),
        Dimension(name="power", si="W", units=("W", "mW")),
        Dimension(name="temperature", si="K", units=("K", "mK")),
        Dimension(name="torque", si="N*m", units=("N*m", "N*mm")),
        Dimension(name="acceleration", si="m/s^2", units=("m/s^2", "mm/s^2")),
        Dimension(name="angular speed", si="rad/s", units=("rad/s", "deg/s", "rpm")),
        Dimension(name="gain", si="m/V", units=("um/V", "nm/V")),
    )
}

# plain numbers, which a units library does not tell from an angle, and a scale with an offset
_PLAIN: dict[str, tuple[float, str]] = {
    **dict.fromkeys(("1", "-", "none", "strain", "m/m"), (1.0, "1")),
    **dict.fromkeys(("%", "percent", "pct"), (0.01, "1")),
    **dict.fromkeys(("ppm", "ustrain", "microstrain", "um/m", "ue"), (1e-6, "1")),
    **dict.fromkeys(("count", "counts", "cts", "lsb", "adu", "digits"), (1.0, "count")),
    **dict.fromkeys(("degc", "deg c", "celsius"), (1.0, "degC")),
}

# what small values are printed in: units of these SI units, the largest first
_PREFIXED = frozenset(("m", "s", "V", "A", "rad"))
_PREFIXES = (("m", 1e3), ("u", 1e6), ("n", 1e9), ("p", 1e12))
#: Values from this size on keep the SI unit.
_LARGE = 0.05

_SYMBOLS = {"²": "^2", "³": "^3", "\N{GREEK SMALL LETTER MU}": "µ", "Ω": "ohm", "ε": "e"}

# what a column may be measured in, by the units library's own names: it knows a day as "d" and the
# speed of light as "c", which a heading in brackets seldom means
_KNOWN_ATOMS = frozenset(
    [
        "meter",
        "micron",
        "inch",
        "gram",
        "newton",
        "pascal",
        "bar",
        "pound_force_per_square_inch",
        "volt",
        "farad",
        "hertz",
        "kelvin",
        "watt",
        "second",
        "minute",
        "hour",
        "ampere",
        "coulomb",
        "ohm",
        "radian",
        "degree",
        "arcsecond",
        "arcminute",
        "revolutions_per_minute",
        "kilogram",
        "force_kilogram",
    ]
)

_WITHOUT_PREFIX = frozenset(("inch", "minute", "hour", "degree", "kilogram", "force_kilogram"))

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

    wanted = DIMENSIONS.get(dimension) or _MEASURED[dimension]
    spelled = unit.replace("°", "deg").replace("·", "*")
    spelled = re.sub(r"(?<=[A-Za-zµμ])(-?[1-4])(?![0-9])", r"^\1", spelled)
    known = sorted({u for d in DIMENSIONS.values() for u in d.units})
    allowed = f"{wanted.noun} in {', '.join(wanted.units)}"
    try:
        quantity = _registry().Quantity(Decimal(1), spelled)
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
    wanted = DIMENSIONS.get(dimension) or _MEASURED[dimension]
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
        raise UnitError(f'expected a quantity such as "10 mm", or a number, got {_short(text)}')
    number, unit = match.groups()
    if unit is None:
        return Fraction(Decimal(number)), ""
    dimension = _dimension_of_unit(unit)
    return Fraction(Decimal(number) * _factor(unit, dimension)), dimension


@lru_cache(maxsize=256)
def _dimension_of_unit(unit: str) -> str:
    for name in DIMENSIONS:
        try:
            _factor(unit, name)
        except UnitError:
            continue
        return name
    known = sorted({u for d in DIMENSIONS.values() for u in d.units})
    hint = did_you_mean(unit, known)
    raise UnitError(f"unknown unit '{unit}': expected one such as mm, deg, N/um or MPa{hint}")


@lru_cache(maxsize=256)
def si_unit(text: str) -> tuple[float, str]:
    """Return what a unit, written over a column of numbers, is in SI.

    Every unit of `DIMENSIONS` is known, and those of time, current, charge, speed, temperature,
    strain, per cent and counts. A degree Celsius stays one, as no factor takes its offset away.

    Parameters
    ----------
    text : str
        The unit, ``"um"``, ``"kN/mm"`` or ``"Volts"``.

    Returns
    -------
    factor : float
        The number of SI units that one of it is.
    unit : str
        The SI unit; ``"1"`` for plain numbers, ``"count"`` for steps of a converter.

    Raises
    ------
    UnitError
        No such unit is known.

    Examples
    --------
    >>> si_unit("um")
    (1e-06, 'm')
    >>> si_unit("%")
    (0.01, '1')
    """
    spelled = " ".join(text.split())
    for symbol, word in _SYMBOLS.items():
        spelled = spelled.replace(symbol, word)
    plain = _PLAIN.get(spelled.lower().replace("µ", "u").replace("°", "deg"))
    if plain is not None:
        return plain
    # "Volts" and "Newton" are words; MPA in capitals is left alone, as mPa is something else
    words = re.sub(r"\b[A-Z][a-z]{2,}\b", lambda word: word[0].lower(), spelled)
    if re.fullmatch(_UNIT, words) and _is_measured(words):
        for wanted in (*DIMENSIONS.values(), *_MEASURED.values()):
            try:
                return float(_factor(words, wanted.name)), wanted.si
            except UnitError:
                continue
    raise UnitError(
        f"unknown unit {_short(text)}: expected one such as V, mV, um, nm, N, s, ms, Hz, A, K, %, "
        "or count"
    )


def dimensions(si: str) -> dict[str, float]:
    """Return the powers of the base quantities that an SI unit is made of.

    Parameters
    ----------
    si : str
        A unit as `si_unit` returns it.

    Returns
    -------
    dict
        Powers other than 0 by base quantity, ``"[length]"`` and so on; none for plain numbers,
        counts and angles. A degree Celsius is a kelvin.

    Examples
    --------
    >>> dimensions("N/m")
    {'[mass]': 1.0, '[time]': -2.0}
    """
    if si in ("", "1", "count"):
        return {}
    found = _registry().Quantity(Decimal(1), "K" if si == "degC" else si).dimensionality
    return {base: float(power) for base, power in found.items() if power}


def _is_measured(unit: str) -> bool:
    """Say whether every part of a unit is one that columns are measured in."""
    for word in re.findall("[A-Za-zµ°]+", unit):
        try:
            meanings = _registry().parse_unit_name(word.replace("°", "deg"))
        except Exception:  # noqa: BLE001 - pint raises tokenizer and assertion errors alike
            return False
        if not meanings:
            return False
        prefix, atom, _ = meanings[0]
        # "ch" is no hundredth of an hour but a channel
        if atom not in _KNOWN_ATOMS or (prefix and atom in _WITHOUT_PREFIX):
            return False
    return not re.search(r"[A-Za-z]1", unit)


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


def readable_text(value: float, dimension: str) -> str:
    """Write an SI number as `to_text` does, in the unit in which it is easily read.

    Parameters
    ----------
    value : float
        The value [SI].
    dimension : str
        One of `DIMENSIONS`.

    Returns
    -------
    str
        Number and unit, which `parse` reads back to the same bits: in the usual unit where the
        number is from 0.1 to below 10 000 there, else in the unit with the fewest digits.

    Examples
    --------
    >>> readable_text(5e-4, "length"), readable_text(3.8e-05, "length")
    ('0.5 mm', '38 um')
    >>> readable_text(71.7e9, "pressure")
    '71.7 GPa'
    """
    first = to_text(value, dimension)
    if value == 0.0 or 0.1 <= abs(float(first.partition(" ")[0])) < 1e4:
        return first
    others = (to_text(value, dimension, u) for u in DIMENSIONS[dimension].units if u != "inch")
    return min(others, key=lambda text: len(text.partition(" ")[0]))


def readable_unit(size: float, unit: str) -> tuple[str, float]:
    """Return the unit that suits a size: a prefix where it is small.

    Parameters
    ----------
    size : float
        The size [`unit`].
    unit : str
        An SI unit, or one over another; any other text is kept.

    Returns
    -------
    str and float
        The unit, and how many of it one `unit` is.

    Examples
    --------
    >>> readable_unit(4.1e-5, "m"), readable_unit(1.4e-5, "m/V"), readable_unit(0.5, "V")
    (('um', 1000000.0), ('um/V', 1000000.0), ('V', 1.0))
    """
    if unit.partition("/")[0] in _PREFIXED and 0.0 < abs(size) < _LARGE:
        for prefix, factor in _PREFIXES:
            if abs(size) * factor >= 1.0:
                return prefix + unit, factor
    return unit, 1.0


def readable(unit: str, *values: float, digits: int = 3) -> str:
    """Write values in one unit that suits the largest of them, for people to read.

    Parameters
    ----------
    unit : str
        Their SI unit; empty where nobody has said.
    *values : float
        One value, or the ends of a range.
    digits : int
        Significant digits.

    Returns
    -------
    str
        The values with "to" between them, and the unit.

    Examples
    --------
    >>> readable("m", 6.71e-07), readable("m", -2e-05, 2e-05), readable("V", 0.168871, 3.51037)
    ('671 nm', '-20 to 20 um', '0.169 to 3.51 V')
    """
    name, factor = readable_unit(max(values, key=abs), unit)
    rounded = (float(f"{value * factor:.{digits}g}") for value in values)
    # no power of ten where digits end before the decimal point
    return f"{' to '.join(f'{value:.15g}' for value in rounded)} {name}".rstrip()


def _plain(number: Decimal) -> str:
    number = number.normalize()
    digits = f"{number:f}"
    return digits if len(digits) <= 24 else f"{number:e}"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
