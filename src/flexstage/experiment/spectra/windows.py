"""Windows, and how many independent averages overlapping segments are worth."""

import math

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError

#: Windows by name, as coefficients a of sum (-1)^m a_m cos(2 pi m j / n).
WINDOWS: dict[str, tuple[float, ...]] = {
    "boxcar": (1.0,),
    "hann": (0.5, 0.5),
    "hamming": (0.54, 0.46),
    "blackman": (0.42, 0.5, 0.08),
}


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
