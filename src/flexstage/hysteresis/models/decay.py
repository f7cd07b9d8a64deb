"""The exponential approach to a limit, in a form that a compiler turns into vector code."""

import math

import numpy as np

from flexstage.hysteresis.compiled import compiled

# ln 2 in two parts: the first has so few digits that its multiples are exact (Cody, Waite 1980).
_LN2_HIGH = 6.93147180369123816490e-01
_LN2_LOW = 1.90821492927058770002e-10
_PER_LN2 = 1.0 / math.log(2.0)
# 2^62 is the largest power of two in a signed integer; beyond it nothing is left of 1 anyway.
_LARGEST_POWER = 62.0

_C3, _C4, _C5, _C6, _C7, _C8, _C9, _C10, _C11, _C12, _C13 = (
    1.0 / math.factorial(k) for k in range(3, 14)
)


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
