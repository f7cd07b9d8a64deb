"""Noise of a stage at rest: drift, rms, peak-to-peak, spectrum, mains, Allan deviation."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.spectra.averaging import SpectralDensity, spectral_density
from flexstage.quantities.estimate import Estimate, deviation_bounds

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
        exponent = -2.0
        for differences in range(2):
            z = z - z.mean()
            power = float(z @ z)
            r = float(z[1:] @ z[:-1]) / power if power > 0.0 else 0.0
            d = r / (1.0 + r) if r > -0.99 else -99.0
            if d < 0.25 or differences:
                exponent = -2.0 * (d + differences)
                break
            z = np.diff(z)
        out.append(int(min(max(round(exponent), -2), 0)))
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
        sizes = np.unique(np.atleast_1d(np.asarray(samples)).astype(np.int64))
        if sizes.size == 0 or sizes[0] < 1 or sizes[-1] > most:
            raise ModelError(
                f"of {n} readings 1 to {most} can be averaged for the deviation, got {samples!r}"
            )
        return sizes
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


_MOST_BLOCKS, _LEAST_BLOCKS = 32, 8


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockLine:
    """A straight line through the means of blocks of a record."""

    slope: float
    """Change in a sample, in the unit of the readings."""
    slope_uncertainty: float
    """Its standard uncertainty."""
    degrees_of_freedom: float
    """Of that: the blocks less two."""
    long_run_variance: float
    """Variance of the mean of a block about the line, times its samples: the variance that
    independent samples would need for the mean to be as uncertain as it is.
    """
    blocks: int
    """Number of blocks."""
    correlated: bool
    """Whether neighbouring blocks still hang together, at the fewest blocks."""


def blocks_line(values: Array) -> BlockLine:
    """Fit a line to means of blocks, which are independent where samples are not.

    There are the most blocks of 32, 22, 15... to 8 whose neighbours do not hang together; the
    record has sixteen values or more.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal(8192)
    >>> line = blocks_line(0.002 * np.arange(8192) + noise)
    >>> print(f"{line.slope:.5f} +- {line.slope_uncertainty:.5f}")
    0.00200 +- 0.00001
    """
    count = min(_MOST_BLOCKS, values.size // 2)
    # autocorrelation of the means of neighbouring blocks above which blocks are made longer
    correlated = 0.1
    while True:
        length = values.size // count
        # incomplete blocks are omitted at the start, where settling is largest
        z = values[values.size - count * length :].reshape(count, length).mean(axis=1)
        t = np.arange(count) - 0.5 * (count - 1)
        slope = float(t @ z / (t @ t))
        rest = z - z.mean() - slope * t
        power = float(rest @ rest)
        # two of the degrees of freedom went with the line, which makes neighbours look opposed
        linked = float(rest[1:] @ rest[:-1]) / power + 2.0 / count if power > 0.0 else 0.0
        if linked < max(correlated, 1.0 / math.sqrt(count)) or count <= _LEAST_BLOCKS:
            break
        count = max(int(count / math.sqrt(2.0)), _LEAST_BLOCKS)
    # what neighbours still share makes a mean over many of them less certain
    variance = power / (count - 2) * (1.0 + 2.0 * max(linked, 0.0))
    return BlockLine(
        slope=slope / length,
        slope_uncertainty=math.sqrt(variance / float(t @ t)) / length,
        degrees_of_freedom=float(count - 2),
        long_run_variance=variance * length,
        blocks=count,
        correlated=linked >= 3.0 * correlated,
    )


def variance_freedom(values: Array) -> float:
    """Return the degrees of freedom of the variance of a Gaussian record.

    They are n over the sum of the squared autocorrelations (Bartlett, 1946, Supplement to the
    Journal of the Royal Statistical Society 8), which by Parseval is the mean square of the
    spectral density over its squared mean. The mean and the trend of the record are taken off
    before; there is one at least.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal(8192)
    >>> round(variance_freedom(noise), -3), round(variance_freedom(noise[1:] + noise[:-1]), -3)
    (8000.0, 5000.0)
    """
    from scipy.signal import welch

    n = values.size
    # long segments, as noise that is narrower than their resolution would look independent
    length = 2 ** max(int(math.log2(n / 3.0)), 4)
    # scipy takes False here, and says text
    _, density = welch(values, nperseg=length, detrend=False)  # type: ignore[arg-type]
    # the scatter of each value adds to its square
    averages = 2.0 * (n - length // 2) / (length // 2) / (1.0 + 1.0 / 18.0)
    inner = density[1:]
    mean, square = float(inner.mean()), float(np.mean(inner**2)) / (1.0 + 2.0 / averages)
    return max(n * mean**2 / square, 1.0) if square > 0.0 else math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class MainsLine:
    """A line at the mains frequency or a multiple of it."""

    frequency_hz: float
    """Where it is [Hz]."""
    mains_hz: int
    """The mains: 50 or 60."""
    multiple: int
    """Which multiple of it."""
    rms: Estimate
    """Its rms, in the unit of the reading."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HoldNoise:
    """What a reading does while the stage is held."""

    drift: Estimate
    """Slope of the line through the readings, their unit in a second."""
    rms: Estimate
    """Standard deviation about that line, with chi-squared bounds."""
    peak_to_peak: Estimate
    """Highest less lowest distance from the line; its interval is for the mean of many such
    records, as one alone is what it is.
    """
    expected_peak_to_peak: float
    """What Gaussian noise of this rms and bandwidth gives on average in this time."""
    spectrum: SpectralDensity
    """Spectral density of the distances from the line."""
    mains: tuple[MainsLine, ...]
    """Lines of the mains in it."""
    correlation: float
    """Correlation of neighbouring samples [1]."""
    duration: float
    """Length of the record [s]."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""
    unit: str
    """Unit of the readings."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""


