"""Figures of the motion of a stage over its stroke, from measured columns.

`motion_cycles` cuts a record into cycles; `fit_motion_curve` makes of them a `MotionCurve`, a
reading over the stroke, forward and backward, drift and offsets apart. From curves come `stroke`,
`linearity`, `cross_coupling`, `squareness`, and the ranges of errors and rotations; from points
straightness and the motion of a rigid body; from repeated targets, as `visits` or
`staircase_dwells` sort them, `positioning`, and from corners, a grid or a path around it the
`workspace`.
"""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.experiment.motion.approaches import CYCLES, Approaches, Visits, visits
    from flexstage.experiment.motion.coupling import Coupling, cross_coupling, squareness
    from flexstage.experiment.motion.curve_basis import CurveBasis
    from flexstage.experiment.motion.curve_fit import fit_motion_curve
    from flexstage.experiment.motion.cycles import MotionCycles, motion_cycles
    from flexstage.experiment.motion.dwells import Dwells, staircase_dwells
    from flexstage.experiment.motion.linearity import Linearity, linearity
    from flexstage.experiment.motion.motion_curve import MotionCurve
    from flexstage.experiment.motion.positioning import Positioning, positioning
    from flexstage.experiment.motion.rigid_body import (
        PARAMETERS,
        RigidMotion,
        rigid_motion,
        travel_frame,
    )
    from flexstage.experiment.motion.sensor_motion import SensorMotion, from_sensors
    from flexstage.experiment.motion.sphere import SphereFit, sphere_fit
    from flexstage.experiment.motion.spread import spread_estimate
    from flexstage.experiment.motion.straightness import (
        Straightness,
        end_point_straightness,
        least_squares_straightness,
        minimum_zone,
    )
    from flexstage.experiment.motion.straightness_cylinder import (
        StraightnessCylinder,
        minimum_zone_cylinder,
    )
    from flexstage.experiment.motion.straightness_noise import less_noise
    from flexstage.experiment.motion.stroke import Stroke, stroke
    from flexstage.experiment.motion.workspace import (
        Workspace,
        workspace,
        workspace_from_grid,
        workspace_from_path,
    )

__all__ = [
    "CYCLES",
    "PARAMETERS",
    "Approaches",
    "Coupling",
    "CurveBasis",
    "Dwells",
    "Linearity",
    "MotionCurve",
    "MotionCycles",
    "Positioning",
    "RigidMotion",
    "SensorMotion",
    "SphereFit",
    "Straightness",
    "StraightnessCylinder",
    "Stroke",
    "Visits",
    "Workspace",
    "cross_coupling",
    "end_point_straightness",
    "fit_motion_curve",
    "from_sensors",
    "least_squares_straightness",
    "less_noise",
    "linearity",
    "minimum_zone",
    "minimum_zone_cylinder",
    "motion_cycles",
    "positioning",
    "rigid_motion",
    "sphere_fit",
    "spread_estimate",
    "squareness",
    "staircase_dwells",
    "stroke",
    "travel_frame",
    "visits",
    "workspace",
    "workspace_from_grid",
    "workspace_from_path",
]

import_on_use(__name__)
