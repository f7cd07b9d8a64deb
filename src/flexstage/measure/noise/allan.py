"""Allan deviation: how far averages of neighbouring stretches of a reading differ, with bounds."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.arrays import Array
from flexstage.errors import ModelError, RecordError
from flexstage.estimate import Estimate, deviation_bounds

#: Estimates in one averaging time that are summed at most: more of them hold nothing new.
_STRIDE = 48
#: Averages that the autocorrelation needs to tell the kind of noise.
_ENOUGH = 30
_NAMES = {0: "white", -1: "flicker", -2: "random walk"}


def allan_freedom(n: int, m: int, power: int) -> float:
    """Return the equivalent degrees of freedom of an Allan variance of overlapping stretches.

    They are 2 E^2 / Var of the mean square of Gaussian differences whose covariance follows from
    the power law (Greenhall and Riley, 2003, Uncertainty of stability variances based on finite
    differences, 35th PTTI meeting). Of n readings m are averaged; `power` is that of frequency
    which the spectral density goes with: 0 white, -1 flicker, -2 random walk.

    Examples
    --------
    >>> round(allan_freedom(1000, 1, 0), 0)
    666.0
    """
    stride = min(m, _STRIDE)
    # a difference is made of 2 m readings
    count = 1 + int(stride * (n - 2 * m) / m)
    most = min(count, 3 * stride)
    z = _covariance(np.arange(most) / stride, m, power)
    weight = (1.0 - np.arange(most) / count) * np.where(np.arange(most) > 0, 2.0, 1.0)
    return float(count * z[0] ** 2 / (weight @ z**2))


def _covariance(t: Array, m: int, power: int) -> Array:
    """Covariance of second differences of running sums of noise, t averaging times apart.

    It is up to a factor.
    """
    out = np.zeros_like(t)
    for k in range(-2, 3):
        factor = (-1) ** k * math.comb(4, 2 + k)
        out += factor * (_flicker(t + k, m) if power == -1 else _sums(t + k, m, 1 - power // 2))
    return out


def _sums(t: Array, m: int, times: int) -> Array:
    """Generalised covariance of white noise that is summed several times, sample by sample."""
    out = np.abs(t)
    for j in range(1, times):
        out = out * (t**2 - (j / m) ** 2)
    return out


def _flicker(t: Array, m: int) -> Array:
    """Generalised covariance of the integral of flicker noise, t^2 log t, averaged over a sample.

    An average over time is the second difference of the next integral, t^4 log t; over a sample
    that is below a four hundredth of t it changes nothing, but the differences would lose digits.
    """

    def law(at: Array) -> Array:
        u = np.abs(at)
        return u**4 * np.log(np.where(u > 0.0, u, 1.0))

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AllanDeviation:
    """Allan deviation of a reading over the time that is averaged."""

    tau: Array
    """Averaging times [s], shape (k,)."""
    samples: NDArray[np.int64]
    """Samples that are averaged [1], shape (k,)."""
    deviation: Array
    """Root of half the mean square difference between neighbouring averages, in the unit of the
    reading, shape (k,).
    """
    low: Array
    """Lower end of its 95 % interval, shape (k,)."""
    high: Array
    """Upper end of its 95 % interval, shape (k,)."""
    degrees_of_freedom: Array
    """Equivalent degrees of freedom of the variance, shape (k,)."""
    noise: tuple[str, ...]
    """What dominates at each averaging time: white, flicker, random walk or drift."""
    slopes: Array
    """Slope of the deviation over tau, both as logarithms [1], shape (k,): -1/2 of white noise, 0
    of flicker noise, 1/2 of a random walk, 1 of a drift.
    """
    unit: str
    """Unit of the reading."""

    def at(self, tau: float) -> Estimate:
        """Return the deviation at the averaging time next to one, with its uncertainty.

        Its bounds are by chi-squared.
        """
        i = int(np.argmin(np.abs(np.log(self.tau / tau))))
        value, freedom = float(self.deviation[i]), float(self.degrees_of_freedom[i])
        note = f"averaged over {self.tau[i]:.4g} s"
        return Estimate.of_deviation(value, freedom, self.unit, note=note)

    def floor(self) -> Estimate:
        """Return the least deviation: what averaging longer does not better.

        Its bounds are by chi-squared; the note tells the averaging time.
        """
        return self.at(float(self.tau[np.argmin(self.deviation)]))


def allan_deviation(
    values: ArrayLike,
    sample_rate_hz: float,
    *,
    samples: ArrayLike | None = None,
    unit: str = "m",
) -> AllanDeviation:
    """Return the Allan deviation of a reading, from all overlapping stretches of it.

    With a_j(m) the mean of m readings from the j-th on, the variance is half the mean of
    ``(a_(j+m) - a_j)^2`` over all j (Allan, 1966, Proceedings of the IEEE 54; overlapping: Howe,
    Allan and Barnes, 1981), from a running sum, in
    O(n) for each averaging time. The degrees of freedom are those of Greenhall and Riley (2003,
    Uncertainty of stability variances based on finite differences, 35th PTTI meeting), for the kind
    of noise that the autocorrelation of neighbouring averages tells (Riley and Greenhall, 2004,
    Power law noise identification using the lag 1 autocorrelation, 18th EFTF).

    Parameters
    ----------
    values : array_like
        Evenly spaced readings, shape (n,): a position, say. They stand where clocks have
        frequencies.
    sample_rate_hz : float
        Readings in a second [Hz].
    samples : array_like, optional
        How many samples to average, shape (k,); 1, 2, 4... where not given.
    unit : str
        Unit of the readings.

    Returns
    -------
    AllanDeviation
        Deviation, intervals, slopes.

    Validity
    --------
    The intervals are those of white, flicker or random-walk noise, Gaussian and stationary. A
    steady drift a gives a tau / sqrt(2), which is no noise: where it dominates the interval is only
    formal. A line at frequency f shows as a hump of A sin^2(pi f tau) / (pi f tau).

    Raises
    ------
    RecordError
        There are fewer than eight readings, or one is not finite.
    ModelError
        The rate or the number of samples to average is none.

    Examples
    --------
    >>> noise = 3e-9 * np.random.default_rng(4).standard_normal(40_000)
    >>> found = allan_deviation(noise, 1000.0)
    >>> half = found.at(0.064).times(1e9)
    >>> print(f"{half.value:.2f} nm, {half.bounds[0]:.2f} to {half.bounds[1]:.2f}")
    0.36 nm, 0.35 to 0.38
    >>> found.noise[0]
    'white'
    """
    y = np.asarray(values, dtype=np.float64)
    if y.ndim != 1 or y.size < 8 or not np.isfinite(y).all():
        raise RecordError(
            f"an Allan deviation needs eight finite readings or more, got an array of {y.shape}"
        )
    if not 0.0 < sample_rate_hz < math.inf:
        raise ModelError(f"the sample rate must be positive, got {sample_rate_hz!r} Hz")
    y = y - y.mean()
    factors = _factors(samples, y.size)
    total = np.concatenate(([0.0], np.cumsum(y)))
    variance = np.array([_variance(total, int(m)) for m in factors])
    powers = power_of_noise(y, factors)
    freedom = np.array(
        [allan_freedom(y.size, int(m), p) for m, p in zip(factors, powers, strict=True)]
    )
    deviation, tau = np.sqrt(variance), factors / sample_rate_hz
    bounds = np.array([deviation_bounds(*pair) for pair in zip(deviation, freedom, strict=True)])
    slopes = _slopes(tau, deviation)
    drift = _drift_share(y, factors, variance)
    names = tuple(
        "drift" if share > 0.5 else _NAMES[p] for p, share in zip(powers, drift, strict=True)
    )
    return AllanDeviation(
        tau=tau,
        samples=factors,
        deviation=deviation,
        low=bounds[:, 0],
        high=bounds[:, 1],
        degrees_of_freedom=freedom,
        noise=names,
        slopes=slopes,
        unit=unit,
    )


def _factors(samples: ArrayLike | None, n: int) -> NDArray[np.int64]:
    most = n // 2
    if samples is not None:
        given = np.unique(np.atleast_1d(np.asarray(samples)).astype(np.int64))
        if given.size == 0 or given[0] < 1 or given[-1] > most:
            raise ModelError(
                f"of {n} readings 1 to {most} can be averaged for the deviation, got {samples!r}"
            )
        return given
    return 2 ** np.arange(int(math.log2(most)) + 1)


def _variance(total: Array, m: int) -> float:
    """Return the variance over m samples, from the running sum of the readings, shape (n + 1,)."""
    d = total[2 * m :] - 2.0 * total[m:-m] + total[: -2 * m]
    return float(d @ d) / (2.0 * m**2 * d.size)


def _slopes(tau: Array, deviation: Array) -> Array:
    if tau.size < 2 or np.any(deviation <= 0.0):
        return np.full(tau.size, np.nan)
    return np.gradient(np.log(deviation), np.log(tau))


def _drift_share(y: Array, factors: NDArray[np.int64], variance: Array) -> Array:
    """Share of the variance that the slope of the readings explains at each averaging time."""
    t = np.arange(y.size) - 0.5 * (y.size - 1)
    slope = float(t @ y / (t @ t))
    return 0.5 * (slope * factors) ** 2 / np.where(variance > 0.0, variance, np.inf)
