"""Virtual measurements of a stage: made with scatter, read with noise, and labelled as such."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.experiment.virtual.as_built import AsBuilt, AsBuiltAxis, as_built
    from flexstage.experiment.virtual.bench import (
        HammerBench,
        hold_record,
        motion_record,
        sphere_record,
        staircase_record,
        workspace_record,
    )
    from flexstage.experiment.virtual.campaign import VirtualCampaign, virtual_campaign
    from flexstage.experiment.virtual.guide import MOTIONS, GuideErrors, random_guide
    from flexstage.experiment.virtual.laboratory import Laboratory, Sensor
    from flexstage.experiment.virtual.scatter import (
        Scatter,
        displaced_system,
        displacements,
        manufactured,
    )
    from flexstage.experiment.virtual.truth import true_figures

__all__ = [
    "MOTIONS",
    "AsBuilt",
    "AsBuiltAxis",
    "GuideErrors",
    "HammerBench",
    "Laboratory",
    "Scatter",
    "Sensor",
    "VirtualCampaign",
    "as_built",
    "displaced_system",
    "displacements",
    "hold_record",
    "manufactured",
    "motion_record",
    "random_guide",
    "sphere_record",
    "staircase_record",
    "true_figures",
    "virtual_campaign",
    "workspace_record",
]

import_on_use(__name__)
