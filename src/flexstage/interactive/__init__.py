"""The library at a prompt and in a notebook: results that show themselves.

Nothing is computed here. What ``import flexstage as fs`` offers is of this room.
"""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.interactive.hinge_result import HingeResult, hinge
    from flexstage.interactive.stage_analysis import StageAnalysis, analyse
    from flexstage.interactive.stage_study import StageStudy, study
    from flexstage.interactive.stages import design, draw, read

__all__ = [
    "HingeResult",
    "StageAnalysis",
    "StageStudy",
    "analyse",
    "design",
    "draw",
    "hinge",
    "read",
    "study",
]

import_on_use(__name__)
