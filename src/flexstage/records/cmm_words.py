"""Words in reports of coordinate measuring machines, of several languages."""

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


#: Axes that are kept: coordinates, diameter, radius, length, height, distance or form (M), angles.
AXES = _words("X Y Z D R A L H M T PR PA PX PY PZ")
#: Those of them that are angles.
ANGLES = _words("A PA")
#: Rows of tables of position that are no coordinate.
LEFT_OUT = _words("TP DF DD D1 D2 D3 LD LF WD WF DS RS RT S V MM")

_ROLES: Mapping[str, frozenset[str]] = {
    "feature": _words(
        "feature featurename featureid element elementname merkmal merkmalsname caracteristique "
        "elemento caratteristica caracteristica"
    ),
    "axis": _words(
        "ax axis achse axe asse eje coordinate coordonnee koordinate"  # codespell:ignore koordinate
    ),
    "nominal": _words(
        "nominal nom nominalvalue nominale nenn nennmass nennwert soll sollmass sollwert theo "
        "theoretical theorique cotenominale valeurnominale valorenominale valornominal"
    ),
    "measured": _words(
        "meas measured measuredvalue measurement actual act actualvalue ist istmass istwert mess "
        "messwert gemessen mesuree valeurmesuree reel reelle misurato medido "
        "mes mesure"  # codespell:ignore mesure
    ),
    "deviation": _words(
        "dev deviation abw abweichung ecart error diff difference differenz scarto desviacion"
    ),
    "unit": _words("unit units einheit einheiten unite unites unita unidad unidades"),
}
_AXIS_WORDS = {
    "diameter": "D",
    "durchmesser": "D",
    "diametre": "D",
    "radius": "R",
    "rayon": "R",
    "angle": "A",
    "winkel": "A",
    "length": "L",
    "lange": "L",
    "longueur": "L",
}
# reports print units in capitals, which elsewhere mean something else
_UNITS = {"mm": "mm", "in": "inch", "inch": "inch", "inches": "inch", "cm": "cm", "deg": "deg"}


@dataclass(frozen=True, slots=True, kw_only=True)
class CoordinateReading:
    """One value that a measuring machine reports."""

    feature: str
    """What was measured."""
    axis: str
    """Which coordinate of it."""
    nominal: float
    """Where it should be, in `unit`."""
    measured: float
    """Where it is, in `unit`."""
    unit: str = ""
    """The unit, where the report says it."""


def plain_word(text: str) -> str:
    """Return a word without case, accents and signs.

    Examples
    --------
    >>> plain_word("Nennmaß"), plain_word("Valeur mesurée")
    ('nennmass', 'valeurmesuree')
    """
    bare = unicodedata.normalize("NFKD", text.casefold())
    return "".join(c for c in bare if c.isalnum() and c.isascii())


def role(heading: str) -> str:
    """Return which column a heading without its unit is over; nothing where it is of no report.

    Examples
    --------
    >>> role("Istmaß"), role("+TOL")
    ('measured', '')
    """
    # a sign before a word makes it another: "+TOL", "-Dev"
    word = "" if heading.strip().startswith(("+", "-")) else plain_word(heading)
    return next((name for name, words in _ROLES.items() if word in words), "")


def axis_name(text: str) -> str:
    """Return the letter of an axis; the text in capitals where that is not known.

    Examples
    --------
    >>> axis_name("x axis"), axis_name("Durchmesser"), axis_name("Q")
    ('X', 'D', 'Q')
    """
    word = plain_word(text)
    short = re.fullmatch(r"(?:axe|axis|achse)?([xyz])(?:axe|axis|achse)?", word)
    if short is not None:
        return short[1].upper()
    return _AXIS_WORDS.get(word, text.strip().upper())


def printed_unit(text: str) -> str:
    """Return a unit that a report prints; the text where it is none of a report.

    Examples
    --------
    >>> printed_unit("MM"), printed_unit("µm")
    ('mm', 'µm')
    """
    return _UNITS.get(text.strip().casefold(), text.strip())
