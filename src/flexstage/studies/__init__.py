"""Studies of a stage: comparison of models, virtual experiments, and parameter studies."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.quantities.comparison import Comparison, compare
    from flexstage.studies.compensation import virtual_experiment
    from flexstage.studies.measurement import MeasurementComparison, compare_measurement
    from flexstage.studies.models import MODELS, ModelRun, analyse_model, run_model
    from flexstage.studies.results import results_json
    from flexstage.studies.study import Study, run_study

__all__ = [
    "MODELS",
    "Comparison",
    "MeasurementComparison",
    "ModelRun",
    "Study",
    "analyse_model",
    "compare",
    "compare_measurement",
    "results_json",
    "run_model",
    "run_study",
    "virtual_experiment",
]

import_on_use(__name__)
