"""From measured records to the figures of a stage, each with its uncertainty."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.experiment.campaign.evaluate import characterise
    from flexstage.experiment.campaign.plan import Campaign, Columns, Test, read_campaign
    from flexstage.experiment.campaign.results import Characterisation
    from flexstage.experiment.modal.fit import fit_modes
    from flexstage.experiment.modal.result import ModalFit, modal_assurance
    from flexstage.experiment.modal.ring_down import RingDown, ring_down
    from flexstage.experiment.modal.stabilisation import Stabilisation, stable_poles
    from flexstage.experiment.motion.coupling import cross_coupling, squareness
    from flexstage.experiment.motion.curve_extremes import curve_loop_width, curve_range
    from flexstage.experiment.motion.curve_fit import fit_motion_curve
    from flexstage.experiment.motion.motion_curve import MotionCurve
    from flexstage.experiment.motion.narrowest_zone import minimum_zone_cylinder
    from flexstage.experiment.motion.positioning import Positioning, positioning
    from flexstage.experiment.motion.rigid_body import rigid_motion
    from flexstage.experiment.motion.sphere import sphere_fit
    from flexstage.experiment.motion.straightness import (
        Straightness,
        end_point_straightness,
        least_squares_straightness,
        minimum_zone,
    )
    from flexstage.experiment.motion.straightness_noise import less_noise
    from flexstage.experiment.motion.stroke import Linearity, Stroke, linearity, stroke
    from flexstage.experiment.motion.workspace import Workspace, workspace
    from flexstage.experiment.noise.allan import allan_deviation
    from flexstage.experiment.noise.hold import HoldNoise, hold_noise
    from flexstage.experiment.noise.mains import mains_lines
    from flexstage.experiment.noise.staircase import (
        Staircase,
        resolution,
        screw_resolution,
        staircase,
    )
    from flexstage.experiment.spectra.density import spectral_density
    from flexstage.experiment.spectra.estimate import estimate_response
    from flexstage.experiment.spectra.response import MeasuredResponse, response_from_record
    from flexstage.experiment.spectra.sums import Spectra
    from flexstage.experiment.uncertainty.budget_file import Budget, read_budget
    from flexstage.experiment.uncertainty.monte_carlo import monte_carlo, validate
    from flexstage.experiment.uncertainty.propagate import propagate
    from flexstage.experiment.uncertainty.sensor import measured
    from flexstage.experiment.updating.parameters import UpdateParameter, stage_with
    from flexstage.experiment.updating.problem import predict
    from flexstage.experiment.updating.update import Updated, update_stage
    from flexstage.experiment.virtual.as_built import AsBuilt
    from flexstage.experiment.virtual.campaign import virtual_campaign
    from flexstage.sensor import SensorSpecification

__all__ = [
    "AsBuilt",
    "Budget",
    "Campaign",
    "Characterisation",
    "Columns",
    "HoldNoise",
    "Linearity",
    "MeasuredResponse",
    "ModalFit",
    "MotionCurve",
    "Positioning",
    "RingDown",
    "SensorSpecification",
    "Spectra",
    "Stabilisation",
    "Staircase",
    "Straightness",
    "Stroke",
    "Test",
    "UpdateParameter",
    "Updated",
    "Workspace",
    "allan_deviation",
    "characterise",
    "cross_coupling",
    "curve_loop_width",
    "curve_range",
    "end_point_straightness",
    "estimate_response",
    "fit_modes",
    "fit_motion_curve",
    "hold_noise",
    "least_squares_straightness",
    "less_noise",
    "linearity",
    "mains_lines",
    "measured",
    "minimum_zone",
    "minimum_zone_cylinder",
    "modal_assurance",
    "monte_carlo",
    "positioning",
    "predict",
    "propagate",
    "read_budget",
    "read_campaign",
    "resolution",
    "response_from_record",
    "rigid_motion",
    "ring_down",
    "screw_resolution",
    "spectral_density",
    "sphere_fit",
    "squareness",
    "stable_poles",
    "stage_with",
    "staircase",
    "stroke",
    "update_stage",
    "validate",
    "virtual_campaign",
    "workspace",
]

import_on_use(__name__)
