"""Motions dg/dv = A - psi |g|^n, on which the Bouc-Wen models run.

For n = 1 they are exponentials, in a form that a compiler turns into vector code, and for n = 2
``tanh`` or ``tan``. For other n a motion is summed as power series, each as far as it converges to
rounding: in the distance from where g is, or, as ``|g|^n`` has no such series at g = 0, in the
power n of the distance from zero. The coefficients of a power ``u^n`` follow from those of u
(J. C. P. Miller; P. Henrici, J. ACM 3 (1956) 10):

    q_0 = 1,   q_k = sum over j = 1..k of ((n + 1) j/k - 1) a_j q_(k-j)     where a_0 = 1.
"""

import math

import numpy as np

from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array

# ln 2 in two parts: the first has so few digits that its multiples are exact (Cody, Waite 1980).
_LN2_HIGH = 6.93147180369123816490e-01
_LN2_LOW = 1.90821492927058770002e-10
_PER_LN2 = 1.0 / math.log(2.0)
# 2^62 is the largest power of two in a signed integer; beyond it nothing is left of 1 anyway.
_LARGEST_POWER = 62.0

_C3, _C4, _C5, _C6, _C7, _C8, _C9, _C10, _C11, _C12, _C13 = (
    1.0 / math.factorial(k) for k in range(3, 14)
)

_HUGE = 1e150  # a scale beyond which saturation is not felt at all
_TERMS = 24
_ROUNDING = 1e-17  # a term, as part of the first, that is below its rounding
_MOST_STEPS = 20_000  # a motion through the whole range of numbers takes fewer
# psi |g|^n/A up to which the series from zero is taken, and to which it leads.
_LOW, _LOW_END = 0.1, 0.2
_SATURATED = 1e-9  # of A, a slope that falls exponentially


@compiled
def decayed(x: float) -> float:
    """Return 1 - exp(-x) for x at least zero, infinity too, to 2.3e-16 of it and without a branch.

    ``-x = -k ln 2 + r`` with ``|r| <= ln(2)/2``, and a Taylor polynomial for ``exp(r) - 1``
    (remainder below 1e-17 of r). Loops over it are vectorised, unlike loops over ``math.expm1``.
    """
    x = min(x, 1e3)
    k = min(np.floor(x * _PER_LN2 + 0.5), _LARGEST_POWER)
    r = max((k * _LN2_HIGH - x) + k * _LN2_LOW, -1.0)
    p = _C12 + r * _C13
    p = _C11 + r * p
    p = _C10 + r * p
    p = _C9 + r * p
    p = _C8 + r * p
    p = _C7 + r * p
    p = _C6 + r * p
    p = _C5 + r * p
    p = _C4 + r * p
    p = _C3 + r * p
    p = 0.5 + r * p
    p = r + r * r * p
    scale = 1.0 / np.float64(np.int64(1) << np.int64(k))
    return (1.0 - scale) - scale * p


@compiled
def grown(x: float) -> float:
    """Return 1 - exp(-x) for any x."""
    return decayed(x) if x >= 0.0 else -math.expm1(-x)


@compiled
def saturating(start: float, slope: float, rate: float, distance: float) -> float:
    """Return g after a distance v, where dg/dv = slope - rate g.

    Below zero of the rate, g runs away.
    """
    x = rate * distance
    if x == 0.0:
        return start + slope * distance
    return start + (slope - rate * start) * (distance * (grown(x) / x))


@compiled
def distance_to_zero(start: float, slope: float, rate: float) -> float:
    """Return the distance in which w >= 0 falls to zero, where dw/dv = -(slope - rate w).

    Infinity where it does not.
    """
    x = -rate * start / slope
    if x <= -1.0:
        return np.inf
    return start / slope * (1.0 if x == 0.0 else math.log1p(x) / x)


@compiled
def moved(g: float, v: float, A: float, unloaded: float, loaded: float, n: float) -> float:
    """Return g after a distance v, where dg/dv = A - psi |g|^n; infinite where it ran away.

    A > 0 and n >= 1; psi is `unloaded` where g is below zero and `loaded` where it is not.
    """
    if n in (1.0, 2.0):
        zero = time_to_zero(-g, A, unloaded, n) if g < 0.0 else 0.0
        # Unloading is loading, with the rate of unloading, followed back.
        if v < zero:
            return -_flow(-g, -v, A, unloaded, n)
        return _flow(max(g, 0.0), v - zero, A, loaded, n)
    a, q = np.empty(_TERMS + 1), np.empty(_TERMS + 1)
    s = 1.0
    for _ in range(_MOST_STEPS):
        if v == 0.0:
            return g
        s = -1.0 if g < 0.0 else 1.0
        psi = unloaded if g < 0.0 else loaded
        w = abs(g)
        power = psi * w**n / A
        if not abs(power) < _HUGE:
            break
        if abs(power) < _LOW and A * v >= 0.1 * w:
            g, v = _from_zero(s, w, v, A, psi, n, power, a, q)
        elif s > 0.0 and abs(1.0 - power) < _SATURATED:
            return g - w * (1.0 - power) / n * math.expm1(-n * A * v / w)
        elif power == 1.0:
            return g
        else:
            # An unloading step stays short of zero.
            reach = 4.0 if s > 0.0 else 0.5
            h = min(v, reach * w / (A * (1.0 + abs(power))))
            across = s * A * h / w
            terms = _coefficients(across, across * power, 0.0, 1.0, n, a, q)
            share = _converged_share(a, terms)
            g += g * _tail(a, terms, share)
            v = v - share * h if h < v or share < 1.0 else 0.0
    return s * np.inf


