"""A stage as a linear mechanical system: statics, modes, responses, reduction, characteristics."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.system.analysis import Analysis, analyse
    from flexstage.system.axis import AxisAnalysis, analyse_axis
    from flexstage.system.characteristics import axis_characteristics, axis_mode, pulsating_limit
    from flexstage.system.damping import Damping, LossFactor, ModalDamping, RayleighDamping
    from flexstage.system.mechanical import (
        STANDARD_GRAVITY,
        AxisPort,
        BodyPort,
        DriveCondition,
        DrivePort,
        LoadPort,
        MechanicalSystem,
        ProbePort,
        StressMap,
    )
    from flexstage.system.modes import Modes, modes
    from flexstage.system.reduction import guyan_reduction, modal_reduction, transformed
    from flexstage.system.response import (
        FrequencyResponse,
        TimeResponse,
        default_frequencies_hz,
        frequency_response,
        time_response,
    )
    from flexstage.system.state_space import StateSpace, state_space
    from flexstage.system.statics import (
        StaticSolution,
        drive_stiffness,
        load_readings,
        probe_stiffness,
        static_displacements,
        static_forces,
        static_loads,
    )

__all__ = [
    "STANDARD_GRAVITY",
    "Analysis",
    "AxisAnalysis",
    "AxisPort",
    "BodyPort",
    "Damping",
    "DriveCondition",
    "DrivePort",
    "FrequencyResponse",
    "LoadPort",
    "LossFactor",
    "MechanicalSystem",
    "ModalDamping",
    "Modes",
    "ProbePort",
    "RayleighDamping",
    "StateSpace",
    "StaticSolution",
    "StressMap",
    "TimeResponse",
    "analyse",
    "analyse_axis",
    "axis_characteristics",
    "axis_mode",
    "default_frequencies_hz",
    "drive_stiffness",
    "frequency_response",
    "guyan_reduction",
    "load_readings",
    "modal_reduction",
    "modes",
    "probe_stiffness",
    "pulsating_limit",
    "state_space",
    "static_displacements",
    "static_forces",
    "static_loads",
    "time_response",
    "transformed",
]

import_on_use(__name__)
