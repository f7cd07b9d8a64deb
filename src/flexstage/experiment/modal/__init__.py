"""Natural frequencies, damping and mode shapes from frequency responses and free decays."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.experiment.modal.fit import fit_modes
    from flexstage.experiment.modal.result import FittedResponse, ModalFit, Mode
    from flexstage.experiment.modal.ring_down import DecayMode, RingDown, ring_down
    from flexstage.experiment.modal.shapes import modal_assurance
    from flexstage.experiment.modal.stabilisation import OrderPoles, Stabilisation, stable_poles

__all__ = [
    "DecayMode",
    "FittedResponse",
    "ModalFit",
    "Mode",
    "OrderPoles",
    "RingDown",
    "Stabilisation",
    "fit_modes",
    "modal_assurance",
    "ring_down",
    "stable_poles",
]

import_on_use(__name__)
