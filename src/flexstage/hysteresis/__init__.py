"""Hysteresis of piezo drives: simulated, identified from records, undone, and joined to a stage.

A *hysteresis model* is a frozen set of parameters with an explicit state (`HysteresisModel`); there
are nine of them, by name in `MODELS`. The *chain* (`Amplifier`, `LogCreep`, `StageModes`, `Lag`,
`Sensor`) is linear but for the limits of the amplifier. A `DriveModel` is both in a row, as
`identify` finds it in records and `feedforward` undoes it; `model_text` writes it. A `DynamicModel`
joins the stacks to every mode of a stage: `dynamic_model` builds it, simulation steps it, and it is
what other programs are given. `excitation` designs the experiment.
Between samples the input moves on straight lines, and every answer to such an input is exact.
"""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.hysteresis.build_model import assembled_model, dynamic_model
    from flexstage.hysteresis.chain.amplifier import Amplifier
    from flexstage.hysteresis.chain.coupled_stepping import simulate_with_stage
    from flexstage.hysteresis.chain.creep import Creep, CreepSpectrum, LogCreep
    from flexstage.hysteresis.chain.lag import Lag
    from flexstage.hysteresis.chain.sensor import Sensor
    from flexstage.hysteresis.chain.stage_modes import StageModes
    from flexstage.hysteresis.drive_model import DriveModel, ValidityRange
    from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive
    from flexstage.hysteresis.excitations.design import excitation
    from flexstage.hysteresis.excitations.excitation import Excitation, memory_coverage
    from flexstage.hysteresis.identification.amplifier import identify_amplifier
    from flexstage.hysteresis.identification.chain_search import find_chain
    from flexstage.hysteresis.identification.cycles import Cycles, cycles
    from flexstage.hysteresis.identification.identify import Identification, identify
    from flexstage.hysteresis.identification.measurement import IdentificationData, measurement
    from flexstage.hysteresis.identification.misfit import ParameterEstimate
    from flexstage.hysteresis.inversion import Feedforward, feedforward, smoothed
    from flexstage.hysteresis.loops import Tracking, loop_width, tracking
    from flexstage.hysteresis.model import HysteresisModel, Response, Segments
    from flexstage.hysteresis.model_file import (
        ModelFile,
        model_text,
        read_model_file,
        read_model_text,
    )
    from flexstage.hysteresis.models import MODELS
    from flexstage.hysteresis.models.asymmetric_bouc_wen import AsymmetricBoucWen
    from flexstage.hysteresis.models.bouc_wen import BoucWen, simulate_bouc_wen_batch
    from flexstage.hysteresis.models.dahl import Dahl
    from flexstage.hysteresis.models.duhem import Duhem
    from flexstage.hysteresis.models.generalised_bouc_wen import GeneralisedBoucWen
    from flexstage.hysteresis.models.maxwell_slip import GeneralisedMaxwellSlip
    from flexstage.hysteresis.models.modified_prandtl_ishlinskii import ModifiedPrandtlIshlinskii
    from flexstage.hysteresis.models.prandtl_ishlinskii import PrandtlIshlinskii
    from flexstage.hysteresis.models.preisach import Preisach
    from flexstage.hysteresis.prediction import Prediction, predict

__all__ = [
    "MODELS",
    "Amplifier",
    "AsymmetricBoucWen",
    "BoucWen",
    "Creep",
    "CreepSpectrum",
    "Cycles",
    "Dahl",
    "DriveModel",
    "Duhem",
    "DynamicModel",
    "Excitation",
    "Feedforward",
    "GeneralisedBoucWen",
    "GeneralisedMaxwellSlip",
    "HysteresisModel",
    "Identification",
    "IdentificationData",
    "Lag",
    "LogCreep",
    "ModelDrive",
    "ModelFile",
    "ModifiedPrandtlIshlinskii",
    "ParameterEstimate",
    "PrandtlIshlinskii",
    "Prediction",
    "Preisach",
    "Response",
    "Segments",
    "Sensor",
    "StageModes",
    "Tracking",
    "ValidityRange",
    "assembled_model",
    "cycles",
    "dynamic_model",
    "excitation",
    "feedforward",
    "find_chain",
    "identify",
    "identify_amplifier",
    "loop_width",
    "measurement",
    "memory_coverage",
    "model_text",
    "predict",
    "read_model_file",
    "read_model_text",
    "simulate_bouc_wen_batch",
    "simulate_with_stage",
    "smoothed",
    "tracking",
]

import_on_use(__name__)
