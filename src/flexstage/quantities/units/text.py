"""Quantities with units as text: reading and writing without loss, and units of columns in SI."""

import math
import re
from decimal import Context, Decimal
from fractions import Fraction
from functools import lru_cache
from typing import Any

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import UnitError
from flexstage.quantities.units.dimension import DIMENSIONS, MEASURED, Dimension

_NUMBER = r"[+-]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][+-]?\d{1,3})?"
#: Pattern of a unit.
UNIT = r"(?:1|[A-Za-zµμ°]{1,20}(?:\^?-?[1-4])?)(?:[*·/][A-Za-zµμ°]{1,20}(?:\^?-?[1-4])?){0,4}"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*({UNIT})?\s*")

# small values are printed with a prefix to these SI units, the largest prefix first
_PREFIXED = frozenset(("m", "s", "V", "A", "rad"))
_PREFIXES = (("m", 1e3), ("u", 1e6), ("n", 1e9), ("p", 1e12))
#: Values from this size on keep the SI unit.
_LARGE = 0.05

#: Words for a turn as a unit.
TURN_WORDS = ("turn", "turns", "rev", "revs", "revolution", "revolutions")

# dimensionless units, which a units library does not distinguish from an angle, and a scale with an
# offset
_PLAIN: dict[str, tuple[float, str]] = {
    **dict.fromkeys(("1", "-", "none", "strain", "m/m"), (1.0, "1")),
    **dict.fromkeys(("%", "percent", "pct"), (0.01, "1")),
    **dict.fromkeys(("ppm", "ustrain", "microstrain", "um/m", "ue"), (1e-6, "1")),
    **dict.fromkeys(("count", "counts", "cts", "lsb", "adu", "digits"), (1.0, "count")),
    **dict.fromkeys(("degc", "deg c", "celsius"), (1.0, "degC")),
    **dict.fromkeys(TURN_WORDS, (2.0 * math.pi, "rad")),
}

_SYMBOLS = {"²": "^2", "³": "^3", "\N{GREEK SMALL LETTER MU}": "µ", "Ω": "ohm", "ε": "e"}

# units of columns, by the names of the units library: it reads "d" as a day and "c" as the speed of
# light, which a heading in brackets seldom means
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

_OF_ANGLES = frozenset(("angle", "rotational stiffness"))
_WITHOUT_PREFIX = frozenset(("inch", "minute", "hour", "degree", "kilogram", "force_kilogram"))


@lru_cache(maxsize=1)
def units_library() -> Any:
    """Return the registry of the units library."""
    # pint is a third of a second to import and is needed only where text is read
    import pint

    decimal: Any = Decimal  # pint accepts it, its annotation does not
    return pint.UnitRegistry(non_int_type=decimal)


def _dimension(name: str) -> Dimension:
    return DIMENSIONS.get(name) or MEASURED[name]


