"""Where a free decay begins, and the poles that a subspace of its samples has."""

import itertools
import math

import numpy as np

from flexstage.arrays import Array, Complex

# a line of a periodogram of noise alone is seldom this many times its surroundings, beyond ln n
_ABOVE = 3.0
# samples of a window of the subspace, at most, and windows that are summed
_WINDOW = 360
_SHIFTS = 8000


def _prominence(values: Array, rate: float) -> tuple[Array, Array]:
    """Return frequencies and power of a record over that of its surroundings."""
    size = values.shape[0]
    ramp = np.linspace(-1.0, 1.0, size)[:, None]
    level = values - values.mean(axis=0)
    level = level - ramp * (level * ramp).sum(axis=0) / (ramp * ramp).sum()
    window = np.hanning(size + 2)[1:-1, None]
    power = np.abs(np.fft.rfft(level * window, axis=0)) ** 2
    frequency = np.fft.rfftfreq(size, 1.0 / rate)
    # lines in groups that widen with frequency, so that the slope of a step is level in each
    edges = np.unique(np.round(np.geomspace(1, power.shape[0], 40)).astype(int))
    ratio = np.zeros_like(power)
    for channel in range(power.shape[1]):
        quiet = [np.median(power[a:b, channel]) for a, b in itertools.pairwise(edges)]
        middle = [0.5 * (a + b - 1) for a, b in itertools.pairwise(edges)]
        floor = np.maximum(quiet, 1e-300)
        # a mode may fill a group: the lesser of its neighbours is the surroundings
        padded = np.concatenate([floor[:1], floor, floor[-1:]])
        floor = np.minimum(floor, np.minimum(padded[:-2], padded[2:]))
        surroundings = np.exp(np.interp(np.arange(power.shape[0]), middle, np.log(floor)))
        ratio[1:, channel] = power[1:, channel] / surroundings[1:]
    return np.asarray(frequency, dtype=np.float64), np.asarray(ratio.max(axis=1))


def highest_frequency(values: Array, rate: float) -> float:
    """Return the highest frequency that stands out in a record.

    In Hz; the strongest where none stands out.
    """
    frequency, ratio = _prominence(values, rate)
    out = np.flatnonzero(ratio > _ABOVE * math.log(ratio.size) / math.log(2.0))
    strong = np.flatnonzero(ratio > 1e-4 * ratio.max())
    both = np.intersect1d(out, strong)
    return float(frequency[both[-1] if both.size else int(np.argmax(ratio))])


def decay_start(values: Array, rate: float) -> int:
    """Return the sample from which a record decays freely.

    It is where the motion at the frequency that stands out most, seen through a window of two of
    its periods, is largest: a release, hit or step lies half a window before that.
    """
    frequency, ratio = _prominence(values, rate)
    tone = float(frequency[int(np.argmax(ratio))])
    size = values.shape[0]
    width = round(2.0 * rate / tone)
    if width < 4 or 4 * width > size:
        return 0
    turn = np.exp(-2j * math.pi * tone / rate * np.arange(size))[:, None]
    # what is constant over a period turns round once in it: the window has two whole ones
    mixed = (values - values[-size // 4 :].mean(axis=0)) * turn
    total = np.cumsum(np.concatenate([np.zeros((1, values.shape[1])), mixed]), axis=0)
    envelope = np.sum(np.abs(total[width:] - total[:-width]) ** 2, axis=1)
    peak = int(np.argmax(envelope))
    return 0 if peak == 0 else peak + width // 2


def subspace_poles(values: Array, rate: float, order: int) -> Complex:
    """Return the poles of a free decay by the shift invariance of its subspace.

    Windows of the record are the columns of a Hankel matrix; the subspace of its largest singular
    values turns into itself by one sample as U_2 = U_1 Z, and the eigenvalues of Z are exp(pole T)
    (Juang and Pappa, 1985, Journal of Guidance, Control and Dynamics 8; Hua and Sarkar, 1990).
    Those in the upper half plane that decay [rad/s], rising in frequency.
    """
    size = values.shape[0]
    window = min(size // 2, _WINDOW)
    order = min(order, window - 2)
    stride = max(1, (size - window) // _SHIFTS)
    square = np.zeros((window, window))
    for channel in values.T:
        hankel = np.lib.stride_tricks.sliding_window_view(channel, window)[::stride]
        square += hankel.T @ hankel
    subspace = np.linalg.eigh(square)[1][:, -order:]
    turn = np.linalg.lstsq(subspace[:-1], subspace[1:])[0]
    roots = np.linalg.eigvals(turn).astype(np.complex128)
    roots = roots[np.abs(roots) > 0.0]
    poles = rate * np.log(roots)
    # a little growth may be noise on a decay that is hardly there
    poles = poles[(poles.imag > 0.0) & (np.abs(poles.real) < 0.7 * np.abs(poles))]
    poles = -np.maximum(-poles.real, 1e-6 * np.abs(poles)) + 1j * poles.imag
    return np.asarray(poles[np.argsort(np.abs(poles), kind="stable")], dtype=np.complex128)
