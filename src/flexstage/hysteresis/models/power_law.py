"""Motions dg/dv = A - psi |g|^n, on which the Bouc-Wen models run.

For n = 1 they are exponentials. For other n a motion is summed as power series, each as far as it
converges to rounding: in the distance from where g is, or, as ``|g|^n`` has no such series at
g = 0, in the power n of the distance from zero. The coefficients of a power ``u^n`` follow from
those of u (J. C. P. Miller; P. Henrici, J. ACM 3 (1956) 10):

    q_0 = 1,   q_k = sum over j = 1..k of ((n + 1) j/k - 1) a_j q_(k-j)     where a_0 = 1.
"""

import math

import numpy as np

from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array

_HUGE = 1e150  # a scale beyond which saturation is not felt at all
_TERMS = 24
_ROUNDING = 1e-17  # a term, as part of the first, that is below its rounding
_MOST_STEPS = 20_000  # a motion through the whole range of numbers takes fewer
# psi |g|^n/A up to which the series from zero is taken, and to which it leads.
_LOW, _LOW_END = 0.1, 0.2
_SATURATED = 1e-9  # of A, a slope that falls exponentially


@compiled
def saturating(start: float, slope: float, rate: float, distance: float) -> float:
    """Return g after a distance v, where dg/dv = slope - rate g.

    Below zero of the rate, g runs away.
    """
    x = rate * distance
    if x == 0.0:
        return start + slope * distance
    return start + (slope - rate * start) * (distance * (-math.expm1(-x) / x))


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
    if n == 1.0:
        zero = distance_to_zero(-g, A, unloaded) if g < 0.0 else 0.0
        if v < zero:
            # Unloading is loading, with the rate of unloading, followed back.
            return -max(saturating(-g, A, unloaded, -v), 0.0)
        return saturating(max(g, 0.0), A, loaded, v - zero)
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
