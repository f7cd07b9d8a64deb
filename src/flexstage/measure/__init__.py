"""Characteristics of a stage from measured records, each with its uncertainty."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.measure.modal.fit import fit_modes
    from flexstage.measure.modal.result import ModalFit, modal_assurance
    from flexstage.measure.modal.ring_down import RingDown, ring_down
    from flexstage.measure.modal.stabilisation import Stabilisation, stable_poles
    from flexstage.measure.motion.curve_fit import fit_motion_curve
    from flexstage.measure.motion.motion_curve import MotionCurve, curve_loop_width, curve_range
    from flexstage.measure.motion.positioning import Positioning, positioning
    from flexstage.measure.motion.reach import Stroke, Workspace, rigid_motion, stroke, workspace
    from flexstage.measure.noise.hold import HoldNoise, allan_deviation, hold_noise, mains_lines
    from flexstage.measure.noise.staircase import (
        Staircase,
        resolution,
        screw_resolution,
        staircase,
    )
    from flexstage.measure.spectra.averaging import spectral_density
    from flexstage.measure.spectra.estimate import estimate_response
    from flexstage.measure.spectra.response import MeasuredResponse, response_from_record
    from flexstage.measure.spectra.sums import Spectra
    from flexstage.measure.uncertainty.budget_file import Budget, read_budget
    from flexstage.measure.uncertainty.monte_carlo import monte_carlo, validate
    from flexstage.measure.uncertainty.propagate import propagate
    from flexstage.measure.uncertainty.sensor import measured
    from flexstage.measure.update_parameters import UpdateParameter, stage_with
    from flexstage.measure.updating import Updated, predict, update_stage
    from flexstage.quantities.sensor import SensorSpecification

__all__ = [
    "Budget",
    "HoldNoise",
    "MeasuredResponse",
    "ModalFit",
    "MotionCurve",
    "Positioning",
    "RingDown",
    "SensorSpecification",
    "Spectra",
    "Stabilisation",
    "Staircase",
    "Stroke",
    "UpdateParameter",
    "Updated",
    "Workspace",
    "allan_deviation",
    "curve_loop_width",
    "curve_range",
    "estimate_response",
    "fit_modes",
    "fit_motion_curve",
    "hold_noise",
    "mains_lines",
    "measured",
    "modal_assurance",
    "monte_carlo",
    "positioning",
    "predict",
    "propagate",
    "read_budget",
    "resolution",
    "response_from_record",
    "rigid_motion",
    "ring_down",
    "screw_resolution",
    "spectral_density",
    "stable_poles",
    "stage_with",
    "staircase",
    "stroke",
    "update_stage",
    "validate",
    "workspace",
]

import_on_use(__name__)
