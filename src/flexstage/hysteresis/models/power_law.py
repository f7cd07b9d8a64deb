"""The exact solution of dg/dv = A - lambda g^n, on which the Bouc-Wen models run.

Scaled by ``G = (A/|lambda|)^(1/n)`` and ``tau = A v / G`` it is ``dx/dtau = 1 - sigma x^n`` with
sigma the sign of lambda. The solution is a straight line for sigma = 0, an exponential for n = 1,
and ``tanh`` or ``tan`` for n = 2. For other n, with ``b = 1/n``, ``z = x^n`` and ``p = ln z``, it
is the inverse of

    n tau(p) = integral of exp(b q)/(1 - sigma exp(q)) dq up to p,

which is an incomplete beta function, ``n x 2F1(1, b; 1 + b; sigma z)``. Three series cover the
line: powers of z below p = -1.1; powers of p between, after the pole at z = 1 has been taken out as
a logarithm; powers of 1/z above 1.1. Their coefficients depend on n alone and are tabulated once.
Nothing is lost near saturation, z = 1, where the logarithm itself is the unknown, nor as n nears 1.
"""

import functools
import math

import numpy as np

from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.models.decay import distance_to_zero, grown, saturating

_EDGE = 1.1  # |p| at which the series meet; all three then need about as many terms
_TERMS = 38
_HUGE = 1e150  # a scale beyond which saturation is not felt at all
_ITERATIONS = 30
_CLOSE = 2e-9  # a Newton correction after which nothing but rounding is left

# Rows of the table.
_LOW, _MIDDLE, _HIGH = 0, 1, 3  # powers of z, of p (one row for each sigma), of 1/z
_CONSTANTS = 5
# Entries of the row of constants: n, then for each sigma the value of n tau at p = 0 (without the
# logarithm), and at the edges -1.1 and 1.1.
_AT_ZERO, _AT_LOW, _AT_HIGH = 1, 3, 5


@functools.lru_cache(maxsize=256)
def power_table(n: float) -> Array:
    """Return the coefficients of the series for an exponent.

    Calls share it: it must not be written into. It is not read for n = 1 and n = 2, whose solutions
    are closed forms.
    """
    b = 1.0 / n
    k = np.arange(_TERMS)
    table = np.zeros((_CONSTANTS + 1, _TERMS))
    table[_LOW] = 1.0 / (k + b)
    table[_HIGH, 1:] = 1.0 / (k[1:] + 1.0 - b)
    # (exp(b q) - 1)/q and exp(b q), as powers of q.
    growth = np.cumprod(np.concatenate([[1.0], np.full(_TERMS, b) / np.arange(1, _TERMS + 1)]))
    pole, smooth = _reciprocals()
    middle = -np.convolve(growth[1:], pole)[:_TERMS]
    middle[0] += 1.0
    table[_MIDDLE, 1:] = middle[:-1] / k[1:]
    middle = np.convolve(growth[:-1], smooth)[:_TERMS]
    table[_MIDDLE + 1, 1:] = middle[:-1] / k[1:]
    constants = table[_CONSTANTS]
    constants[0] = n
    for side, sigma in enumerate((1.0, -1.0)):
        z = math.exp(-_EDGE)
        low = math.exp(-b * _EDGE) * _series(table[_LOW], sigma * z)
        at_zero = low - _middle(-_EDGE, sigma, table[_MIDDLE + side])
        constants[_AT_ZERO + side] = at_zero
        constants[_AT_LOW + side] = low
        constants[_AT_HIGH + side] = at_zero + _middle(_EDGE, sigma, table[_MIDDLE + side])
    return table


@functools.cache
def _reciprocals() -> tuple[Array, Array]:
    """Return q/(exp(q) - 1) and 1/(exp(q) + 1) as powers of q, by division of power series."""
    grow = np.cumprod(1.0 / np.arange(1, _TERMS + 2))
    pole, smooth = np.zeros(_TERMS), np.zeros(_TERMS)
    pole[0], smooth[0] = 1.0, 0.5
    for k in range(1, _TERMS):
        pole[k] = -np.dot(grow[1 : k + 1], pole[k - 1 :: -1])
        smooth[k] = -0.5 * np.dot(grow[:k], smooth[k - 1 :: -1])
    return pole, smooth


