"""The functions of ``import flexstage as fs``, with results for prompts and notebooks.

Nothing is computed here.
"""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use, names_for_types

if TYPE_CHECKING:
    from flexstage.report.notebook.jobs import analyse as analyse
    from flexstage.report.notebook.jobs import centre as centre
    from flexstage.report.notebook.jobs import characterise as characterise
    from flexstage.report.notebook.jobs import check as check
    from flexstage.report.notebook.jobs import compare as compare
    from flexstage.report.notebook.jobs import frf as frf
    from flexstage.report.notebook.jobs import optimise as optimise
    from flexstage.report.notebook.jobs import reconstruct as reconstruct
    from flexstage.report.notebook.jobs import sensitivity as sensitivity
    from flexstage.report.notebook.jobs import study as study
    from flexstage.report.notebook.jobs import sweep as sweep
    from flexstage.report.notebook.jobs import tolerance as tolerance
    from flexstage.report.notebook.show import draw as draw
    from flexstage.report.notebook.show import hinge as hinge
    from flexstage.report.notebook.show import read as read
    from flexstage.stage.designs.registry import design as design

__all__ = list(names_for_types(__name__))

import_on_use(__name__)