def expected_peak_to_peak(samples: int, *, correlation: float = 0.0) -> float:
    """Return the mean peak-to-peak of Gaussian noise, over its standard deviation.

    A level u is crossed upwards between neighbouring samples with probability
    ``2 T(u, sqrt((1 - r) / (1 + r)))``, of Owen's function T (1956, Annals of Mathematical
    Statistics 27) and their correlation r; crossings of a high level are as good as independent, so
    the highest of n samples is below u with probability exp(-n) of that (Rice, 1945, Bell System
    Technical Journal 24, for continuous time).

    Validity
    --------
    Within 1 % of white noise for 100 samples or more; noise that is slower than the record counts
    as drift. A line of the mains, whose peak is its amplitude, gives less.

    Examples
    --------
    >>> print(f"{expected_peak_to_peak(1000):.2f}, {expected_peak_to_peak(100_000):.2f}")
    6.48, 8.78
    """
    level, below = _highest(samples, correlation)
    return 2.0 * float(np.sum(1.0 - below) * (level[1] - level[0]))


def _highest(samples: int, correlation: float) -> tuple[Array, Array]:
    """Levels, and the probability that the highest sample is below each."""
    from scipy.special import owens_t

    if samples < 2 or not -1.0 < correlation < 1.0:
        raise ModelError(
            "a peak-to-peak needs two samples or more whose correlation is between -1 and 1, got "
            f"{samples} and {correlation!r}"
        )
    level = np.linspace(0.0, 9.0, 1801)
    crossed = 2.0 * owens_t(level, math.sqrt((1.0 - correlation) / (1.0 + correlation)))
    return level, np.exp(-samples * crossed)


def _range_bounds(
    value: float, samples: int, correlation: float, freedom: float
) -> tuple[float, float]:
    """95 % interval of the mean peak-to-peak, from one: highest and lowest are independent.

    Slow noise makes the rms of a record, and its extremes with it, differ from that of the next.
    """
    level, below = _highest(samples, correlation)
    step = level[1] - level[0]
    density = np.diff(below, prepend=0.0)
    total = np.cumsum(np.convolve(density, density))
    mean = 2.0 * float(np.sum(1.0 - below) * step)
    at = np.arange(total.size) * step
    low, high = np.interp([0.025, 0.975], total, at)
    rms = deviation_bounds(1.0, freedom)
    down = math.hypot(math.log(mean / float(high)), math.log(rms[0]))
    up = math.hypot(math.log(mean / float(low)), math.log(rms[1]))
    return value * math.exp(-down), value * math.exp(up)


