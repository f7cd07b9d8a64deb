"""The input that makes a stage of modes follow a smooth reference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexstage.errors import ModelError
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array

if TYPE_CHECKING:
    from flexstage.hysteresis.chain.resonance import StageModes

# A coefficient below this part of the largest is rounding of the sum that made it.
_NOTHING = 1e-12


def _polynomials(stage: StageModes) -> tuple[Array, Array, float]:
    """Return numerator and denominator of the stage, highest power first, and the unit of s."""
    unit = float(np.exp(np.mean(np.log(stage.omega))))
    w = stage.omega / unit
    factors = [
        np.array([1.0, 2.0 * zeta * own, own**2])
        for zeta, own in zip(stage.damping_ratio, w.tolist(), strict=True)
    ]
    below = np.array([1.0])
    for factor in factors:
        below = np.polymul(below, factor)
    above = stage.static_share * below
    for i, share in enumerate(stage.share):
        others = np.array([share * w[i] ** 2])
        for j, factor in enumerate(factors):
            if j != i:
                others = np.polymul(others, factor)
        above = np.polyadd(above, others)
    size = np.abs(above).max()
    first = int(np.flatnonzero(np.abs(above) > _NOTHING * size)[0])
    return np.asarray(above[first:], np.float64), np.asarray(below, np.float64), unit


def stage_zeros(stage: StageModes) -> np.ndarray:
    """Return the complex zeros of a stage [rad/s]; its inverse is stable if all lie on the left."""
    above, _, unit = _polynomials(stage)
    return unit * np.roots(above)


def stage_inverse(
    stage: StageModes,
    y: Array,
    dt: float,
    rate: Array | None = None,
    curvature: Array | None = None,
) -> Array:
    """Return the input that gives a smooth output.

    At least six outputs; the stage rests at the first. Rate [1/s] and curvature [1/s^2] are given
    both or not at all: a spline of fifth degree then makes them.
    """
    above, below, unit = _polynomials(stage)
    if below.size - above.size > 2:
        raise ModelError(
            "the shares of the modes cancel at high frequency: the inverse of this stage needs "
            f"{below.size - above.size} derivatives of the reference, and two can be had"
        )
    zeros = np.roots(above)
    if np.any(zeros.real >= 0.0):
        worst = unit * zeros[int(np.argmax(zeros.real))]
        raise ModelError(
            f"the stage has a zero at {worst:.4g} rad/s, which is not in the left half-plane: its "
            "inverse is unstable; leave out the mode of opposite sign, or close the loop"
        )
    quotient, rest = np.polydiv(below, above)
    derivatives = _derivatives(y, dt, rate, curvature)
    x = np.zeros_like(y)
    for power, c in enumerate(quotient[::-1]):
        x += c * derivatives[power] / (unit * dt) ** power
    if above.size > 1:
        x += _remainder(np.asarray(rest, np.float64), above, unit * dt, derivatives)
    return x


def _derivatives(y: Array, dt: float, rate: Array | None, curvature: Array | None) -> Array:
    """Return derivatives 0 to 5 [per sample] to the right of each sample, shape (6, n)."""
    if y.size < 6:
        raise ModelError(f"the inverse of a stage needs 6 samples or more, got {y.size}")
    if (rate is None) != (curvature is None):
        raise ModelError("give both derivatives of the reference, or neither")
    at = np.arange(y.size, dtype=np.float64)
    if rate is None or curvature is None:
        from scipy.interpolate import make_interp_spline

        spline = make_interp_spline(at, y, k=5)
        return np.array([spline(at, nu) for nu in range(6)])
    if rate.shape != y.shape or curvature.shape != y.shape:
        raise ModelError(
            f"the derivatives of the reference must have {y.size} samples as it has, got "
            f"{rate.shape} and {curvature.shape}"
        )
    v, c = rate * dt, curvature * dt**2
    out = np.zeros((6, y.size))
    out[:3] = y, v, c
    # polynomial of fifth degree that has value, rate and curvature at both ends of a step
    gap = np.diff(y) - v[:-1] - 0.5 * c[:-1]
    gap1, gap2 = np.diff(v) - c[:-1], np.diff(c)
    out[3, :-1] = 6.0 * (10.0 * gap - 4.0 * gap1 + 0.5 * gap2)
    out[4, :-1] = 24.0 * (-15.0 * gap + 7.0 * gap1 - gap2)
    out[5, :-1] = 120.0 * (6.0 * gap - 3.0 * gap1 + 0.5 * gap2)
    return out


def _remainder(rest: Array, above: Array, h: float, derivatives: Array) -> Array:
    """Step rest/above, a proper filter, exactly along polynomials of fifth degree."""
    from scipy.linalg import expm

    n = above.size - 1
    matrix = np.zeros((n + 6, n + 6))
    matrix[: n - 1, 1:n] = np.eye(n - 1)
    matrix[n - 1, :n] = -(above / above[0])[:0:-1]
    matrix[:n] *= h
    matrix[n - 1, n] = h
    matrix[range(n, n + 5), range(n + 1, n + 6)] = 1.0
    step = np.asarray(expm(matrix), dtype=np.float64)[:n]
    read = np.zeros(n)
    trimmed = np.atleast_1d(rest)[::-1][:n] / above[0]
    read[: trimmed.size] = trimmed
    q = np.zeros(n)
    q[0] = derivatives[0, 0] / (above[-1] / above[0])
    out = np.empty(derivatives.shape[1])
    _filter(
        np.ascontiguousarray(step), np.ascontiguousarray(derivatives), read, q, np.empty(n), out
    )
    return out


@compiled
def _filter(
    step: Array, derivatives: Array, read: Array, q: Array, following: Array, out: Array
) -> None:
    n = q.size
    for k in range(out.size):
        total = 0.0
        for i in range(n):
            total += read[i] * q[i]
        out[k] = total
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += step[i, j] * q[j]
            for j in range(6):
                total += step[i, n + j] * derivatives[j, k]
            following[i] = total
        for i in range(n):
            q[i] = following[i]
