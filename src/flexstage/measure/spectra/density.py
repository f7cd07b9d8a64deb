"""The power spectral density of a signal, and its rms between two frequencies."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import ModelError, RecordError
from flexstage.estimate import Estimate
from flexstage.measure.spectra.averaging import (
    effective_averages,
    hop_of,
    integral_averages,
    line_frequencies,
    segment_length,
    window_values,
)
from flexstage.measure.spectra.sums import SumOfSpectra, add_segments


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpectralDensity:
    """A single-sided power spectral density."""

    frequency_hz: Array
    """Frequencies, from 0 to half the sample rate [Hz], shape (k,)."""
    density: Array
    """Power in a hertz [unit^2/Hz], shape (k,)."""
    segments: int
    """Number of segments."""
    averages: float
    """Number of independent averages at one frequency."""
    integral_averages: float
    """Number of independent values that each frequency is worth where they are added up."""
    unit: str = ""
    """Unit of the signal."""

    def bounds(self, confidence: float = 0.95) -> tuple[Array, Array]:
        """Return the interval that holds the true density at each frequency.

        2 n G' / G is distributed as chi-squared of 2 n degrees of freedom (Bendat and Piersol,
        Random Data, 4th edition, chapter 8), of half as many at 0 and half the sample rate. In
        unit^2/Hz, shape (k,) each.
        """
        from scipy.special import chdtri

        if not 0.0 < confidence < 1.0:
            raise ModelError(f"a confidence lies between 0 and 1, got {confidence!r}")
        nu = np.full(self.density.size, 2.0 * self.averages)
        nu[[0, -1]] = self.averages
        power, tail = nu * self.density, 0.5 * (1.0 - confidence)
        return power / chdtri(nu, tail), power / chdtri(nu, 1.0 - tail)

    def rms(self, low_hz: float = 0.0, high_hz: float = np.inf) -> Estimate:
        """Return the rms of what lies between two frequencies.

        The root of the sum of G df over the lines between them; each line stands for half the
        distance to its neighbours. The interval is by chi-squared.

        Validity
        --------
        Gaussian noise. With the mean taken off each segment, what is slower than two lines is
        missing.

        Examples
        --------
        >>> noise = np.random.default_rng(1).normal(0.0, 3e-9, 50_000)
        >>> found = spectral_density(noise, 1e4, unit="m").rms(1e3, 3e3)
        >>> low, high = found.interval()
        >>> f"{found.value:.3e} m, {low:.3e} to {high:.3e}"
        '1.891e-09 m, 1.872e-09 to 1.911e-09'
        """
        f = self.frequency_hz
        inside = (f >= low_hz) & (f <= high_hz)
        if not inside.any():
            raise RecordError(
                f"there is no line from {low_hz:g} to {high_hz:g} Hz: lines are "
                f"{f[1]:g} Hz apart, up to {f[-1]:g} Hz"
            )
        g = self.density[inside] * f[1]
        power, squares = float(g.sum()), float(g @ g)
        rms = power**0.5
        if squares == 0.0:
            return Estimate(value=0.0, unit=self.unit)
        # degrees of freedom of a chi-squared variable with this mean and variance
        nu = max(2.0 * power**2 / squares * self.integral_averages, 1.0)
        return Estimate.of_deviation(rms, nu, self.unit)


def spectral_density(
    values: ArrayLike,
    sample_rate_hz: float,
    *,
    segment: int | None = None,
    resolution_hz: float | None = None,
    overlap: float | None = None,
    window: str | Array = "hann",
    detrend: bool = True,
    unit: str = "",
) -> SpectralDensity:
    """Return the single-sided power spectral density of a signal.

    G = 2 / (f_s sum w^2) mean abs(rfft(w x))^2, without the 2 at 0 and half the sample rate (Welch,
    1967, IEEE Transactions on Audio and Electroacoustics 15).

    Parameters
    ----------
    values : array_like
        Evenly spaced samples, shape (n,).
    sample_rate_hz : float
        Samples in a second [Hz].
    segment : int, optional
        Samples of a segment; a power of two up to 32768 with some 31 of them where not given.
    resolution_hz : float, optional
        Instead of it, the distance of lines [Hz].
    overlap : float, optional
        Share of a segment that the next one has too [1]; one half where not given, none without a
        window.
    window : str or numpy.ndarray
        ``hann``, ``hamming``, ``blackman``, ``boxcar``, or its values.
    detrend : bool
        Whether to take the mean off each segment.
    unit : str
        Unit of the samples.

    Returns
    -------
    SpectralDensity
        The density.

    Validity
    --------
    A signal that does not change its kind over the record. A line narrower than the resolution is
    spread over three lines by a Hann window, with its power kept.

    Raises
    ------
    RecordError
        A sample is not finite, or there are fewer than a segment.
    ModelError
        The options contradict each other, or the sample rate is not positive.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal(100_000)
    >>> found = spectral_density(noise, 1000.0, resolution_hz=5.0)
    >>> f"{found.density[1:-1].mean():.4f} 1/Hz, {found.segments} segments"
    '0.0020 1/Hz, 999 segments'
    """
    x = np.asarray(values, dtype=np.float64)
    if not 0.0 < sample_rate_hz < np.inf:
        raise ModelError(f"a sample rate is positive, got {sample_rate_hz!r} Hz")
    if x.ndim != 1:
        raise RecordError(f"a spectral density is that of one channel, got shape {x.shape}")
    length = segment_length((x.size,), sample_rate_hz, segment, resolution_hz)
    hop = hop_of(length, window, overlap)
    w = window_values(window, length)
    sums = SumOfSpectra(length // 2 + 1, 1, 0)
    count = add_segments(sums, (x,), w, hop, detrend=detrend)
    if not np.isfinite(sums.power).all():
        raise RecordError("a spectral density needs finite samples: correct those that are NaN")
    density = sums.power[0] * (2.0 / (sample_rate_hz * float(w @ w) * count))
    density[0] *= 0.5
    if length % 2 == 0:
        density[-1] *= 0.5
    return SpectralDensity(
        frequency_hz=line_frequencies(length, sample_rate_hz),
        density=density,
        segments=count,
        averages=effective_averages(w, hop, count),
        integral_averages=integral_averages(w, hop, count),
        unit=unit,
    )
