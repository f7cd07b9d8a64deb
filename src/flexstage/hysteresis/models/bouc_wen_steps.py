"""Steps of Bouc-Wen and Dahl for any exponent and any shape function: the compiled loops.

The models of the Bouc-Wen family are one equation, h' = u' (A - psi |h|^n), with a shape function
psi that depends on three signs: of u', of h, and of u from a centre. With s the sign of u', v the
distance and g = s h, it is autonomous between the changes of sign,

    dg/dv = A - psi g^n           where h is loaded, g >= 0,
    dw/dv = -(A - psi w^n)        where it is unloaded, w = -g > 0,

so each piece is a flow of the power law, and the pieces end at h = 0 and at the centre, where they
are split exactly. Dahl's friction is solved at once: it has no such changes.

A law is an array: A, n, the centre, Dahl's limit (zero for Bouc-Wen), then psi for (u' < 0, u' > 0)
by (unloaded, loaded) by (u below, u above the centre).
"""

import math

import numpy as np

from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.models.power_law import distance_to_zero, moved

#: Places of psi in a law, where h is unloaded and where it is loaded.
UNLOADED, LOADED = [4, 5, 8, 9], [6, 7, 10, 11]

# Most steps of a Newton iteration, and the rounding of a number.
_ITERATIONS = 100
_ROUNDING = 2.3e-16
_LEAST_RATE = 1e-5


def law_of(A: float, n: float, centre: float, psi: Array) -> Array:
    """Return the law of a shape function, shape (12,), with A the slope dh/du at h = 0.

    Psi is for (u' < 0, u' > 0) by (unloaded, loaded) by (u below, above the centre), shape (2, 2,
    2); the centre is minus infinity where it does not change with u.
    """
    return np.concatenate([[A, n, centre, 0.0], np.ravel(psi)])


def friction_law(stiffness: float, limit: float, exponent: float) -> Array:
    """Return the law of Dahl's friction, shape (12,), of another exponent than 1."""
    return np.concatenate([[stiffness, exponent, -math.inf, limit], np.zeros(8)])


@compiled
def _branch(s: float, upper: bool) -> int:
    """Return where a law holds psi for unloading; loading is two places further."""
    return (8 if s > 0.0 else 4) + (1 if upper else 0)


@compiled
def _is_upper(u: float, s: float, centre: float) -> bool:
    """Say on which side of the centre a motion from u begins."""
    return u >= centre if s > 0.0 else u > centre


@compiled
def _one_side(h: float, s: float, v: float, upper: bool, law: Array) -> float:
    """Return h after a distance on one side of the centre."""
    at = _branch(s, upper)
    return s * moved(s * h, v, law[0], law[at], law[at + 2], law[1])


@compiled
def advance(h: float, u: float, du: float, law: Array) -> float:
    """Return the hysteretic displacement after one straight line of the input.

    Not finite if h grows without limit.
    """
    if du == 0.0:
        return h
    s = 1.0 if du > 0.0 else -1.0
    v = s * du
    if law[3] > 0.0:
        return _rubbed(h, s, v, law[0], law[3], law[1])
    upper = _is_upper(u, s, law[2])
    until = s * (law[2] - u)
    # Two stretches where the centre lies between; one call, which is long once compiled.
    stretch = until if 0.0 < until < v else v
    while True:
        h = _one_side(h, s, stretch, upper, law)
        v -= stretch
        if not v > 0.0:
            return h
        stretch = v
        upper = not upper


@compiled
def _rubbed(F: float, s: float, v: float, sigma: float, limit: float, i: float) -> float:
    """Return Dahl's friction after a distance v.

    The gap e = 1 - s F/F_c closes as ``|e|' = -(sigma/F_c) |e|^i``, whose solution is
    ``|e| (1 + (i - 1) (sigma/F_c) v |e|^(i-1))^(-1/(i-1))``.
    """
    e = 1.0 - s * F / limit
    if e == 0.0:
        return F
    m = i - 1.0
    q = m * (sigma / limit * v) * abs(e) ** m
    return F + s * limit * e * (-math.expm1(-math.log1p(q) / m) if q > -1.0 else 1.0)


@compiled
def simulate_samples(
    u: Array, u_last: float, h: float, cubic: Array, law: Array, out: Array
) -> float:
    """Write the output sample by sample, and return the last hysteretic displacement.

    `cubic` are the coefficients of u, u^2 and u^3 in the output.
    """
    for i in range(u.size):
        h = advance(h, u_last, u[i] - u_last, law)
        u_last = u[i]
        out[i] = u_last * (cubic[0] + u_last * (cubic[1] + u_last * cubic[2])) - h
    return h


@compiled
def inverse_samples(
    y: Array, u: float, h: float, limits: Array, cubic: Array, law: Array, out: Array
) -> tuple[int, float, int]:
    """Write the input that gives each output.

    Limits are lowest and highest input, and the least slope of the cubic between them; psi must not
    be below zero where h is loaded. Returned: number of inverted samples, less than all if
    the output does not rise with the input; the last h; and the first sample out of reach within
    the limits, at which the input stops, or -1.
    """
    missed = -1
    for i in range(y.size):
        level = u * (cubic[0] + u * (cubic[1] + u * cubic[2])) - h
        change = y[i] - level
        if change != 0.0:
            least = limits[2] - _steepest(h, law)
            if not least > 0.0:
                return i, h, missed
            end, after = _inverse_step(change, u, h, least, limits, cubic, law)
            if not np.isfinite(end):
                missed = i if missed < 0 else missed
                end = limits[1] if change > 0.0 else limits[0]
                after = advance(h, u, end - u, law)
            u, h = end, after
        out[i] = u
    return y.size, h, missed


