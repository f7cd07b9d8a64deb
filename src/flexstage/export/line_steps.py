"""Modes behind straight lines of a displacement, and what probes read at rest: compiled."""

from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array


@compiled
def modes_behind_lines(
    w: Array,
    transition: Array,
    moments: Array,
    by_rate: Array,
    z: Array,
    v: Array,
    reader: Array,
    y: Array,
) -> None:
    """Step modes along straight lines of a displacement that acts by its rate too.

    Of k modes: w has the n + 1 samples, the modes are at the first of them; `transition` goes from
    (z, z') to (z, z'), shape (4, k); `moments` say what the derivatives of a force do, 3 rows at
    least; `by_rate` is the time by which the rate acts [samples]. z and v [per sample] are moved
    on. Readings are added to y, shape (p, n), with the weights `reader` of z and then of z', shape
    (p, 2 k).
    """
    k = z.size
    for n in range(w.size - 1):
        rise = w[n + 1] - w[n]
        for i in range(k):
            # a rate in the force is a constant within each step
            start = w[n] + by_rate[i] * rise
            at, speed = z[i], v[i]
            z[i] = (transition[0, i] * at + transition[1, i] * speed) + (
                moments[1, i] * start + moments[2, i] * rise
            )
            v[i] = (transition[2, i] * at + transition[3, i] * speed) + (
                moments[0, i] * start + moments[1, i] * rise
            )
        for p in range(y.shape[0]):
            total = y[p, n]
            for i in range(k):
                total += reader[p, i] * z[i] + reader[p, k + i] * v[i]
            y[p, n] = total


@compiled
def read_at_rest(w: float, reader: Array, lags: Array, feedthrough: Array, y: Array) -> None:
    """Add what probes read of a drive that rests, in the order in which a step adds it."""
    for p in range(y.size):
        total = y[p]
        for i in range(reader.shape[1]):
            total += reader[p, i] * w
        for i in range(lags.shape[1]):
            total += lags[p, i] * w
        y[p] = total + feedthrough[p] * w
