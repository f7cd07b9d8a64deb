"""Running sums of spectra over segments, in blocks that stay in the cache."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array, Complex
from flexstage.experiment.spectra.checks import COMPILED, Extremes

# samples that are transformed at a time: with their transforms they fit a second-level cache
_BLOCK = 131_072
# a window's own transform beyond this, relative to its largest, is rounding
_ROUNDING = 1e-15


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spectra:
    """Averaged single-sided spectra of inputs x and outputs y."""

    frequency_hz: Array
    """Frequencies [Hz], shape (k,)."""
    input_power: Complex
    """Mean of X X^H [input unit^2/Hz], shape (k, inputs, inputs)."""
    cross: Complex
    """Mean of Y X^H [output unit input unit/Hz], shape (k, outputs, inputs)."""
    output_power: Array
    """Mean of abs(Y)^2 [output unit^2/Hz], shape (k, outputs)."""
    segments: int
    """Number of segments, hits or periods."""
    averages: float
    """Number of independent averages that they are worth."""


def channel_pairs(inputs: int, outputs: int) -> NDArray[np.int64]:
    """Return which products of channels the estimates need, inputs before outputs.

    Numbers (y, x) of the products Y conj(X), shape (pairs, 2).
    """
    pairs = [(j, i) for j in range(inputs) for i in range(j)]
    pairs += [(inputs + o, i) for o in range(outputs) for i in range(inputs)]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


class SumOfSpectra:
    """Sums of squares and products of transforms, added to segment by segment.

    Inputs come first among the channels. From some millions of samples in all, the sums are
    compiled.
    """

    def __init__(self, lines: int, inputs: int, outputs: int, samples: int = 0) -> None:
        self.inputs, self.outputs = inputs, outputs
        self.pairs = channel_pairs(inputs, outputs)
        self.power = np.zeros((inputs + outputs, lines))
        self.real = np.zeros((len(self.pairs), lines))
        self.imaginary = np.zeros((len(self.pairs), lines))
        self.segments = 0
        self.compiled = samples >= COMPILED

    def add(self, transforms: Complex) -> None:
        """Add the transforms of some segments.

        They are contiguous along the lines, shape (channels, segments, lines).
        """
        self.segments += transforms.shape[1]
        parts = transforms.view(np.float64)
        if self.compiled:
            from flexstage.experiment.spectra.kernels import add_products

            add_products(parts, self.pairs, self.power, self.real, self.imaginary)
            return
        for c, z in enumerate(parts):
            self.power[c] += np.einsum("sk,sk->k", z, z).reshape(-1, 2).sum(axis=1)
        for p, (y, x) in enumerate(self.pairs):
            product = np.einsum("sk,sk->k", transforms[y], np.conj(transforms[x]))
            self.real[p] += product.real
            self.imaginary[p] += product.imag

    def matrices(self) -> tuple[Complex, Complex, Array]:
        """Return the sums of X X^H, Y X^H and abs(Y)^2.

        Shapes (k, inputs, inputs), (k, outputs, inputs) and (k, outputs).
        """
        lines = self.power.shape[1]
        xx = np.zeros((lines, self.inputs, self.inputs), dtype=np.complex128)
        yx = np.zeros((lines, self.outputs, self.inputs), dtype=np.complex128)
        for i in range(self.inputs):
            xx[:, i, i] = self.power[i]
        for p, (y, x) in enumerate(self.pairs):
            value = self.real[p] + 1j * self.imaginary[p]
            if y < self.inputs:
                xx[:, y, x], xx[:, x, y] = value, np.conj(value)
            else:
                yx[:, y - self.inputs, x] = value
        return xx, yx, np.ascontiguousarray(self.power[self.inputs :].T)


def add_segments(
    sums: SumOfSpectra,
    channels: Sequence[Array],
    window: Array,
    hop: int,
    *,
    detrend: bool = True,
    extremes: Sequence[Extremes] | None = None,
) -> int:
    """Add the windowed segments of one record to sums of spectra.

    The mean of a segment is taken off its transform: m times that of the window, which for a cosine
    window is a few lines, so that one pass through the samples is saved. Inputs come first among
    the channels; in `extremes` their least and greatest samples are noted, while they are at hand.
    Returned is the number of segments.
    """
    length = window.size
    count = (channels[0].size - length) // hop + 1
    # a library that transforms one row at a time plans anew for each
    rows = min(count, max(2, _BLOCK // length))
    of_window = np.fft.rfft(window)
    seen = np.abs(of_window) > _ROUNDING * np.abs(of_window).max()
    of_window = of_window[: int(np.flatnonzero(seen)[-1]) + 1]
    buffer, means = np.empty((rows, length)), np.empty(rows)
    transforms = np.empty((len(channels), rows, length // 2 + 1), dtype=np.complex128)
    # what is not finite shows in the sums, and is then named
    with np.errstate(invalid="ignore", over="ignore"):
        for first in range(0, count, rows):
            size = min(rows, count - first)
            # the last, smaller block gets arrays of its own, as rows must follow one another
            work = transforms if size == rows else np.empty_like(transforms[:, :size])
            for c, values in enumerate(channels):
                part = _Part(start=first * hop, stop=(first + size - 1) * hop + length, hop=hop)
                ends = _window(values, part, window, buffer[:size], means[:size], sums.compiled)
                np.fft.rfft(buffer[:size], axis=-1, out=work[c])
                if detrend:
                    work[c, :, : of_window.size] -= means[:size, None] * of_window
                if extremes is not None:
                    extremes[c].note(*ends, part.start, part.stop)
            sums.add(work)
    return count


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """Segments of a channel: first sample, the one behind the last, and from one to the next."""

    start: int
    stop: int
    hop: int


def _window(
    values: Array, part: _Part, window: Array, out: Array, means: Array, compiled: bool
) -> tuple[float, float]:
    """Put windowed segments and their means where they belong; least and greatest sample."""
    if compiled:
        from flexstage.experiment.spectra.kernels import windowed

        ends = np.empty(2)
        windowed(values, part.start, part.hop, window, out, means, ends)
        return float(ends[0]), float(ends[1])
    piece = values[part.start : part.stop]
    segments = np.lib.stride_tricks.sliding_window_view(piece, window.size)[:: part.hop]
    np.multiply(segments, window, out=out)
    means[:] = segments.mean(axis=1)
    return float(piece.min()), float(piece.max())