@compiled
def _series(coefficients: Array, x: float) -> float:
    """Return a power series, odd and even terms apart: two short chains instead of a long one."""
    square = x * x
    even = odd = 0.0
    # The length is read from the table: a known one would be unrolled at each of a dozen places.
    for k in range(coefficients.size - 2, -1, -2):
        even = even * square + coefficients[k]
        odd = odd * square + coefficients[k + 1]
    return even + x * odd


@compiled
def _middle(p: float, sigma: float, coefficients: Array) -> float:
    """Return n tau between the edges, counted from p = 0."""
    smooth = _series(coefficients, p)
    return smooth if sigma < 0.0 else smooth - math.log(abs(math.expm1(p)))


@compiled
def _elapsed(x: float, sigma: float, table: Array) -> float:
    """Return n tau at x; from x = 0, except above saturation, where only differences count."""
    if x == 0.0:
        return 0.0
    constants = table[_CONSTANTS]
    n = constants[0]
    side = 0 if sigma > 0.0 else 1
    p = n * math.log(x)
    if p <= -_EDGE:
        return x * _series(table[_LOW], sigma * x**n)
    if p < _EDGE:
        return constants[_AT_ZERO + side] + _middle(p, sigma, table[_MIDDLE + side])
    return constants[_AT_HIGH + side] - sigma * _beyond(_EDGE, p, sigma, table)


@compiled
def _beyond(start: float, p: float, sigma: float, table: Array) -> float:
    """Return the integral of exp(b q)/(exp(q) - sigma) from start to p, beyond the upper edge."""
    a = 1.0 - 1.0 / table[_CONSTANTS, 0]
    before = math.exp(-a * start)
    first = before * (p - start) * _relative(a * (p - start))
    before *= _series(table[_HIGH], sigma * math.exp(-start))
    after = math.exp(-a * p) * _series(table[_HIGH], sigma * math.exp(-p))
    return first + (before - after)


@compiled
def _relative(x: float) -> float:
    """Return (1 - exp(-x))/x."""
    return grown(x) / x if x != 0.0 else 1.0


@compiled
def _reached(target: float, sigma: float, above: bool, guess: float, table: Array) -> float:
    """Return x at n tau = target; infinity where the solution has run away before."""
    constants = table[_CONSTANTS]
    side = 0 if sigma > 0.0 else 1
    if not above and target <= constants[_AT_LOW + side]:
        return _reached_low(target, sigma, guess, table)
    if sigma > 0.0:
        if above and target < constants[_AT_HIGH]:
            return _reached_high(_EDGE, constants[_AT_HIGH] - target, sigma, table)
        return _reached_saturation(target, -1.0 if above else 1.0, guess, table)
    if target >= constants[_AT_HIGH + 1]:
        return _reached_high(_EDGE, target - constants[_AT_HIGH + 1], sigma, table)
    return _reached_middle(target, guess, table)


@compiled
def _reached_low(target: float, sigma: float, guess: float, table: Array) -> float:
    """Return x by Halley's method on x; both derivatives are known in closed form."""
    n = table[_CONSTANTS, 0]
    # tau lies between x and x/(1 + z) below the lower edge: a bracket.
    tau = target / n
    x = guess if 0.7 * tau <= guess <= 1.4 * tau else tau
    for _ in range(_ITERATIONS):
        z = x**n
        slope = 1.0 / (1.0 - sigma * z)
        error = x * _series(table[_LOW], sigma * z) / n - tau
        newton = error / slope
        correction = newton / (1.0 - 0.5 * newton * n * sigma * z * slope / x)
        x -= correction
        # The next error is of the third order.
        if abs(correction) <= 1e-6 * x:
            break
    return x


@compiled
def _reached_saturation(target: float, sign: float, guess: float, table: Array) -> float:
    """Return x near saturation by Newton's method on L = -ln|1 - z|; sign -1 above it."""
    constants = table[_CONSTANTS]
    n = constants[0]
    a = 1.0 - 1.0 / n
    remaining = target - constants[_AT_ZERO]
    z = guess**n
    gap = sign * (1.0 - z)
    L = -math.log(gap) if 0.0 < gap < 0.9 else remaining
    p = 0.0
    for _ in range(_ITERATIONS):
        L = max(L, 0.2 if sign > 0.0 else -1.2)
        p = math.log1p(-sign * math.exp(-L))
        error = L + _series(table[_MIDDLE], p) - remaining
        correction = error * math.exp(a * p)
        L -= correction
        if abs(correction) <= _CLOSE:
            break
    return math.exp(math.log1p(-sign * math.exp(-L)) / n)


