"""Generalised Maxwell-slip in C and MATLAB."""

from flexstage.hysteresis.models.maxwell_slip.law import GeneralisedMaxwellSlip
from flexstage.hysteresis.models.play_code import elements, largest_pieces, sum_numbers
from flexstage.hysteresis.models.source_code import (
    HysteresisCode,
    MatlabCode,
    code_of,
    tunable_of,
)


def c_code(model: GeneralisedMaxwellSlip) -> HysteresisCode:
    """Return the code in C, all fixed: the state must fit to every parameter."""
    total, sliders, zones = model.play_terms(), model.thresholds, model.dead_zones
    tunable = [
        tunable_of(model, "stiffness", None, "stiffness of the spring that never slides"),
        *elements(model, "thresholds", sliders, "displacement from which an element slides"),
        *elements(model, "element_stiffness", sliders, "stiffness of an element before it slides"),
        *elements(model, "dead_zones", zones, "where the stiffness of the spring changes"),
        *elements(model, "dead_zone_weights", zones, "by how much it changes there"),
    ]
    return code_of(model, sum_numbers(total), tunable, largest_pieces(total))


def matlab_code(model: GeneralisedMaxwellSlip) -> MatlabCode:
    """Return the code in MATLAB."""
    gain, thresholds, knots, slopes, offsets = model.play_terms()
    numbers = {
        "gain": (gain, "slope of all elements together [V/m]"),
        "thresholds": (thresholds, "displacement from which each element slides [m]"),
        "knots": (knots, "where the bent spring changes its slope [m]"),
        "slopes": (slopes, "slopes of the bent spring, and of the elements, negative [V/m]"),
        "offsets": (offsets, "their values at zero, continued from each interval [V]"),
    }
    return MatlabCode(parts=("maxwell_slip",), parameters=numbers)
