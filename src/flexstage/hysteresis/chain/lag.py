"""First-order lags: exact steps for straight lines, and a lag with a delay, as of a recorder."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Complex
from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.element import (
    LARGEST_RATE,
    LONGEST,
    ORDERS,
    ChainElement,
    piece_from,
    positive_step,
    terms_needed,
)
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, Response, SegmentArrays, Segments, samples

# Below this ratio of step to time constant the closed form loses digits; the series has 18 terms.
_SHORT = 1.0
#: Largest number of steps of a delay, which is the number of stored samples.
_MOST_STEPS = 10_000_000


def decay_share(ratio: ArrayLike) -> Array:
    r"""Return the share of a constant input that a lag approaches in a step.

    .. math:: 1 - e^{-r}

    The ratio r is step over time constant [1], infinite for no lag.
    """
    return -np.expm1(-np.asarray(ratio, dtype=np.float64))


def ramp_share(ratio: ArrayLike) -> Array:
    r"""Return the share of the rise of a ramp that a lag follows in a step.

    .. math:: 1 - \frac{1 - e^{-r}}{r}

    The ratio r is as in `decay_share`; exact to rounding also for short steps.
    """
    r = np.asarray(ratio, dtype=np.float64)
    small = np.where(r < _SHORT, r, 0.0)
    large = np.where(r < _SHORT, 1.0, r)
    series = np.zeros_like(small)
    for k in range(18, 0, -1):
        # 1 - phi_1(r) = r/2! - r^2/3! + r^3/4! - ...
        series = small / (k + 1.0) * (1.0 - series)
    return np.where(r < _SHORT, series, 1.0 + np.expm1(-large) / large)


def lag_moments(ratio: Array) -> Array:
    r"""Return the effect of the derivatives of an input on lags in a step of one sample.

    .. math:: r \int_0^1 e^{-r (1 - s)} \frac{s^j}{j!}\, ds

    The ratio r is step over time constant of each lag, shape (m,); row j is for the derivative j,
    shape (ORDERS, m).
    """
    out = np.empty((ORDERS, ratio.size))
    small, large = np.minimum(ratio, 2.0), np.maximum(ratio, 2.0)
    factorial = 1.0
    by_parts = decay_share(large)
    for j in range(ORDERS):
        if j > 0:
            factorial *= j
            by_parts = 1.0 / factorial - by_parts / large
        series = np.ones_like(small)
        for k in range(j + 30, j + 1, -1):
            series = 1.0 - small / k * series
        out[j] = np.where(ratio < 2.0, small * series / (factorial * (j + 1.0)), by_parts)
    return out


def lags_through_segments(
    force: Segments, ratio: Array, lag: Array, reader: Array, y: Array
) -> None:
    """Step lags through an input that is known between the samples, and add their readings.

    The input has n + 1 samples, and the lags, shape (m,), are at the first of them and are updated.
    The ratio is step over time constant of each. Readings after the first sample are added to y,
    shape (p, n), with one row of weights each in the reader, shape (p, m).
    """
    moments = _cached_moments(ratio.tobytes())
    _lags_through(force.arrays, ratio, np.exp(-ratio), moments, lag, reader, y)


@lru_cache(maxsize=64)
def _cached_moments(ratio: bytes) -> Array:
    """Return the moments of lags, cached for steps of one sample at a time."""
    return lag_moments(np.frombuffer(ratio, dtype=np.float64))


@compiled
def _lags_through(
    force: SegmentArrays,
    ratio: Array,
    decay: Array,
    moments: Array,
    lag: Array,
    reader: Array,
    y: Array,
) -> None:
    terms = terms_needed(force)
    i = 0
    for n in range(y.shape[1]):
        here = float(n)
        while here < n + 1.0:
            i, end, a, b, c, mu = piece_from(force, i, here, n + 1.0)
            if end - here == 1.0 and (c == 0.0 or abs(mu) <= LARGEST_RATE):
                for m in range(lag.size):
                    by = 0.0
                    if c != 0.0:
                        for j in range(terms - 1, -1, -1):
                            by = moments[j, m] - mu * by
                    lag[m] = decay[m] * lag[m] + (moments[0, m] * a + moments[1, m] * b + c * by)
            else:
                for m in range(lag.size):
                    lag[m] = _lag_piece(lag[m], ratio[m], end - here, a, b, c, mu)
            here = end
        _read_lags(lag, reader, y, n)


@compiled
def _read_lags(lag: Array, reader: Array, y: Array, n: int) -> None:
    """Add the weighted lags to column n of y, as in `lags_through_segments`."""
    for p in range(y.shape[0]):
        total = y[p, n]
        for m in range(lag.size):
            total += reader[p, m] * lag[m]
        y[p, n] = total


@compiled
def _lag_piece(lag: float, r: float, h: float, a: float, b: float, c: float, mu: float) -> float:
    """Return one lag after a piece h of a step, for the input a + b s + c exp(-mu s)."""
    x = r * h
    gone = -np.expm1(-x)
    if x < 1.0:
        share, k = 0.0, 18
        while k > 0:
            share = x / (k + 1.0) * (1.0 - share)
            k -= 1
    else:
        share = 1.0 - gone / x
    # exp(-mu h) - exp(-r h) over r - mu, which may be equal
    apart = (r - mu) * h
    ratio = -np.expm1(-apart) / apart if apart != 0.0 else 1.0
    by_c = c * r * h * np.exp(-mu * h) * ratio
    return (1.0 - gone) * lag + a * gone + b * h * share + by_c


@dataclass(frozen=True, slots=True, kw_only=True)
class Lag(ChainElement):
    r"""A first-order lag and a pure delay.

    .. math:: T \dot l + l = x, \qquad y(t) = l(t - t_d)

    The delay need not be an integer number of steps: inside a step the lag is evaluated in closed
    form, so that the output is exact for an input of straight lines. State: the last inputs, newest
    first, as far back as the delay reaches, then the lag there.

    Validity: linear; a filter of higher order, or one that rings, is not this.

    Raises
    ------
    ModelError
        A time is negative or longer than `LONGEST`.

    Examples
    --------
    >>> import numpy as np
    >>> lag = Lag(time_constant=0.002, delay=0.0013)
    >>> ramp = np.arange(50) * 0.7
    >>> round(float(ramp[-1] - lag.simulate(ramp, 0.001).values[-1]), 9)
    2.31
    """

    time_constant: float = 0.0
    """Time constant T [s]; 0 for none."""
    delay: float = 0.0
    """Delay [s]; 0 for none."""

    def __post_init__(self) -> None:
        for name in ("time_constant", "delay"):
            value = getattr(self, name)
            if not 0.0 <= value <= LONGEST:
                raise ModelError(
                    f"the {name} of a lag must be between 0 and {LONGEST:g} s, got {value!r} s"
                )

    def settled(self, x: float, dt: float) -> Array:
        return np.full(2 + self._delay_steps(positive_step(dt)), float(x))

    def simulate(self, x: ArrayLike, dt: float, state: ArrayLike | None = None) -> Response:
        inputs = samples(x, "input of a lag")
        now = self._initial_state(inputs[0], dt, state, "a lag")
        steps = now.size - 2
        remainder = 1.0 - (self.delay / dt - steps)
        ratio = self._ratio(dt)
        line = np.concatenate((now[steps::-1], inputs))
        y = np.empty_like(inputs)
        end = _lag(
            line,
            now[-1],
            float(decay_share(ratio)),
            float(ramp_share(ratio)),
            float(decay_share(ratio * remainder)),
            remainder * float(ramp_share(ratio * remainder)),
            y,
        )
        newest = line[line.size - 1 - steps :][::-1]
        return Response(values=y, state=np.append(newest, end))

    def resampled(self, state: Array, step: float, dt: float) -> Array:
        """Return a state for another step between samples [s], of which it had one before.

        Inputs are straight lines between samples. The lag itself is taken as constant over a step,
        which is exact without a time constant.
        """
        if step == dt:
            return state
        times = dt * np.arange(self._delay_steps(dt) + 1.0)
        inputs = np.interp(times, step * np.arange(state.size - 1.0), state[:-1])
        return np.append(inputs, state[-1])

    def lead(self, y: ArrayLike, dt: float) -> Array:
        r"""Return the smooth input that gives a smooth output.

        .. math:: x(t) = y(t + t_d) + T \dot y(t + t_d)

        Parameters
        ----------
        y : array_like
            Outputs, shape (n,), n at least 6; between them a spline of fifth degree. After the last
            one the output is constant.
        dt : float
            Step between samples [s].

        Returns
        -------
        numpy.ndarray
            Inputs, shape (n,).

        Raises
        ------
        ModelError
            There are fewer than 6 outputs.
        """
        from scipy.interpolate import make_interp_spline

        outputs = samples(y, "output of a lag")
        if outputs.size < 6:
            raise ModelError(f"`lead` needs 6 samples or more, got {outputs.size}")
        spline = make_interp_spline(np.arange(outputs.size), outputs, k=5)
        at = np.arange(outputs.size) + self.delay / positive_step(dt)
        inside = at <= outputs.size - 1
        at = np.minimum(at, outputs.size - 1)
        rate = np.asarray(spline(at, 1), dtype=np.float64) / dt
        return np.asarray(spline(at), dtype=np.float64) + self.time_constant * rate * inside

    def frequency_response(self, frequency_hz: ArrayLike) -> Complex:
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        return np.exp(-s * self.delay) / (1.0 + s * self.time_constant)

    def _delay_steps(self, dt: float) -> int:
        """Number of complete steps in the delay."""
        if self.delay > _MOST_STEPS * dt:
            raise ModelError(
                f"a delay of {self.delay:g} s is more than {_MOST_STEPS:,} steps of {dt:g} s: "
                "check the delay, or use a longer step"
            )
        return math.floor(self.delay / dt)

    def _ratio(self, dt: float) -> float:
        return dt / self.time_constant if self.time_constant > 0.0 else math.inf


@compiled
def _lag(
    line: Array,
    lag: float,
    decay: float,
    ramp: float,
    part_decay: float,
    part_ramp: float,
    y: Array,
) -> float:
    """Fill y with the lag inside each step of `line`, and return the lag at the last step used."""
    for k in range(y.size):
        rise = line[k + 1] - line[k]
        away = line[k] - lag
        y[k] = lag + away * part_decay + rise * part_ramp
        lag += away * decay + rise * ramp
    return lag