def hold_noise(
    values: ArrayLike, sample_rate_hz: float, *, segment: int | None = None, unit: str = "m"
) -> HoldNoise:
    """Return drift, rms, peak-to-peak and spectrum of a reading while the stage is held.

    The drift is the slope of a line through the means of 32 blocks or fewer, as many as do not
    hang together, so that slow noise counts in its uncertainty. The rms has as many degrees of
    freedom as its spectrum tells (Bartlett, 1946), and what the line took of slow noise is given
    back to it.

    Parameters
    ----------
    values : array_like
        Evenly spaced readings, shape (n,), 64 or more.
    sample_rate_hz : float
        Readings in a second [Hz].
    segment : int, optional
        Samples in a segment of the spectrum.
    unit : str
        Unit of the readings.

    Returns
    -------
    HoldNoise
        The figures.

    Validity
    --------
    Gaussian noise that is stationary and much shorter than the record: at 40 correlation times the
    95 % intervals hold the truth in nine of ten cases, at 10 in four of five, and the notes say so.
    A random walk is not separable from drift. A steady line has no scatter from record to record,
    but counts as narrow noise, which widens the interval of the rms.

    Raises
    ------
    RecordError
        There are fewer than 64 readings, one is not finite, or none changes.
    ModelError
        The rate or the segment is not possible.

    Examples
    --------
    >>> t = np.arange(20_000) / 1000.0
    >>> noise = 3e-9 * np.random.default_rng(4).standard_normal(20_000)
    >>> found = hold_noise(0.4e-9 * t + noise, 1000.0)
    >>> print(f"drift {1e9 * found.drift.value:.2f} +- {1e9 * found.drift.expanded:.2f} nm/s")
    drift 0.40 +- 0.01 nm/s
    >>> print(f"rms {1e9 * found.rms.value:.2f} nm, peak to peak {found.peak_to_peak.value:.1e} m")
    rms 3.00 nm, peak to peak 2.3e-08 m
    """
    y = np.asarray(values, dtype=np.float64)
    if y.ndim != 1 or y.size < 64 or not np.isfinite(y).all():
        raise RecordError(
            f"a noise floor needs 64 finite readings or more, got an array of shape {y.shape}"
        )
    if not np.ptp(y) > 0.0:
        raise RecordError("all readings are equal: the sensor is dead or too coarse")
    if not 0.0 < sample_rate_hz < math.inf:
        raise ModelError(f"the sample rate must be positive, got {sample_rate_hz!r} Hz")
    n, line = y.size, blocks_line(y)
    t = np.arange(n) - 0.5 * (n - 1)
    rest = y - y.mean()
    rest -= float(t @ rest / (t @ t)) * t
    # largest default number of samples in a segment of the spectrum
    longest = 65_536
    length = min(n // 8, longest) if segment is None else segment
    spectrum = spectral_density(rest, sample_rate_hz, segment=length - length % 2, unit=unit)
    # mean and slope each take one long-run variance from the sum of squares
    power, lost = float(rest @ rest), 2.0 * line.long_run_variance
    variance = (power + lost) / n
    rms = math.sqrt(variance)
    # the two sums err together, as both are made of the slow part
    error = power / math.sqrt(variance_freedom(rest)) + lost / math.sqrt(line.degrees_of_freedom)
    freedom = ((power + lost) / error) ** 2
    correlation = min(max(float(rest[1:] @ rest[:-1]) / power, -0.99), 0.999999)
    between = float(np.ptp(rest))
    bounds = _range_bounds(between, n, correlation, freedom)
    return HoldNoise(
        # a line through all samples is the better slope, that of the blocks tells how good
        drift=Estimate.of(
            line.slope * sample_rate_hz,
            line.slope_uncertainty * sample_rate_hz,
            f"{unit}/s",
            degrees_of_freedom=line.degrees_of_freedom,
        ),
        rms=Estimate.of_deviation(
            rms, freedom, unit, note=f"about a line, over {n / sample_rate_hz:.4g} s"
        ),
        peak_to_peak=Estimate.of(
            between,
            (bounds[1] - bounds[0]) / 3.92,
            unit,
            source="chance of extremes",
            bounds=bounds,
            note=f"in {n / sample_rate_hz:.4g} s; it grows with time",
        ),
        expected_peak_to_peak=rms * expected_peak_to_peak(n, correlation=correlation),
        spectrum=spectrum,
        mains=mains_lines(rest, sample_rate_hz, unit=unit),
        correlation=correlation,
        duration=n / sample_rate_hz,
        sample_rate_hz=sample_rate_hz,
        unit=unit,
        notes=_notes(line.correlated, freedom),
    )


def _notes(correlated: bool, freedom: float) -> tuple[str, ...]:
    # degrees of freedom of the rms below which noise counts as slow
    fewest = 50.0
    if not correlated and freedom >= fewest:
        return ()
    return (
        f"the noise is slow, with {freedom:.0f} degrees of freedom in this record: it "
        "cannot be separated from drift, and uncertainties are underestimated; record for longer",
    )


def mains_lines(
    values: ArrayLike, sample_rate_hz: float, *, unit: str = "m"
) -> tuple[MainsLine, ...]:
    """Return the lines at 50 or 60 Hz and their multiples that stand out of the noise.

    The whole record is one segment with a Hann window. A line is a peak within 0.4 % of a multiple
    that noise of the height around it would show in one of 10 000 searches; its frequency and
    amplitude are those of the sine of least squares there. Of 50 and 60 Hz the one with more power
    in its lines is named.

    Parameters
    ----------
    values : array_like
        Evenly spaced readings, shape (n,).
    sample_rate_hz : float
        Readings in a second [Hz].
    unit : str
        Unit of the readings.

    Returns
    -------
    tuple of MainsLine
        The lines, by frequency; none where there is none, or fewer than 25 periods.

    Validity
    --------
    A steady line: mains whose frequency wanders by more than 1 / record over the record gives less
    than its rms.

    Raises
    ------
    RecordError
        A reading is not finite.

    Examples
    --------
    >>> t = np.arange(20_000) / 2000.0
    >>> hum = 2e-9 * np.sin(2.0 * np.pi * 49.97 * t)
    >>> noise = 3e-9 * np.random.default_rng(4).standard_normal(20_000)
    >>> line, = mains_lines(hum + noise, 2000.0)
    >>> print(f"{line.frequency_hz:.2f} Hz, {1e9 * line.rms.value:.2f} nm")
    49.97 Hz, 1.42 nm
    """
    y = np.asarray(values, dtype=np.float64)
    if y.ndim != 1 or not np.isfinite(y).all():
        raise RecordError("the readings must be one finite number for each time")
    n = y.size
    if n * 50.0 < 25.0 * sample_rate_hz:
        return ()
    y = y - y.mean()
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(n) + 0.5) / n)
    power = np.abs(np.fft.rfft(y * window)) ** 2
    candidates = {mains: _multiples(y, power, sample_rate_hz, mains, unit) for mains in (50, 60)}
    best = max(candidates.values(), key=lambda lines: sum(line.rms.value**2 for line in lines))
    return tuple(best)


