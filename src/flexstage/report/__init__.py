"""Tables, figures and the report of a study."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.report.comparison import Comparison, compare
    from flexstage.report.figures.drawing import draw_stage
    from flexstage.report.figures.following import draw_following
    from flexstage.report.figures.stabilisation import draw_stabilisation
    from flexstage.report.figures.style import encode
    from flexstage.report.html import report_html
    from flexstage.report.measurement import MeasurementComparison, compare_measurement
    from flexstage.report.models import MODELS, ModelRun, analyse_model, run_model
    from flexstage.report.quantities import display, number
    from flexstage.report.results import results_json, study_results
    from flexstage.report.study import Study, run_study

__all__ = [
    "MODELS",
    "Comparison",
    "MeasurementComparison",
    "ModelRun",
    "Study",
    "analyse_model",
    "compare",
    "compare_measurement",
    "display",
    "draw_following",
    "draw_stabilisation",
    "draw_stage",
    "encode",
    "number",
    "report_html",
    "results_json",
    "run_model",
    "run_study",
    "study_results",
]

import_on_use(__name__)
