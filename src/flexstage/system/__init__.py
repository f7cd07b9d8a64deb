"""A stage as a linear mechanical system: statics, modes, responses, reduction, characteristics."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.system.analysis import Analysis, analyse
    from flexstage.system.batch import SystemBatch
    from flexstage.system.batch_analysis import batch_characteristics
    from flexstage.system.coupled_axes import CoupledAxes, coupled_axes
    from flexstage.system.derivatives import characteristic_derivatives
    from flexstage.system.mechanical import (
        Damping,
        DriveCondition,
        LossFactor,
        MechanicalSystem,
        ModalDamping,
        RayleighDamping,
    )
    from flexstage.system.modes import Modes, modes
    from flexstage.system.response import (
        FrequencyResponse,
        StateSpace,
        TimeResponse,
        frequency_response,
        state_space,
        time_response,
    )
    from flexstage.system.seated_drives import SeatedState, static_drives
    from flexstage.system.seated_response import SeatedResponse, seated_response
    from flexstage.system.statics import (
        AxisAnalysis,
        StaticSolution,
        analyse_axis,
        drive_stiffness,
        load_readings,
        probe_stiffness,
        static_displacements,
        static_forces,
        static_loads,
    )
    from flexstage.system.thermal import ThermalDrift, thermal_drift
    from flexstage.system.thermal_transient import (
        HeatNetwork,
        ThermalTransient,
        heat_network,
        thermal_transient,
    )

__all__ = [
    "Analysis",
    "AxisAnalysis",
    "CoupledAxes",
    "Damping",
    "DriveCondition",
    "FrequencyResponse",
    "HeatNetwork",
    "LossFactor",
    "MechanicalSystem",
    "ModalDamping",
    "Modes",
    "RayleighDamping",
    "SeatedResponse",
    "SeatedState",
    "StateSpace",
    "StaticSolution",
    "SystemBatch",
    "ThermalDrift",
    "ThermalTransient",
    "TimeResponse",
    "analyse",
    "analyse_axis",
    "batch_characteristics",
    "characteristic_derivatives",
    "coupled_axes",
    "drive_stiffness",
    "frequency_response",
    "heat_network",
    "load_readings",
    "modes",
    "probe_stiffness",
    "seated_response",
    "state_space",
    "static_displacements",
    "static_drives",
    "static_forces",
    "static_loads",
    "thermal_drift",
    "thermal_transient",
    "time_response",
]

import_on_use(__name__)
