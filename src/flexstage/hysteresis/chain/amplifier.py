"""A voltage amplifier on a capacitive load: bandwidth, slew, current, and range."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Complex
from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.element import ChainElement, positive_step
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, Response, checked, samples

_LINEAR, _SLEW, _RAIL = 0, 1, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Amplifier(ChainElement):
    r"""An amplifier that drives the capacitance of a stack.

    .. math:: T \dot u = g c - u, \qquad |\dot u| \le \min(S, I/C), \qquad
              u_{min} \le u \le u_{max}, \qquad T = \frac{1}{2\pi f_b}

    Inside each step the changes between following, slewing and resting at the end of the range are
    solved for, so that the output is exact at the samples for a command of straight lines. State:
    the command, and the output [V].

    Validity: large and small signal of an amplifier whose closed loop has one dominant pole. The
    capacitance is one number; that of a stack grows with its voltage, its temperature and the
    amplitude.

    Raises
    ------
    ModelError
        A quantity is not positive, or the range does not rise.

    Examples
    --------
    >>> import numpy as np
    >>> amplifier = Amplifier(bandwidth_hz=800.0, capacitance=6.2e-6, current_limit=0.14)
    >>> round(amplifier.largest_rate)
    22581
    >>> jump = amplifier.settled(0.0, 1e-4)
    >>> jump[0] = 100.0
    >>> u = amplifier.simulate(np.full(60, 100.0), 1e-4, jump).values
    >>> round(float(u[9]), 4), round(float(u[59]), 4)
    (22.5806, 99.9994)
    """

    bandwidth_hz: float
    """Frequency at which a small sine has fallen by 3 dB [Hz]."""
    capacitance: float = 0.0
    """Capacitance of the load [F]; 0 where the current does not limit."""
    current_limit: float | None = None
    """Largest current [A]."""
    slew_limit: float | None = None
    """Largest rate of the output, whatever the load [V/s]."""
    voltage_range: tuple[float, float] | None = None
    """Lowest and highest output [V]."""
    gain: float = 1.0
    """Output over command g [1]."""

    def __post_init__(self) -> None:
        for name in ("bandwidth_hz", "current_limit", "slew_limit"):
            value = getattr(self, name)
            if value is not None:
                checked(value, f"{name} of an amplifier", "positive and finite")
        checked(self.capacitance, "capacitance of a load", "finite and not negative", "F")
        checked(self.gain, "gain of an amplifier", "finite, not 0")
        if self.voltage_range is not None and not self.voltage_range[0] < self.voltage_range[1]:
            raise ModelError(
                f"the voltage range of an amplifier must rise, got {self.voltage_range!r} V"
            )

    @property
    def time_constant(self) -> float:
        """Time constant of small signals [s]."""
        return 1.0 / (2.0 * math.pi * self.bandwidth_hz)

    @property
    def largest_rate(self) -> float:
        """Largest rate of the output [V/s]; infinite where nothing limits it."""
        rate = math.inf if self.slew_limit is None else self.slew_limit
        if self.current_limit is not None and self.capacitance > 0.0:
            rate = min(rate, self.current_limit / self.capacitance)
        return rate

    def settled(self, x: float, dt: float) -> Array:
        del dt
        low, high = self._range()
        return np.array([x, min(max(self.gain * x, low), high)])

    def simulate(self, x: ArrayLike, dt: float, state: ArrayLike | None = None) -> Response:
        command = samples(x, "command of the amplifier")
        h = positive_step(dt)
        now = self._initial_state(command[0], h, state, "an amplifier")
        y = np.empty_like(command)
        low, high = self._range()
        amplify(
            self.gain * command,
            self.gain * now[0],
            min(max(now[1], low), high),
            h / self.time_constant,
            self.largest_rate * self.time_constant,
            low,
            high,
            y,
        )
        return Response(values=y, state=np.array([command[-1], y[-1]]))

    def frequency_response(self, frequency_hz: ArrayLike) -> Complex:
        return self.gain * Lag(time_constant=self.time_constant).frequency_response(frequency_hz)

    def _range(self) -> tuple[float, float]:
        return (-math.inf, math.inf) if self.voltage_range is None else self.voltage_range


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
    constant [V], the largest lag of the output. Writes y.
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
    # no mode is entered twice in a step
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
            begin, until, met = (0.0, min(turn, t), early)
            if low <= early <= high:
                begin, until, met = (turn if turn < t else 0.0, t, end)
            if met > high or met < low:
                rail = high if met > high else low
                t, following = _meet(u, e, slope, begin, until, rail), _RAIL
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
    """Return the output after a time t of following a line at a distance e that rises by slope."""
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
    """Return the time at which the output reaches the end of its range, by bisection."""
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
