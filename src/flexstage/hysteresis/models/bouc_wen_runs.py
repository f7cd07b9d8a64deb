"""Monotone runs of the Bouc-Wen equation with exponent 1, evaluated without a chain of steps.

In a run of direction s, with v = |u - u_start| and g = s h,

    dg/dv = A - (beta + gamma) g      for g >= 0,
    dg/dv = A - (beta - gamma) g      for g < 0,

so g is an exponential of the distance from where the run began, or from where h passed zero. No
sample needs the one before, and a loop over the samples of a run becomes vector code.
"""

from numba import prange

from flexstage.hysteresis.compiled import compiled, compiled_parallel
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.models.decay import decayed, distance_to_zero, saturating


@compiled
def _fill(
    u: Array,
    first: int,
    last: int,
    origin: float,
    s: float,
    gain: float,
    g: float,
    A: float,
    rate: float,
    out: Array,
) -> None:
    """Write y = d u - h for the samples of one piece; g is the value at its origin."""
    start = s * g
    if rate > 0.0:
        span = s * ((A - rate * g) / rate)
        for k in range(first, last):
            # Rounding may put a sample before the origin by one unit in the last place.
            v = max(s * (u[k] - origin), 0.0)
            out[k] = gain * u[k] - (start + span * decayed(rate * v))
    else:
        for k in range(first, last):
            v = max(s * (u[k] - origin), 0.0)
            out[k] = gain * u[k] - s * saturating(g, A, rate, v)


@compiled
def _first_beyond(u: Array, first: int, last: int, s: float, origin: float, v: float) -> int:
    """Return the first sample of a run that lies at least a distance v from its origin."""
    while first < last:
        middle = (first + last) // 2
        if s * (u[middle] - origin) < v:
            first = middle + 1
        else:
            last = middle
    return first


@compiled
def simulate_runs(
    u: Array,
    u_last: float,
    h: float,
    gain: float,
    A: float,
    beta: float,
    gamma: float,
    out: Array,
) -> float:
    """Write the output run by run, and return the last hysteretic displacement.

    A is the slope dh/du at h = 0; `u_last` and h are before the first input.
    """
    count = u.size
    i = 0
    while i < count:
        if u[i] == u_last:
            out[i] = gain * u[i] - h
            i += 1
            continue
        s = 1.0 if u[i] > u_last else -1.0
        end = i + 1
        while end < count and s * (u[end] - u[end - 1]) >= 0.0:
            end += 1
        g = s * h
        zero = 0.0
        middle = i
        length = s * (u[end - 1] - u_last)
        if g < 0.0:
            zero = distance_to_zero(-g, A, gamma - beta)
            middle = _first_beyond(u, i, end, s, u_last, zero)
            _fill(u, i, middle, u_last, s, gain, g, A, beta - gamma, out)
        if middle < end:
            g = max(g, 0.0)
            _fill(u, middle, end, u_last + s * zero, s, gain, g, A, beta + gamma, out)
            h = s * saturating(g, A, beta + gamma, length - zero)
        else:
            h = s * saturating(g, A, beta - gamma, length)
        u_last = u[end - 1]
        i = end
    return h


@compiled_parallel
def simulate_batch(u: Array, parameters: Array, out: Array) -> None:
    """Write the outputs of many models at rest for one input, one model for each core.

    Parameters: gain, hysteresis gain, beta and gamma of each, shape (k, 4).
    """
    for k in prange(parameters.shape[0]):
        p = parameters[k]
        simulate_runs(u, 0.0, 0.0, p[0], p[1], p[2], p[3], out[k])
