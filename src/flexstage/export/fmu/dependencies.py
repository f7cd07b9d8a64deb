"""What each output and each derivative of an FMU depends on."""

import numpy as np

from flexstage.export.fmu.layout import FmuLayout
from flexstage.export.model import DynamicModel


def depends_on(model: DynamicModel, layout: FmuLayout) -> dict[int, list[int]]:
    """Return the inputs and states that each output, derivative and event indicator depends on.

    All are value references, rising, and 0 is time.
    """
    k, x, at = model.omega.size, layout.first["state"], layout.states
    dx = layout.first["derivative"]
    q, v = x + at.deflection_at, x + at.deflection_at + k
    to_rate = dx - x
    drives = range(len(model.drives))
    # what sets the free displacement of a drive, and that with its creep
    source = [
        [layout.first["input"] + d if at.voltage_at[d] < 0 else x + at.voltage_at[d]]
        for d in drives
    ]
    lags = [[x + at.lag_at[d] + j for j in range(_lags(model, d))] for d in drives]
    total = [source[d] + lags[d] for d in drives]
    found: dict[int, list[int]] = {}
    for d in drives:
        if at.voltage_at[d] >= 0:
            command = layout.first["input"] + d
            found[dx + at.voltage_at[d]] = [command, *source[d]]
        for lag in lags[d]:
            found[lag + to_rate] = [*source[d], lag]
    for m in range(k):
        moved = [t for d in drives if model.drives[d].modal_gain[m] != 0.0 for t in total[d]]
        blown = [t for d in drives if model.drives[d].rate_time[m] != 0.0 for t in total[d]]
        found[q + m + to_rate] = [v + m, *blown]
        found[v + m + to_rate] = [q + m, v + m, *moved]
    for p, probe in enumerate(model.probes):
        motion = [q + m for m in range(k) if model.probe_shapes[p, m] != 0.0]
        motion += [t for d in drives if model.drives[d].feedthrough[p] != 0.0 for t in total[d]]
        reading = layout.first["output"] + p
        found[reading] = motion
        if at.seen_at[p] >= 0:
            seen = x + at.seen_at[p]
            found[seen + to_rate] = [*motion, seen]
            # a bandwidth of 0 takes the lag away
            found[reading] = [*motion, seen]
        if probe.sensor is not None:
            found[reading] = [0, *found[reading]]
    amplified = [d for d in drives if at.voltage_at[d] >= 0]
    each = layout.count["indicator"] // max(len(amplified), 1)
    for j, d in enumerate(amplified):
        for which in range(each):
            reference = layout.first["indicator"] + each * j + which
            found[reference] = [layout.first["input"] + d, *source[d]]
    return {key: sorted(set(value)) for key, value in found.items()}


def _lags(model: DynamicModel, d: int) -> int:
    return int(np.shape(model.drives[d].lag_weights)[1])
