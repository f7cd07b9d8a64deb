"""What is drawn of a result in a report, by its type."""

from collections.abc import Mapping
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING

from flexstage.errors import ModelError
from flexstage.section import Picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: By type and view: the function that draws it, of `flexstage.report.figures`, and what that calls
#: the result.
DRAWINGS: Mapping[tuple[str, str], tuple[str, str]] = {
    ("HoldNoise", ""): ("noise.draw_hold", "noise"),
    ("Identification", ""): ("identification.draw_identification", "found"),
    ("IdentifiedStep", ""): ("tracking.draw_drive_fit", "step"),
    ("MeasuredResponse", ""): ("responses.draw_response", "response"),
    ("ModalFit", ""): ("modal_fit.draw_modal_fit", "fit"),
    ("ModalFit", "resonance"): ("modal_fit.draw_resonance", "fit"),
    ("ModalFit", "stabilisation"): ("modal_fit.draw_stabilisation", "fit"),
    ("MotionCurve", ""): ("motion_error.draw_motion_error", "curve"),
    ("Positioning", ""): ("motion_error.draw_positioning", "found"),
    ("ReachableArea", ""): ("reachable_area.draw_reachable_area", "found"),
    ("Record", ""): ("record.draw_record", "record"),
    ("Refinement", ""): ("convergence.draw_convergence", "refinement"),
    ("Sensitivities", ""): ("sensitivity.draw_sensitivities", "found"),
    ("Stage", ""): ("drawing.draw_stage", "stage"),
    ("Staircase", ""): ("noise.draw_staircase", "found"),
    ("ToleranceStudy", "shares"): ("tolerance.draw_shares", "study"),
    ("ToleranceStudy", "spreads"): ("tolerance.draw_spreads", "study"),
    ("VerifiedStep", ""): ("tracking.draw_following", "step"),
    ("Workspace", ""): ("motion_error.draw_workspace", "found"),
}


def drawn(picture: Picture) -> "Figure":
    """Draw the result of a picture; a function that draws one is called."""
    if isinstance(picture.result, partial):
        return picture.result(**picture.options)
    kind = type(picture.result).__name__
    if (kind, picture.view) not in DRAWINGS:
        view = f" as '{picture.view}'" if picture.view else ""
        known = ", ".join(sorted({name for name, _ in DRAWINGS}))
        raise ModelError(f"no drawing shows a {kind}{view}: there are drawings of {known}")
    function, parameter = DRAWINGS[kind, picture.view]
    module, _, name = function.partition(".")
    draw = getattr(import_module(f"flexstage.report.figures.{module}"), name)
    return draw(**{parameter: picture.result}, **picture.options)
