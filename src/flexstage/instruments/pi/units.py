"""Units of the wire: in which unit an axis counts, and how values are written in it."""

import math
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import ControllerError
from flexstage.instruments.pi.replies import excerpt

Range = tuple[float, float]

#: Metres of the units in which controllers count along a line.
METRES = MappingProxyType(
    {
        "m": 1.0,
        "mm": 1e-3,
        "um": 1e-6,
        "\N{MICRO SIGN}m": 1e-6,
        "\N{GREEK SMALL LETTER MU}m": 1e-6,
        "micron": 1e-6,
        "microns": 1e-6,
        "micrometer": 1e-6,
        "nm": 1e-9,
    }
)
_TURNS = ("deg", "degree", "degrees", "\N{DEGREE SIGN}", "rad", "mrad", "urad", "arcsec")


@dataclass(frozen=True, slots=True, kw_only=True)
class WireUnit:
    """A unit of the wire.

    Examples
    --------
    >>> um = WireUnit(factor=1e-6, decimals=6)
    >>> um.text(12.5e-6), um.text(99.9999996e-6, (0.0, 99.9999996e-6))
    ('12.5', '99.999999')
    """

    factor: float
    """SI value of one of it."""
    decimals: int
    """Digits behind the point that are sent."""

    def text(self, value: float, bounds: Range | None = None) -> str:
        """Return a value [SI] as it is sent; rounding does not leave the bounds."""
        return self.texts(np.array([value]), bounds)[0]

    def texts(self, values: NDArray[np.float64], bounds: Range | None = None) -> list[str]:
        """Return values [SI], shape (n,), as they are sent: no exponents, no zeros at the end."""
        scale = 10.0**self.decimals
        steps = np.round(np.asarray(values, dtype=np.float64) / self.factor * scale)
        if bounds is not None:
            # what is a rounding error away from a step of the wire is on it
            low = math.ceil(bounds[0] / self.factor * scale - 1e-3)
            high = math.floor(bounds[1] / self.factor * scale + 1e-3)
            steps = np.clip(steps, low, high) if low <= high else steps
        pattern = f"%.{self.decimals}f"
        texts = [(pattern % v).rstrip("0").rstrip(".") for v in (steps / scale).tolist()]
        return ["0" if text in ("-0", "") else text for text in texts]


#: Voltages, to a microvolt.
VOLTS = WireUnit(factor=1.0, decimals=6)


def axis_unit(text: str, axis: str, name: str) -> WireUnit:
    """Return the unit in which an axis counts by its answer to ``PUN?``, down to a picometre.

    Examples
    --------
    >>> axis_unit("UM", "1", "x").factor
    1e-06
    """
    word = text.strip().lower()
    # a micro sign arrives in one byte, or in the two of UTF-8 read as latin-1
    factor = METRES.get(word.replace("\N{LATIN SMALL LETTER A WITH CIRCUMFLEX}", ""))
    if factor is None:
        turns = "it turns" if word in _TURNS else "this is no unit of length that is known"
        raise ControllerError(
            f"axis '{axis}' of the controller counts in {excerpt(text)}: {turns}, and axis "
            f"'{name}' of the stage moves along a line; name the right one with axes={{...}}"
        )
    return WireUnit(factor=factor, decimals=round(12.0 + math.log10(factor)))
