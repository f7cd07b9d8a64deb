"""Model updating: the dimensions and the material of a stage from what was measured on it."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.experiment.updating.necks import with_neck_thickness
    from flexstage.experiment.updating.parameters import (
        PARAMETER_KINDS,
        UpdateParameter,
        stage_with,
    )
    from flexstage.experiment.updating.predict import UPDATABLE, predict
    from flexstage.experiment.updating.update import Updated, UpdatedRow, update_stage

__all__ = [
    "PARAMETER_KINDS",
    "UPDATABLE",
    "UpdateParameter",
    "Updated",
    "UpdatedRow",
    "predict",
    "stage_with",
    "update_stage",
    "with_neck_thickness",
]

import_on_use(__name__)
