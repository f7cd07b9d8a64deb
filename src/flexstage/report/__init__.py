"""Tables, figures and the report of a study."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.report.comparison import Comparison, ComparisonRow, compare, difference_percent
    from flexstage.report.files import require_writable, write_files
    from flexstage.report.html import SECTIONS, report_html, report_pages
    from flexstage.report.measurement import (
        MeasuredRow,
        Measurement,
        measurement,
        measurement_results,
        set_beside,
    )
    from flexstage.report.measurement_html import measurement_section, measurement_text
    from flexstage.report.models import MODELS, ModelRun, Wanted, analyse_model, run_model
    from flexstage.report.positioning_tables import PositioningTables, positioning_tables
    from flexstage.report.quantities import Display, display, number
    from flexstage.report.results import (
        analysis_results,
        characteristic_row,
        results_json,
        run_results,
        study_results,
    )
    from flexstage.report.study import Study, run_study

__all__ = [
    "MODELS",
    "SECTIONS",
    "Comparison",
    "ComparisonRow",
    "Display",
    "MeasuredRow",
    "Measurement",
    "ModelRun",
    "PositioningTables",
    "Study",
    "Wanted",
    "analyse_model",
    "analysis_results",
    "characteristic_row",
    "compare",
    "difference_percent",
    "display",
    "measurement",
    "measurement_results",
    "measurement_section",
    "measurement_text",
    "number",
    "positioning_tables",
    "report_html",
    "report_pages",
    "require_writable",
    "results_json",
    "run_model",
    "run_results",
    "run_study",
    "set_beside",
    "study_results",
    "write_files",
]

import_on_use(__name__)
