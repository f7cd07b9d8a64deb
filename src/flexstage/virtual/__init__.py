"""The stage as manufactured: scatter, guide errors, stacks, sensors, hammer, and a rotary table.

It runs sample by sample with position control (`virtual_stage`), or returns quasi-static records of
measurements, many stages per second. All results are marked as simulated.
"""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.virtual.as_built import AsBuilt, as_built
    from flexstage.virtual.build import virtual_stage
    from flexstage.virtual.imperfections import Scatter
    from flexstage.virtual.stack import VirtualStack, virtual_stack
    from flexstage.virtual.stage import VirtualStage
    from flexstage.virtual.table import (
        TableMounting,
        VirtualBench,
        VirtualPositioner,
        VirtualTable,
        scale_errors,
    )

__all__ = [
    "AsBuilt",
    "Scatter",
    "TableMounting",
    "VirtualBench",
    "VirtualPositioner",
    "VirtualStack",
    "VirtualStage",
    "VirtualTable",
    "as_built",
    "scale_errors",
    "virtual_stack",
    "virtual_stage",
]

import_on_use(__name__)