@compiled
def _inverse_step(
    change: float,
    u: float,
    h: float,
    least: float,
    limits: Array,
    cubic: Array,
    law: Array,
) -> tuple[float, float]:
    """Return input and displacement after a change of output: Newton's method in a bracket."""
    s = 1.0 if change > 0.0 else -1.0
    target = s * change
    room = limits[1] - u if s > 0.0 else u - limits[0]
    low = 0.0
    # The least slope bounds the way from above, with a margin for rounding.
    high = target / least
    high += 4.0 * _ROUNDING * (high + abs(h) / least)
    limited = high > room
    high = min(high, room)
    v = high if limited else min(high, target / _slope(0.0, h, u, s, cubic, law))
    converged = False
    count = 0
    while True:
        end = u + s * v
        # The hysteresis sees the rounded input; so does the last evaluation.
        after = advance(h, u, end - u, law)
        count += 1
        if converged or count > _ITERATIONS:
            return end, after
        # Divided differences of the powers: no cancellation.
        secant = cubic[0] + cubic[1] * (u + end) + cubic[2] * (u * u + u * end + end * end)
        excess = (end - u) * s * secant - s * (after - h) - target
        if limited and excess < 0.0:
            tolerance = 8.0 * _ROUNDING * (abs(h) + limits[2] * (abs(u) + room) + target)
            return (end, after) if excess > -tolerance else (np.nan, np.nan)
        limited = False
        if excess > 0.0:
            high = v
        else:
            low = v
        correction = excess / _slope(v, after, u, s, cubic, law)
        if not low <= v - correction <= high:
            correction = v - 0.5 * (low + high)
        v -= correction
        converged = abs(correction) <= _ROUNDING * (abs(u) + v)


@compiled
def _steepest(h: float, law: Array) -> float:
    """Return the steepest dh/du that any motion from h can reach."""
    if law[3] > 0.0:
        # Along any motion the slope only falls: the steepest is the one at the start.
        return max(_rise(h, 0.0, 1.0, law), _rise(h, 0.0, -1.0, law))
    # Loading slows down from A; unloading starts at its steepest.
    return law[0] - min(0.0, law[4], law[5], law[8], law[9]) * abs(h) ** law[1]


@compiled
def _rise(h: float, u: float, s: float, law: Array) -> float:
    """Return dh/du of a motion of direction s at u."""
    if law[3] > 0.0:
        e = 1.0 - s * h / law[3]
        return 0.0 if e == 0.0 else law[0] * abs(e) ** law[1] * (1.0 if e > 0.0 else -1.0)
    at = _branch(s, _is_upper(u, s, law[2])) + (2 if s * h >= 0.0 else 0)
    return law[0] - law[at] * abs(h) ** law[1]


@compiled
def _slope(v: float, h: float, u: float, s: float, cubic: Array, law: Array) -> float:
    """Return the slope of the output after a distance v from u, where it is h."""
    end = u + s * v
    tangent = cubic[0] + end * (2.0 * cubic[1] + end * 3.0 * cubic[2])
    return tangent - _rise(h, end, s, law)


@compiled
def law_segments(u: Array, h: float, gain: float, law: Array, out: Array) -> tuple:
    """Write the pieces of the output d u - h between samples, for exponent 1.

    Writes start, constant, slope, amplitude and rate of each piece, shape (5, 4 n), from h at the
    first sample; returns the number of pieces and the last h.
    """
    m = 0
    for i in range(u.size - 1):
        du = u[i + 1] - u[i]
        s = 1.0 if du >= 0.0 else -1.0
        v = s * du
        upper = _is_upper(u[i], s, law[2])
        until = s * (law[2] - u[i])
        begin, end = 0.0, until if 0.0 < until < v else v
        while True:
            at = _branch(s, upper)
            g, start = s * h, begin
            if g < 0.0:
                start += distance_to_zero(-g, law[0], law[at])
                _piece(out, m, i, begin, s, v, u[i], gain, g, law[0], -law[at])
                m += 1
            if start < end or g >= 0.0:
                _piece(out, m, i, start, s, v, u[i], gain, max(g, 0.0), law[0], law[at + 2])
                m += 1
            h = _one_side(h, s, end - begin, upper, law)
            if end == v:
                break
            begin, end, upper = end, v, not upper
    return m, h


@compiled
def _piece(
    out: Array,
    m: int,
    i: int,
    begin: float,
    s: float,
    v: float,
    u: float,
    gain: float,
    g: float,
    A: float,
    rate: float,
) -> None:
    """Write one piece, g = g0 + G (1 - exp(-x s))/x, with s in samples.

    Where x is small, g0 and the limit g0 + G/x would cancel. A larger rate and a
    slope then approximate the piece by its first two derivatives: the third differs by less than
    1e-5 x G, which is below the rounding of the limit.
    """
    x = rate * v
    rise = v * (A - rate * g)
    r = x if abs(x) >= _LEAST_RATE else _LEAST_RATE
    amplitude = -rise * (x / r) / r
    out[0, m] = i + (begin / v if v > 0.0 else 0.0)
    out[1, m] = gain * (u + s * begin) - s * (g - amplitude)
    out[2, m] = s * (v * gain - rise * (1.0 - x / r))
    out[3, m] = -s * amplitude
    out[4, m] = r if amplitude != 0.0 else 0.0