@compiled
def _from_zero(
    s: float, w: float, v: float, A: float, psi: float, n: float, power: float, a: Array, q: Array
) -> tuple[float, float]:
    """Return g after a distance near zero, and what is left of the distance.

    With t the distance from zero, times A, ``|g| = t f(psi t^n/A)``.
    """
    share = term = 1.0
    k = 1
    while abs(term) > _ROUNDING:
        term *= power
        share += term / (1.0 + n * k)
        k += 1
    t = w * share
    if s < 0.0 and A * v >= t:
        return 0.0, max(v - t / A, 0.0)
    end, left = t + s * A * v, 0.0
    reach = (_LOW_END * A / abs(psi)) ** (1.0 / n)
    if end > reach:
        end, left = reach, max(v - (reach - t) / A, 0.0)
    terms = _coefficients(0.0, psi * end**n / A, 1.0, n, n, a, q)
    return s * (end + end * _tail(a, terms, 1.0)), left


@compiled
def _coefficients(
    slope: float, factor: float, first: float, step: float, n: float, a: Array, q: Array
) -> int:
    """Write the terms of the solution u of ``first (u - 1) + step x u' = slope x - factor x u^n``.

    Terms are at x = 1, where u is 1 at x = 0. Returned: the number of terms, all that there is room
    for where they do not converge.
    """
    a[0] = q[0] = 1.0
    for k in range(1, _TERMS + 1):
        a[k] = ((slope if k == 1 else 0.0) - factor * q[k - 1]) / (first + step * k)
        if abs(a[k]) < _ROUNDING and abs(a[k - 1]) < _ROUNDING:
            return k
        total = 0.0
        for j in range(1, k + 1):
            total += ((n + 1.0) / k * j - 1.0) * a[j] * q[k - j]
        q[k] = total
    return _TERMS


@compiled
def _converged_share(a: Array, terms: int) -> float:
    """Return the x of at most one up to which the last two terms are below rounding."""
    last = max(abs(a[terms]), abs(a[terms - 1]) ** (terms / (terms - 1.0)))
    return (_ROUNDING / last) ** (1.0 / terms) if last > _ROUNDING else 1.0


@compiled
def _tail(a: Array, terms: int, x: float) -> float:
    """Return the sum of all terms but the first at x."""
    total = 0.0
    for k in range(terms, 0, -1):
        total = (total + a[k]) * x
    return total


@compiled
def _scale(A: float, rate: float, n: float) -> float:
    """Return G, the value at which both terms are of one size."""
    return (A / abs(rate)) ** (1.0 / n) if rate != 0.0 else np.inf


@compiled
def _flow(g: float, v: float, A: float, rate: float, n: float) -> float:
    """Return g >= 0 after a distance v, where dg/dv = A - rate g^n and n is 1 or 2.

    A distance below zero follows the motion back, at most to g = 0; with a rate below zero g runs
    away.
    """
    if n == 1.0:
        return max(saturating(g, A, rate, v), 0.0)
    G = _scale(A, rate, n)
    if not G < _HUGE:
        return max(g + A * v, 0.0)
    return G * _flow_2(g / G, A * v / G, 1.0 if rate > 0.0 else -1.0)


@compiled
def _flow_2(x: float, tau: float, sigma: float) -> float:
    """Return the scaled solution for n = 2."""
    if sigma > 0.0:
        t = math.tanh(tau)
        below = 1.0 + x * t
        return max((x + t) / below, 0.0) if below > 0.0 else np.inf
    angle = math.atan(x) + tau
    if angle >= 0.5 * math.pi:
        return np.inf
    # The sum of tangents keeps the digits of a large x, which its angle loses.
    t = math.tan(tau)
    below = 1.0 - x * t
    if abs(tau) < 1.0 and below > 0.0:
        return max((x + t) / below, 0.0)
    return max(math.tan(angle), 0.0)


@compiled
def time_to_zero(w: float, A: float, rate: float, n: float) -> float:
    """Return the distance in which w >= 0 falls to zero, where dw/dv = -(A - rate w^n), n 1 or 2.

    Infinity where it does not.
    """
    if n == 1.0:
        return distance_to_zero(w, A, rate)
    G = _scale(A, rate, n)
    if not G < _HUGE:
        return w / A
    x = w / G
    if rate > 0.0 and x >= 1.0:
        return np.inf
    return G / A * (math.atanh(x) if rate > 0.0 else math.atan(x))
