"""Responses made ready for a fit: the band, displacement for acceleration, scatter and weights."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.modal.variable_projection import ResponseBlock
from flexstage.measure.spectra.response import MeasuredResponse

# lines of a window, and coefficients of the rational function through them: a parabola over a line
_WINDOW, _COEFFICIENTS = 9, 4
# windows in which poles are looked for: as many lines as a peak may be wide
_WINDOWS = (9, 17, 33, 65, 129)


def line_scatter(frequency_hz: Array, response: Complex) -> Array:
    """Return the rms of the noise of each line, by what a smooth function leaves of its neighbours.

    Through each line and four on either side goes a parabola over a straight line, which follows a
    resonance that is as sharp as two lines (local rational method: McKelvey and Guerin, 2012, IFAC
    Proceedings 45); what it leaves is noise. The rms is that of the complex error; frequencies [Hz]
    rise, not necessarily evenly.
    """
    lines = frequency_hz.size
    columns = response.reshape(lines, -1)
    width = min(_WINDOW, lines)
    first = np.clip(np.arange(lines) - width // 2, 0, lines - width)
    rows = first + np.arange(width)[:, None]
    x = frequency_hz[rows] - frequency_hz
    x = x / np.abs(x).max(axis=0)
    out = np.empty(columns.shape)
    # windows that a median is taken over, so that two poles in one window do not count as noise
    smooth = 11
    # what the median of a chi-square of 2 (9 - 4) degrees of freedom is of its mean
    median_over_mean = 0.934
    for column in range(columns.shape[1]):
        left = _rational(x, columns[rows, column], 1, 2)[0] / max(width - _COEFFICIENTS, 1)
        out[:, column] = np.sqrt(_medians(left, min(smooth, lines)) / median_over_mean)
    return out.reshape(response.shape)


def local_poles(frequency_hz: Array, response: Complex) -> tuple[Complex, Array]:
    """Return poles that windows of some lines show, whatever the response is elsewhere.

    In each window a pole with a parabola is compared with a cubic, which has as many coefficients;
    it counts where it is likelier by far, decays, and lies in the middle of the window. Poles are
    in rad/s; with each comes twice the logarithm by which it is likelier.
    """
    lines = frequency_hz.size
    columns = response.reshape(lines, -1)
    poles: list[Complex] = [np.zeros(0, dtype=np.complex128)]
    gains: list[Array] = [np.zeros(0)]
    # twice the logarithm of the likelihood by which a pole must be better than a cubic, in addition
    # to that for the number of windows
    least_gain = 12.0
    for width in _WINDOWS:
        if width > lines:
            break
        rows = np.arange(0, lines - width + 1, max(width // 8, 1)) + np.arange(width)[:, None]
        middle = frequency_hz[rows[width // 2]]
        x = frequency_hz[rows] - middle
        scale = np.abs(x).max(axis=0)
        x = x / scale
        for h in columns.T[:, rows]:
            for count in (1, 2):
                total = _COEFFICIENTS + 2 * (count - 1)
                if width < 2 * total:
                    continue
                more, roots = _rational(x, h, count, total - count - 1)
                inside = (np.abs(roots.real) < 0.5) & (roots.imag > 0.0) & (roots.imag < 0.5)
                inside &= middle + scale * roots.real > 0.0
                some = np.flatnonzero(inside.any(axis=0))
                fewer = _rational(x[:, some], h[:, some], count - 1, total - count)[0]
                floor = 1e-24 * np.sum(np.abs(h[:, some]) ** 2, axis=0) + 1e-300
                gain = 2.0 * (width - total) * np.log((fewer + floor) / (more[some] + floor))
                significant = gain > least_gain + 2.0 * math.log(lines)
                for at, within in zip(roots[:, some], inside[:, some] & significant, strict=True):
                    f = (middle[some] + scale[some] * at)[within]
                    poles.append(2.0 * math.pi * (1j * f.real - f.imag))
                    gains.append(gain[within])
    return np.concatenate(poles), np.concatenate(gains)


def _rational(x: Array, h: Complex, count: int, degree: int) -> tuple[Array, Complex]:
    """Fit h (1 + d x + ...) = n in each window: sum of squares left, and poles.

    x and h hold a window in each column.
    """
    below = np.zeros((count, h.shape[1]), dtype=np.complex128)
    terms = degree + 1 + count
    columns = np.empty((terms + 1, *h.shape), dtype=np.complex128)
    r = np.empty((terms, terms + 1, h.shape[1]), dtype=np.complex128)
    # the equation is divided by the denominator that it gave before
    denominator = np.ones(h.shape, dtype=np.complex128)
    for _ in range(3 if count else 1):
        np.divide(1.0, denominator, out=columns[0])
        np.multiply(h, columns[0], out=columns[terms])
        for n in range(degree):
            np.multiply(columns[n], x, out=columns[n + 1])
        for n in range(degree + 1, terms):
            np.multiply(columns[n - 1] if n > degree + 1 else -columns[terms], x, out=columns[n])
        _orthogonalised(columns, r)
        diagonal = np.abs(np.einsum("cck->ck", r[:, :terms]))
        sure = (diagonal > 1e-10 * diagonal.max(axis=0)).all(axis=0)
        # the last unknowns come first in the triangle
        for n in reversed(range(count)):
            at = degree + 1 + n
            partial_sum = np.einsum("nk,nk->k", r[at, at + 1 : terms], below[n + 1 :])
            below[n] = np.where(
                sure, (r[at, terms] - partial_sum) / np.where(sure, r[at, at], 1.0), 0.0
            )
        denominator = 1.0 + sum((below[n] * x ** (n + 1) for n in range(count)), 0.0)
        # a pole on a line itself would weigh it without end
        denominator = np.where(np.abs(denominator) < 1e-3, 1e-3, denominator)
    return np.sum(np.abs(columns[terms]) ** 2, axis=0), _roots(below)


def _orthogonalised(columns: Complex, r: Complex) -> None:
    """Make columns orthonormal but the last, which keeps what they leave of it.

    Modified Gram-Schmidt of all windows at once, which for a least-squares problem is as stable as
    Householder's method where the right side is a column like the others (Bjoerck, 1967, BIT 7).
    """
    product = np.empty_like(columns[0])
    for c in range(r.shape[0]):
        one = columns[c]
        size = np.sqrt(np.sum(np.square(one.real) + np.square(one.imag), axis=0))
        r[c, c] = size
        one *= 1.0 / np.where(size > 0.0, size, 1.0)
        conjugate = one.conj()
        for other in range(c + 1, columns.shape[0]):
            np.multiply(conjugate, columns[other], out=product)
            r[c, other] = product.sum(axis=0)
            columns[other] -= np.multiply(one, r[c, other], out=product)


def _roots(below: Complex) -> Complex:
    """Zeros of 1 + d x + e x^2, far away where there is none."""
    if below.shape[0] < 1:
        return below
    d, *others = np.where(below == 0.0, 1e-12 + 0.0j, below)
    if not others:
        return np.asarray(-1.0 / d[None], dtype=np.complex128)
    root = np.sqrt(d * d - 4.0 * others[0])
    return np.asarray(np.stack((-d + root, -d - root)) / (2.0 * others[0]), dtype=np.complex128)


def _medians(values: Array, width: int) -> Array:
    half = width // 2
    padded = np.pad(values, half, mode="reflect") if half else values
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)


def moving_mean(values: Array, width: int) -> Array:
    """Return the mean over a number of lines, the first axis; over fewer at the ends."""
    half, lines = width // 2, np.arange(values.shape[0])
    total = np.zeros((lines.size + 1, *values.shape[1:]), dtype=values.dtype)
    np.cumsum(values, axis=0, out=total[1:])
    low, high = np.maximum(lines - half, 0), np.minimum(lines + half + 1, lines.size)
    return (total[high] - total[low]) / (high - low).reshape(-1, *(1,) * (values.ndim - 1))


_POWERS = {"m": 0, "m/s": 1, "m/s^2": 2, "rad": 0, "rad/s": 1, "rad/s^2": 2}
# correlation of the errors of neighbouring lines, of noise on both sides under a Hann window: the
# square of that of its own transform, 2/3
_CORRELATION = 4.0 / 9.0
# a residual this far below the response is rounding
_ROUNDING = 1e-10
# gain of the logarithm of the likelihood of a line, from which on noise is not even
_UNEVEN = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """One response in the form for the fit."""

    measured: MeasuredResponse
    """The lines in the band."""
    powers: tuple[int, ...]
    """Order of the time derivative of each output."""
    deviation: Array
    """Expected rms of the error of each value, up to a common factor, shape (k, outputs, inputs).
    """
    has_variance: bool
    """Whether the variance is known, so that the factor should be 1."""
    has_final_weights: bool
    """Whether the weights do not change with the residuals of the fit."""
    scatter: Array
    """How neighbouring lines scatter, shape (k, outputs, inputs)."""
    block: ResponseBlock
    """Responses to displacement, one column for each output and input."""


def prepared(
    responses: Sequence[MeasuredResponse],
    band: tuple[float, float] | None,
    weighting: Literal["variance", "uniform", "relative"],
    reference: float,
) -> tuple[Prepared, ...]:
    """Make responses ready for a fit.

    Lines count by their variance, equally, or by the inverse of their magnitude. Outputs
    whose unit is none of motion are displacements; `reference` makes numbers of size 1 [rad/s].
    """
    if weighting not in ("variance", "uniform", "relative"):
        raise ModelError(
            f"the weighting must be 'variance', 'uniform' or 'relative', got {weighting!r}"
        )
    out = []
    for response in responses:
        split = _parted(response)
        part = split if band is None else split.between(*band)
        keep = part.frequency_hz > 0.0
        if keep.sum() < 8:
            raise RecordError(
                f"a modal fit needs at least 8 lines above 0 Hz in the band, got {keep.sum()}: "
                "widen the band, or use longer segments"
            )
        part = part.lines(keep)
        size = np.sqrt(np.mean(np.abs(part.response) ** 2, axis=0))
        if np.any(size == 0.0):
            dead = part.outputs[int(np.argwhere(size == 0.0)[0, 0])]
            raise RecordError(f"output '{dead}' is always zero: is its sensor connected?")
        deviation = deviations(part) if weighting == "variance" else None
        has_variance = deviation is not None
        scatter = line_scatter(part.frequency_hz, part.response)
        if deviation is None:
            deviation = _first(part, scatter, size, weighting)
        units = part.output_units or ("",) * len(part.outputs)
        powers = tuple(_POWERS.get(u, 0) for u in units)
        out.append(
            Prepared(
                measured=part,
                powers=powers,
                deviation=deviation,
                has_variance=has_variance,
                has_final_weights=has_variance or weighting != "variance",
                scatter=scatter,
                block=_block(part, powers, deviation, reference),
            )
        )
    return tuple(out)


def _first(part: MeasuredResponse, scatter: Array, size: Array, weighting: str) -> Array:
    """Return deviations to begin with, where none are given."""
    if weighting == "uniform":
        return np.broadcast_to(size, part.response.shape).copy()
    magnitude = np.abs(part.response)
    # share of the response that no model is asked for until it is known what it leaves
    trusted = 0.01
    share = 1.0 if weighting == "relative" else trusted
    # in proportion, down to the noise
    return np.maximum(np.hypot(scatter, share * magnitude), _ROUNDING * size)


def reweighted(part: Prepared, fitted: Complex, left: Array, reference: float) -> Prepared:
    """Weight a response by what a fit left: noise of the output, and noise in proportion.

    The mean square of the residual is modelled as a + b |H|^2, neither below 0, by likelihood of
    the exponential distribution that squares of complex noise have; where the noise of the output
    is of some frequencies, a follows the scatter of the lines. `left` is the share of the noise of
    each line that the fit leaves, shape (k, outputs, inputs).
    """
    deviation = np.empty_like(part.deviation)
    for o, i in np.ndindex(*part.measured.response.shape[1:]):
        square = np.abs(part.measured.response[:, o, i] - fitted[:, o, i]) ** 2
        signal = np.abs(fitted[:, o, i]) ** 2
        floor = _ROUNDING**2 * signal.mean()
        if square.mean() <= floor:
            deviation[:, o, i] = math.sqrt(max(square.mean(), 1e-32 * signal.mean()))
            continue
        deviation[:, o, i] = np.sqrt(
            _noises(square, signal, part.scatter[:, o, i] ** 2, left[:, o, i])
        )
    return replace(
        part, deviation=deviation, block=_block(part.measured, part.powers, deviation, reference)
    )


def _noises(square: Array, signal: Array, scatter: Array, left: Array) -> Array:
    """Mean square of the noise of each line: even, or as lines scatter where that is likelier."""
    even = _two_noises(square, signal, np.ones(signal.size), left)
    shape = np.maximum(scatter, 1e-12 * scatter.max())
    if shape.max() == 0.0:
        return even
    # a window reduces the scatter of all lines equally; model errors occur only in some lines
    middle, high = np.quantile(square / (shape * left), (0.5, 0.9))
    # a tenth of squares of noise is above 3.3 of their median
    reached = 6.0
    if high > reached * middle:
        return even
    uneven = _two_noises(square, signal, shape, left)
    gain = np.mean(np.log(even / uneven) + square / left * (1.0 / even - 1.0 / uneven))
    return uneven if gain > _UNEVEN else even


def _two_noises(square: Array, signal: Array, shape: Array, left: Array) -> Array:
    functions = np.stack([shape / shape.mean(), signal / signal.mean()], axis=1)
    constant = np.array([square.mean() / left.mean(), 0.0])
    factors = constant
    for _ in range(20):
        # of noise, the square scatters as much as it is
        weighted = functions / ((functions @ factors) ** 2)[:, None]
        trial = np.linalg.lstsq(functions.T @ (weighted * (left**2)[:, None]),
                                weighted.T @ (left * square))[0]  # fmt: skip
        if trial[1] <= 0.0:
            trial = np.array([float(np.mean(square / (left * functions[:, 0]))), 0.0])
        # noise in proportion alone would leave its least lines without any
        trial[0] = max(trial[0], 1e-4 * constant[0])
        if np.allclose(trial, factors, rtol=1e-3, atol=0.0):
            break
        factors = trial
    return np.asarray(functions @ factors, dtype=np.float64)


def deviations(part: MeasuredResponse) -> Array | None:
    """Return the expected rms of the error of each value, from the variance of a response.

    Shape (k, outputs, inputs); None where no variance is known, or it is 0 at most lines.
    """
    if part.variance is None:
        return None
    variance = part.variance
    if np.any(np.isnan(variance)) or np.any(variance < 0.0):
        raise RecordError("the variance of a response must be 0 or more, got a negative or none")
    lines = part.frequency_hz.size
    freedom = 2.0 * (part.averages - 1.0)
    # degrees of freedom that a variance should rest on before it is used as a weight
    known_well = 64.0
    if part.averages > 1.0 and freedom < known_well:
        # inverse variances from few averages scatter: their neighbours help
        width = min(math.ceil(known_well / freedom), max(lines // 8, 1))
        sharp = _share_of_response(variance, part.response)
        variance = np.maximum(_averaged(variance - sharp, width | 1), 0.0) + sharp
    finite = np.where(np.isfinite(variance), variance, np.nan)
    if np.all(np.isnan(finite)):
        raise RecordError("the variance of a response must be finite at least at some lines")
    middle = np.nanmedian(finite, axis=0)
    if np.any(middle == 0.0):
        # free of noise: nothing tells one line from another
        return None
    # no noise at all at single lines is what a single average or a rounded coherence says
    return np.sqrt(np.maximum(np.where(variance == 0.0, middle, variance), 1e-6 * middle))


def _parted(response: MeasuredResponse) -> MeasuredResponse:
    """Return a response whose lines a window has mixed, with them parted again.

    A kernel of second moment m makes H + m/2 H'' of H, to second order in the distance of lines
    over the width of a peak: so half the moment times the second difference is taken off.
    """
    f = response.frequency_hz
    even = np.ptp(np.diff(f)) <= 1e-6 * float(f[1] - f[0])
    if response.blur == 0.0 or not even or f.size < 3:
        return response
    half = 0.5 * response.blur
    inner = slice(1, -1)
    h = response.response.copy()
    h[inner] -= half * (h[2:] - 2.0 * response.response[inner] + response.response[:-2])
    variance = response.variance
    if variance is not None:
        # errors of neighbouring lines under such a window are correlated
        width = 1.0 + 2.0 * half
        growth = width**2 + 2.0 * half**2 - 4.0 * width * half * _CORRELATION
        variance = variance.copy()
        variance[inner] *= growth
    return replace(response, response=h, variance=variance, blur=0.0)


def _share_of_response(variance: Array, response: Complex) -> Array:
    """Return the part of a variance that goes with the square of the response.

    Noise of the input gives it. It is as sharp as a resonance, so a mean over neighbouring lines
    would not leave it where it is.
    """
    from scipy.optimize import nnls

    out = np.zeros(variance.shape)
    for o, i in np.ndindex(*variance.shape[1:]):
        v, square = variance[:, o, i], np.abs(response[:, o, i]) ** 2
        good = np.isfinite(v) & (v > 0.0)
        if good.sum() < 8:
            continue
        model = np.full(int(good.sum()), float(np.mean(v[good])))
        b = 0.0
        # each variance scatters in proportion to itself
        for _ in range(8):
            columns = np.stack((np.ones(model.size), square[good]), axis=1) / model[:, None]
            size = np.linalg.norm(columns, axis=0)
            (a, b), _ = nnls(columns / size, v[good] / model)
            a, b = a / size[0], b / size[1]
            model = np.maximum(a + b * square[good], 1e-12 * float(v[good].max()))
        out[:, o, i] = b * square
    return out


def _averaged(values: Array, width: int) -> Array:
    """The mean over neighbouring lines, of those that are finite."""
    finite = np.isfinite(values)
    finite_values = np.where(finite, values, np.nanmax(values[finite]))
    return np.where(finite, moving_mean(finite_values, width), values)


def _block(
    part: MeasuredResponse, powers: tuple[int, ...], deviation: Array, reference: float
) -> ResponseBlock:
    omega = 2.0 * math.pi * part.frequency_hz
    motion = (1j * omega)[:, None] ** np.array(powers)[None, :]
    values = part.response / motion[:, :, None]
    # the error of a real or imaginary part has half the variance of both
    weights = math.sqrt(2.0) * np.abs(motion)[:, :, None] / deviation
    return ResponseBlock(
        s=np.asarray(1j * omega / reference, dtype=np.complex128),
        values=values.reshape(omega.size, -1),
        weights=weights.reshape(omega.size, -1),
    )
