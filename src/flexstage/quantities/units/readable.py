"""Numbers in the unit in which people read them easily."""

from flexstage.quantities.units.dimension import DIMENSIONS
from flexstage.quantities.units.text import to_text

# what small values are printed in: units of these SI units, the largest first
_PREFIXED = frozenset(("m", "s", "V", "A", "rad"))
_PREFIXES = (("m", 1e3), ("u", 1e6), ("n", 1e9), ("p", 1e12))
#: Values from this size on keep the SI unit.
_LARGE = 0.05


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
