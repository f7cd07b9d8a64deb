"""Fit of the Bouc-Wen model."""

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.model_fit import FitData
from flexstage.hysteresis.identification.nonlinear_fit import SearchedFit
from flexstage.hysteresis.models.bouc_wen.law import BoucWen

#: Range of (beta + gamma) times the range of the input, in powers of ten, ...
_STIFFNESS = (-1.0, 2.5)
#: ... and of (beta - gamma) / (beta + gamma).
_RATIO = (-0.95, 5.0)


def shape_at(place: Array, scale: float) -> tuple[float, float]:
    """Return beta and gamma [per unit of the input] of a place, for a part of unit gain."""
    total = 10.0 ** (_STIFFNESS[0] + place[0] * (_STIFFNESS[1] - _STIFFNESS[0])) / scale
    ratio = _RATIO[0] + place[1] * (_RATIO[1] - _RATIO[0])
    return float(0.5 * total * (1.0 + ratio)), float(0.5 * total * (1.0 - ratio))


class BoucWenFit(SearchedFit):
    """Two parameters are searched for: a Bouc-Wen model is linear in its two gains.

    Put h = A g; then g' = u' - beta |u'| g - gamma u' |g|. With beta and gamma given, the output
    d u - A g is linear in d and A. The exponent is 1: records of piezo drives do not determine it.
    """

    law = BoucWen
    size = 4
    grid = (8, 6)

    def columns(self, section: RecordSection, place: Array, data: FitData) -> Array:
        beta, gamma = shape_at(place, data.input_scale)
        unit = BoucWen(gain=0.0, hysteresis_gain=1.0, beta=beta, gamma=gamma)
        return np.column_stack((section.u, unit.simulate(section.u).values))

    def build(self, place: Array, coefficients: Array, data: FitData) -> BoucWen:
        beta, gamma = shape_at(place, data.input_scale)
        gain = max(float(coefficients[1]), 1e-12 * data.stroke / data.input_scale)
        return BoucWen(gain=float(coefficients[0]), hysteresis_gain=gain, beta=beta, gamma=gamma)
