"""How far rounding takes the readings of the C code in single precision."""

import numpy as np

from flexstage.export.model import DynamicModel
from flexstage.export.realtime.check_samples import command_span
from flexstage.hysteresis.model import Array

#: Roundings of a step over the largest force: six terms of the size of the force in deflection and
#: in rate, each with the rounding of its factor, its product and three sums.
ROUNDINGS = 42.0
# of a step of a lag, whose losses are carried, over what a step adds
_LAG_ROUNDINGS = ROUNDINGS
_SINGLE = 2.0**-24


def rounding_bound(model: DynamicModel, unit_roundoff: float = _SINGLE) -> Array:
    r"""Return a bound of the error that rounding makes in the readings, for ever, by probe.

    What is rounded in a step, at most :math:`c\,u\,W` with the largest free displacement W and unit
    roundoff u, decays with the mode: errors of all steps add up to

    .. math:: \sum_d W_d \sum_i |r_{di}| \frac{c\,u}{1 - e^{-\zeta_i\omega_i h}}

    with the weights r of the reading and c = 42, which for slow modes is
    :math:`c u/(\zeta\omega h)`. Roundings go both ways, so that what is seen is some hundred times
    less. It is infinite where a mode is not damped.

    Notes
    -----
    Validity: commands within their range, modes that are not driven far above what they do at rest
    (times their amplification where they are), and loops of hysteresis of not too many steps: N
    steps all one way add up to ``N u/2`` of its memory, which 10,000 steps do not show beside the
    modes and a million do.
    """
    k = model.omega.size
    # an overdamped mode forgets by its slower root
    zeta = model.damping_ratio
    fall = (zeta - np.sqrt(np.maximum(zeta**2 - 1.0, 0.0))) * model.omega * model.step
    with np.errstate(divide="ignore"):
        growth = np.where(fall > 0.0, -1.0 / np.expm1(-fall), np.inf)
    bound = np.zeros(len(model.probes))
    for d in model.drives:
        low, high = command_span(model, d)
        if d.hysteresis is None:
            largest = abs(d.gain) * max(abs(low), abs(high))
        else:
            ends = d.hysteresis.simulate([low, high]).values
            largest = float(np.abs(ends).max())
        rate = np.abs(d.mode_weights[:, k:]) * model.omega
        reach = np.hypot(d.mode_weights[:, :k], rate)
        terms = 2.0 * k + d.lag_weights.shape[1]
        total = reach.sum(axis=1) + np.abs(d.lag_weights).sum(axis=1) + np.abs(d.feedthrough)
        bound += (
            largest
            * unit_roundoff
            * (
                ROUNDINGS * (reach @ growth)
                + _LAG_ROUNDINGS * np.abs(d.lag_weights).sum(axis=1)
                + terms * total
            )
        )
    for j, p in enumerate(model.probes):
        if p.sensor is not None:
            bound[j] = abs(p.sensor.gain) * bound[j] + p.sensor.quantisation
            bound[j] += 4.0 * unit_roundoff * abs(p.sensor.offset)
    return bound
