"""Quantities with units as text, in files and commands only.

Inside the package every number is SI (angles in rad, frequencies in Hz). A stage file or a command
line has ``"38 um"``; `parse` converts it to ``3.8e-05``, and `to_text` back to the same digits.
Numbers are scaled as decimals, so that the unit adds no rounding error.

Hertz is never converted to rad/s here: a units library treats the radian as the number one and
would say that 339 Hz is 339 rad/s.
"""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
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
    from flexstage.quantities.units.text import (
        dimensions,
        exact_quantity,
        parse,
        readable,
        readable_text,
        readable_unit,
        si_unit,
        to_text,
    )

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
