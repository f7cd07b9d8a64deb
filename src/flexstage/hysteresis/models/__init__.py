"""The hysteresis models, one file each, and the kernels that they share."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.hysteresis.models.asymmetric_bouc_wen import AsymmetricBoucWen
    from flexstage.hysteresis.models.bouc_wen import BoucWen, simulate_bouc_wen_batch
    from flexstage.hysteresis.models.dahl import Dahl
    from flexstage.hysteresis.models.duhem import Duhem
    from flexstage.hysteresis.models.generalised_bouc_wen import GeneralisedBoucWen
    from flexstage.hysteresis.models.maxwell_slip import GeneralisedMaxwellSlip
    from flexstage.hysteresis.models.modified_prandtl_ishlinskii import ModifiedPrandtlIshlinskii
    from flexstage.hysteresis.models.prandtl_ishlinskii import PrandtlIshlinskii
    from flexstage.hysteresis.models.preisach import Preisach
    from flexstage.hysteresis.models.registry import MODELS

__all__ = [
    "MODELS",
    "AsymmetricBoucWen",
    "BoucWen",
    "Dahl",
    "Duhem",
    "GeneralisedBoucWen",
    "GeneralisedMaxwellSlip",
    "ModifiedPrandtlIshlinskii",
    "PrandtlIshlinskii",
    "Preisach",
    "simulate_bouc_wen_batch",
]

import_on_use(__name__)
