"""The period of a repeated signal."""

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import RecordError

# a signal whose best copy of itself is less alike than this is not taken as repeated
_LIKE = 0.9
# a fraction of a sample that matters, and the share of what a copy lacks that is due to it
_ASIDE = 0.01
_OWED = 0.1
# what the samples at the edges alone may shift a summit by, times the samples that overlap
_EDGE = 4.0
# and what noise alone may seem to be due to it, times the samples that overlap
_CHANCE = 30.0
# a copy that is worse than the best by no more than this counts as good
_ROUNDING = 1e-9


def likeness(values: Array) -> Array:
    """Return how much a signal is like itself some samples later.

    r_l = 2 sum_t x_t x_(t+l) / sum_t (x_t^2 + x_(t+l)^2), over the samples that overlap, of the
    signal less its mean: 1 for a copy and for nothing else. At lags from 0 to n / 2, shape (n // 2
    + 1,).
    """
    from scipy.fft import irfft, next_fast_len, rfft

    x = values - values.mean()
    n = x.size
    lags = n // 2 + 1
    size = next_fast_len(n + lags, real=True)
    power = np.abs(np.asarray(rfft(x, size))) ** 2
    product = np.asarray(irfft(power, size))[:lags]
    energy = np.concatenate(([0.0], np.cumsum(x**2)))
    k = np.arange(lags)
    both = energy[n - k] + energy[n] - energy[k]
    return np.divide(2.0 * product, both, out=np.zeros(lags), where=both > 0.0)


def find_period(values: Array, name: str = "the input") -> int:
    """Return the period of a repeated signal.

    It is the least lag at which the signal is as like itself as at any, but for noise. In samples;
    the record holds two periods or more.

    Validity
    --------
    A whole number of samples in a period, and more than some ten times as much signal as noise.

    Examples
    --------
    >>> t = np.arange(500)
    >>> find_period(np.sin(2 * np.pi * t / 125) + np.cos(10 * np.pi * t / 125))
    125
    """
    r = likeness(np.asarray(values, dtype=np.float64))
    inner = np.flatnonzero((r[1:-1] >= r[:-2]) & (r[1:-1] >= r[2:])) + 1
    best = float(r[inner].max()) if inner.size else 0.0
    if best < _LIKE:
        raise RecordError(
            f"'{name}' does not repeat itself: its best copy within half of its {r.size * 2 - 2} "
            f"samples is {100.0 * best:.3g} % like it; record two periods at least, give the "
            "samples of a period, or take another kind of excitation"
        )
    good = inner[1.0 - r[inner] <= 2.0 * (1.0 - best) + _ROUNDING]
    period = int(good[0])
    # the summit of a parabola through the likeness at the period and beside it
    before, at, after = r[period - 1], r[period], r[period + 1]
    bend = 2.0 * at - before - after
    aside = 0.5 * (after - before) / bend if bend > 0.0 else 0.0
    gain, overlap = 0.5 * bend * aside**2, len(values) - period
    if abs(aside) > _ASIDE + _EDGE / overlap and gain > (_OWED + _CHANCE / overlap) * (1.0 - at):
        raise RecordError(
            f"'{name}' repeats itself after {period + aside:.6g} samples, which is not a whole "
            "number: choose clock and period so that it is, or resample the record"
        )
    return period
