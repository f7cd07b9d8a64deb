"""Control of a stage, real or simulated: trajectories, feedforward, feedback, learning, tuning.

A `Trajectory` says where the axes are to be. `compensate` turns it into voltages by the inverse of
an identified drive, `tune` finds settings of the position control with stated margins,
`control_run` and `carry_out` join both on any instrument, and `learn` takes away what repeats.
`evaluate_run` says how well it went.
"""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.control.design import Requirements, ServoDesign, tune
    from flexstage.control.feedforward import Compensation, compensate, shifted_model, trimmed_model
    from flexstage.control.learning import learn
    from flexstage.control.learning_axis import Learning, LearningSettings, Trial
    from flexstage.control.loop_plant import loop_margins
    from flexstage.control.tracking_run import evaluate_record
    from flexstage.control.trajectory import Trajectory, trajectory_of
    from flexstage.control.trajectory_shapes import raster, sine, triangle
    from flexstage.control.two_degree_of_freedom import (
        Way,
        carry_out,
        control_run,
        with_feedforward,
    )

__all__ = [
    "Compensation",
    "Learning",
    "LearningSettings",
    "Requirements",
    "ServoDesign",
    "Trajectory",
    "Trial",
    "Way",
    "carry_out",
    "compensate",
    "control_run",
    "evaluate_record",
    "learn",
    "loop_margins",
    "raster",
    "shifted_model",
    "sine",
    "trajectory_of",
    "triangle",
    "trimmed_model",
    "tune",
    "with_feedforward",
]

import_on_use(__name__)
