"""Windows, averaged spectra of records, and the power spectral density of a signal."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.spectra.checks import Extremes, Signals, require_sound
from flexstage.measure.spectra.sums import Spectra, SumOfSpectra, add_segments
from flexstage.quantities.estimate import Estimate
from flexstage.records.sampling import require_complete

#: Windows by name, as coefficients a of sum (-1)^m a_m cos(2 pi m j / n).
WINDOWS: dict[str, tuple[float, ...]] = {
    "boxcar": (1.0,),
    "hann": (0.5, 0.5),
    "hamming": (0.54, 0.46),
    "blackman": (0.42, 0.5, 0.08),
}
# default number of half-overlapping segments of a record: twice this, minus one
_SEGMENTS = 16
# longest default segment, beyond which there are more lines but no better average
_LONGEST = 32_768
_SHORTEST = 8
# shorter segments widen peaks, which averaging does not correct: short records have longer and
# fewer segments, but at least this number
_RESOLVING, _FEWEST = 256, 4


def line_frequencies(length: int, sample_rate_hz: float) -> Array:
    """Return the frequencies of the lines of a transform [Hz], shape (length // 2 + 1,).

    Examples
    --------
    >>> line_frequencies(5, 100.0)
    array([ 0., 20., 40.])
    """
    return np.arange(length // 2 + 1, dtype=np.float64) * (sample_rate_hz / length)


def window_values(window: str | Array, length: int) -> Array:
    """Return the values of a window, periodic for the discrete transform.

    w_j = sum_m (-1)^m a_m cos(2 pi m j / n) (Harris, 1978, Proceedings of the IEEE 66). `window` is
    one of `WINDOWS`, or the values themselves.

    Examples
    --------
    >>> window_values("hann", 4)
    array([0. , 0.5, 1. , 0.5])
    """
    if isinstance(window, str):
        if window not in WINDOWS:
            raise ModelError(
                f"the window must be one of {', '.join(WINDOWS)}, or an array of values, got "
                f"'{window}'"
            )
        angle = 2.0 * math.pi * np.arange(length) / length
        terms = ((-1) ** m * a * np.cos(m * angle) for m, a in enumerate(WINDOWS[window]))
        return np.sum(list(terms), axis=0)
    values = np.asarray(window, dtype=np.float64)
    if values.shape != (length,) or not np.isfinite(values).all() or not np.any(values):
        raise ModelError(
            f"a window for segments of {length} samples needs {length} finite values, not all 0, "
            f"got shape {values.shape}"
        )
    return values


def window_blur(window: Array) -> float:
    r"""Return the smearing of neighbouring lines of noise spectra by a window.

    A line is the mean of the response over its neighbours, weighted by the power of the window's
    transform, whose second moment is :math:`(n/2\pi)^2 \sum (w_{j+1}-w_j)^2 / \sum w_j^2` by
    Parseval's theorem. In squares of the line spacing [1]; 0 without a window.

    Examples
    --------
    >>> round(window_blur(window_values("hann", 4096)), 4)
    0.3333
    """
    steps = np.diff(window, append=window[:1])
    return (window.size / (2.0 * math.pi)) ** 2 * float(steps @ steps) / float(window @ window)


def effective_averages(window: Array, hop: int, segments: int) -> float:
    """Return the effective number of independent segments at one line.

    n / (1 + 2 sum_k (1 - k/n) r_k^2), r_k = sum_j w_j w_(j + k hop) / sum w^2 (Welch, 1967, IEEE
    Transactions on Audio and Electroacoustics 15). The hop is in samples from the start of one
    segment to that of the next.

    Validity
    --------
    A density with little change over the width of a line, and Gaussian noise.

    Examples
    --------
    >>> round(effective_averages(window_values("hann", 64), 32, 100), 1)
    94.8
    """
    return segments / _overlap_sum(window, window, hop, segments, 2)


def integral_averages(window: Array, hop: int, segments: int) -> float:
    """Return the effective number of independent values of each line in sums over lines.

    Neighbouring lines of a windowed segment are correlated. Summed over all their distances, the
    squared correlation is n sum_j w_j^2 w_(j + k hop)^2 / (sum w^2)^2 by Parseval's theorem, which
    takes the place of r_k^2 in `effective_averages`.

    Examples
    --------
    >>> w = window_values("boxcar", 64)
    >>> integral_averages(w, 64, 7), round(integral_averages(window_values("hann", 64), 32, 7), 2)
    (7.0, 3.35)
    """
    squares = window**2
    first = window.size * float(squares @ squares) / float(np.sum(squares)) ** 2
    return segments / (first * _overlap_sum(squares, squares, hop, segments, 1))


def _overlap_sum(a: Array, b: Array, hop: int, segments: int, power: int) -> float:
    """1 + 2 sum_k (1 - k / n) r_k^power, with r_k the overlap of a and b moved by k hops."""
    full = float(a @ b)
    total = 1.0
    for k in range(1, min(segments, -(-a.size // hop))):
        overlap = float(a[k * hop :] @ b[: a.size - k * hop]) / full
        total += 2.0 * (1.0 - k / segments) * overlap**power
    return total


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SegmentSpectra:
    """Averages over segments of records, and rejected segments."""

    spectra: Spectra
    """The averages."""
    segment: int
    """Samples of a segment."""
    rejected: tuple[str, ...] = ()
    """Rejected segments, with reasons."""
    added_damping_rate: float = 0.0
    """Decay rate that an exponential window adds to every mode [1/s]."""


def segment_length(
    sizes: tuple[int, ...],
    sample_rate_hz: float,
    segment: int | None,
    resolution_hz: float | None,
    *,
    resolving: bool = False,
) -> int:
    """Return the samples of a segment.

    The default is a power of two, up to 32768, with about 31 half-overlapping segments. If peaks
    must be resolved, records of 1024 to 4096 samples have segments of 256, and shorter ones of at
    most a quarter.
    """
    if segment is not None and resolution_hz is not None:
        raise ModelError("give the samples of a segment or the resolution, not both")
    if resolution_hz is not None:
        if not 0.0 < resolution_hz < math.inf:
            raise ModelError(f"the resolution must be positive, got {resolution_hz!r} Hz")
        length = round(sample_rate_hz / resolution_hz)
    elif segment is not None:
        length = segment
    else:
        most = sum(sizes) // _SEGMENTS
        if resolving and most >= _SHORTEST:
            most = max(most, min(_RESOLVING, sum(sizes) // _FEWEST))
        most = min(most, *sizes)
        length = min(2 ** int(math.log2(max(most, 1))), _LONGEST)
        if length < _SHORTEST:
            raise RecordError(
                f"a record of {min(sizes)} samples is too short for a frequency response by "
                f"averaging: give {_SEGMENTS * _SHORTEST} samples or more"
            )
    if length < _SHORTEST:
        raise ModelError(
            f"a segment must have at least {_SHORTEST} samples, got {length}: at "
            f"{sample_rate_hz:g} Hz the coarsest resolution is {sample_rate_hz / _SHORTEST:g} Hz"
        )
    if length > min(sizes):
        raise RecordError(
            f"a segment of {length} samples is longer than the record of {min(sizes)}: use a "
            "coarser resolution, or record longer"
        )
    return length


def hop_of(length: int, window: str | Array, overlap: float | None) -> int:
    """Return the samples from one segment to the next; half a segment by default.

    Without a window, segments do not overlap by default.
    """
    if overlap is None:
        overlap = 0.0 if isinstance(window, str) and window == "boxcar" else 0.5
    if not 0.0 <= overlap < 1.0:
        raise ModelError(f"the overlap must be from 0 to less than 1, got {overlap!r}")
    return max(length - int(overlap * length), 1)


def single_sided(
    sums: SumOfSpectra, frequency_hz: Array, scale: float, averages: float, signals: Signals
) -> Spectra:
    """Return single-sided densities from sums.

    `scale` is the factor from a mean square to a density [s].
    """
    if not np.isfinite(sums.power).all():
        for row in signals.channels:
            for values, name in zip(row, signals.names, strict=True):
                require_complete(values, name)
        raise RecordError("the samples are so large that their squares overflow: use SI units")
    factor = scale / sums.segments
    xx, yx, yy = sums.matrices()
    return Spectra(
        frequency_hz=frequency_hz,
        input_power=factor * xx,
        cross=factor * yx,
        output_power=factor * yy,
        segments=sums.segments,
        averages=averages,
    )


def welch_spectra(
    signals: Signals, length: int, window: str | Array, hop: int, *, allow_clipped: bool = False
) -> Spectra:
    """Return averages over overlapping windowed segments, with their means subtracted.

    Welch, 1967, IEEE Transactions on Audio and Electroacoustics 15. The hop is in samples;
    `allow_clipped` lets a channel rest at its ends.
    """
    w = window_values(window, length)
    fs = signals.sample_rate_hz
    counts = [(n - length) // hop + 1 for n in signals.sizes]
    sums = SumOfSpectra(length // 2 + 1, signals.inputs, signals.outputs)
    extremes = []
    for row in signals.channels:
        ends = [Extremes() for _ in row]
        add_segments(sums, row, w, hop, extremes=ends)
        extremes.append(ends)
    require_sound(signals, extremes, allow_clipped=allow_clipped)
    averages = sum(effective_averages(w, hop, count) for count in counts)
    scale = 2.0 / (fs * float(w @ w))
    return single_sided(sums, line_frequencies(length, fs), scale, averages, signals)


def whole_spectra(signals: Signals) -> Spectra:
    """Return averages over whole records, as of one sweep each."""
    if len(set(signals.sizes)) > 1:
        raise RecordError(
            f"averaged sweeps need records of equal length, got {signals.sizes} samples"
        )
    length = signals.sizes[0]
    window = np.ones(length)
    sums = SumOfSpectra(length // 2 + 1, signals.inputs, signals.outputs)
    for row in signals.channels:
        add_segments(sums, row, window, length)
    fs = signals.sample_rate_hz
    lines = line_frequencies(length, fs)
    return single_sided(sums, lines, 2.0 / (fs * length), float(sums.segments), signals)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpectralDensity:
    """Single-sided power spectral density."""

    frequency_hz: Array
    """Frequencies, from 0 to half the sample rate [Hz], shape (k,)."""
    density: Array
    """Power per hertz [unit^2/Hz], shape (k,)."""
    segments: int
    """Number of segments."""
    averages: float
    """Number of independent averages at one frequency."""
    integral_averages: float
    """Effective number of independent values of each frequency in sums over frequencies."""
    unit: str = ""
    """Unit of the signal."""

    def bounds(self, confidence: float = 0.95) -> tuple[Array, Array]:
        """Return the confidence interval of the density at each frequency.

        2 n G' / G is distributed as chi-squared of 2 n degrees of freedom (Bendat and Piersol,
        Random Data, 4th edition, chapter 8), of half as many at 0 and half the sample rate. In
        unit^2/Hz, shape (k,) each.
        """
        from scipy.special import chdtri

        if not 0.0 < confidence < 1.0:
            raise ModelError(f"the confidence must be between 0 and 1, got {confidence!r}")
        nu = np.full(self.density.size, 2.0 * self.averages)
        nu[[0, -1]] = self.averages
        power, tail = nu * self.density, 0.5 * (1.0 - confidence)
        return power / chdtri(nu, tail), power / chdtri(nu, 1.0 - tail)

    def rms(self, low_hz: float = 0.0, high_hz: float = np.inf) -> Estimate:
        """Return the rms between two frequencies.

        It is the root of the sum of G df over the lines between them; each line extends half the
        distance to its neighbours. The interval is from chi-squared.

        Validity
        --------
        Gaussian noise. As the mean of each segment is subtracted, content below the frequency of
        the second line is missing.

        Examples
        --------
        >>> noise = np.random.default_rng(1).normal(0.0, 3e-9, 50_000)
        >>> rms = spectral_density(noise, 1e4, unit="m").rms(1e3, 3e3)
        >>> low, high = rms.interval()
        >>> f"{rms.value:.3e} m, {low:.3e} to {high:.3e}"
        '1.891e-09 m, 1.872e-09 to 1.911e-09'
        """
        f = self.frequency_hz
        inside = (f >= low_hz) & (f <= high_hz)
        if not inside.any():
            raise RecordError(
                f"there is no line from {low_hz:g} to {high_hz:g} Hz: the lines are {f[1]:g} Hz "
                f"apart, up to {f[-1]:g} Hz"
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
        Sample rate [Hz].
    segment : int, optional
        Samples of a segment; by default a power of two up to 32768 with about 31 segments.
    resolution_hz : float, optional
        Instead of a segment, the frequency resolution [Hz].
    overlap : float, optional
        Overlap of segments, as a share of their length [1]; one half if not given, none without a
        window.
    window : str or numpy.ndarray
        ``hann``, ``hamming``, ``blackman``, ``boxcar``, or its values.
    detrend : bool
        Whether to subtract the mean of each segment.
    unit : str
        Unit of the samples.

    Returns
    -------
    SpectralDensity
        The density.

    Validity
    --------
    A stationary signal. A Hann window spreads a spectral line narrower than the resolution over
    three lines, and preserves its power.

    Raises
    ------
    RecordError
        A sample is not finite, or there are fewer than a segment.
    ModelError
        The options contradict each other, or the sample rate is not positive.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal(100_000)
    >>> psd = spectral_density(noise, 1000.0, resolution_hz=5.0)
    >>> f"{psd.density[1:-1].mean():.4f} 1/Hz, {psd.segments} segments"
    '0.0020 1/Hz, 999 segments'
    """
    x = np.asarray(values, dtype=np.float64)
    if not 0.0 < sample_rate_hz < np.inf:
        raise ModelError(f"the sample rate must be positive, got {sample_rate_hz!r} Hz")
    if x.ndim != 1:
        raise RecordError(f"a spectral density needs one channel, got shape {x.shape}")
    length = segment_length((x.size,), sample_rate_hz, segment, resolution_hz)
    hop = hop_of(length, window, overlap)
    w = window_values(window, length)
    sums = SumOfSpectra(length // 2 + 1, 1, 0)
    count = add_segments(sums, (x,), w, hop, detrend=detrend)
    if not np.isfinite(sums.power).all():
        raise RecordError("a spectral density needs finite samples: correct or remove the others")
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
