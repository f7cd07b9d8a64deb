"""Data types of results: units, quantities, estimates with uncertainty, characteristics, tables."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.quantities.characteristic import Characteristic
    from flexstage.quantities.comparison import Comparison, compare
    from flexstage.quantities.estimate import Estimate
    from flexstage.quantities.material import Material
    from flexstage.quantities.quantity import QUANTITIES, Quantity
    from flexstage.quantities.table import Table

__all__ = [
    "QUANTITIES",
    "Characteristic",
    "Comparison",
    "Estimate",
    "Material",
    "Quantity",
    "Table",
    "compare",
]

import_on_use(__name__)
