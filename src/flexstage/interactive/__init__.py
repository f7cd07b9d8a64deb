# ruff: noqa: F401
"""The library at a prompt and in a notebook: results that show themselves.

Nothing is computed here. What ``import flexstage as fs`` offers is of this room.
"""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use, names_for_types

if TYPE_CHECKING:
    from flexstage.designs.registry import design
    from flexstage.interactive.hinge_result import hinge
    from flexstage.interactive.show import draw, read
    from flexstage.interactive.stage_analysis import analyse
    from flexstage.interactive.stage_study import study
    from flexstage.interactive.verbs import (
        centre,
        characterise,
        check,
        compare,
        frf,
        optimise,
        sensitivity,
        sweep,
        tolerance,
    )

__all__ = list(names_for_types(__name__))  # pyright: ignore[reportUnsupportedDunderAll]

import_on_use(__name__)
