"""In which units a person reads the front panel, and on which ground."""

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

from flexstage.quantities.quantity import Quantity, display

AUTOMATIC = "auto"
#: Units of lengths and angles that can be chosen, and what an SI value is multiplied by.
LENGTHS = MappingProxyType({"nm": 1e9, "µm": 1e6, "mm": 1e3})
ANGLES = MappingProxyType({"µrad": 1e6, "mrad": 1e3, "arcsec": 206264.80624709636})
#: A page that follows the setting of the computer, or does not.
LOOKS = ("auto", "light", "dark")


@dataclass(frozen=True, slots=True, kw_only=True)
class Preferences:
    """Units and look that one person chose."""

    length: str = AUTOMATIC
    """One of `LENGTHS`, or `AUTOMATIC`: as each quantity is usually quoted."""
    angle: str = AUTOMATIC
    """One of `ANGLES`, or `AUTOMATIC`."""
    look: Literal["auto", "light", "dark"] = "auto"
    """Ground of the page."""

    @property
    def dark(self) -> bool | None:
        """Whether the page is dark; None where the computer decides."""
        return {"auto": None, "light": False, "dark": True}[self.look]

    def shown(self, quantity: Quantity | str) -> Quantity:
        """Return a quantity in the unit that was chosen for its kind.

        Examples
        --------
        >>> arcsec = Preferences(angle="arcsec")
        >>> arcsec.shown("parasitic_rotation").text(4.85e-6), arcsec.shown("pitch").shown_unit
        ('1.000', 'arcsec')
        """
        known = display(quantity) if isinstance(quantity, str) else quantity
        for unit, chosen, units in (("m", self.length, LENGTHS), ("rad", self.angle, ANGLES)):
            if known.unit == unit and chosen != AUTOMATIC:
                return replace(known, shown_unit=chosen, factor=units[chosen])
        return known

    def length_unit(self) -> tuple[str, float]:
        """Return the unit of lengths and its factor, for axes."""
        unit = "µm" if self.length == AUTOMATIC else self.length
        return unit, LENGTHS[unit]

    def angle_unit(self) -> tuple[str, float]:
        """Return the unit of angles and its factor, for axes."""
        unit = "µrad" if self.angle == AUTOMATIC else self.angle
        return unit, ANGLES[unit]
