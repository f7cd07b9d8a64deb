"""What units over columns of measured numbers are in SI."""

import math
import re
from decimal import Decimal
from functools import lru_cache

from flexstage.base.errors import UnitError
from flexstage.quantities.units.dimension import DIMENSIONS, MEASURED
from flexstage.quantities.units.text import UNIT, factor_of, shortened, units_library

#: Words for a turn as a unit.
TURN_WORDS = ("turn", "turns", "rev", "revs", "revolution", "revolutions")

# plain numbers, which a units library does not tell from an angle, and a scale with an offset
_PLAIN: dict[str, tuple[float, str]] = {
    **dict.fromkeys(("1", "-", "none", "strain", "m/m"), (1.0, "1")),
    **dict.fromkeys(("%", "percent", "pct"), (0.01, "1")),
    **dict.fromkeys(("ppm", "ustrain", "microstrain", "um/m", "ue"), (1e-6, "1")),
    **dict.fromkeys(("count", "counts", "cts", "lsb", "adu", "digits"), (1.0, "count")),
    **dict.fromkeys(("degc", "deg c", "celsius"), (1.0, "degC")),
    **dict.fromkeys(TURN_WORDS, (2.0 * math.pi, "rad")),
}

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


@lru_cache(maxsize=256)
def si_unit(text: str) -> tuple[float, str]:
    """Return what a unit, written over a column of numbers, is in SI.

    Every unit of `DIMENSIONS` is known, and those of time, current, charge, speed, temperature,
    strain, per cent, counts and turns. A degree Celsius stays one, as no factor takes its offset
    away.

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
    if re.fullmatch(UNIT, words) and _is_measured(words):
        for wanted in (*DIMENSIONS.values(), *MEASURED.values()):
            try:
                return float(factor_of(words, wanted.name)), wanted.si
            except UnitError:
                continue
    raise UnitError(
        f"unknown unit {shortened(text)}: expected one such as V, mV, um, nm, N, s, ms, Hz, A, K, "
        "%, or count"
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
    found = units_library().Quantity(Decimal(1), "K" if si == "degC" else si).dimensionality
    return {base: float(power) for base, power in found.items() if power}


def _is_measured(unit: str) -> bool:
    """Say whether every part of a unit is one that columns are measured in."""
    for word in re.findall("[A-Za-zµ°]+", unit):
        try:
            meanings = units_library().parse_unit_name(word.replace("°", "deg"))
        except Exception:  # noqa: BLE001 - pint raises tokenizer and assertion errors alike
            return False
        if not meanings:
            return False
        prefix, atom, _ = meanings[0]
        # "ch" is no hundredth of an hour but a channel
        if atom not in _KNOWN_ATOMS or (prefix and atom in _WITHOUT_PREFIX):
            return False
    return not re.search(r"[A-Za-z]1", unit)
