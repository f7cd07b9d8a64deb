"""Fit of the Dahl model."""

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.model_fit import FitData
from flexstage.hysteresis.identification.nonlinear_fit import SearchedFit
from flexstage.hysteresis.models.dahl.law import Dahl

#: Range of the slope of friction over its limit, times the range of the input, in powers of ten.
_STIFFNESS = (-0.5, 2.5)


class DahlFit(SearchedFit):
    """One parameter is searched for: the model is linear in its gain and in friction."""

    law = Dahl
    size = 3
    automatic = False
    grid = (16,)

    def columns(self, section: RecordSection, place: Array, data: FitData) -> Array:
        unit = Dahl(gain=0.0, stiffness=1.0, limit=_limit(place, data.input_scale))
        return np.column_stack((section.u, unit.simulate(section.u).values))

    def build(self, place: Array, coefficients: Array, data: FitData) -> Dahl:
        least = 1e-12 * data.stroke / data.input_scale
        stiffness = max(float(coefficients[1]), least)
        limit = stiffness * _limit(place, data.input_scale)
        return Dahl(gain=float(coefficients[0]), stiffness=stiffness, limit=limit)


def _limit(place: Array, scale: float) -> float:
    """Limit of friction of unit slope, in the unit of the input."""
    return float(scale / 10.0 ** (_STIFFNESS[0] + place[0] * (_STIFFNESS[1] - _STIFFNESS[0])))
