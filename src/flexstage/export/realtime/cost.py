"""What a step of the C code costs: operations, and bytes of an instance."""

import numpy as np

from flexstage.export.model import DynamicModel
from flexstage.export.source.model_numbers import lag_rates


def operations(model: DynamicModel) -> int:
    """Return about how many additions and multiplications a usual step takes."""
    k, probes = model.omega.size, len(model.probes)
    total = 0
    for d in model.drives:
        lags = lag_rates(d).size
        # transition and moments, rates to samples and back, readings
        total += k * (20 + 2 + 4 * probes) + 2 * lags * probes + 2 * probes
        if d.hysteresis is None:
            total += 2 * k
            continue
        # nine derivatives of an exponential that falls by some hundredths in a step
        total += k * 2 * 8 + lags * (2 * 9 + 6) + 100
    return int(round(total, -1))


def state_numbers(model: DynamicModel) -> int:
    """Return how many numbers the model remembers from step to step."""
    total = 0
    for d in model.drives:
        memory = 1 if d.hysteresis is None else int(np.size(d.hysteresis.initial_state()))
        total += 2 * model.omega.size + lag_rates(d).size + memory + 3
    return total + sum(3 for p in model.probes if p.sensor is not None)
