"""Hysteresis of piezo drives: simulated, identified from records, undone, and joined to a stage.

A *hysteresis model* is a frozen set of parameters with an explicit state (`HysteresisModel`);
`MODELS` holds all by name, and their classes are public here. The *chain* (`Amplifier`, `LogCreep`,
`StageModes`, `Lag`, `Sensor`) is linear but for the limits of the amplifier. A `DriveModel` is both
in a row, as `identify` finds it in records and `feedforward` undoes it; `model_text` writes it. A
`DynamicModel` joins the stacks to every mode of a stage: `dynamic_model` builds it, simulation
steps it, and it is what other programs are given. `excitation` designs the experiment.
Between samples the input moves on straight lines, and every answer to such an input is exact.
"""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use, names_for_types

if TYPE_CHECKING:
    from flexstage.hysteresis.build_model import assembled_model, dynamic_model
    from flexstage.hysteresis.chain.amplifier import Amplifier
    from flexstage.hysteresis.chain.creep import Creep, CreepSpectrum, LogCreep
    from flexstage.hysteresis.chain.lag import Lag
    from flexstage.hysteresis.chain.sensor import Sensor
    from flexstage.hysteresis.chain.stage_modes import StageModes
    from flexstage.hysteresis.coupled_drives.identify import identify_coupled_drives
    from flexstage.hysteresis.coupled_drives.inverse import coupled_commands
    from flexstage.hysteresis.coupled_drives.model import CoupledDriveModel
    from flexstage.hysteresis.coupled_drives.model_file import read_coupled_model
    from flexstage.hysteresis.drive_model import DriveModel, DriveState, ValidityRange
    from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive
    from flexstage.hysteresis.excitations.design import excitation
    from flexstage.hysteresis.excitations.excitation import Excitation, memory_coverage
    from flexstage.hysteresis.identification.chain_search import find_chain
    from flexstage.hysteresis.identification.cycles import Cycles, cycles
    from flexstage.hysteresis.identification.identify import identify
    from flexstage.hysteresis.identification.measurement import IdentificationData, measurement
    from flexstage.hysteresis.identification.nonlinear_fit import SearchedFit
    from flexstage.hysteresis.identification.residuals import ParameterEstimate
    from flexstage.hysteresis.identification.result import Identification
    from flexstage.hysteresis.inversion import Feedforward, feedforward, smoothed
    from flexstage.hysteresis.loops import Tracking, loop_width, tracking
    from flexstage.hysteresis.model import (
        HysteresisModel,
        ModelProperty,
        Response,
        Segments,
        samples,
    )
    from flexstage.hysteresis.model_file import (
        ModelFile,
        model_text,
        read_model_file,
        read_model_text,
    )
    from flexstage.hysteresis.models.registry import *  # noqa: F403
    from flexstage.hysteresis.models.registry import MODELS
    from flexstage.hysteresis.oscillator.identify import identify_oscillator
    from flexstage.hysteresis.oscillator.model import BoucWenOscillator
    from flexstage.hysteresis.oscillator.model_file import read_oscillator
    from flexstage.hysteresis.prediction import Prediction, predict

__all__ = [
    "MODELS",
    "Amplifier",
    "BoucWenOscillator",
    "CoupledDriveModel",
    "Creep",
    "CreepSpectrum",
    "Cycles",
    "DriveModel",
    "DriveState",
    "DynamicModel",
    "Excitation",
    "Feedforward",
    "HysteresisModel",
    "Identification",
    "IdentificationData",
    "Lag",
    "LogCreep",
    "ModelDrive",
    "ModelFile",
    "ModelProperty",
    "ParameterEstimate",
    "Prediction",
    "Response",
    "SearchedFit",
    "Segments",
    "Sensor",
    "StageModes",
    "Tracking",
    "ValidityRange",
    "assembled_model",
    "coupled_commands",
    "cycles",
    "dynamic_model",
    "excitation",
    "feedforward",
    "find_chain",
    "identify",
    "identify_coupled_drives",
    "identify_oscillator",
    "loop_width",
    "measurement",
    "memory_coverage",
    "model_text",
    "predict",
    "read_coupled_model",
    "read_model_file",
    "read_model_text",
    "read_oscillator",
    "samples",
    "smoothed",
    "tracking",
]

# the classes of the models
__all__ += list(names_for_types("flexstage.hysteresis.models.registry"))

import_on_use(__name__)
