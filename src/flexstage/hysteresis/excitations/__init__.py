"""The design of the experiment: a drive record that identifies a stage, within its limits."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.hysteresis.excitations.coverage import memory_coverage
    from flexstage.hysteresis.excitations.design import excitation
    from flexstage.hysteresis.excitations.record import Excitation, ExcitationPart

__all__ = ["Excitation", "ExcitationPart", "excitation", "memory_coverage"]

import_on_use(__name__)
