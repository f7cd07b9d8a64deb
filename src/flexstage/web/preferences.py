"""Units and theme that a user of the front panel has selected."""

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

from flexstage.quantities.quantity import Quantity, display

AUTOMATIC = "auto"
#: Selectable units of lengths and angles, with the factor from SI.
LENGTHS = MappingProxyType({"nm": 1e9, "µm": 1e6, "mm": 1e3})
ANGLES = MappingProxyType({"µrad": 1e6, "mrad": 1e3, "arcsec": 206264.80624709636})
#: Themes; `auto` follows the setting of the computer.
THEMES = ("auto", "light", "dark")


@dataclass(frozen=True, slots=True, kw_only=True)
class Preferences:
    """Units and theme of one user."""

    length: str = AUTOMATIC
    """One of `LENGTHS`, or `AUTOMATIC`: the customary unit of each quantity."""
    angle: str = AUTOMATIC
    """One of `ANGLES`, or `AUTOMATIC`."""
    theme: Literal["auto", "light", "dark"] = "auto"
    """Theme of the page."""

    @property
    def dark(self) -> bool | None:
        """Dark page or not; None if the computer decides."""
        return {"auto": None, "light": False, "dark": True}[self.theme]

    def displayed(self, quantity: Quantity | str) -> Quantity:
        """Return a quantity with the unit that is selected for its dimension.

        Examples
        --------
        >>> arcsec = Preferences(angle="arcsec")
        >>> rotation, pitch = map(arcsec.displayed, ("parasitic_rotation", "pitch"))
        >>> rotation.text(4.85e-6), pitch.shown_unit
        ('1.000', 'arcsec')
        """
        customary = display(quantity) if isinstance(quantity, str) else quantity
        for unit, selected, units in (("m", self.length, LENGTHS), ("rad", self.angle, ANGLES)):
            if customary.unit == unit and selected != AUTOMATIC:
                return replace(customary, shown_unit=selected, factor=units[selected])
        return customary

    def length_unit(self) -> tuple[str, float]:
        """Return the unit of lengths and its factor, for axes."""
        unit = "µm" if self.length == AUTOMATIC else self.length
        return unit, LENGTHS[unit]

    def angle_unit(self) -> tuple[str, float]:
        """Return the unit of angles and its factor, for axes."""
        unit = "µrad" if self.angle == AUTOMATIC else self.angle
        return unit, ANGLES[unit]
