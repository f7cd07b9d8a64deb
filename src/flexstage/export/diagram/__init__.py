"""The structural diagram of a stage: its equations as blocks and lines, and drawn."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.export.diagram.files import diagram_files
    from flexstage.export.diagram.graph import Block, BlockKind, Diagram, Group, Line
    from flexstage.export.diagram.page import Layout, layout
    from flexstage.export.diagram.stage_diagram import stage_diagram
    from flexstage.export.diagram.state_space import StateSpace, diagram_state_space
    from flexstage.export.diagram.svg import diagram_svg

__all__ = [
    "Block",
    "BlockKind",
    "Diagram",
    "Group",
    "Layout",
    "Line",
    "StateSpace",
    "diagram_files",
    "diagram_state_space",
    "diagram_svg",
    "layout",
    "stage_diagram",
]

import_on_use(__name__)
