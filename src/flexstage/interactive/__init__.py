"""The library at a prompt and in a notebook: results that show themselves.

Nothing is computed here. What ``import flexstage as fs`` offers is of this room.
"""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.designs.registry import design
    from flexstage.interactive.hinge_result import hinge
    from flexstage.interactive.show import draw, read
    from flexstage.interactive.stage_analysis import analyse
    from flexstage.interactive.stage_study import study

__all__ = [
    "analyse",
    "design",
    "draw",
    "hinge",
    "read",
    "study",
]

import_on_use(__name__)
