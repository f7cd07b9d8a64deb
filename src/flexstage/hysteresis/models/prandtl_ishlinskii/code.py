"""Prandtl-Ishlinskii in C and MATLAB."""

from flexstage.hysteresis.models.play_code import play_parameters, plays_matlab_code, sum_numbers
from flexstage.hysteresis.models.prandtl_ishlinskii.law import PrandtlIshlinskii
from flexstage.hysteresis.models.source_code import HysteresisCode, MatlabCode, code_of


def c_code(model: PrandtlIshlinskii) -> HysteresisCode:
    """Return the code in C, whose gain and weights can be changed."""
    tunable = play_parameters(model, model.thresholds)
    return code_of(model, sum_numbers(model.play_terms()), tunable, model.thresholds.size + 1)


def matlab_code(model: PrandtlIshlinskii) -> MatlabCode:
    """Return the code in MATLAB."""
    return plays_matlab_code(model.play_terms())
