"""Spectral density of a reading, and the mains lines in it."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.errors import ModelError, RecordError
from flexstage.estimate import Component, Estimate

__all__ = ["MainsLine", "Spectrum", "mains_lines", "spectral_density"]

Array = NDArray[np.float64]

#: Share by which the mains frequency strays, and at which a line counts as a multiple of it.
_STRAY = 0.004
#: Chance that noise alone gives a line.
_FALSE = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spectrum:
    """One-sided spectral density of a reading.

    Parameters
    ----------
    frequency_hz : numpy.ndarray
        Frequencies [Hz], shape (k,).
    density : numpy.ndarray
        Power in each hertz, unit of the reading squared over Hz, shape (k,).
    low, high : numpy.ndarray
        Ends of its 95 % interval, shape (k,).
    degrees_of_freedom : float
        Of each value between 0 and half the sample rate.
    unit : str
        Unit of the reading.
    """

    frequency_hz: Array
    density: Array
    low: Array
    high: Array
    degrees_of_freedom: float
    unit: str

    def rms(self, low_hz: float, high_hz: float) -> float:
        """Return the rms in a band.

        Parameters
        ----------
        low_hz, high_hz : float
            Ends of the band [Hz].

        Returns
        -------
        float
            The rms, in the unit of the reading.
        """
        inside = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        return math.sqrt(float(self.density[inside].sum()) * float(self.frequency_hz[1]))


@dataclass(frozen=True, slots=True, kw_only=True)
class MainsLine:
    """A line at the mains frequency or a multiple of it.

    Parameters
    ----------
    frequency_hz : float
        Where it is [Hz].
    mains_hz : int
        The mains: 50 or 60.
    multiple : int
        Which multiple of it.
    rms : Estimate
        Its rms, in the unit of the reading.
    """

    frequency_hz: float
    mains_hz: int
    multiple: int
    rms: Estimate


def spectral_density(
    values: ArrayLike, sample_rate_hz: float, *, segment: int | None = None, unit: str = "m"
) -> Spectrum:
    """Return the one-sided spectral density by averaged segments with Hann windows.

    Segments overlap by half and have their mean taken off (Welch, 1967, IEEE Transactions on Audio
    and Electroacoustics 15). The degrees of freedom follow from how the overlapping windows
    correlate (Percival and Walden, 1993, Spectral Analysis for Physical Applications, 6.17):
    ``2 K / (1 + 2 sum (1 - m/K) r_m^2)`` with r_1 = 1/6 for half overlap.

    Parameters
    ----------
    values : array_like
        Evenly spaced readings, shape (n,).
    sample_rate_hz : float
        Readings in a second [Hz].
    segment : int, optional
        Samples in a segment; an eighth of the record or 65 536, whichever is less, where not given.
    unit : str
        Unit of the readings.

    Returns
    -------
    Spectrum
        Density with its interval.

    Validity
    --------
    Frequencies of several over the length of a segment; narrower features are smeared over 1.5 of
    its lines. Whatever lies above half the sample rate is folded in.

    Raises
    ------
    RecordError
        There are fewer than sixteen readings, or one is not finite.
    ModelError
        The rate is not positive, or a segment has fewer than eight samples or more than there are.

    Examples
    --------
    >>> noise = 3e-9 * np.random.default_rng(4).standard_normal(40_000)
    >>> found = spectral_density(noise, 1000.0)
    >>> print(f"{1e9 * found.rms(0.0, 500.0):.2f} nm")
    3.00 nm
    """
    from scipy.signal import welch
    from scipy.special import gammaincinv

    y = np.asarray(values, dtype=np.float64)
    if y.ndim != 1 or y.size < 16 or not np.isfinite(y).all():
        raise RecordError(f"a spectrum needs sixteen finite readings or more, got {y.shape}")
    if not 0.0 < sample_rate_hz < math.inf:
        raise ModelError(f"the sample rate must be positive, got {sample_rate_hz!r} Hz")
    length = max(min(y.size // 8, 65_536), 8) if segment is None else segment
    if not 8 <= length <= y.size:
        raise ModelError(f"a segment has 8 to {y.size} of the samples, got {length}")
    length -= length % 2
    f, density = welch(y, fs=sample_rate_hz, window="hann", nperseg=length, detrend="constant")
    count = (y.size - length // 2) // (length // 2)
    freedom = 2.0 * count / (1.0 + 2.0 * (1.0 - 1.0 / count) / 36.0)
    own = np.full(f.size, freedom)
    # at 0 and half the sample rate the value is a square of one number, not of two
    own[[0, -1]] = 0.5 * freedom
    return Spectrum(
        frequency_hz=f,
        density=density,
        low=density * own / (2.0 * gammaincinv(0.5 * own, 0.975)),
        high=density * own / (2.0 * gammaincinv(0.5 * own, 0.025)),
        degrees_of_freedom=freedom,
        unit=unit,
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
    found = {mains: _multiples(y, power, sample_rate_hz, mains, unit) for mains in (50, 60)}
    best = max(found.values(), key=lambda lines: sum(line.rms.value**2 for line in lines))
    return tuple(best)


def _multiples(y: Array, power: Array, rate: float, mains: int, unit: str) -> list[MainsLine]:
    n, lines = y.size, []
    for k in range(1, int(0.498 * rate / mains) + 1):
        at = k * mains * n / rate
        reach = max(int(_STRAY * at), 2)
        low, high = max(int(at) - reach, 1), min(int(at) + reach + 2, power.size)
        wide = max(8 * reach, 60)
        around = np.concatenate([power[max(low - wide, 1) : low], power[high : high + wide]])
        if high - low < 3 or around.size < 40:
            continue
        floor = float(np.median(around)) / math.log(2.0)
        peak = low + int(np.argmax(power[low:high]))
        if power[peak] > floor * math.log((high - low) / _FALSE):
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
    noise = Component(
        name="noise about the line",
        uncertainty=uncertainty / math.sqrt(2.0),
        degrees_of_freedom=2.0 * len(near),
    )
    rms = Estimate(value=abs(amplitude) / math.sqrt(2.0), unit=unit, components=(noise,))
    return MainsLine(frequency_hz=f, mains_hz=mains, multiple=k, rms=rms)
