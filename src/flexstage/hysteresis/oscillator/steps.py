"""The steps of an oscillator with a Bouc–Wen force: Taylor series, cut at their zeros."""

import math

import numba
import numpy as np

from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array

#: Largest number of steps within one sample; a motion that needs more diverges.
MOST_STEPS = 4000


@compiled
def advance(
    pieces: Array,
    interval: float,
    parameters: Array,
    initial: Array,
    order: int,
    tolerance: float,
    motion: Array,
) -> int:
    """Step an oscillator through a record.

    Pieces of `input_pieces`, parameters of `parameter_row`, the initial displacement, velocity and
    force. The order is the degree of the series; the tolerance is its largest last term, in parts
    of its first five: steps are cut to keep it. Writes the motion, shape (n, 3); returns how many
    samples were reached, fewer than n where the motion diverges.
    """
    binomials = _binomials(pieces.shape[1])
    powers = np.empty(pieces.shape[1])
    force = np.zeros(max(pieces.shape[1], order + 1))
    terms = np.zeros((4, order + 1))
    y, v, z = initial[0], initial[1], initial[2]
    motion[0, 0], motion[0, 1], motion[0, 2] = y, v, z
    for i in range(pieces.shape[0]):
        s = -0.5
        steps = 0
        while s < 0.5:
            steps += 1
            _about(pieces[i], s, binomials, powers, force)
            z_tiny = _series(force, interval, parameters, y, v, z, order, tolerance, terms)
            rest = 0.5 - s
            h = _longest(terms, rest, z_tiny, order, tolerance)
            h, v_zero, z_zero = _until_event(terms, h, order)
            y = _value(terms[0], h, 0, order)
            v = 0.0 if v_zero else _value(terms[1], h, 0, order)
            z = 0.0 if z_zero else _value(terms[2], h, 0, order)
            s = 0.5 if h >= rest else s + h
            if steps > MOST_STEPS or not math.isfinite(y + v + z):
                return i + 1
        motion[i + 1, 0], motion[i + 1, 1], motion[i + 1, 2] = y, v, z
    return pieces.shape[0] + 1


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def advance_each(
    pieces: Array,
    interval: float,
    parameters: Array,
    initial: Array,
    order: int,
    tolerance: float,
    displacement: Array,
) -> None:
    """Step many oscillators through one record, each on a core.

    As `advance`, a row of parameters and of initial state for each; displacements, shape (m, n),
    are NaN from where a motion diverges.
    """
    for i in numba.prange(parameters.shape[0]):
        motion = np.empty((displacement.shape[1], 3))
        done = advance(pieces, interval, parameters[i], initial[i], order, tolerance, motion)
        displacement[i, :done] = motion[:done, 0]
        displacement[i, done:] = np.nan


@compiled
def _binomials(d: int) -> Array:
    table = np.zeros((d, d))
    for i in range(d):
        table[i, 0] = 1.0
        for j in range(1, i + 1):
            table[i, j] = table[i - 1, j - 1] + table[i - 1, j]
    return table


@compiled
def _about(piece: Array, s: float, binomials: Array, powers: Array, force: Array) -> None:
    """Expand a polynomial about another point."""
    d = piece.size
    powers[0] = 1.0
    for i in range(1, d):
        powers[i] = s * powers[i - 1]
    for j in range(d):
        force[j] = 0.0
    # The inner sums do not wait for one another, as those of a synthetic division do.
    for i in range(d):
        coefficient = piece[i]
        for j in range(i + 1):
            force[j] += coefficient * binomials[i, j] * powers[i - j]


@compiled
def _series(
    force: Array,
    interval: float,
    parameters: Array,
    y: float,
    v: float,
    z: float,
    order: int,
    tolerance: float,
    terms: Array,
) -> float:
    """Find the series of y, y', z and |z|**nu in time, counted in samples.

    Return the |z| below which |z|**nu counts as nothing, zero where it has a series anywhere.
    """
    m, c, k, alpha = parameters[0], parameters[1], parameters[2], parameters[3]
    nu = parameters[6]
    ys, vs, zs, ws = terms[0], terms[1], terms[2], terms[3]
    acceleration = force[0] - c * v - k * y - z
    v_sign = _sign_to_come(v, acceleration, force)
    z_sign = v_sign if z == 0.0 else math.copysign(1.0, z)
    # On a piece without a change of sign z' = y' (alpha - rate |z|**nu).
    rate = parameters[4] * v_sign * z_sign + parameters[5]
    z_tiny = 0.0
    if not (nu == 1.0 or nu == 2.0 or rate == 0.0):  # noqa: PLR1714
        # What |z|**nu adds up to from there to zero is the tolerance, in parts of the largest z.
        z_tiny = (tolerance ** (nu / (nu + 1.0)) * alpha / abs(rate)) ** (1.0 / nu)
    ys[0], vs[0], zs[0] = y, v, z
    for j in range(order):
        if nu == 1.0:
            ws[j] = z_sign * zs[j]
        elif nu == 2.0:
            total = 0.0
            for i in range(j + 1):
                total += zs[i] * zs[j - i]
            ws[j] = total
        elif abs(z) <= z_tiny:
            ws[j] = 0.0
        elif j == 0:
            ws[0] = abs(z) ** nu
        else:
            # z w' = nu z' w
            total = 0.0
            for i in range(1, j + 1):
                total += ((nu + 1.0) * i - j) * zs[i] * ws[j - i]
            ws[j] = total / (j * z)
        product, other = 0.0, 0.0
        for i in range(0, j, 2):  # two sums, which do not wait for each other
            product += vs[i] * ws[j - i]
            other += vs[i + 1] * ws[j - i - 1]
        if j % 2 == 0:
            product += vs[j] * ws[0]
        product += other
        scale = interval / (j + 1)
        ys[j + 1] = scale * vs[j]
        vs[j + 1] = scale * (force[j] - c * vs[j] - k * ys[j] - zs[j]) / m
        zs[j + 1] = scale * (alpha * vs[j] - rate * product)
    return z_tiny


