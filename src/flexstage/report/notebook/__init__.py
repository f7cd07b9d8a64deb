"""The library at a prompt and in a notebook: results that show themselves.

Nothing is computed here. What ``import flexstage as fs`` offers is of this room.
"""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use, names_for_types

if TYPE_CHECKING:
    from flexstage.report.notebook.hinge_result import hinge as hinge
    from flexstage.report.notebook.show import draw as draw
    from flexstage.report.notebook.show import read as read
    from flexstage.report.notebook.stage_analysis import analyse as analyse
    from flexstage.report.notebook.stage_analysis import study as study
    from flexstage.report.notebook.verbs import centre as centre
    from flexstage.report.notebook.verbs import characterise as characterise
    from flexstage.report.notebook.verbs import check as check
    from flexstage.report.notebook.verbs import compare as compare
    from flexstage.report.notebook.verbs import frf as frf
    from flexstage.report.notebook.verbs import optimise as optimise
    from flexstage.report.notebook.verbs import sensitivity as sensitivity
    from flexstage.report.notebook.verbs import sweep as sweep
    from flexstage.report.notebook.verbs import tolerance as tolerance
    from flexstage.stage.designs.registry import design as design

__all__ = list(names_for_types(__name__))  # pyright: ignore[reportUnsupportedDunderAll]

import_on_use(__name__)
