"""Control of a stage, real or simulated: trajectories, feedforward, feedback, learning, tuning.

A `Trajectory` says where the axes are to be. `compensate` turns it into voltages by the inverse of
an identified drive, `tune` finds settings of the position control with stated margins,
`control_run` and `carry_out` join both on any instrument, and `learn` takes away what repeats.
`evaluate_run` says how well it went.
"""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.control.design import Requirements, Tuning, tune, tune_plant
    from flexstage.control.feedforward import (
        Compensation,
        compensate,
        conditioning_waveform,
        shifted_model,
    )
    from flexstage.control.learning import learn
    from flexstage.control.learning_results import LearnedAxis, Learning, LearningSettings, Trial
    from flexstage.control.loop_plant import LoopPlant, local_gains, loop_plant
    from flexstage.control.margins import Margins, loop_margins
    from flexstage.control.periodic import delayed, steady_input, steady_output
    from flexstage.control.tracking_run import RunTracking, evaluate_record, evaluate_run
    from flexstage.control.trajectories import (
        Trajectory,
        band_limited,
        lissajous,
        raster,
        sine,
        spiral,
        staircase,
        trajectory_of,
        triangle,
    )
    from flexstage.control.trim import trimmed_model
    from flexstage.control.two_degrees import (
        ControlRun,
        Way,
        carry_out,
        control_run,
        with_feedforward,
    )

__all__ = [
    "Compensation",
    "ControlRun",
    "LearnedAxis",
    "Learning",
    "LearningSettings",
    "LoopPlant",
    "Margins",
    "Requirements",
    "RunTracking",
    "Trajectory",
    "Trial",
    "Tuning",
    "Way",
    "band_limited",
    "carry_out",
    "compensate",
    "conditioning_waveform",
    "control_run",
    "delayed",
    "evaluate_record",
    "evaluate_run",
    "learn",
    "lissajous",
    "local_gains",
    "loop_margins",
    "loop_plant",
    "raster",
    "shifted_model",
    "sine",
    "spiral",
    "staircase",
    "steady_input",
    "steady_output",
    "trajectory_of",
    "triangle",
    "trimmed_model",
    "tune",
    "tune_plant",
    "with_feedforward",
]

import_on_use(__name__)