@lru_cache(maxsize=512)
def factor_of(unit: str, dimension: str) -> Decimal:
    """Return the number of SI units of a dimension in one `unit`."""
    import pint

    target = _dimension(dimension)
    spelled = unit.replace("°", "deg").replace("·", "*")
    spelled = re.sub(r"(?<=[A-Za-zµμ])(-?[1-4])(?![0-9])", r"^\1", spelled)
    known = sorted({u for d in DIMENSIONS.values() for u in d.units})
    allowed = f"{target.noun} in {', '.join(target.units)}"
    try:
        quantity = units_library().Quantity(Decimal(1), spelled)
    except Exception as error:  # pint raises tokenizer, attribute and assertion errors
        hint = did_you_mean(unit, known)
        raise UnitError(f"unknown unit '{unit}': expected {allowed}{hint}") from error
    angles = ("rad", "deg", "arc", "turn", "rev", "grad", "cycle", "rpm")
    is_angle = any(word in spelled.lower() for word in angles)
    # the radian is the number one to pint, so names distinguish angles from frequencies
    if is_angle != (dimension.startswith("angular") or dimension in _OF_ANGLES):
        raise UnitError(f"'{unit}' is not a unit of {target.name}: expected {allowed}")
    try:
        return quantity.to(target.si).magnitude
    except (pint.DimensionalityError, pint.OffsetUnitCalculusError) as error:
        raise UnitError(f"'{unit}' is not a unit of {target.name}: expected {allowed}") from error


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
    target = _dimension(dimension)
    example = f'"10 {target.units[0]}"'
    if isinstance(text, bool) or not isinstance(text, (str, int, float)):
        raise UnitError(f"expected {target.noun} such as {example}, got {shortened(text)}")
    # a number keeps its shortest digits: 0.1 is one tenth, and not its binary neighbour
    match = _QUANTITY.fullmatch(text if isinstance(text, str) else repr(text))
    if match is None:
        raise UnitError(f"expected {target.noun} such as {example}, got {shortened(text)}")
    number, unit = match.groups()
    if unit is None:
        if bare_unit is None:
            raise UnitError(
                f"the {target.name} {shortened(text)} has no unit: write it as "
                f'"{number} {target.units[0]}"'
            )
        unit = bare_unit
    value = float(Decimal(number) * factor_of(unit, dimension))
    if not math.isfinite(value):
        raise UnitError(f"the {target.name} {shortened(text)} is too large to be a number")
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
        Name of the dimension; empty for a number.

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
        Number and unit. The SI unit is used where the requested one would lose a bit.

    Examples
    --------
    >>> to_text(3.8e-05, "length", "um")
    '38 um'
    """
    target = DIMENSIONS[dimension]
    for name in (unit or target.units[0], target.si):
        number = Decimal(repr(float(value))) / factor_of(name, dimension)
        # the fewest digits that come back to the same bits: 90 deg, not 89.99999999999999889812643
        for digits in (12, 15, 17, 28):
            text = f"{_plain(Context(prec=digits).create_decimal(number))} {name}"
            if parse(text, dimension) == value:
                return text
    return f"{float(value)!r} {target.si}"


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


def readable_text(value: float, dimension: str) -> str:
    """Write an SI number as `to_text` does, in the most readable unit.

    Parameters
    ----------
    value : float
        The value [SI].
    dimension : str
        One of `DIMENSIONS`.

    Returns
    -------
    str
        Number and unit, which `parse` reads back to the same bits: the usual unit where the number
        is then from 0.1 to below 10 000, else the unit with the fewest digits.

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
    """Return a unit with the prefix that suits a size.

    Parameters
    ----------
    size : float
        The size [`unit`].
    unit : str
        An SI unit, or one over another; any other text is kept.

    Returns
    -------
    str and float
        The unit, and its number in one `unit`.

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
    """Write values in one unit, with a prefix that suits the largest of them.

    Parameters
    ----------
    unit : str
        SI unit of the values; empty if unknown.
    *values : float
        A value, or the ends of a range.
    digits : int
        Significant digits.

    Returns
    -------
    str
        The values, joined by "to", and the unit.

    Examples
    --------
    >>> readable("m", 6.71e-07), readable("m", -2e-05, 2e-05), readable("V", 0.168871, 3.51037)
    ('671 nm', '-20 to 20 um', '0.169 to 3.51 V')
    """
    name, factor = readable_unit(max(values, key=abs), unit)
    rounded = (float(f"{value * factor:.{digits}g}") for value in values)
    # no power of ten where digits end before the decimal point
    return f"{' to '.join(f'{value:.15g}' for value in rounded)} {name}".rstrip()


@lru_cache(maxsize=256)
def si_unit(text: str) -> tuple[float, str]:
    """Return the SI equivalent of the unit in the heading of a column.

    Units of `DIMENSIONS` are known, and those of current, charge, temperature, strain, per cent,
    counts and turns. A degree Celsius is kept, as no factor removes its offset.

    Parameters
    ----------
    text : str
        The unit, ``"um"``, ``"kN/mm"`` or ``"Volts"``.

    Returns
    -------
    factor : float
        Number of SI units in one unit.
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
    if re.fullmatch(UNIT, words) and _is_measured(words):
        for dimension in (*DIMENSIONS.values(), *MEASURED.values()):
            try:
                return float(factor_of(words, dimension.name)), dimension.si
            except UnitError:
                continue
    raise UnitError(
        f"unknown unit {shortened(text)}: expected one such as V, mV, um, nm, N, s, ms, Hz, A, K, "
        "%, or count"
    )


def dimensions(si: str) -> dict[str, float]:
    """Return the powers of the base quantities in an SI unit.

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
    unit = "K" if si == "degC" else si
    powers = units_library().Quantity(Decimal(1), unit).dimensionality
    return {base: float(power) for base, power in powers.items() if power}


def _is_measured(unit: str) -> bool:
    """Say whether every part of a unit is one that columns are measured in."""
    for word in re.findall("[A-Za-zµ°]+", unit):
        try:
            meanings = units_library().parse_unit_name(word.replace("°", "deg"))
        except Exception:  # noqa: BLE001 - pint raises tokenizer and assertion errors
            return False
        if not meanings:
            return False
        prefix, atom, _ = meanings[0]
        # "ch" is no hundredth of an hour but a channel
        if atom not in _KNOWN_ATOMS or (prefix and atom in _WITHOUT_PREFIX):
            return False
    return not re.search(r"[A-Za-z]1", unit)
