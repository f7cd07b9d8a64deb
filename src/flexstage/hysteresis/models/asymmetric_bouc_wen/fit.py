"""Fit of the Asymmetric Bouc-Wen model."""

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.model_fit import FitData
from flexstage.hysteresis.identification.nonlinear_fit import SearchedFit
from flexstage.hysteresis.models.asymmetric_bouc_wen.law import AsymmetricBoucWen
from flexstage.hysteresis.models.bouc_wen.fit import shape_at
from flexstage.hysteresis.models.bouc_wen.law import BoucWen


class AsymmetricBoucWenFit(SearchedFit):
    """Two parameters are searched for: the model is linear in its cubic and its gain."""

    law = AsymmetricBoucWen
    size = 6
    automatic = False
    grid = (8, 6)
    free = np.array([False, True, True, False])

    def columns(self, section: RecordSection, place: Array, data: FitData) -> Array:
        beta, gamma = shape_at(place, data.input_scale)
        unit = BoucWen(gain=0.0, hysteresis_gain=1.0, beta=beta, gamma=gamma)
        u = section.u
        return np.column_stack((u, u**2, u**3, unit.simulate(u).values))

    def build(self, place: Array, coefficients: Array, data: FitData) -> AsymmetricBoucWen:
        beta, gamma = shape_at(place, data.input_scale)
        low, high = data.input_range
        least = 1e-12 * data.stroke / data.input_scale
        return AsymmetricBoucWen(
            gain=float(coefficients[0]),
            quadratic=float(coefficients[1]),
            cubic=float(coefficients[2]),
            hysteresis_gain=max(float(coefficients[3]), least),
            beta=beta,
            gamma=gamma,
            lowest_input=min(low, 0.0),
            highest_input=max(high, 0.0),
        )
