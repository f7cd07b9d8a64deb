"""Isolated outliers of a measured output, and what is put in their place."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from flexstage.arrays import Array
from flexstage.records import quantisation_step

#: A spike is this many samples long at most, ...
_LONGEST_SPIKE = 3
#: ... stands out from its neighbours by this many times what they scatter by, ...
_STANDS_OUT = 8.0
#: ... among this many samples to either side; an input that moved so many before explains it.
_NEAR = 32


def without_spikes(u: Array, y: Array) -> tuple[Array, NDArray[np.intp]]:
    """Replace isolated outliers of the output by what their neighbours say.

    One to three samples are a spike where all of them are off the cubic through two samples before
    and two after, by more than neighbourhood, converter, speed and the change of the input explain,
    and where the output goes on after them as if they were not there. So a jump is none, nor is
    ringing, whose neighbours are off as well.
    """
    mended = np.array(y, dtype=np.float64)
    found: list[int] = []
    floor = 0.4 * quantisation_step(y)
    moved = _moved(u, y)
    for length in range(1, _LONGEST_SPIKE + 1):
        for first in _spikes(mended, length, floor, moved):
            at = np.arange(first, first + length)
            around = [first - 2, first - 1, first + length, first + length + 1]
            mended[at] = _cubic(length) @ mended[around]
            found += at.tolist()
    return mended, np.unique(np.array(found, dtype=np.intp))


def _spikes(y: Array, length: int, floor: float, moved: Array) -> list[int]:
    n = y.size - length - 3
    if n < 2 * _NEAR:
        return []
    before = np.arange(2, 2 + n)
    a0, a1 = y[before - 2], y[before - 1]
    b1, b0 = y[before + length], y[before + length + 1]
    between = np.stack((a0, a1, b1, b0))
    off = np.stack([y[before + j] for j in range(length)]) - _cubic(length) @ between
    least = np.abs(off).min(axis=0)
    # how far any sample is off its neighbours near by
    near = np.abs(y[2:-2] - _cubic(1)[0] @ np.stack((y[:-4], y[1:-3], y[3:-1], y[4:])))
    typical = 1.4826 * median_filter(near, size=2 * _NEAR + 1, mode="nearest")
    typical = np.maximum(typical, max(1.4826 * float(np.median(near)), floor))[before - 2]
    gain = float(np.sqrt(np.sum(_cubic(length) ** 2, axis=1).max() + 1.0))
    typical *= gain / float(np.sqrt(np.sum(_cubic(1) ** 2) + 1.0))
    speed = np.maximum(np.abs(a1 - a0), np.abs(b0 - b1))
    goes_on = np.abs(b1 - a1 - 0.5 * (length + 1) * (a1 - a0 + b0 - b1)) < 0.5 * least
    one_side = np.all(off > 0.0, axis=0) | np.all(off < 0.0, axis=0)
    is_off = least > _STANDS_OUT * typical + speed + moved[before]
    found: list[int] = []
    for k in before[is_off & one_side & goes_on].tolist():
        if not found or k > found[-1] + length + 1:
            found.append(k)
    return found


def _cubic(length: int) -> Array:
    """Weights of two samples before and two after for those between, shape (length, 4)."""
    x = np.array([-2.0, -1.0, length, length + 1.0])
    at = np.arange(length, dtype=np.float64)
    others = [np.delete(x, i) for i in range(4)]
    return np.stack(
        [np.prod([(at - o) / (x[i] - o) for o in others[i]], axis=0) for i in range(4)], axis=1
    )


def _moved(u: Array, y: Array) -> Array:
    """What changes of the speed of the input explain in the output, up to some samples later."""
    bend = np.abs(np.diff(u, 2, prepend=u[0], append=u[-1]))
    bend = np.maximum(bend - 5.0 * 1.4826 * float(np.median(bend)), 0.0)
    low, high = np.quantile(y, (0.005, 0.995))
    gain = float(high - low) / max(float(np.ptp(u)), 1e-300)
    return gain * maximum_filter1d(bend, size=2 * _NEAR + 1, origin=_NEAR - _LONGEST_SPIKE)
