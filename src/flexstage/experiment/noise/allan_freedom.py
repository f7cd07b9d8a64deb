"""Degrees of freedom of an Allan variance, and the kind of noise that they hang on."""

import math

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array

#: Estimates in one averaging time that are summed at most: more of them hold nothing new.
_STRIDE = 48
#: Averages that the autocorrelation needs to tell the kind of noise.
_ENOUGH = 30


def allan_freedom(n: int, m: int, power: int, kind: str) -> float:
    """Return the equivalent degrees of freedom of an Allan variance of overlapping stretches.

    They are 2 E^2 / Var of the mean square of Gaussian differences whose covariance follows from
    the power law (Greenhall and Riley, 2003, Uncertainty of stability variances based on finite
    differences, 35th PTTI meeting). Of n readings m are averaged; `power` is that of frequency
    which the spectral density goes with: 0 white, -1 flicker, -2 random walk. The kind is
    overlapping, modified or hadamard.

    Examples
    --------
    >>> round(allan_freedom(1000, 1, 0, "overlapping"), 0)
    666.0
    """
    order = 3 if kind == "hadamard" else 2
    modified = kind == "modified"
    stride = min(m, _STRIDE)
    # readings from the first to the last that one difference is made of
    span = order * m + (m - 1 if modified else 0)
    count = 1 + int(stride * (n - span) / m)
    most = min(count, (order + 1) * stride)
    z = _covariance(np.arange(most) / stride, m, power, order, modified=modified)
    weight = (1.0 - np.arange(most) / count) * np.where(np.arange(most) > 0, 2.0, 1.0)
    return float(count * z[0] ** 2 / (weight @ z**2))


def _covariance(t: Array, m: int, power: int, order: int, *, modified: bool) -> Array:
    """Covariance of differences of running sums of noise, t averaging times apart, up to a factor.

    The mean over m of the modified variance is one more difference, of one more sum.
    """
    total = order + modified
    out = np.zeros_like(t)
    for k in range(-total, total + 1):
        factor = (-1) ** k * math.comb(2 * total, total + k)
        if power == -1:
            out += factor * _flicker(t + k, m, filtered=not modified)
        else:
            out += factor * _sums(t + k, m, 1 - power // 2 + modified)
    return out


def _sums(t: Array, m: int, times: int) -> Array:
    """Generalised covariance of white noise that is summed several times, sample by sample."""
    out = np.abs(t)
    for j in range(1, times):
        out = out * (t**2 - (j / m) ** 2)
    return out


def _flicker(t: Array, m: int, *, filtered: bool) -> Array:
    """Generalised covariance of the integral of flicker noise, t^2 log t, averaged over a sample.

    An average over time is the second difference of the next integral, t^4 log t; over a sample
    that is below a four hundredth of t it changes nothing, but the differences would lose digits.
    """

    def law(at: Array) -> Array:
        u = np.abs(at)
        return u**4 * np.log(np.where(u > 0.0, u, 1.0))

    if not filtered:
        return law(t)
    step = 1.0 / min(m, 400)
    return (law(t + step) - 2.0 * law(t) + law(t - step)) / step**2


def power_of_noise(values: Array, samples: NDArray[np.int64]) -> list[int]:
    """Return the power of frequency that noise goes with at each averaging time.

    With r the autocorrelation of neighbouring averages and d = r / (1 + r) the power is -2 d, or
    that of the differences less 2 where d exceeds 1/4 (Riley and Greenhall, 2004). Where there are
    fewer than 30 averages it is that of the last with more.

    Examples
    --------
    >>> noise = np.random.default_rng(2).standard_normal(4000)
    >>> power_of_noise(noise, np.array([1, 8])), power_of_noise(noise.cumsum(), np.array([1, 8]))
    ([0, 0], [-2, -2])
    """
    out: list[int] = []
    for m in samples.tolist():
        count = values.size // m
        if count < _ENOUGH and out:
            out.append(out[-1])
            continue
        z = values[: count * m].reshape(count, m).mean(axis=1)
        # a drift is not noise
        t = np.arange(count) - 0.5 * (count - 1)
        z = z - z.mean() - (t @ z) / (t @ t) * t
        found = -2.0
        for taken in range(2):
            z = z - z.mean()
            power = float(z @ z)
            r = float(z[1:] @ z[:-1]) / power if power > 0.0 else 0.0
            d = r / (1.0 + r) if r > -0.99 else -99.0
            if d < 0.25 or taken:
                found = -2.0 * (d + taken)
                break
            z = np.diff(z)
        out.append(int(min(max(round(found), -2), 0)))
    return out
