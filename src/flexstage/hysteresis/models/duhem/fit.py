"""Fit of the Duhem model."""

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.model_fit import FitData
from flexstage.hysteresis.identification.nonlinear_fit import SearchedFit
from flexstage.hysteresis.models.duhem.law import Duhem, duhem_columns

#: Range of alpha times the range of the input, in powers of ten.
_RATE = (-0.5, 2.0)
#: Coefficients of f and of g.
_CURVE, _TANGENT = 4, 2
#: Penalty on the square of the constant of f. After the initial movement its effect is that of the
#: offset, and without a penalty both grow to many strokes of opposite sign.
_CONSTANT = 3e-9


class DuhemFit(SearchedFit):
    """One parameter, alpha, is searched for: the output is linear in those of f and g."""

    law = Duhem
    size = 1 + _CURVE + _TANGENT
    automatic = False
    grid = (16,)
    free = np.ones(_CURVE + _TANGENT, dtype=bool)
    penalty = np.diag([_CONSTANT, *[0.0] * (_CURVE + _TANGENT - 1)])

    def columns(self, section: RecordSection, place: Array, data: FitData) -> Array:
        return duhem_columns(section.u, _rate(place, data), _CURVE, _TANGENT)

    def build(self, place: Array, coefficients: Array, data: FitData) -> Duhem:
        low, high = data.input_range
        return Duhem(
            rate=_rate(place, data),
            anhysteretic=coefficients[:_CURVE],
            tangent=coefficients[_CURVE:],
            input_range=(min(low, 0.0), max(high, 0.0)),
        )


def _rate(place: Array, data: FitData) -> float:
    return float(10.0 ** (_RATE[0] + place[0] * (_RATE[1] - _RATE[0])) / data.input_scale)
