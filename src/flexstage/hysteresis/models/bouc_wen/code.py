"""Bouc-Wen in C and MATLAB."""

from flexstage.hysteresis.models.bouc_wen.law import BoucWen
from flexstage.hysteresis.models.bouc_wen_code import bouc_wen_c_code, bouc_wen_matlab_code
from flexstage.hysteresis.models.bouc_wen_common import classical_law
from flexstage.hysteresis.models.source_code import HysteresisCode, MatlabCode


def c_code(model: BoucWen) -> HysteresisCode:
    """Return the code in C, with pieces where the exponent is 1."""
    names = ("gain", "hysteresis_gain", "beta", "gamma")
    return bouc_wen_c_code(model, names, 2 if model.exponent == 1.0 else 0)


def matlab_code(model: BoucWen) -> MatlabCode:
    """Return the code in MATLAB."""
    law = classical_law(model.hysteresis_gain, model.beta, model.gamma, model.exponent)
    return bouc_wen_matlab_code([model.gain, 0.0, 0.0], law, model.exponent)
