"""The steps of an oscillator with a Bouc–Wen force: Runge–Kutta, cut at its corners."""

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array

#: Largest number of steps within one sample; a motion that needs more diverges.
MOST_STEPS = 4000
#: Smallest and largest change of the length of a step.
_SHORTER, _LONGER = 0.1, 4.0


class Method(NamedTuple):
    """Coefficients of a Runge–Kutta method of order 8."""

    weights: Array
    """Weights of the slopes before each of 12 stages, and in the step, shape (13, 12)."""
    times: Array
    """Times of the stages, and of the end, shape (13,)."""
    errors: Array
    """Weights of the slopes in the errors of order 5 and 3, shape (2, 13)."""


@cache
def runge_kutta() -> Method:
    """Return the method of Dormand and Prince (Hairer, Nørsett, Wanner 1993, DOP853)."""
    from scipy.integrate import DOP853

    arrays = (DOP853.A, DOP853.B), (DOP853.C, 1.0), (DOP853.E5, DOP853.E3)
    return Method(np.vstack(arrays[0]), np.append(*arrays[1]), np.vstack(arrays[2]))


@compiled
def advance(
    pieces: Array,
    interval: float,
    parameters: Array,
    initial: Array,
    tolerance: float,
    method: Method,
    motion: Array,
) -> int:
    """Step an oscillator through a record.

    Pieces of `input_pieces`, parameters of `parameter_row`, the initial displacement, velocity and
    force. The tolerance is the largest error of a step, in parts of the motion. Writes the motion,
    shape (n, 3); returns how many samples were reached, fewer than n where the motion diverges.

    Where the velocity or the force passes zero, the right side has a corner: steps end there.
    """
    state, following, slopes = initial.copy(), np.empty(3), np.empty((13, 3))
    motion[0] = state
    for i in range(pieces.shape[0]):
        t, h = 0.0, 1.0
        for _ in range(MOST_STEPS):
            rest = 1.0 - t
            h = min(h, rest)
            step = (pieces[i], t - 0.5, interval, parameters, state, method, slopes, following)
            error = _step(h, *step)
            for k in range(1, 3):
                if state[k] * following[k] < 0.0:
                    h, error = _until_zero(h, k, *step)
            change = _SHORTER
            if error < np.inf:
                change = max(0.9 * (tolerance / error) ** 0.125, _SHORTER)
            if error <= tolerance:
                state[:] = following
                if h == rest:
                    break
                t += h
            h *= min(change, _LONGER)
        else:
            return i + 1
        motion[i + 1] = state
    return pieces.shape[0] + 1


@compiled
def _until_zero(  # type: ignore[no-untyped-def]
    h, k, piece, s, interval, parameters, state, method, slopes, following
):
    """Shorten a step to where a part of the state passes zero: Newton's method in a bracket.

    The step was made; returned are its new length and error.
    """
    low, high, error = 0.0, h, np.inf
    for _ in range(60):
        before, h = h, h - following[k] / (interval * slopes[12, k])
        if not low < h < high:
            h = 0.5 * (low + high)
        error = _step(h, piece, s, interval, parameters, state, method, slopes, following)
        if abs(h - before) <= 1e-15:
            break
        if state[k] * following[k] > 0.0:
            low = h
        else:
            high = h
    following[k] = 0.0
    return h, error


@compiled
def _step(
    h: float,
    piece: Array,
    s: float,
    interval: float,
    parameters: Array,
    state: Array,
    method: Method,
    slopes: Array,
    following: Array,
) -> float:
    """Write the state after a step of h samples from s, and return its error over the motion."""
    m, c, k, alpha = parameters[0], parameters[1], parameters[2], parameters[3]
    gamma, delta, nu = parameters[4], parameters[5], parameters[6]
    weights, times, errors = method
    y = v = z = 0.0
    for j in range(13):
        y = v = z = 0.0
        for i in range(min(j, 12)):
            y += weights[j, i] * slopes[i, 0]
            v += weights[j, i] * slopes[i, 1]
            z += weights[j, i] * slopes[i, 2]
        y = state[0] + h * interval * y
        v = state[1] + h * interval * v
        z = state[2] + h * interval * z
        force, at = 0.0, s + times[j] * h
        for i in range(piece.size - 1, -1, -1):
            force = force * at + piece[i]
        power = abs(z) if nu == 1.0 else abs(z) ** nu
        slopes[j, 0] = v
        slopes[j, 1] = (force - c * v - k * y - z) / m
        slopes[j, 2] = alpha * v - (gamma * math.copysign(abs(v), z) + delta * v) * power
    following[0], following[1], following[2] = y, v, z
    # as displacements: the velocity over the natural frequency, the force over the stiffness
    stiffness = abs(k) + alpha
    units = (1.0, math.sqrt(m / stiffness), 1.0 / stiffness)
    size = fifth = third = 0.0
    for n in range(3):
        size = max(size, units[n] * max(abs(state[n]), abs(following[n])))
        by_fifth = by_third = 0.0
        for i in range(13):
            by_fifth += errors[0, i] * slopes[i, n]
            by_third += errors[1, i] * slopes[i, n]
        fifth += (units[n] * by_fifth) ** 2
        third += (units[n] * by_third) ** 2
    if fifth == 0.0:
        return 0.0
    return h * interval * fifth / math.sqrt(fifth + 0.01 * third) / size
