"""Bouc-Wen of exponent 1 and one mode in one loop, for simulations by the million."""

import numpy as np

from flexstage.hysteresis.chain.element import LARGEST_RATE, ORDERS
from flexstage.hysteresis.chain.modal import UnitStep, piece_of_step
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array

# (1 - exp(-x))/x = sum of (-x)^j/(j + 1)!
_GROWTH: Array = np.asarray(1.0 / np.cumprod(np.arange(1.0, ORDERS + 2.0)), dtype=np.float64)


def bouc_wen_with_mode(
    u: Array,
    last: float,
    h: float,
    numbers: tuple[float, float, float, float],
    step: UnitStep,
    z: float,
    v: float,
    share: float,
    y: Array,
) -> tuple[float, float, float]:
    """Write the output of a stage of one mode behind Bouc-Wen of exponent 1.

    Inside a line of the input on which h does not pass zero, the derivatives of the force are those
    of an exponential, so that a step is two sums.

    Numbers are gain d, hysteresis gain A, beta and gamma; h is the hysteretic displacement, z the
    deflection and v its rate [per sample], at the input `last` one step before the first. What
    `share` leaves of one follows at once. Writes y; returns h, z and v at the last sample.
    """
    fastest = (abs(numbers[2]) + abs(numbers[3])) * float(np.abs(np.diff(u, prepend=last)).max())
    terms, size = 2, 1.0
    while terms < ORDERS and size > 1e-18:
        size *= min(fastest, LARGEST_RATE) / (terms + 1.0)
        terms += 1
    return _run(
        u,
        last,
        h,
        *numbers,
        terms,
        float(step.angle[0]),
        float(step.damping_ratio[0]),
        np.ascontiguousarray(step.transition[:, 0]),
        np.ascontiguousarray(step.moments[:, 0]),
        _GROWTH,
        z,
        v,
        share,
        y,
    )


@compiled
def _run(
    u: Array,
    last: float,
    h: float,
    gain: float,
    A: float,
    beta: float,
    gamma: float,
    terms: int,
    w: float,
    zeta: float,
    transition: Array,
    moments: Array,
    growth: Array,
    z: float,
    v: float,
    share: float,
    y: Array,
) -> tuple[float, float, float]:
    zz, zv, vz, vv = transition[0], transition[1], transition[2], transition[3]
    m0, m1, m2 = moments[0], moments[1], moments[2]
    for k in range(u.size):
        du = u[k] - last
        s = 1.0 if du >= 0.0 else -1.0
        # two calls and no choice of a rate: the processor guesses the side, and need not wait for h
        if s * h >= 0.0:
            mu = (beta + gamma) * abs(du)
            by_z, grown = _sums(mu, terms, moments, growth)
        else:
            mu = (beta - gamma) * abs(du)
            by_z, grown = _sums(mu, terms, moments, growth)
        # dh/dx = rise exp(-mu x), x from 0 to 1 along the line
        rise = A * du - mu * h
        end = h + rise * grown
        if abs(mu) <= LARGEST_RATE and (s * h >= 0.0 or s * end < 0.0):
            by_v = m1 - mu * by_z
            f = gain * last - h
            at = (zz * z + zv * v) + (m1 * f + gain * du * m2 - rise * by_z)
            v = (vz * z + vv * v) + (m0 * f + gain * du * m1 - rise * by_v)
            z, h = at, end
        else:
            h, z, v = _hard_step(last, du, h, gain, A, beta, gamma, w, zeta, z, v)
        last = u[k]
        y[k] = share * z + (1.0 - share) * (gain * last - h)
    return h, z, v


@compiled
def _sums(mu: float, terms: int, moments: Array, growth: Array) -> tuple[float, float]:
    """What an exponential does to the mode and to h in a step, by its derivatives."""
    by_z = grown = 0.0
    for j in range(terms - 1, 0, -1):
        by_z = moments[j + 1] - mu * by_z
        grown = growth[j - 1] - mu * grown
    return by_z, grown


@compiled
def _hard_step(
    last: float,
    du: float,
    h: float,
    gain: float,
    A: float,
    beta: float,
    gamma: float,
    w: float,
    zeta: float,
    z: float,
    v: float,
) -> tuple[float, float, float]:
    """A line on which h may pass zero, or that is long."""
    s = 1.0 if du >= 0.0 else -1.0
    d = s * du
    g, done = s * h, 0.0
    if g < 0.0:
        rate = beta - gamma
        # g rises to zero where 1 - exp(-rate v) = -g rate/(A - rate g)
        x = -g * rate / A
        zero = np.inf
        if x > -1.0:
            zero = -g / A * (np.log1p(x) / x if x != 0.0 else 1.0)
        done = min(zero, d)
        z, v = _one_sign(last, du, s, g, done / d, gain, A, rate, w, zeta, z, v)
        g = 0.0 if zero < d else _risen(g, A, rate, d)
    if done < d:
        start, share = last + s * done, (d - done) / d
        z, v = _one_sign(start, du, s, g, share, gain, A, beta + gamma, w, zeta, z, v)
        g = _risen(g, A, beta + gamma, d - done)
    return s * g, z, v


@compiled
def _risen(g: float, A: float, rate: float, d: float) -> float:
    """The solution of dg/dv = A - rate g after a distance d."""
    x = rate * d
    return g + (A - rate * g) * d * (-np.expm1(-x) / x if x != 0.0 else 1.0)


@compiled
def _one_sign(
    start: float,
    du: float,
    s: float,
    g: float,
    share: float,
    gain: float,
    A: float,
    rate: float,
    w: float,
    zeta: float,
    z: float,
    v: float,
) -> tuple[float, float]:
    """A part of a line on which h keeps its sign: force a + b x + c exp(-mu x)."""
    a, b, c, mu = gain * start - s * g, gain * du, 0.0, rate * s * du
    if mu != 0.0:
        c = s * (A - rate * g) / rate
        a -= c
    else:
        b -= A * du
    return piece_of_step(z, v, w, zeta, share, a, b, c, mu)
