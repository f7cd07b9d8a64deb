"""Tables, figures and reports of results."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.report.figures.body_motion import draw_static_shape, draw_stroke
    from flexstage.report.figures.centring import draw_polar
    from flexstage.report.figures.distributions import draw_budget
    from flexstage.report.figures.drawing import draw_stage
    from flexstage.report.figures.fields import draw_convergence, draw_fe_modes
    from flexstage.report.figures.hinges import draw_neck_stress, draw_notch, draw_stress
    from flexstage.report.figures.identification import (
        draw_identification,
        draw_prediction,
        draw_record,
    )
    from flexstage.report.figures.modal_fit import (
        draw_modal_fit,
        draw_ring_down,
        draw_stabilisation,
    )
    from flexstage.report.figures.motion_error import (
        draw_motion_error,
        draw_positioning,
        draw_workspace,
    )
    from flexstage.report.figures.noise import draw_hold, draw_staircase
    from flexstage.report.figures.part import draw_part
    from flexstage.report.figures.responses import draw_bode, draw_response
    from flexstage.report.figures.style import encode
    from flexstage.report.figures.sweep import draw_indices, draw_sweep
    from flexstage.report.figures.tracking import draw_compensation, draw_drive_fit, draw_following
    from flexstage.report.study import report_html

__all__ = [
    "draw_bode",
    "draw_budget",
    "draw_compensation",
    "draw_convergence",
    "draw_drive_fit",
    "draw_fe_modes",
    "draw_following",
    "draw_hold",
    "draw_identification",
    "draw_indices",
    "draw_modal_fit",
    "draw_motion_error",
    "draw_neck_stress",
    "draw_notch",
    "draw_part",
    "draw_polar",
    "draw_positioning",
    "draw_prediction",
    "draw_record",
    "draw_response",
    "draw_ring_down",
    "draw_stabilisation",
    "draw_stage",
    "draw_staircase",
    "draw_static_shape",
    "draw_stress",
    "draw_stroke",
    "draw_sweep",
    "draw_workspace",
    "encode",
    "report_html",
]

import_on_use(__name__)
