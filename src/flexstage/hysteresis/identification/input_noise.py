"""Noise of a monitored input, and its removal."""

import math

import numpy as np

from flexstage.base.arrays import Array
from flexstage.records.quality import RMS_OVER_MEDIAN, difference_noise

#: Noise below this share of the range changes no figure: a command is not smoothed.
_NEGLIGIBLE = 1e-4
#: Largest order of differences: one of them contains no motion.
_ORDERS = 8
#: Noise has the same size in the last order as two before, motion has not.
_WHITE = 0.8
#: Half widths of the polynomials that smooth, and their degree.
_HALF_WIDTHS = (4, 6, 9, 13, 19, 28, 41, 60, 88, 129)
_DEGREE = 4
#: A polynomial is too wide if it leaves the confidence intervals of the narrower ones, of this many
#: standard errors, or that of the sample itself.
_INTERVAL = 1.0
_SAMPLE_INTERVAL = 4.0
#: The removed part is motion if the output follows it with this share of the gain, ...
_FOLLOWED = 0.2
#: ... after at most this many samples.
_LAGS = 200


def denoised(u: Array, y: Array) -> tuple[Array, float]:
    r"""Remove white noise from a monitored input.

    White noise has the same size in differences of any order :math:`k` (standard deviation
    :math:`\sigma\sqrt{\binom{2k}{k}}`), motion has not. Each noisy sample becomes the value of the
    widest polynomial about it that agrees with all narrower ones (intersection of confidence
    intervals: A. Goldenshluger, A. Nemirovski, Math. Methods Statist. 6 (1997) 135), so that jumps,
    corners and fast parts remain. Plays would otherwise follow the noise, and a delay of half a
    sample would be preferred, as it averages two samples. Motion that the output follows remains.
    Returned with the standard deviation of the noise; unchanged, with 0, if there is none.

    Validity: noise that is independent between samples. Hum, or noise behind a slow filter,
    remains. A random walk that the output is too slow to follow is smoothed.
    """
    noise = _noise(u)
    if noise <= _NEGLIGIBLE * float(np.ptp(u)):
        return u, 0.0
    smooth = _smoothed(u, noise)
    return (u, 0.0) if _followed(u - smooth, noise, u, y) else (smooth, noise)


def _noise(u: Array) -> float:
    """Standard deviation of white noise in a signal; 0 if there is none."""
    if u.size < 4 * _ORDERS:
        return 0.0
    estimates = [difference_noise(u, k) for k in range(1, _ORDERS + 1)]
    # steps increase the higher orders, slopes the lower ones
    least = int(np.argmin(estimates))
    if least == _ORDERS - 1 and estimates[least] < _WHITE * estimates[least - 2]:
        return 0.0
    return estimates[least]


def _smoothed(u: Array, noise: float) -> Array:
    from scipy.signal import oaconvolve, savgol_coeffs

    smooth, reach = u.copy(), _SAMPLE_INTERVAL * noise
    low, high = u - reach, u + reach
    widening = np.ones(u.size, dtype=bool)
    for h in _HALF_WIDTHS:
        if 2 * h + 1 > u.size:
            break
        weights = savgol_coeffs(2 * h + 1, _DEGREE)
        reach = _INTERVAL * noise * float(np.sqrt(weights @ weights))
        value = np.asarray(oaconvolve(u, weights, mode="same"))
        np.maximum(low, value - reach, out=low)
        np.minimum(high, value + reach, out=high)
        widening &= low <= high
        widening[:h] = widening[u.size - h :] = False
        if not widening.any():
            break
        smooth[widening] = value[widening]
    return smooth


def _followed(removed: Array, noise: float, u: Array, y: Array) -> bool:
    """Return true if the output follows the part removed from the input."""
    from scipy.signal import correlate, savgol_filter

    quick = y - np.asarray(savgol_filter(y, 11, 3))
    size = RMS_OVER_MEDIAN * float(np.median(np.abs(quick)))
    quick = np.clip(quick, -4.0 * size, 4.0 * size)
    removed = np.clip(removed, -4.0 * noise, 4.0 * noise)
    power = float(removed @ removed)
    gain = float(np.ptp(y) / np.ptp(u))
    lags = min(_LAGS, u.size // 4)
    share = correlate(quick, removed, mode="full", method="fft")[u.size - 1 :][:lags]
    share = np.abs(share) / max(gain * power, 1e-300)
    by_chance = size / max(gain * math.sqrt(power), 1e-300)
    return float(share.max()) > max(_FOLLOWED, 5.0 * by_chance)


def input_noise_warning(share: float) -> str:
    """Return the warning about noise that was removed from an input."""
    return (
        f"the input has noise of {100 * share:.2g} % of its range, which the output does not "
        "follow: it was smoothed; if the command was recorded, use it instead"
    )
