"""The hysteresis models by name, one file each, and the kernels that they share."""

from collections.abc import Mapping

from flexstage.hysteresis.model import HysteresisModel
from flexstage.hysteresis.models.asymmetric_bouc_wen import AsymmetricBoucWen
from flexstage.hysteresis.models.bouc_wen import BoucWen
from flexstage.hysteresis.models.dahl import Dahl
from flexstage.hysteresis.models.duhem import Duhem
from flexstage.hysteresis.models.generalised_bouc_wen import GeneralisedBoucWen
from flexstage.hysteresis.models.maxwell_slip import GeneralisedMaxwellSlip
from flexstage.hysteresis.models.modified_prandtl_ishlinskii import ModifiedPrandtlIshlinskii
from flexstage.hysteresis.models.prandtl_ishlinskii import PrandtlIshlinskii
from flexstage.hysteresis.models.preisach import Preisach

#: Every hysteresis model, by its name in files and on the command line.
MODELS: Mapping[str, type[HysteresisModel]] = {
    model.kind: model
    for model in (
        BoucWen,
        AsymmetricBoucWen,
        GeneralisedBoucWen,
        Dahl,
        Duhem,
        PrandtlIshlinskii,
        ModifiedPrandtlIshlinskii,
        GeneralisedMaxwellSlip,
        Preisach,
    )
}
