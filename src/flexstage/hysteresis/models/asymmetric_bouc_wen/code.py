"""Asymmetric Bouc-Wen in C and MATLAB."""

from flexstage.hysteresis.models.asymmetric_bouc_wen.law import AsymmetricBoucWen
from flexstage.hysteresis.models.bouc_wen_code import bouc_wen_c_code, bouc_wen_matlab_code
from flexstage.hysteresis.models.bouc_wen_common import classical_law
from flexstage.hysteresis.models.source_code import HysteresisCode, MatlabCode


def c_code(model: AsymmetricBoucWen) -> HysteresisCode:
    """Return the code in C, without pieces and without limits of the input."""
    names = ("gain", "quadratic", "cubic", "hysteresis_gain", "beta", "gamma")
    return bouc_wen_c_code(model, names, 0)


def matlab_code(model: AsymmetricBoucWen) -> MatlabCode:
    """Return the code in MATLAB."""
    law = classical_law(model.hysteresis_gain, model.beta, model.gamma, model.exponent)
    return bouc_wen_matlab_code([model.gain, model.quadratic, model.cubic], law, model.exponent)
