"""The noise of a monitored input, and what is left of the input without it."""

import math

import numpy as np

from flexstage.base.arrays import Array
from flexstage.records.quality import difference_noise

#: Noise that is smaller than this share of the range changes no figure: a command stays as it is.
_NEGLIGIBLE = 1e-4
#: Differences of so many orders are looked at: one of them leaves the motion out.
_ORDERS = 8
#: Noise is as large in the last of them as two before, content is not.
_WHITE = 0.8
#: Half widths of the polynomials that smooth, and their degree.
_HALF_WIDTHS = (4, 6, 9, 13, 19, 28, 41, 60, 88, 129)
_DEGREE = 4
#: A polynomial is too wide where it leaves the intervals of the narrower ones, of this many
#: standard errors, or that of the sample itself.
_INTERVAL = 1.0
_OWN_INTERVAL = 4.0
#: What was taken away is motion where the output follows it with this share of the gain, ...
_FOLLOWED = 0.2
#: ... after at most this many samples.
_LAGS = 200


def denoised(u: Array, y: Array) -> tuple[Array, float]:
    r"""Take the noise out of a monitored input, where it has any.

    White noise is alike in differences of any order :math:`k` (standard deviation
    :math:`\sigma\sqrt{\binom{2k}{k}}`), motion is not. Where there is some, each sample becomes the
    value of the widest polynomial about it that agrees with all narrower ones (intersection of
    confidence intervals: A. Goldenshluger, A. Nemirovski, Math. Methods Statist. 6 (1997) 135), so
    that jumps, corners and quick parts stay. Plays would otherwise follow the noise, and a delay of
    half a sample would be preferred, as it averages two samples. What the output follows is motion,
    and stays. Returned with the standard deviation of the noise; unchanged, with 0, where it has
    none.

    Validity: noise that differs from sample to sample. A hum, or noise behind a slow filter, stays.
    A random walk that the output is too slow to follow is smoothed.
    """
    noise = _noise(u)
    if noise <= _NEGLIGIBLE * float(np.ptp(u)):
        return u, 0.0
    smooth = _smoothed(u, noise)
    return (u, 0.0) if _followed(u - smooth, noise, u, y) else (smooth, noise)


def _noise(u: Array) -> float:
    """Standard deviation of what is white in a signal; 0 where nothing is."""
    if u.size < 4 * _ORDERS:
        return 0.0
    found = [difference_noise(u, k) for k in range(1, _ORDERS + 1)]
    # steps spoil the higher orders, slopes the lower ones
    least = int(np.argmin(found))
    if least == _ORDERS - 1 and found[least] < _WHITE * found[least - 2]:
        return 0.0
    return found[least]


def _smoothed(u: Array, noise: float) -> Array:
    from scipy.signal import oaconvolve, savgol_coeffs

    made, reach = u.copy(), _OWN_INTERVAL * noise
    low, high = u - reach, u + reach
    going = np.ones(u.size, dtype=bool)
    for h in _HALF_WIDTHS:
        if 2 * h + 1 > u.size:
            break
        weights = savgol_coeffs(2 * h + 1, _DEGREE)
        reach = _INTERVAL * noise * float(np.sqrt(weights @ weights))
        value = np.asarray(oaconvolve(u, weights, mode="same"))
        np.maximum(low, value - reach, out=low)
        np.minimum(high, value + reach, out=high)
        going &= low <= high
        going[:h] = going[u.size - h :] = False
        if not going.any():
            break
        made[going] = value[going]
    return made


def _followed(taken: Array, noise: float, u: Array, y: Array) -> bool:
    """Whether the output moves with what was taken from the input."""
    from scipy.signal import correlate, savgol_filter

    quick = y - np.asarray(savgol_filter(y, 11, 3))
    size = 1.4826 * float(np.median(np.abs(quick)))
    quick = np.clip(quick, -4.0 * size, 4.0 * size)
    taken = np.clip(taken, -4.0 * noise, 4.0 * noise)
    power = float(taken @ taken)
    gain = float(np.ptp(y) / np.ptp(u))
    lags = min(_LAGS, u.size // 4)
    share = correlate(quick, taken, mode="full", method="fft")[u.size - 1 :][:lags]
    share = np.abs(share) / max(gain * power, 1e-300)
    by_chance = size / max(gain * math.sqrt(power), 1e-300)
    return float(share.max()) > max(_FOLLOWED, 5.0 * by_chance)


def smoothed_text(share: float) -> str:
    """Return what is said of noise that was taken out of an input."""
    return (
        f"the input has noise of {100 * share:.2g} % of its range, which the output does not "
        "follow: it was smoothed; use the command instead where it was recorded"
    )
