"""One mode through a piece of a step, under a force with an exponential in it."""

import numpy as np

from flexstage.hysteresis.compiled import compiled

# A piece of a step: closed form at less damping than this and over a longer angle than that.
_DAMPED = 0.9
_SHORT = 0.5
_TERMS = 18


@compiled
def piece_of_step(
    z: float,
    v: float,
    w: float,
    zeta: float,
    h: float,
    a: float,
    b: float,
    c: float,
    mu: float,
) -> tuple[float, float]:
    """Return one mode after a piece of a step, under the force a + b s + c exp(-mu s).

    Time s, the length h, the rates v, b and mu count in samples; w is the angle of the mode in a
    step [rad], zeta its damping ratio.
    """
    if zeta <= _DAMPED and w * h >= _SHORT:
        return _oscillate(z, v, w, zeta, h, a, b, c, mu)
    parts = int(np.ceil(max(w * max(1.0, 2.0 * zeta), abs(mu)) * h / 0.5))
    d = h / max(1, parts)
    for _ in range(max(1, parts)):
        z, v = _series(z, v, w * d, zeta, d, a + c, (b - mu * c) * d, c, mu * d)
        a += b * d
        c *= np.exp(-mu * d)
    return z, v


@compiled
def _series(
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
    for j in range(_TERMS):
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
def _oscillate(
    z: float,
    v: float,
    w: float,
    zeta: float,
    h: float,
    a: float,
    b: float,
    c: float,
    mu: float,
) -> tuple[float, float]:
    """The same in closed form: what the force holds, and what turns about it."""
    decay = zeta * w
    own = w * w * (1.0 - zeta * zeta)
    damped = np.sqrt(own)
    offset = a - 2.0 * zeta * b / w
    held = c * w * w / ((mu - decay) * (mu - decay) + own)
    away, speed = z - offset - held, v - b + mu * held
    fall = np.exp(-decay * h)
    cos, sin = fall * np.cos(damped * h), fall * np.sin(damped * h) / damped
    held *= np.exp(-mu * h)
    at = offset + b * h + held + (cos + decay * sin) * away + sin * speed
    rate = b - mu * held - w * w * sin * away + (cos - decay * sin) * speed
    return at, rate
