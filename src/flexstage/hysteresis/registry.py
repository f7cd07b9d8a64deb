"""Hysteresis models by name."""

from collections.abc import Mapping

from flexstage.hysteresis.asymmetric_bouc_wen import AsymmetricBoucWen
from flexstage.hysteresis.bouc_wen import BoucWen
from flexstage.hysteresis.dahl import Dahl
from flexstage.hysteresis.duhem import Duhem
from flexstage.hysteresis.generalised_bouc_wen import GeneralisedBoucWen
from flexstage.hysteresis.maxwell_slip import GeneralisedMaxwellSlip
from flexstage.hysteresis.model import HysteresisModel
from flexstage.hysteresis.modified_prandtl_ishlinskii import ModifiedPrandtlIshlinskii
from flexstage.hysteresis.prandtl_ishlinskii import PrandtlIshlinskii
from flexstage.hysteresis.preisach import Preisach

__all__ = ["MODELS"]

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
