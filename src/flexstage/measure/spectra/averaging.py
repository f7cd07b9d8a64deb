"""Windows, and averaged spectra of records of random, or of a single long, excitation."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError, RecordError
from flexstage.measure.spectra.checks import Extremes, Signals, require_sound
from flexstage.measure.spectra.sums import Spectra, SumOfSpectra, add_segments
from flexstage.records.sampling import require_complete

#: Windows by name, as coefficients a of sum (-1)^m a_m cos(2 pi m j / n).
WINDOWS: dict[str, tuple[float, ...]] = {
    "boxcar": (1.0,),
    "hann": (0.5, 0.5),
    "hamming": (0.54, 0.46),
    "blackman": (0.42, 0.5, 0.08),
}
# segments, half overlapping, that a record is cut into where nothing is asked: twice this, less one
_SEGMENTS = 16
# and the longest of them, beyond which lines become many and the average no better
_LONGEST = 32_768
_SHORTEST = 8
# segments of fewer samples make peaks wide, which a longer average does not mend: short records
# are cut into longer segments, but into no fewer than this
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
    """Return the values of a window, periodic as the discrete transform sees it.

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
                f"there is no window '{window}': choose one of {', '.join(WINDOWS)}, or give its "
                "values"
            )
        angle = 2.0 * math.pi * np.arange(length) / length
        terms = ((-1) ** m * a * np.cos(m * angle) for m, a in enumerate(WINDOWS[window]))
        return np.sum(list(terms), axis=0)
    values = np.asarray(window, dtype=np.float64)
    if values.shape != (length,) or not np.isfinite(values).all() or not np.any(values):
        raise ModelError(
            f"a window for segments of {length} samples needs as many finite values, not all 0, "
            f"got shape {values.shape}"
        )
    return values


def window_blur(window: Array) -> float:
    r"""Return how far a window mixes neighbouring lines of spectra of noise.

    A line is the mean of the response over its neighbours, weighted by the power of the window's
    transform, whose second moment is :math:`(n/2\pi)^2 \sum (w_{j+1}-w_j)^2 / \sum w_j^2` by
    Parseval's theorem. In squares of the distance of lines [1]; 0 of no window, whose kernel has
    none.

    Examples
    --------
    >>> round(window_blur(window_values("hann", 4096)), 4)
    0.3333
    """
    steps = np.diff(window, append=window[:1])
    return (window.size / (2.0 * math.pi)) ** 2 * float(steps @ steps) / float(window @ window)


def effective_averages(window: Array, hop: int, segments: int) -> float:
    """Return how many independent segments overlapping ones are worth at one line.

    n / (1 + 2 sum_k (1 - k/n) r_k^2), r_k = sum_j w_j w_(j + k hop) / sum w^2 (Welch, 1967, IEEE
    Transactions on Audio and Electroacoustics 15). The hop is in samples from the start of one
    segment to that of the next.

    Validity
    --------
    A density that changes little over the width of a line, and Gaussian noise.

    Examples
    --------
    >>> round(effective_averages(window_values("hann", 64), 32, 100), 1)
    94.8
    """
    return segments / _overlap_sum(window, window, hop, segments, 2)


def integral_averages(window: Array, hop: int, segments: int) -> float:
    """Return how many independent values each line is worth where lines are added up.

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
    whole = float(a @ b)
    total = 1.0
    for k in range(1, min(segments, -(-a.size // hop))):
        overlap = float(a[k * hop :] @ b[: a.size - k * hop]) / whole
        total += 2.0 * (1.0 - k / segments) * overlap**power
    return total


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CutSpectra:
    """Averages over parts of records, and what was left out of them."""

    spectra: Spectra
    """The averages."""
    segment: int
    """Samples of a part."""
    left_out: tuple[str, ...] = ()
    """Which parts were left out, and why."""
    added_damping_rate: float = 0.0
    """Rate by which an exponential window makes every motion decay faster [1/s]."""


def segment_length(
    sizes: tuple[int, ...],
    sample_rate_hz: float,
    segment: int | None,
    resolution_hz: float | None,
    *,
    resolving: bool = False,
) -> int:
    """Return the samples of a segment.

    A power of two, up to 32768, that leaves some 31 half overlapping segments, where neither it nor
    the distance of lines [Hz] is asked. Where peaks are to be resolved, records of 1024 to 4096
    samples have segments of 256, and shorter ones of at most a quarter.
    """
    if segment is not None and resolution_hz is not None:
        raise ModelError("ask for the samples of a segment or for the resolution, not for both")
    if resolution_hz is not None:
        if not 0.0 < resolution_hz < math.inf:
            raise ModelError(f"a resolution is positive, got {resolution_hz!r} Hz")
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
            f"a segment has {_SHORTEST} samples or more, got {length}: at {sample_rate_hz:g} Hz "
            f"the resolution is {sample_rate_hz / _SHORTEST:g} Hz at the coarsest"
        )
    if length > min(sizes):
        raise RecordError(
            f"a segment of {length} samples is longer than the record of {min(sizes)}: take a "
            "coarser resolution, or record longer"
        )
    return length


def hop_of(length: int, window: str | Array, overlap: float | None) -> int:
    """Return the samples from one segment to the next; half one where no overlap is asked.

    Without a window segments do not overlap unless asked.
    """
    if overlap is None:
        overlap = 0.0 if isinstance(window, str) and window == "boxcar" else 0.5
    if not 0.0 <= overlap < 1.0:
        raise ModelError(f"an overlap is a share from 0 to less than 1, got {overlap!r}")
    return max(length - int(overlap * length), 1)


def finished(
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
    """Return averages over overlapping windowed segments, less their means.

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
    return finished(sums, line_frequencies(length, fs), scale, averages, signals)


def whole_spectra(signals: Signals) -> Spectra:
    """Return averages over whole records, as of one sweep each."""
    if len(set(signals.sizes)) > 1:
        raise RecordError(
            f"sweeps that are averaged need records of one length, got {signals.sizes} samples"
        )
    length = signals.sizes[0]
    window = np.ones(length)
    sums = SumOfSpectra(length // 2 + 1, signals.inputs, signals.outputs)
    for row in signals.channels:
        add_segments(sums, row, window, length)
    fs = signals.sample_rate_hz
    lines = line_frequencies(length, fs)
    return finished(sums, lines, 2.0 / (fs * length), float(sums.segments), signals)
