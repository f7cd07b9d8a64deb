"""How quantities are written for people, where the caller has no choice of his own."""

import math
from dataclasses import dataclass
from typing import Protocol

from flexstage.characteristic import QUANTITIES


class Shown(Protocol):
    """How a quantity is shown, such as `flexstage.report.quantities.Display`."""

    @property
    def label(self) -> str:
        """Its name in words."""
        ...

    @property
    def unit(self) -> str:
        """The unit that it is shown in; empty for a plain number."""
        ...

    @property
    def factor(self) -> float:
        """What a value in its own unit is multiplied by."""
        ...

    @property
    def zero(self) -> float:
        """Magnitude below which a value is rounding, in its own unit."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class _ByUnit:
    label: str
    unit: str
    factor: float
    zero: float = 0.0


_UNITS = {
    "m": ("µm", 1e6),
    "m^2": ("µm²", 1e12),
    "m/s": ("nm/s", 1e9),
    "m/K": ("nm/K", 1e9),
    "rad": ("µrad", 1e6),
    "Pa": ("MPa", 1e-6),
    "N/m": ("N/µm", 1e-6),
    "1": ("", 1.0),
}


def shown(quantity: str) -> Shown:
    """Return how a quantity is shown: by the size that its unit usually has on a flexure stage.

    Examples
    --------
    >>> found = shown("natural_frequency_hz")
    >>> found.label, found.unit, found.factor
    ('Natural frequency', 'Hz', 1.0)
    """
    own = QUANTITIES.get(quantity, "")
    unit, factor = _UNITS.get(own, (own, 1.0))
    words = quantity.removesuffix("_hz").replace("_", " ")
    return _ByUnit(label=words[:1].upper() + words[1:], unit=unit, factor=factor)


def plain_number(value: float, digits: int = 4) -> str:
    """Write a number with some significant digits, with an exponent outside of 1e-3 to 1e6.

    Examples
    --------
    >>> plain_number(64.6), plain_number(12345.6), plain_number(-2.8e-13)
    ('64.60', '12346', '-2.800e-13')
    """
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if not -3 <= exponent < 6:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(digits - 1 - exponent, 0)}f}"


def with_uncertainty(value: float, uncertainty: float) -> tuple[str, str]:
    """Write a value and its uncertainty with the same decimals: two digits of the uncertainty.

    Four digits of the value where it has none that tell, or far less than a millionth of it.

    Examples
    --------
    >>> with_uncertainty(338.9104, 0.243), with_uncertainty(63.12, 0.0)
    (('338.91', '0.24'), ('63.12', '0'))
    """
    if not (math.isfinite(value) and 0.0 < uncertainty < math.inf):
        return plain_number(value), plain_number(uncertainty, 2)
    last = math.floor(math.log10(float(f"{uncertainty:.1e}"))) - 1
    size = max(abs(value), uncertainty)
    first = math.floor(math.log10(size))
    if not -3 <= first < 6 or first - last > 6 or last > 0:
        return plain_number(value), plain_number(uncertainty, 2)
    return f"{value:.{-last}f}", f"{uncertainty:.{-last}f}"
