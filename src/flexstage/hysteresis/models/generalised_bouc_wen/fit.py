"""Fit of the Generalised Bouc-Wen model."""

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.model_fit import FitData
from flexstage.hysteresis.identification.nonlinear_fit import RefinedFit
from flexstage.hysteresis.models.bouc_wen.fit import BoucWenFit
from flexstage.hysteresis.models.bouc_wen.law import BoucWen
from flexstage.hysteresis.models.generalised_bouc_wen.law import GeneralisedBoucWen

#: Signs of the rate, and of the input about the centre, in the four regions of loading.
_BY_RATE = np.array([-1.0, -1.0, 1.0, 1.0])
_BY_SIDE = np.array([-1.0, 1.0, -1.0, 1.0])
#: Least value of the shape function where loaded, times the range of the input.
_LEAST = 0.01
#: Largest value of the shape function where unloaded, over the least one where loaded.
_BELOW = 0.99


class GeneralisedBoucWenFit(RefinedFit):
    """Two gains and the shape function, bounded; begun from the best Bouc-Wen model.

    The shape is searched for as its values in the four loading regions, which are kept above zero,
    and two differences between unloading regions: so the hysteretic part cannot grow without limit
    on an input that it was not fitted to.
    """

    law = GeneralisedBoucWen
    size = 8
    automatic = False

    def begin(self, data: FitData) -> Array:
        # the two gains, the shape function where loaded, two differences
        key = f"{self.kind} start"
        if key not in data.memo:
            plain = BoucWenFit().fit(data).model
            assert isinstance(plain, BoucWen)
            # gamma sgn(x h) comes next to the gamma of Bouc-Wen, which has no place in the shape
            loaded = plain.beta + plain.gamma * _BY_SIDE * _BY_RATE
            gains = [plain.gain, plain.hysteresis_gain]
            data.memo[key] = [np.array([*gains, *loaded, -plain.gamma, 0.0])]
        return data.memo[key][0].copy()

    def bounds(self, data: FitData) -> tuple[Array, Array]:
        slope = data.stroke / data.input_scale
        low = np.full(8, -np.inf)
        low[:2] = 0.0, 1e-6 * slope
        low[2:6] = _LEAST / data.input_scale
        scale = np.full(8, 10.0 / data.input_scale)
        scale[:2] = slope
        return low, scale

    def build(self, parameters: Array, data: FitData) -> GeneralisedBoucWen:
        low, high = data.input_range
        return GeneralisedBoucWen(
            gain=float(parameters[0]),
            hysteresis_gain=float(parameters[1]),
            shape=_bounded(parameters[2:6], *parameters[6:]),
            centre=0.5 * (low + high),
        )


def _bounded(loaded: Array, by_both: float, by_rate: float) -> tuple[float, ...]:
    """Six numbers of a shape that is positive where loaded, and smaller where unloaded."""
    rate, side = _BY_RATE, _BY_SIDE
    mean, by_side = float(np.mean(loaded)), float(np.mean(loaded * side))
    # where unloaded, psi is by_side * side - mean + change; h comes no further than A / psi loaded
    change = by_both * side * rate + by_rate * rate
    room = _BELOW * float(np.min(loaded)) + mean - by_side * side
    share = 1.0 / max(1.0, float(np.max(change / room)))
    both, alone = float(np.mean(loaded * side * rate)), float(np.mean(loaded * rate))
    return (
        mean,
        0.5 * (both + share * by_both),
        0.5 * (both - share * by_both),
        0.5 * (alone + share * by_rate),
        0.5 * (alone - share * by_rate),
        by_side,
    )
