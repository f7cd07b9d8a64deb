"""Fit of the Generalised Maxwell-slip model."""

from dataclasses import replace

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.model_fit import FitData
from flexstage.hysteresis.identification.nonlinear_fit import RefinedFit, roughness
from flexstage.hysteresis.models.maxwell_slip.law import GeneralisedMaxwellSlip
from flexstage.hysteresis.models.play_sum import play_columns
from flexstage.hysteresis.models.prandtl_ishlinskii.fit import (
    FLATTEST,
    PLAYS,
    PrandtlIshlinskiiFit,
    interior_kinks,
)
from flexstage.hysteresis.models.prandtl_ishlinskii.law import PrandtlIshlinskii

#: Kinks of the spring; there are as many elements as plays.
_KINKS = 6
#: Weight of the penalty on second differences.
_SMOOTHING = 3e-4


class GeneralisedMaxwellSlipFit(RefinedFit):
    """Springs, sliders and a bent spring; begun from the exact inverse of plays alone.

    Parameters: stiffness, those of the elements, then the kinks of the spring. The penalty is on
    second differences of stiffnesses and of kinks.
    """

    law = GeneralisedMaxwellSlip
    size = 1 + PLAYS + _KINKS
    penalty = _SMOOTHING * roughness(1, PLAYS, _KINKS)

    def begin(self, data: FitData) -> Array:
        stiffness, _, elements, _ = self._cached(data)
        return np.concatenate((stiffness, elements, np.zeros(_KINKS)))

    def bounds(self, data: FitData) -> tuple[Array, Array]:
        slope = data.input_scale / data.stroke
        low = np.zeros(self.size)
        low[0] = 1e-3 * slope
        low[1 + PLAYS :] = -np.inf
        return low, np.full(self.size, slope)

    def build(self, parameters: Array, data: FitData) -> GeneralisedMaxwellSlip:
        _, thresholds, _, kinks = self._cached(data)
        return GeneralisedMaxwellSlip(
            stiffness=float(parameters[0]),
            thresholds=thresholds,
            element_stiffness=parameters[1 : 1 + PLAYS],
            dead_zones=kinks,
            dead_zone_weights=parameters[1 + PLAYS :],
        )

    def changes(self, p: Array, scale: Array, section: RecordSection, data: FitData) -> Array:
        # in closed form: the voltage is given, so that what a parameter adds to it the displacement
        # y takes away again, by the slope of all springs at y less that of the sliders that slide;
        # those that stick keep the change that they had where they last slid
        model = self.build(p, data)
        y = model.simulate(section.u).values
        sliders = play_columns(y, model.thresholds)
        beyond = y[:, None] - model.dead_zones
        beyond = np.where(beyond * np.sign(model.dead_zones) > 0.0, beyond, 0.0)
        slope = model.stiffness + (beyond != 0.0) @ model.dead_zone_weights
        derivatives = np.column_stack((y, y[:, None] - sliders, beyond))
        _given_voltage(derivatives, sliders, slope, model.element_stiffness)
        return derivatives * scale

    def _cached(self, data: FitData) -> list[Array]:
        """Stiffness, thresholds and stiffnesses of elements of the start, and the kinks."""
        key = f"{self.kind} start"
        if key not in data.memo:
            # those of the first fit, so that they stay where they are when cycles are held out
            plays = PrandtlIshlinskiiFit().fit(data).model
            assert isinstance(plays, PrandtlIshlinskii)
            kinks = interior_kinks(data, plays, _KINKS)
            # plays that stand still after a turn, as where noise of the input or a delay blunts
            # it, have no inverse; some slope there is enough to begin with
            least = FLATTEST * data.stroke / data.input_scale
            start = replace(plays, gain=max(plays.gain, least))
            gain, thresholds, weights = start.inverse_plays()
            # a play is the displacement less a stop, so that negative plays are stops and a spring
            data.memo[key] = [np.array([gain + weights.sum()]), thresholds, -weights, kinks]
        return data.memo[key]


@compiled
def _given_voltage(derivatives: Array, sliders: Array, slope: Array, stiffness: Array) -> None:
    """Turn changes of the voltage at given displacements into those of the displacement."""
    sticking = np.zeros((sliders.shape[1], derivatives.shape[1]))
    before = np.zeros(sliders.shape[1])
    for n in range(derivatives.shape[0]):
        now, total = derivatives[n], slope[n]
        for i in range(before.size):
            if sliders[n, i] == before[i]:
                total += stiffness[i]
                for q in range(now.size):
                    now[q] -= stiffness[i] * sticking[i, q]
        for q in range(now.size):
            now[q] /= -total
        for i in range(before.size):
            if sliders[n, i] != before[i]:
                before[i] = sliders[n, i]
                sticking[i] = now
