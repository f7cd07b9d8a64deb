"""Steps of first-order lags that are exact for straight lines."""

import numpy as np
from numpy.typing import ArrayLike

from flexstage.hysteresis.chain.element import LARGEST_RATE, ORDERS, terms_needed
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, Segments

# Below this ratio of step to time constant the closed form loses digits; the series has 18 terms.
_SHORT = 1.0


def decay_share(ratio: ArrayLike) -> Array:
    r"""Return how far a lag goes towards a constant input in a step.

    .. math:: 1 - e^{-r}

    The ratio r is step over time constant [1], infinite for no lag.
    """
    return -np.expm1(-np.asarray(ratio, dtype=np.float64))


def ramp_share(ratio: ArrayLike) -> Array:
    r"""Return how far a lag follows the rise of a ramp in a step.

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
    r"""Return what the derivatives of an input do to lags in a step of one sample.

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
    _lags_through(
        force.start,
        force.constant,
        force.slope,
        force.amplitude,
        force.rate,
        ratio,
        np.exp(-ratio),
        lag_moments(ratio),
        lag,
        reader,
        y,
    )


@compiled
def _lags_through(
    start: Array,
    constant: Array,
    slope: Array,
    amplitude: Array,
    rate: Array,
    ratio: Array,
    decay: Array,
    moments: Array,
    lag: Array,
    reader: Array,
    y: Array,
) -> None:
    terms = terms_needed(amplitude, rate)
    i, last = 0, start.size - 1
    for n in range(y.shape[1]):
        here, following = float(n), n + 1.0
        while here < following:
            while i < last and start[i + 1] <= here:
                i += 1
            end = following
            if i < last and start[i + 1] < end:
                end = start[i + 1]
            since = here - start[i]
            a, b, c, mu = constant[i] + slope[i] * since, slope[i], amplitude[i], rate[i]
            if since != 0.0 and c != 0.0:
                c *= np.exp(-mu * since)
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
        for p in range(y.shape[0]):
            total = y[p, n]
            for m in range(lag.size):
                total += reader[p, m] * lag[m]
            y[p, n] = total


@compiled
def _lag_piece(lag: float, r: float, h: float, a: float, b: float, c: float, mu: float) -> float:
    """A piece h of a step, of one lag, under the input a + b s + c exp(-mu s)."""
    x = r * h
    gone = -np.expm1(-x)
    if x < 1.0:
        share, k = 0.0, 18
        while k > 0:
            share = x / (k + 1.0) * (1.0 - share)
            k -= 1
    else:
        share = 1.0 - gone / x
    # exp(-mu h) - exp(-r h) over r - mu, which are equal now and then
    apart = (r - mu) * h
    ratio = -np.expm1(-apart) / apart if apart != 0.0 else 1.0
    by_c = c * r * h * np.exp(-mu * h) * ratio
    return (1.0 - gone) * lag + a * gone + b * h * share + by_c