@compiled
def _reached_middle(target: float, guess: float, table: Array) -> float:
    """Return x between the edges for sigma = -1, by Newton's method on p."""
    constants = table[_CONSTANTS]
    n = constants[0]
    p = min(max(n * math.log(guess), -_EDGE), _EDGE) if guess > 0.0 else 0.0
    for _ in range(_ITERATIONS):
        error = constants[_AT_ZERO + 1] + _series(table[_MIDDLE + 1], p) - target
        correction = error * (1.0 + math.exp(p)) * math.exp(-p / n)
        p = min(max(p - correction, -1.01 * _EDGE), 1.01 * _EDGE)
        if abs(correction) <= _CLOSE:
            break
    return math.exp(p / n)


@compiled
def _reached_high(start: float, target: float, sigma: float, table: Array) -> float:
    """Return x where the integral of `_beyond` has the target value; infinity if nowhere.

    The unknown is E = (1 - exp(-a (p - start)))/a, in which the integral is nearly linear.
    """
    n = table[_CONSTANTS, 0]
    a = 1.0 - 1.0 / n
    scale = math.exp(-a * start)
    E = 0.0
    p = start
    for _ in range(_ITERATIONS):
        error = _beyond(start, p, sigma, table) - target
        correction = error / scale * (1.0 - sigma * math.exp(-p))
        if a * (E - correction) >= 1.0:
            # At E = 1/a the integral has its greatest value; short of it this is an overshoot.
            whole = scale * (1.0 / a + _series(table[_HIGH], sigma * math.exp(-start)))
            if target >= whole:
                return np.inf
            correction = 0.5 * (E - 1.0 / a)
        E -= correction
        p = max(start + E * _relative_log(a * E), 0.9 * _EDGE)
        if abs(correction) <= _CLOSE * (1.0 - a * E):
            break
    return math.exp(p / n)


@compiled
def _relative_log(x: float) -> float:
    """Return -ln(1 - x)/x."""
    return -math.log1p(-x) / x if x != 0.0 else 1.0


@compiled
def _scale(A: float, rate: float, n: float) -> float:
    """Return G, the value at which both terms are of one size."""
    return (A / abs(rate)) ** (1.0 / n) if rate != 0.0 else np.inf


@compiled
def flow(g: float, v: float, A: float, rate: float, n: float, table: Array) -> float:
    """Return g after a distance v, where dg/dv = A - rate g^n; infinity where it ran away.

    A > 0 and n >= 1, with the table of `power_table` for n. A distance below zero follows the
    motion back, at most to g = 0; with a rate below zero g runs away.
    """
    if n == 1.0:
        return max(saturating(g, A, rate, v), 0.0)
    G = _scale(A, rate, n)
    if not G < _HUGE:
        return max(g + A * v, 0.0)
    x = g / G
    tau = A * v / G
    sigma = 1.0 if rate > 0.0 else -1.0
    if n == 2.0:
        return G * _flow_2(x, tau, sigma)
    if sigma > 0.0 and x == 1.0:
        return g
    return G * _flow_n(x, tau, sigma, table)


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
def _flow_n(x: float, tau: float, sigma: float, table: Array) -> float:
    """Return the scaled solution for other n."""
    n = table[_CONSTANTS, 0]
    above = sigma > 0.0 and x > 1.0
    power = 0.0
    if x > 0.0:
        p = n * math.log(x)
        power = math.exp(p)
        if p > _EDGE:
            # High up, a distance from 0 or from 1 would drown that from here.
            move = -sigma * n * tau
            if move >= -_beyond(_EDGE, p, sigma, table):
                return _reached_high(p, move, sigma, table)
    target = _elapsed(x, sigma, table) + n * tau
    if target <= 0.0 and not above:
        return 0.0
    guess = max(x + tau * (1.0 - sigma * power), 0.0)
    return _reached(target, sigma, above, guess, table)


@compiled
def time_to_zero(w: float, A: float, rate: float, n: float, table: Array) -> float:
    """Return the distance in which w >= 0 falls to zero, where dw/dv = -(A - rate w^n).

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
    if n == 2.0:
        return G / A * (math.atanh(x) if rate > 0.0 else math.atan(x))
    return G / A * (_elapsed(x, 1.0 if rate > 0.0 else -1.0, table) / n)
