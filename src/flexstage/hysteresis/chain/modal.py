"""Steps of second-order modes that are exact for the forces of a stage with hysteresis.

Time is counted in samples here: a mode is z'' + 2 zeta W z' + W^2 z = W^2 f with W the angle
[rad] that the undamped mode turns in a step, so that z settles at f.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flexstage.hysteresis.chain.element import LARGEST_RATE, ORDERS, piece_from, terms_needed
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, SegmentArrays, Segments

# A piece of a step: closed form below this damping ratio and above this angle [rad], otherwise
# this number of terms of a power series.
_PIECE_DAMPING = 0.9
_PIECE_ANGLE = 0.5
_PIECE_TERMS = 18

# Above this damping ratio the roots of a mode come close; below this angle closed forms of its
# integrals lose digits.
_NEARLY_CRITICAL = 0.999
_SMALL = 0.01
_LONG = 3.0


class UnitStep(NamedTuple):
    """Effect of a step of one sample on modes."""

    angle: Array
    """Angle of each mode in a step [rad], shape (k,)."""
    damping_ratio: Array
    """Damping ratios [1], shape (k,)."""
    transition: Array
    """From (z, z') to (z, z'): rows zz, zv, vz, vv, shape (4, k)."""
    moments: Array
    """Row j is the effect of the derivative j of the force on z', and row j + 1 that on z, shape
    (ORDERS + 1, k).
    """


def unit_step(angle: Array, damping_ratio: Array) -> UnitStep:
    r"""Return the effect of a step of one sample on modes.

    With g the response to an impulse, the moments are :math:`W^2 g(1)` and
    :math:`W^2 \int_0^1 g(1 - s) s^j / j!\, ds`.
    """
    transition = np.empty((4, angle.size))
    moments = np.empty((ORDERS + 1, angle.size))
    for i, (w, zeta) in enumerate(zip(angle.tolist(), damping_ratio.tolist(), strict=True)):
        transition[:, i], moments[:, i] = _unit_step(w, zeta)
    return UnitStep(
        angle=np.ascontiguousarray(angle, dtype=np.float64),
        damping_ratio=np.ascontiguousarray(damping_ratio, dtype=np.float64),
        transition=transition,
        moments=moments,
    )


@lru_cache(maxsize=512)
def _unit_step(w: float, zeta: float) -> tuple[Array, Array]:
    if w < _SMALL or zeta > _NEARLY_CRITICAL:
        return _by_exponential(w, zeta)
    a, damped = zeta * w, w * np.sqrt(1.0 - zeta**2)
    decay = np.exp(-a)
    g, cos = decay * np.sin(damped) / damped, decay * np.cos(damped)
    transition = np.array((cos + a * g, g, -(w**2) * g, cos - a * g))
    if w < _LONG:
        return transition, _by_exponential(w, zeta)[1]
    integrals = [g, (1.0 - cos - a * g) / w**2]
    factorial = 1.0
    for j in range(1, ORDERS):
        # by parts; errors shrink from one to the next, as the angle is large
        factorial *= j
        integrals.append((1.0 / factorial - integrals[-2] - 2.0 * a * integrals[-1]) / w**2)
    return transition, w**2 * np.array(integrals)


def _by_exponential(w: float, zeta: float) -> tuple[Array, Array]:
    """Transition and moments from the exponential of the matrix of (z, z', f, f', f'' ...).

    C. F. Van Loan, IEEE Trans. Autom. Control 23 (1978) 395. The rate z' is scaled with the
    angle where that is large, so that no digits are lost.
    """
    from scipy.linalg import expm

    scale = max(1.0, w)
    matrix = np.zeros((2 + ORDERS, 2 + ORDERS))
    matrix[0, 1] = scale
    matrix[1, 0] = -(w**2) / scale
    matrix[1, 1] = -2.0 * zeta * w
    matrix[1, 2] = 1.0 / scale
    matrix[range(2, 1 + ORDERS), range(3, 2 + ORDERS)] = 1.0
    e = np.asarray(expm(matrix), dtype=np.float64)
    transition = np.array((e[0, 0], e[0, 1] / scale, scale * e[1, 0], e[1, 1]))
    integrals = np.append(e[0, 1] / scale, e[0, 2:])
    return transition, w**2 * integrals


def modes_along_lines(
    x: Array,
    step: UnitStep,
    z: Array,
    v: Array,
    reader: Array,
    y: Array,
    rate_time: Array | None = None,
) -> None:
    """Step modes along straight lines, and add their readings.

    The forces have n + 1 samples; deflections z and rates v [per sample], shape (k,), are at the
    first of them and are updated. Readings are added to y, shape (p, n); the reader weighs z in its
    first k columns and z' in the others, shape (p, 2 k). Of each mode the rate of the force acts
    too, by `rate_time` [samples], shape (k,).
    """
    by_rate = np.zeros(z.size) if rate_time is None else rate_time
    _along_lines(x, step, by_rate, z, v, reader, y)


def modes_through_segments(
    force: Segments, step: UnitStep, z: Array, v: Array, reader: Array, y: Array
) -> None:
    """Step modes through a force that is known between the samples, and add their readings.

    Other arguments as in `modes_along_lines`.
    """
    _through(force.arrays, step, z, v, reader, y)


@compiled
def _along_lines(
    x: Array, step: UnitStep, by_rate: Array, z: Array, v: Array, reader: Array, y: Array
) -> None:
    _, _, transition, moments = step
    k = z.size
    for n in range(x.size - 1):
        rise = x[n + 1] - x[n]
        for i in range(k):
            # a rate in the force is a constant within each step
            start = x[n] + by_rate[i] * rise
            at, speed = z[i], v[i]
            z[i] = (transition[0, i] * at + transition[1, i] * speed) + (
                moments[1, i] * start + moments[2, i] * rise
            )
            v[i] = (transition[2, i] * at + transition[3, i] * speed) + (
                moments[0, i] * start + moments[1, i] * rise
            )
        _read_modes(z, v, reader, y, n)


@compiled
def _read_modes(z: Array, v: Array, reader: Array, y: Array, n: int) -> None:
    """Add the weighted modes to column n of y, as in `modes_along_lines`."""
    k = z.size
    for p in range(y.shape[0]):
        total = y[p, n]
        for i in range(k):
            total += reader[p, i] * z[i] + reader[p, k + i] * v[i]
        y[p, n] = total


@compiled
def _through(
    force: SegmentArrays, step: UnitStep, z: Array, v: Array, reader: Array, y: Array
) -> None:
    angle, zeta, transition, moments = step
    terms = terms_needed(force)
    i = 0
    for n in range(y.shape[1]):
        here = float(n)
        while here < n + 1.0:
            i, end, a, b, c, mu = piece_from(force, i, here, n + 1.0)
            if end - here == 1.0 and (c == 0.0 or abs(mu) <= LARGEST_RATE):
                for m in range(z.size):
                    # derivatives of the exponential, by Horner; highest first
                    by_z = 0.0
                    if c != 0.0:
                        for j in range(terms, 0, -1):
                            by_z = moments[j, m] - mu * by_z
                    by_v = moments[0, m] - mu * by_z
                    at, speed = z[m], v[m]
                    z[m] = (transition[0, m] * at + transition[1, m] * speed) + (
                        moments[1, m] * a + moments[2, m] * b + c * by_z
                    )
                    v[m] = (transition[2, m] * at + transition[3, m] * speed) + (
                        moments[0, m] * a + moments[1, m] * b + c * by_v
                    )
            else:
                for m in range(z.size):
                    z[m], v[m] = piece_of_step(
                        z[m], v[m], angle[m], zeta[m], end - here, a, b, c, mu
                    )
            here = end
        _read_modes(z, v, reader, y, n)


@compiled
def piece_of_step(
    z: float, v: float, w: float, zeta: float, h: float, a: float, b: float, c: float, mu: float
) -> tuple[float, float]:
    """Return one mode after a piece of a step, under the force a + b s + c exp(-mu s).

    Time s, the length h, the rates v, b and mu count in samples; w is the angle of the mode in a
    step [rad], zeta its damping ratio.
    """
    if zeta <= _PIECE_DAMPING and w * h >= _PIECE_ANGLE:
        return _piece_in_closed_form(z, v, w, zeta, h, a, b, c, mu)
    parts = int(np.ceil(max(w * max(1.0, 2.0 * zeta), abs(mu)) * h / 0.5))
    d = h / max(1, parts)
    for _ in range(max(1, parts)):
        z, v = _piece_by_series(z, v, w * d, zeta, d, a + c, (b - mu * c) * d, c, mu * d)
        a += b * d
        c *= np.exp(-mu * d)
    return z, v


@compiled
def _piece_by_series(
    z: float,
    v: float,
    turn: float,
    zeta: float,
    d: float,
    f0: float,
    f1: float,
    c: float,
    mu: float,
) -> tuple[float, float]:
    """Power series in the share of a short piece d: force f0 + f1 x + c (exp(-mu x) - 1 + mu x)."""
    low, high = z, v * d
    at, speed = low + high, high
    term = c
    for j in range(_PIECE_TERMS):
        if j == 0:
            force = f0
        elif j == 1:
            force = f1
        else:
            force = term
        following = (turn * turn * (force - low) - 2.0 * zeta * turn * (j + 1.0) * high) / (
            (j + 1.0) * (j + 2.0)
        )
        at += following
        speed += (j + 2.0) * following
        low, high = high, following
        term *= -mu / (j + 1.0)
    return at, speed / d


@compiled
def _piece_in_closed_form(
    z: float, v: float, w: float, zeta: float, h: float, a: float, b: float, c: float, mu: float
) -> tuple[float, float]:
    """A piece of a step in closed form: response to the force, and free oscillation about it."""
    decay = zeta * w
    damped_square = w * w * (1.0 - zeta * zeta)
    damped = np.sqrt(damped_square)
    offset = a - 2.0 * zeta * b / w
    forced = c * w * w / ((mu - decay) * (mu - decay) + damped_square)
    away, speed = z - offset - forced, v - b + mu * forced
    fall = np.exp(-decay * h)
    cos, sin = fall * np.cos(damped * h), fall * np.sin(damped * h) / damped
    forced *= np.exp(-mu * h)
    at = offset + b * h + forced + (cos + decay * sin) * away + sin * speed
    rate = b - mu * forced - w * w * sin * away + (cos - decay * sin) * speed
    return at, rate
