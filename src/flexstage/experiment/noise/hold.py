"""Noise floor of a stage that is held still: drift, rms, peak-to-peak, spectrum."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import ModelError, RecordError
from flexstage.estimate import Component, Estimate
from flexstage.experiment.noise.allan import deviation_bounds, deviation_estimate
from flexstage.experiment.noise.correlated_noise import blocks_line, variance_freedom
from flexstage.experiment.noise.mains import MainsLine, mains_lines
from flexstage.experiment.spectra.density import SpectralDensity, spectral_density

#: Degrees of freedom of the rms below which noise counts as slow.
_FEW = 50.0
#: Samples of a segment of the spectrum at most, where nobody asks for more.
_LONGEST = 65_536


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

    def peak_to_peak_in(self, duration: float) -> float:
        """Return the peak-to-peak that is expected in another time.

        Parameters
        ----------
        duration : float
            The time [s].

        Returns
        -------
        float
            Mean of highest less lowest, of Gaussian noise of this rms and bandwidth.
        """
        samples = max(int(duration * self.sample_rate_hz), 2)
        return self.rms.value * expected_peak_to_peak(samples, correlation=self.correlation)


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
    A random walk cannot be told from drift. A steady line has no
    scatter from record to record, but counts here as narrow noise, which makes the interval of the
    rms wider than need be.

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
        raise RecordError("no reading differs from the others: the sensor is dead or too coarse")
    if not 0.0 < sample_rate_hz < math.inf:
        raise ModelError(f"the sample rate must be positive, got {sample_rate_hz!r} Hz")
    n, line = y.size, blocks_line(y)
    t = np.arange(n) - 0.5 * (n - 1)
    rest = y - y.mean()
    rest -= float(t @ rest / (t @ t)) * t
    length = min(n // 8, _LONGEST) if segment is None else segment
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
    spread = Component(name="chance of extremes", uncertainty=(bounds[1] - bounds[0]) / 3.92)
    # a line through all samples is the better slope, that of the blocks tells how good
    slope = Component(
        name="noise",
        uncertainty=line.slope_uncertainty * sample_rate_hz,
        degrees_of_freedom=line.degrees_of_freedom,
    )
    return HoldNoise(
        drift=Estimate(value=line.slope * sample_rate_hz, unit=f"{unit}/s", components=(slope,)),
        rms=deviation_estimate(
            rms, freedom, unit, f"about a line, over {n / sample_rate_hz:.4g} s"
        ),
        peak_to_peak=Estimate(
            value=between,
            unit=unit,
            components=(spread,),
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
    if not correlated and freedom >= _FEW:
        return ()
    return (
        f"the noise is slow, with {freedom:.0f} degrees of freedom in this record: it "
        "cannot be separated from drift, and uncertainties are underestimated; record for longer",
    )
