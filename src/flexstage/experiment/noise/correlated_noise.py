"""Noise whose neighbours hang together: how uncertain its mean, its drift and its rms are."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array

_MOST_BLOCKS, _LEAST_BLOCKS = 32, 8
#: Autocorrelation of the means of neighbouring blocks above which blocks are made longer.
_CORRELATED = 0.1


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
    while True:
        length = values.size // count
        # what does not fill a block is left out at the start, which has more to settle
        z = values[values.size - count * length :].reshape(count, length).mean(axis=1)
        t = np.arange(count) - 0.5 * (count - 1)
        slope = float(t @ z / (t @ t))
        rest = z - z.mean() - slope * t
        power = float(rest @ rest)
        # two of the degrees of freedom went with the line, which makes neighbours look opposed
        linked = float(rest[1:] @ rest[:-1]) / power + 2.0 / count if power > 0.0 else 0.0
        if linked < max(_CORRELATED, 1.0 / math.sqrt(count)) or count <= _LEAST_BLOCKS:
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
        correlated=linked >= 3.0 * _CORRELATED,
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
