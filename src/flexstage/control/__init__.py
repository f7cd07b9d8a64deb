"""Control of a stage, real or simulated: trajectories, feedforward, feedback, learning, tuning.

A `Trajectory` is the reference of the axes; `shaper` and `minimum_time` make moves without
vibration. `compensate` computes voltages by the inverse of an identified drive. `tune` finds
settings of the position control with stated margins. `control_run` and `carry_out` combine both on
any instrument. `learn` removes the error that repeats, and `evaluate_run` computes the errors.
"""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.control.design import Requirements, ServoDesign, tune
    from flexstage.control.dynamic_budget import DynamicBudget, dynamic_budget
    from flexstage.control.feedforward import Compensation, compensate, shifted_model, trimmed_model
    from flexstage.control.learning import Learning, LearningSettings, Trial, learn
    from flexstage.control.loop_plant import loop_margins
    from flexstage.control.moves import jerk_limited, minimum_time, shaped, shaper
    from flexstage.control.trajectory import (
        Trajectory,
        evaluate_record,
        sine,
        steps,
        trajectory_of,
        triangle,
    )
    from flexstage.control.two_degree_of_freedom import (
        ControlMode,
        carry_out,
        control_run,
        with_feedforward,
    )
    from flexstage.system.environment import Environment, read_environment

__all__ = [
    "Compensation",
    "ControlMode",
    "DynamicBudget",
    "Environment",
    "Learning",
    "LearningSettings",
    "Requirements",
    "ServoDesign",
    "Trajectory",
    "Trial",
    "carry_out",
    "compensate",
    "control_run",
    "dynamic_budget",
    "evaluate_record",
    "jerk_limited",
    "learn",
    "loop_margins",
    "minimum_time",
    "read_environment",
    "shaped",
    "shaper",
    "shifted_model",
    "sine",
    "steps",
    "trajectory_of",
    "triangle",
    "trimmed_model",
    "tune",
    "with_feedforward",
]

import_on_use(__name__)
