"""Sums of spectra over segments, and the frequency responses H1, H2 and Hv from them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.spectra.checks import Extremes

Estimator = Literal["H1", "H2", "Hv"]


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
    """Effective number of independent averages."""


def channel_pairs(inputs: int, outputs: int) -> NDArray[np.int64]:
    """Return the products of channels that the estimates need, inputs before outputs.

    Numbers (y, x) of the products Y conj(X), shape (pairs, 2).
    """
    pairs = [(j, i) for j in range(inputs) for i in range(j)]
    pairs += [(inputs + o, i) for o in range(outputs) for i in range(inputs)]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


class SumOfSpectra:
    """Sums of squares and products of transforms, added to segment by segment.

    Inputs come first among the channels.
    """

    def __init__(self, lines: int, inputs: int, outputs: int) -> None:
        self.inputs, self.outputs = inputs, outputs
        self.pairs = channel_pairs(inputs, outputs)
        self.products = np.zeros((len(self.pairs), lines), dtype=np.complex128)
        self.segments = 0
        # alternating real and imaginary parts, which are combined after the sums
        self._squares = np.zeros((inputs + outputs, 2 * lines))

    @property
    def power(self) -> Array:
        """Sums of abs(X)^2, shape (channels, lines)."""
        with np.errstate(over="ignore"):
            return self._squares[:, ::2] + self._squares[:, 1::2]

    def add(self, transforms: Complex) -> None:
        """Add the transforms of some segments.

        They are contiguous along the lines, shape (channels, segments, lines).
        """
        self.segments += transforms.shape[1]
        # values that are not finite appear in the sums and are reported there
        with np.errstate(invalid="ignore", over="ignore"):
            for c, z in enumerate(transforms.view(np.float64)):
                self._squares[c] += np.einsum("sk,sk->k", z, z)
            product = np.empty_like(transforms[0])
            for p, (y, x) in enumerate(self.pairs):
                np.conjugate(transforms[x], out=product)
                product *= transforms[y]
                self.products[p] += product.sum(axis=0)

    def matrices(self) -> tuple[Complex, Complex, Array]:
        """Return the sums of X X^H, Y X^H and abs(Y)^2.

        Shapes (k, inputs, inputs), (k, outputs, inputs) and (k, outputs).
        """
        power = self.power
        lines = power.shape[1]
        xx = np.zeros((lines, self.inputs, self.inputs), dtype=np.complex128)
        yx = np.zeros((lines, self.outputs, self.inputs), dtype=np.complex128)
        for i in range(self.inputs):
            xx[:, i, i] = power[i]
        for p, (y, x) in enumerate(self.pairs):
            value = self.products[p]
            if y < self.inputs:
                xx[:, y, x], xx[:, x, y] = value, np.conj(value)
            else:
                yx[:, y - self.inputs, x] = value
        return xx, yx, np.ascontiguousarray(power[self.inputs :].T)


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

    The mean of a segment is subtracted from its transform, as the mean times the transform of the
    window, which for a cosine window is a few lines. Inputs come first among the channels; their
    minima and maxima are noted in `extremes`. The function returns the number of segments.
    """
    length = window.size
    count = (channels[0].size - length) // hop + 1
    # samples per block: with their transforms they fit in a second-level cache
    block = 131_072
    # the transform of several rows at once has one plan
    rows = min(count, max(2, block // length))
    of_window = np.fft.rfft(window)
    # lines of the window's transform below this, relative to its largest, are rounding errors
    rounding = 1e-15
    significant = np.abs(of_window) > rounding * np.abs(of_window).max()
    of_window = of_window[: int(np.flatnonzero(significant)[-1]) + 1]
    buffer = np.empty((rows, length))
    transforms = np.empty((len(channels), rows, length // 2 + 1), dtype=np.complex128)
    with np.errstate(invalid="ignore", over="ignore"):
        for first in range(0, count, rows):
            size = min(rows, count - first)
            start, stop = first * hop, (first + size - 1) * hop + length
            # the last, smaller block has its own arrays, as rows must be contiguous
            work = transforms if size == rows else np.empty_like(transforms[:, :size])
            for c, values in enumerate(channels):
                # all reading of the samples while they are in the cache
                if extremes is not None:
                    extremes[c].update(values, start, stop)
                segments = sliding_window_view(values[start:stop], length)[::hop]
                means = segments.mean(axis=1, keepdims=True)
                np.multiply(segments, window, out=buffer[:size])
                np.fft.rfft(buffer[:size], axis=-1, out=work[c])
                if detrend:
                    work[c, :, : of_window.size] -= means * of_window
            sums.add(work)
    return count


def require_estimator(estimator: str, inputs: int, noise_ratio: float | None) -> None:
    """Refuse an unknown or unsuitable estimator."""
    if estimator not in get_args(Estimator):
        raise ModelError(f"the estimator must be H1, H2 or Hv, got {estimator!r}")
    if estimator == "H2" and inputs > 1:
        raise ModelError("H2 is defined for one input: use H1 or Hv for several")
    if noise_ratio is not None and not (estimator == "Hv" and 0.0 < noise_ratio < np.inf):
        raise ModelError(
            f"the ratio of noise powers must be positive and is for Hv only, got {noise_ratio!r} "
            f"for {estimator}"
        )


def transfer(
    spectra: Spectra, estimator: Estimator = "H1", noise_ratio: float | None = None
) -> tuple[Complex, Array | None, Array | None]:
    """Return responses, their variance and the coherence.

    H1 = G_yx G_xx^-1, H2 = G_yy / G_xy. Hv is the total least-squares solution, with noise on both
    sides: (x, y) scaled to unit power, or to the given noise, is orthogonal to the eigenvector of
    the least eigenvalue of their spectral matrix (Rocklin, Crowley and Vold, 1985, 3rd
    International Modal Analysis Conference). With one input and unit power it is sqrt(H1 H2) with
    the phase of H1.

    With n independent averages and q inputs, the residual of an output has the density (1 -
    coherence) G_yy n / (n - q), and the variance of H1 is that times (G_xx^-1)_ii / n, as of any
    least-squares estimate; with one input (1 - coherence) abs(H)^2 / (coherence (n - 1)), twice the
    square of the random error of the magnitude (Bendat and Piersol, Random Data, 4th edition,
    chapter 9) except for the degree of freedom. That of H2 is the same share of abs(H)^2, that of
    the geometric mean Hv is (1 + coherence) / 2 times it. `noise_ratio` is for Hv: noise power of
    an output over that of an input [(output unit/input unit)^2]; if not given, noise has the same
    share of the power of each. Response and variance, the expected square of the error of each
    complex value, have shape (k, outputs, inputs); the coherence, with several inputs the multiple
    one, has shape (k, outputs). Variance needs more averages than inputs.

    Validity
    --------
    The variance is about the expectation of the estimate. It excludes bias by noise on the side
    that the estimator assumes to be free of noise, and by lines wider than a resonance.
    """
    q = spectra.input_power.shape[1]
    xx, yx, yy = spectra.input_power, spectra.cross, spectra.output_power
    inverse = _inverse(xx) if q > 1 else 1.0 / xx
    h1 = yx @ inverse
    explained = np.einsum("koi,koi->ko", h1, np.conj(yx)).real
    coherence = np.divide(explained, yy, out=np.zeros_like(yy), where=yy > 0.0)
    coherence = np.clip(coherence, 0.0, 1.0)
    response = h1
    if estimator == "H2" or (estimator == "Hv" and q == 1):
        response = _one_input(
            h1, xx[:, :, 0].real, yx[:, :, 0], yy, coherence, estimator, noise_ratio
        )
    elif estimator == "Hv":
        response = _smallest(xx, yx, yy, noise_ratio)
    n = spectra.averages
    if n <= q:
        return response, None, None
    unexplained = np.maximum(yy - explained, 0.0) / (n - q)
    variance = unexplained[:, :, None] * np.einsum("kii->ki", inverse).real[:, None, :]
    if q == 1 and estimator != "H1":
        # the share of the power, which is the same for H1 and H2
        factor = 0.5 * (1.0 + coherence) if estimator == "Hv" and noise_ratio is None else 1.0
        h1_power = np.abs(h1[:, :, 0]) ** 2
        share = np.abs(response[:, :, 0]) ** 2
        share = np.divide(share, h1_power, out=np.ones_like(h1_power), where=h1_power > 0.0)
        variance = variance * (factor * share)[:, :, None]
    return response, variance, coherence


def _one_input(
    h1: Complex,
    xx: Array,
    yx: Complex,
    yy: Array,
    coherence: Array,
    estimator: Estimator,
    noise_ratio: float | None,
) -> Complex:
    """Return H2 or Hv for one input."""
    if np.any(coherence == 0.0):
        raise RecordError(
            f"{estimator} is undefined where the coherence of input and output is zero: use H1, or "
            "a band in which the input excites"
        )
    h = h1[:, :, 0]
    if estimator == "H2":
        return (h / coherence)[:, :, None]
    if noise_ratio is None:
        return (h / np.sqrt(coherence))[:, :, None]
    # the larger root of the quadratic, in the form that does not cancel
    b = yy - noise_ratio * xx
    root = np.sqrt(b**2 + 4.0 * noise_ratio * np.abs(yx) ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.where(
            b >= 0.0, (b + root) / (2.0 * np.conj(yx)), 2.0 * noise_ratio * yx / (root - b)
        )
    return value[:, :, None]


def _inverse(xx: Complex) -> Complex:
    """Return the inverse of the spectral matrices of the inputs, after a check of correlation."""
    power = np.einsum("kii->ki", xx).real
    scale = 1.0 / np.sqrt(power)
    coherence = xx * scale[:, :, None] * scale[:, None, :]
    if np.linalg.eigvalsh(coherence)[:, 0].min() < 1e-12:
        raise _correlated(None, 1.0)
    inverse = np.linalg.inv(coherence)
    # 1 - 1 / (R^-1)_ii is the share of input i that the others explain
    shared = 1.0 - 1.0 / np.einsum("kii->ki", inverse).real
    worst = np.median(shared, axis=0)
    # largest share of an input that the others may explain, at the median line
    correlated = 0.98
    if worst.max() > correlated:
        raise _correlated(int(worst.argmax()), float(worst.max()))
    return inverse * scale[:, :, None] * scale[:, None, :]


def _correlated(number: int | None, share: float) -> RecordError:
    which = "an input" if number is None else f"input {number + 1}"
    return RecordError(
        f"the inputs cannot be separated: the others explain {100.0 * share:.3g} % of the power "
        f"of {which}; drive them by independent signals, or one after the other, with at least as "
        "many averages as inputs"
    )


def _smallest(xx: Complex, yx: Complex, yy: Array, noise_ratio: float | None) -> Complex:
    """Return the total least-squares response to several inputs, output by output."""
    lines, outputs, q = yx.shape
    response = np.empty((lines, outputs, q), dtype=np.complex128)
    power = np.einsum("kii->ki", xx).real
    for o in range(outputs):
        spectral = np.empty((lines, q + 1, q + 1), dtype=np.complex128)
        spectral[:, :q, :q], spectral[:, q, q] = xx, yy[:, o]
        spectral[:, q, :q], spectral[:, :q, q] = yx[:, o], np.conj(yx[:, o])
        noise = np.ones((lines, q + 1))
        if noise_ratio is None:
            noise = np.concatenate((power, yy[:, o : o + 1]), axis=1)
        else:
            noise[:, q] = noise_ratio
        d = np.sqrt(noise)
        vectors = np.linalg.eigh(spectral / (d[:, :, None] * d[:, None, :]))[1][:, :, 0]
        conjugate = np.conj(vectors)
        response[:, o] = -conjugate[:, :q] / conjugate[:, q:] * d[:, q:] / d[:, :q]
    return response
