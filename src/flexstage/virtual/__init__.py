"""The stage as it was made: scatter, guide errors, stacks, sensors, hammer, and a table below it.

None of it is a measurement: what is simulated says so.
"""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.virtual.as_built import AsBuilt
    from flexstage.virtual.positioner import VirtualPositioner
    from flexstage.virtual.stack import VirtualStack, virtual_stack
    from flexstage.virtual.table import VirtualBench, VirtualTable, scale_errors

__all__ = [
    "AsBuilt",
    "VirtualBench",
    "VirtualPositioner",
    "VirtualStack",
    "VirtualTable",
    "scale_errors",
    "virtual_stack",
]

import_on_use(__name__)
