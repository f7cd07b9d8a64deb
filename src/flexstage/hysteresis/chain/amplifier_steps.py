"""Exact steps of an amplifier that follows, slews, and rests at the ends of its range.

Time is counted in time constants here, so that the output moves by u' = c - u, and by no more than
a threshold.
"""

import numpy as np

from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array

_LINEAR, _SLEW, _RAIL = 0, 1, 2


@compiled
def amplify(
    target: Array,
    last: float,
    u: float,
    h: float,
    threshold: float,
    low: float,
    high: float,
    y: Array,
) -> None:
    """Step an amplifier along straight lines, and write its output.

    Targets are commands times gain, `last` that one step before the first, and u the output there
    [V]; h is the step over the time constant, and the threshold the largest rate times the time
    constant [V]: how far the output may be behind. Writes y.
    """
    for k in range(target.size):
        u = _one_step(last, (target[k] - last) / h, u, h, threshold, low, high)
        last = target[k]
        y[k] = u


@compiled
def _one_step(
    c: float, slope: float, u: float, h: float, threshold: float, low: float, high: float
) -> float:
    e = c - u
    if (u >= high and e > 0.0) or (u <= low and e < 0.0):
        mode = _RAIL
    elif abs(e) > threshold:
        mode = _SLEW
    else:
        mode = _LINEAR
    # each change is towards a mode that the rest of the step does not leave for the same one
    for _ in range(16):
        e = c - u
        s = 1.0 if e > 0.0 or (e == 0.0 and slope > 0.0) else -1.0
        if mode == _RAIL:
            t = np.inf if s * slope >= 0.0 else abs(e / slope)
            following = _LINEAR
            if t >= h:
                return u
            c = u
        elif mode == _SLEW:
            closing = threshold - s * slope
            t = (abs(e) - threshold) / closing if closing > 0.0 else np.inf
            rail = ((high - u) if s > 0.0 else (u - low)) / threshold
            following = _LINEAR if t <= rail else _RAIL
            t = min(t, rail)
            if t >= h:
                return u + s * threshold * h
            c += slope * t
            u = (high if s > 0.0 else low) if following == _RAIL else c - s * threshold
        else:
            t = np.inf
            side = 1.0 if slope > 0.0 else -1.0
            if abs(slope) > threshold:
                t = max(0.0, np.log((slope - e) / (slope - side * threshold)))
            t, following = min(t, h), _SLEW
            end = _follow(u, e, slope, t)
            # the output turns at most once; on which side it may meet an end before that
            turn = np.log1p(-e / slope) if e * slope < 0.0 else np.inf
            early = _follow(u, e, slope, turn) if turn < t else end
            if early > high or early < low:
                rail = high if early > high else low
                t, following = _meet(u, e, slope, 0.0, min(turn, t), rail), _RAIL
                u = rail
            elif end > high or end < low:
                rail = high if end > high else low
                t, following = _meet(u, e, slope, turn if turn < t else 0.0, t, rail), _RAIL
                u = rail
            elif t >= h:
                return end
            else:
                u = end
            c += slope * t
            if following == _RAIL and t >= h:
                return u
        h -= t
        mode = following
    return u


@compiled
def _follow(u: float, e: float, slope: float, t: float) -> float:
    """The output after a time t of following a line that is e away and rises by slope."""
    gone = -np.expm1(-t)
    # slope (t - gone) + e gone, by a series where t - gone would lose its digits
    ramp = t - gone if t > 0.1 else t * t * (0.5 - t * (1.0 / 6.0 - t * _tail(t)))
    return u + e * gone + slope * ramp


@compiled
def _tail(t: float) -> float:
    """1/4! - t/5! + t^2/6! - ..."""
    total = 0.0
    for k in range(12, 4, -1):
        total = (1.0 - total * t) / k
    return (1.0 - total * t) / 24.0


@compiled
def _meet(u: float, e: float, slope: float, start: float, end: float, rail: float) -> float:
    """The time between two at which the output passes the end of its range, by bisection."""
    rising = _follow(u, e, slope, end) > rail
    for _ in range(200):
        middle = 0.5 * (start + end)
        if middle in (start, end):
            break
        if (_follow(u, e, slope, middle) > rail) == rising:
            end = middle
        else:
            start = middle
    return end
