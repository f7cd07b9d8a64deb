"""Fit of the Modified Prandtl-Ishlinskii model."""

import itertools

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.model_fit import FitData
from flexstage.hysteresis.identification.nonlinear_fit import RefinedFit, roughness
from flexstage.hysteresis.models.modified_prandtl_ishlinskii.law import ModifiedPrandtlIshlinskii
from flexstage.hysteresis.models.play_sum import play_columns
from flexstage.hysteresis.models.prandtl_ishlinskii.fit import (
    FLATTEST,
    PLAYS,
    PrandtlIshlinskiiFit,
    interior_kinks,
)
from flexstage.hysteresis.models.prandtl_ishlinskii.law import PrandtlIshlinskii

#: Places where the line behind the plays may bend.
_KINKS = 8
#: Weight of the penalty on second differences.
_SMOOTHING = 3e-4


class ModifiedPrandtlIshlinskiiFit(RefinedFit):
    """Plays, and the slopes of the line behind them; begun from plays alone.

    Parameters: gain, weights of plays, then slopes of the line. The penalty is on second
    differences of weights and of slopes.
    """

    law = ModifiedPrandtlIshlinskii
    size = 1 + PLAYS + _KINKS
    penalty = _SMOOTHING * roughness(1, PLAYS, _KINKS + 1)

    def begin(self, data: FitData) -> Array:
        model, kinks = self._cached(data)
        return np.concatenate(([model.gain], model.weights, np.ones(kinks.size + 1)))

    def bounds(self, data: FitData) -> tuple[Array, Array]:
        slope = data.stroke / data.input_scale
        low = np.zeros(2 + PLAYS + _KINKS)
        low[0] = 1e-3 * slope
        low[1 + PLAYS :] = FLATTEST
        scale = np.full(low.size, slope)
        scale[1 + PLAYS :] = 1.0
        return low, scale

    def build(self, parameters: Array, data: FitData) -> ModifiedPrandtlIshlinskii:
        start, kinks = self._cached(data)
        gain, weights = parameters[0], parameters[1 : 1 + PLAYS]
        slopes = parameters[1 + PLAYS :]
        about_zero = slopes[int(np.searchsorted(kinks, 0.0))]
        change = np.diff(slopes) / about_zero
        return ModifiedPrandtlIshlinskii(
            gain=gain * about_zero,
            thresholds=start.thresholds,
            weights=weights * about_zero,
            dead_zones=kinks * about_zero,
            dead_zone_weights=np.where(kinks > 0.0, change, -change),
        )

    def changes(self, p: Array, scale: Array, section: RecordSection, data: FitData) -> Array:
        # in closed form: with v the sum of the plays and S the line behind them, S(v) changes by
        # S'(v) with what a play adds to v, and by the way from 0 to v within an interval with its
        # slope
        start, kinks = self._cached(data)
        slopes = p[1 + PLAYS :]
        columns = play_columns(section.u, start.thresholds)
        v = p[0] * section.u + columns @ p[1 : 1 + PLAYS]
        ends = np.concatenate(([-np.inf], kinks, [np.inf]))
        derivatives = np.empty((section.u.size, p.size), order="F")
        slope = slopes[np.searchsorted(kinks, v)]
        derivatives[:, 0] = slope * section.u
        derivatives[:, 1 : 1 + PLAYS] = slope[:, None] * columns
        for j, (low, high) in enumerate(itertools.pairwise(ends), start=1 + PLAYS):
            derivatives[:, j] = np.clip(v, low, high) - np.clip(0.0, low, high)
        return derivatives * scale

    def _cached(self, data: FitData) -> tuple[PrandtlIshlinskii, Array]:
        key = f"{self.kind} start"
        if key not in data.memo:
            # those of the first fit, so that the kinks stay where they are when cycles are held out
            model = PrandtlIshlinskiiFit().fit(data).model
            assert isinstance(model, PrandtlIshlinskii)
            kinks = interior_kinks(data, model, _KINKS)
            data.memo[key] = [np.array([model.gain]), model.thresholds, model.weights, kinks]
        gain, thresholds, weights, kinks = data.memo[key]
        plays = PrandtlIshlinskii(gain=float(gain[0]), thresholds=thresholds, weights=weights)
        return plays, kinks
