"""What single stretches of a frequency response show by themselves: its noise, and resonances."""

import math

import numpy as np

from flexstage.arrays import Array, Complex

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
    # twice the logarithm of the likelihood by which a pole must be better than a cubic, beside
    # that for the number of windows
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
                shown = gain > least_gain + 2.0 * math.log(lines)
                for at, within in zip(roots[:, some], inside[:, some] & shown, strict=True):
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
            known = np.einsum("nk,nk->k", r[at, at + 1 : terms], below[n + 1 :])
            below[n] = np.where(sure, (r[at, terms] - known) / np.where(sure, r[at, at], 1.0), 0.0)
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
