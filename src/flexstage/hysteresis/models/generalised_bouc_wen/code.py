"""Generalised Bouc-Wen in C and MATLAB."""

from flexstage.hysteresis.models.bouc_wen_code import bouc_wen_c_code, bouc_wen_matlab_code
from flexstage.hysteresis.models.bouc_wen_steps import law_of
from flexstage.hysteresis.models.generalised_bouc_wen.law import GeneralisedBoucWen
from flexstage.hysteresis.models.source_code import HysteresisCode, MatlabCode


def c_code(model: GeneralisedBoucWen) -> HysteresisCode:
    """Return the code in C, with pieces where the exponent is 1."""
    names = ("gain", "hysteresis_gain", *(f"shape[{k}]" for k in range(6)), "centre")
    return bouc_wen_c_code(model, names, 4 if model.exponent == 1.0 else 0)


def matlab_code(model: GeneralisedBoucWen) -> MatlabCode:
    """Return the code in MATLAB."""
    law = law_of(model.hysteresis_gain, model.exponent, model.centre, model.shape_function())
    return bouc_wen_matlab_code([model.gain, 0.0, 0.0], law, model.exponent)
