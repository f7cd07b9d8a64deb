"""Quantities with units as text, read and written at the edge and nowhere else.

Inside the package every number is SI (angles in rad, frequencies in Hz). A stage file or a command
line says ``"38 um"``; `parse` turns that into ``3.8e-05`` and `to_text` turns it back, digit for
digit: numbers are scaled as decimals, so no rounding is added by the unit.

Hertz is never converted to rad/s here: a units library treats the radian as the number one and
would say that 339 Hz is 339 rad/s.
"""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.quantities.units.columns import dimensions, si_unit
    from flexstage.quantities.units.dimension import (
        DIMENSIONS,
        Angle,
        Dimension,
        Frequency,
        Length,
        Stiffness,
        Time,
        Voltage,
    )
    from flexstage.quantities.units.readable import readable, readable_text, readable_unit
    from flexstage.quantities.units.text import exact_quantity, parse, to_text

__all__ = [
    "DIMENSIONS",
    "Angle",
    "Dimension",
    "Frequency",
    "Length",
    "Stiffness",
    "Time",
    "Voltage",
    "dimensions",
    "exact_quantity",
    "parse",
    "readable",
    "readable_text",
    "readable_unit",
    "si_unit",
    "to_text",
]

import_on_use(__name__)
