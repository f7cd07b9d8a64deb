"""How each hysteresis model is fitted, by name."""

from collections.abc import Mapping

from flexstage.hysteresis.identification.families.asymmetric_bouc_wen import AsymmetricBoucWenFamily
from flexstage.hysteresis.identification.families.bouc_wen import BoucWenFamily
from flexstage.hysteresis.identification.families.dahl import DahlFamily
from flexstage.hysteresis.identification.families.duhem import DuhemFamily
from flexstage.hysteresis.identification.families.family import Family
from flexstage.hysteresis.identification.families.generalised_bouc_wen import (
    GeneralisedBoucWenFamily,
)
from flexstage.hysteresis.identification.families.maxwell_slip import MaxwellSlipFamily
from flexstage.hysteresis.identification.families.modified_prandtl_ishlinskii import (
    ModifiedPrandtlIshlinskiiFamily,
)
from flexstage.hysteresis.identification.families.prandtl_ishlinskii import PrandtlIshlinskiiFamily
from flexstage.hysteresis.identification.families.preisach import PreisachFamily

#: Families by the name of their model, from few parameters to many.
FAMILIES: Mapping[str, Family] = {
    family.kind: family
    for family in (
        DahlFamily(),
        BoucWenFamily(),
        AsymmetricBoucWenFamily(),
        DuhemFamily(),
        GeneralisedBoucWenFamily(),
        PrandtlIshlinskiiFamily(),
        MaxwellSlipFamily(),
        ModifiedPrandtlIshlinskiiFamily(),
        PreisachFamily(),
    )
}