@compiled
def _sign_to_come(v: float, acceleration: float, force: Array) -> float:
    """Return the sign that the velocity is about to have."""
    if v != 0.0:
        return math.copysign(1.0, v)
    if acceleration != 0.0:
        return math.copysign(1.0, acceleration)
    # At rest and in balance: the first derivative of the force that is not zero moves it.
    for j in range(1, force.size):
        if force[j] != 0.0:
            return math.copysign(1.0, force[j])
    return 1.0


@compiled
def _longest(terms: Array, rest: float, z_tiny: float, order: int, tolerance: float) -> float:
    """Return how far the series hold, in samples, at most the rest of the interval."""
    h = rest
    if z_tiny > 0.0:
        # A power of z has a series no further than to z = 0.
        reach = 0.8 * max(abs(terms[2, 0]), z_tiny)
        slope, bend = abs(terms[2, 1]), abs(terms[2, 2])
        if slope * h > reach:
            h = reach / slope
        if bend * h * h > reach:
            h = math.sqrt(reach / bend)
    for row in range(3):
        size, power = 0.0, 1.0
        for j in range(min(order, 5)):
            size += abs(terms[row, j]) * power
            power *= h
        last = abs(terms[row, order]) * h**order
        if last > tolerance * size and size > 0.0:
            h *= 0.9 * (tolerance * size / last) ** (1.0 / order)
    return h


@compiled
def _until_event(terms: Array, h: float, order: int) -> tuple[float, bool, bool]:
    """Cut a step where the velocity or the hysteretic force first passes zero."""
    h, v_zero = _first_zero(terms[1], h, order, True)
    # While the velocity keeps its sign z passes zero once at most, upwards with the displacement.
    t, z_zero = _first_zero(terms[2], h, order, False)
    if z_zero and t < h:
        return t, False, True
    return h, v_zero, z_zero


@compiled
def _first_zero(series: Array, h: float, order: int, twice: bool) -> tuple[float, bool]:
    """Return the first zero of a series after its start, up to h, or h where there is none."""
    low = 0
    while low < order and series[low] == 0.0:
        low += 1  # a zero at the start is no event: divide it out
    if low == order:
        return h, False
    sign = math.copysign(1.0, series[low])
    end = h
    if sign * _value(series, h, low, order) > 0.0:
        falls = sign * series[low + 1] < 0.0
        if not (twice and falls and sign * _slope(series, h, low, order) > 0.0):
            return h, False
        # It comes nearer to zero and leaves again: does it pass zero twice?
        end = _bisected(series, h, low, order, -sign, True)
        if sign * _value(series, end, low, order) > 0.0:
            return h, False
    return _bisected(series, end, low, order, sign, False), True


@compiled
def _bisected(series: Array, h: float, low: int, order: int, sign: float, of_slope: bool) -> float:
    """Return the zero of a series, or of its slope, that has the sign given at the start."""
    left, right = 0.0, h
    t = 0.5 * h
    for _ in range(80):
        value = _slope(series, t, low, order) if of_slope else _value(series, t, low, order)
        if sign * value > 0.0:
            left = t
        else:
            right = t
        step = math.inf
        if not of_slope:
            slope = _slope(series, t, low, order)
            step = -value / slope if slope != 0.0 else math.inf
        following = t + step
        if not left < following < right:
            following = 0.5 * (left + right)
        if abs(following - t) <= 4e-16 * h or right - left <= 4e-16 * h:
            return following
        t = following
    return t


@compiled
def _value(series: Array, t: float, low: int, order: int) -> float:
    """Evaluate a series from term `low` on, divided by that power."""
    total = 0.0
    for j in range(order, low - 1, -1):
        total = total * t + series[j]
    return total


@compiled
def _slope(series: Array, t: float, low: int, order: int) -> float:
    """Evaluate the derivative of what `_value` evaluates."""
    total = 0.0
    for j in range(order, low, -1):
        total = total * t + (j - low) * series[j]
    return total
