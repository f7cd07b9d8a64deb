"""Other ways to step hysteresis and a stage: Runge-Kutta, SciPy, 30 digits."""

from typing import Any

import mpmath as mp
import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from flexstage.base.arrays import Array
from flexstage.hysteresis import BoucWen
from flexstage.hysteresis.chain.stage_modes import StageModes

__all__ = [
    "in_30_digits",
    "runge_kutta",
    "runge_kutta_with_mode",
    "solve_ivp_lines",
    "sweep",
]


def sweep(count: int) -> Array:
    """Return a sine sweep from 0 to 120 V of 250 to 2500 samples a cycle, shrinking by a third."""
    share = np.arange(count) / count
    # as long as the record is, it has as many samples in its cycles
    cycles = count * (share / 2500.0 + (1.0 / 250.0 - 1.0 / 2500.0) * share**2 / 2.0)
    return 60.0 - 60.0 * (1.0 - share / 3.0) * np.cos(2.0 * np.pi * cycles)


@njit(cache=True)
def runge_kutta(u: Array, d: float, a: float, beta: float, gamma: float, y: Array) -> None:
    """Step Bouc-Wen with exponent 1 by Runge and Kutta's fourth order, one step a sample."""
    h, last = 0.0, 0.0
    for i in range(u.size):
        v = u[i] - last
        w = abs(v)
        k1 = a * v - beta * w * h - gamma * v * abs(h)
        g = h + 0.5 * k1
        k2 = a * v - beta * w * g - gamma * v * abs(g)
        g = h + 0.5 * k2
        k3 = a * v - beta * w * g - gamma * v * abs(g)
        g = h + k3
        k4 = a * v - beta * w * g - gamma * v * abs(g)
        h += (k1 + 2.0 * (k2 + k3) + k4) / 6.0
        last = u[i]
        y[i] = d * last - h


@njit(cache=True)
def _slopes(
    h: float, z: float, v: float, w: float, du: float, c: Array
) -> tuple[float, float, float]:
    """Rates per sample of h, z, v at an input w that moves by du a sample."""
    d, a, beta, gamma, angle, zeta = c
    rate = a * du - beta * abs(du) * h - gamma * du * abs(h)
    return rate, v, angle * angle * (d * w - h - z) - 2.0 * zeta * angle * v


@njit(cache=True)
def runge_kutta_with_mode(u: Array, c: Array, y: Array) -> None:
    """Step Bouc-Wen and one mode behind it by Runge and Kutta, one step a sample."""
    h, z, v, last = 0.0, 0.0, 0.0, 0.0
    for i in range(u.size):
        du = u[i] - last
        middle = last + 0.5 * du
        a1, b1, c1 = _slopes(h, z, v, last, du, c)
        a2, b2, c2 = _slopes(h + 0.5 * a1, z + 0.5 * b1, v + 0.5 * c1, middle, du, c)
        a3, b3, c3 = _slopes(h + 0.5 * a2, z + 0.5 * b2, v + 0.5 * c2, middle, du, c)
        a4, b4, c4 = _slopes(h + a3, z + b3, v + c3, u[i], du, c)
        h += (a1 + 2.0 * (a2 + a3) + a4) / 6.0
        z += (b1 + 2.0 * (b2 + b3) + b4) / 6.0
        v += (c1 + 2.0 * (c2 + c3) + c4) / 6.0
        last = u[i]
        y[i] = z


def solve_ivp_lines(model: BoucWen, u: Array, dt: float, stage: StageModes | None = None) -> Array:
    """Integrate by `solve_ivp` (RK45, rtol 1e-8) along the lines between samples, from rest."""
    d, a, beta, gamma = model.gain, model.hysteresis_gain, model.beta, model.gamma
    w = 2.0 * np.pi * stage.frequency_hz[0] if stage else 0.0
    zeta = stage.damping_ratio[0] if stage else 0.0
    slope = np.append(np.diff(u), 0.0) / dt
    values, slopes = u.tolist(), slope.tolist()

    def rates(t: float, s: Array) -> list[float]:
        i = min(int(t / dt), len(values) - 1)
        h, du = s[0], slopes[i]
        rate = a * du - beta * abs(du) * h - gamma * du * abs(h)
        if stage is None:
            return [rate]
        x = values[i] + du * (t - i * dt)
        return [rate, s[2], w * w * (d * x - h - s[1]) - 2.0 * zeta * w * s[2]]

    t = np.arange(u.size) * dt
    found: Any = solve_ivp(
        rates, (0.0, t[-1]), np.zeros(3 if stage else 1), t_eval=t, rtol=1e-8, atol=1e-10
    )
    return found.y[1] if stage else d * u - found.y[0]


def in_30_digits(model: BoucWen, u: Array) -> Array:
    """Return the output of Bouc-Wen with exponent 1 by its exponentials, in 30 digits."""
    out = []
    with mp.workdps(30):
        d, a = mp.mpf(model.gain), mp.mpf(model.hysteresis_gain)
        beta, gamma = mp.mpf(model.beta), mp.mpf(model.gamma)
        h, last = mp.mpf(0), mp.mpf(0)
        for value in map(mp.mpf, u.tolist()):
            s, left = mp.sign(value - last), abs(value - last)
            g = s * h
            if g < 0 and left > 0:
                zero = mp.log(1 - g * (beta - gamma) / a) / (beta - gamma)
                part = min(left, zero)
                top = a / (beta - gamma)
                g = top + (g - top) * mp.exp(-(beta - gamma) * part)
                left -= part
                if left > 0:
                    g = mp.mpf(0)
            if left > 0:
                top = a / (beta + gamma)
                g = top + (g - top) * mp.exp(-(beta + gamma) * left)
            if s:
                h = s * g
            last = value
            out.append(d * value - h)
    return np.array([float(y) for y in out])