def _multiples(y: Array, power: Array, rate: float, mains: int, unit: str) -> list[MainsLine]:
    n, lines = y.size, []
    # share by which the mains frequency strays, and at which a line counts as a multiple of it
    stray = 0.004
    # chance that noise alone gives a line
    false_alarm = 1e-4
    for k in range(1, int(0.498 * rate / mains) + 1):
        at = k * mains * n / rate
        reach = max(int(stray * at), 2)
        low, high = max(int(at) - reach, 1), min(int(at) + reach + 2, power.size)
        wide = max(8 * reach, 60)
        around = np.concatenate([power[max(low - wide, 1) : low], power[high : high + wide]])
        if high - low < 3 or around.size < 40:
            continue
        floor = float(np.median(around)) / math.log(2.0)
        peak = low + int(np.argmax(power[low:high]))
        if power[peak] > floor * math.log((high - low) / false_alarm):
            lines.append(_line(y, peak, rate, mains, k, unit))
    return lines


def _line(y: Array, peak: int, rate: float, mains: int, k: int, unit: str) -> MainsLine:
    from scipy.optimize import minimize_scalar

    t = (np.arange(y.size) - 0.5 * (y.size - 1)) / rate

    def fit(f: float) -> complex:
        return complex(2.0 / y.size * (y @ np.exp(-2j * np.pi * f * t)))

    width = rate / y.size
    best: Any = minimize_scalar(
        lambda f: -abs(fit(f)), bounds=((peak - 1.0) * width, (peak + 1.0) * width),
        method="bounded", options={"xatol": 1e-4 * width},
    )  # fmt: skip
    f = float(best.x)
    amplitude = fit(f)
    # noise about the line, from lines near it on both sides, beyond its own width
    near = [abs(fit(f + s * j * width)) ** 2 for s in (-1, 1) for j in range(2, 12)]
    uncertainty = math.sqrt(float(np.mean(near)) / 2.0)
    rms = Estimate.of(
        abs(amplitude) / math.sqrt(2.0),
        uncertainty / math.sqrt(2.0),
        unit,
        source="noise about the line",
        degrees_of_freedom=2.0 * len(near),
    )
    return MainsLine(frequency_hz=f, mains_hz=mains, multiple=k, rms=rms)
