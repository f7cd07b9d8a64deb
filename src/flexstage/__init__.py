# ruff: noqa: F405
"""Design, verify, identify and drive flexure-based micropositioning stages.

``import flexstage as fs`` offers `read` for a stage file, `design` for a built-in stage, `draw`,
`check`, `analyse` for one model of it, `study` for several, `compare`, `sensitivity`, `sweep`,
`optimise`, `tolerance` and `reconstruct`, `hinge` for a notch; `read_record` for measured data, and
`identify`, `characterise`, `frf` and `centre` for what is in them. Everything else is in the
subpackages, which the reference manual lists. All of it is imported when it is first used.
"""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use
from flexstage.base.version import __version__

if TYPE_CHECKING:
    from flexstage import centring as centring
    from flexstage import control as control
    from flexstage import experiments as experiments
    from flexstage import export as export
    from flexstage import fem as fem
    from flexstage import hinges as hinges
    from flexstage import hysteresis as hysteresis
    from flexstage import instruments as instruments
    from flexstage import lumped as lumped
    from flexstage import measure as measure
    from flexstage import quantities as quantities
    from flexstage import records as records
    from flexstage import report as report
    from flexstage import stage as stage
    from flexstage import studies as studies
    from flexstage import system as system
    from flexstage import virtual as virtual
    from flexstage.hysteresis.identification.identify import identify
    from flexstage.records.read import read_record
    from flexstage.report.notebook import *  # noqa: F403

__all__ = [
    "__version__",
    "analyse",
    "centre",
    "characterise",
    "check",
    "compare",
    "design",
    "draw",
    "frf",
    "hinge",
    "identify",
    "optimise",
    "read",
    "read_record",
    "reconstruct",
    "sensitivity",
    "study",
    "sweep",
    "tolerance",
]

import_on_use(__name__)
