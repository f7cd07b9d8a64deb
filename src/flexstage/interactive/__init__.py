"""The library at a prompt and in a notebook: results that show themselves.

Nothing is computed here. What ``import flexstage as fs`` offers is of this room.
"""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use, names_for_types

if TYPE_CHECKING:
    from flexstage.designs.registry import design as design
    from flexstage.interactive.hinge_result import hinge as hinge
    from flexstage.interactive.show import draw as draw
    from flexstage.interactive.show import read as read
    from flexstage.interactive.stage_analysis import analyse as analyse
    from flexstage.interactive.stage_analysis import study as study
    from flexstage.interactive.verbs import centre as centre
    from flexstage.interactive.verbs import characterise as characterise
    from flexstage.interactive.verbs import check as check
    from flexstage.interactive.verbs import compare as compare
    from flexstage.interactive.verbs import frf as frf
    from flexstage.interactive.verbs import optimise as optimise
    from flexstage.interactive.verbs import sensitivity as sensitivity
    from flexstage.interactive.verbs import sweep as sweep
    from flexstage.interactive.verbs import tolerance as tolerance

__all__ = list(names_for_types(__name__))  # pyright: ignore[reportUnsupportedDunderAll]

import_on_use(__name__)
