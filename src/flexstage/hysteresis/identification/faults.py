"""Faults of a record: noise of the input, spikes, clipping, a butterfly loop."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import Cycles, RecordSection
from flexstage.quantities.units import readable
from flexstage.records import saturation
from flexstage.records.quality import difference_noise, quantisation_step

#: Largest number of samples of a spike, ...
_LONGEST_SPIKE = 3
#: ... its smallest size over the scatter of its neighbours, ...
_SPIKE_RATIO = 8.0
#: ... and number of these on each side; an input that moved within as many samples explains it.
_NEAR = 32

#: Widths of the end bands, as shares of the range of the input, the widest first: slow saturation
#: of an amplifier, and an end of range that is reached in 1 % of the samples.
_END_BANDS = np.geomspace(0.3, 0.005, 14)
#: The output is clipped if its slope there is less than this share of the slope further inside.
_FLAT = 0.3
#: A swing over this share of the range and more is a large one.
_LARGE_SWING = 0.5
#: Number of intervals of the input over which a branch is averaged.
_INTERVALS = 16
#: Smallest turn of the branches of a butterfly, as a share of the range of the output.
_TURNS_BACK = 0.03
#: Largest number of times in a message.
_TIMES = 3

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


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordFault:
    """Fault of a record."""

    kind: str
    """``spikes``, ``clipping``, ``butterfly``, ``jump`` or ``drift``."""
    record: int
    """Number of the record, from 0."""
    at: tuple[float, ...]
    """Times from the first sample of the record [s]; empty for a fault of the whole record."""
    size: float
    """Size, in the unit of the output; of a drift, over the record."""
    percent: float
    """The same over the stroke [%]."""
    text: str
    """Message with a remedy."""


def clipped(
    u: Array, y: Array, moves: Cycles, noise: float, input_noise: float = 0.0
) -> tuple[float, float, int] | None:
    """Find a constant output at an end of its range while the input still moves.

    Only branches towards the end of the range are used, as every drive hesitates after a turning
    point. Their slope near the end is compared with that further inside. Neither a delay nor creep
    reduces it, and noise does not hide a slope of many samples; bands of a few times the noise of
    the input are not used. Equal values at the end are clipped if noise would have changed them.
    Returned: the constant value, the lost motion, and the number of clipped samples. The noise of
    the input is that removed from it.
    """
    for sign in (1.0, -1.0):
        clipping = _clipped_above(sign * u, sign * y, moves.turning, noise, input_noise)
        if clipping is not None:
            return sign * clipping[0], clipping[1], clipping[2]
    return None


def _clipped_above(
    u: Array, y: Array, turning: NDArray[np.intp], noise: float, input_noise: float
) -> tuple[float, float, int] | None:
    low, high = float(u.min()), float(u.max())
    rising = [s for s in _swings(u, turning) if u[s.stop - 1] > u[s.start]]
    inner = _slope(u, y, rising, low + 0.3 * (high - low), low + 0.7 * (high - low))
    jitter = max(difference_noise(u, 2), input_noise)
    if inner is None or inner[0] <= 0.0:
        return None
    step = quantisation_step(y)
    levels = saturation(y)
    if levels.clipped_high:
        lost = max(_rise(u, y, rising) - 3.0 * jitter, 0.0) * inner[0]
        if max(lost, noise) > 2.0 * step:
            return levels.high, max(lost, noise), levels.at_high
    for share in _END_BANDS:
        band = share * (high - low)
        # noise of the input reduces every slope over less than a few times it
        outer = _slope(u, y, rising, high - band, high) if band > 10.0 * jitter else None
        if outer is None or outer[1] == 0.0:
            continue
        # a step of the converter is an error of all samples in it
        error = 4.0 * noise / outer[1] + 2.0 * step / band
        if outer[0] + error < _FLAT * inner[0]:
            level = float(np.median(np.concatenate([y[s][u[s] > high - band] for s in rising])))
            lost = (inner[0] - outer[0]) * band
            return level, lost, int(np.sum(y > level - max(4.0 * noise, 0.05 * lost)))
    return None


def _rise(u: Array, y: Array, swings: Sequence[slice]) -> float:
    """Largest range of the input over which the output is exactly at its maximum."""
    spans = []
    for s in swings:
        ends = np.flatnonzero(np.diff(np.concatenate(([0], (y[s] == y.max()).astype(int), [0]))))
        spans += [float(np.ptp(u[s][a:b])) for a, b in zip(ends[::2], ends[1::2], strict=True)]
    return max(spans, default=0.0)


def _slope(
    u: Array, y: Array, swings: Sequence[slice], low: float, high: float
) -> tuple[float, float] | None:
    """Slope of the output in a band of the input, and root of the sum of squares of the input."""
    product = square = 0.0
    count = 0
    for s in swings:
        inside = (u[s] >= low) & (u[s] <= high)
        if int(inside.sum()) < 3:
            continue
        du = u[s][inside] - u[s][inside].mean()
        product += float(du @ (y[s][inside] - y[s][inside].mean()))
        square += float(du @ du)
        count += int(inside.sum())
    if count < 5 or square == 0.0:
        return None
    return product / square, float(np.sqrt(square))


def _swings(u: Array, turning: NDArray[np.intp]) -> list[slice]:
    """Parts of a signal between turning points that cover much of its range."""
    ends = np.concatenate(([0], turning, [u.size - 1]))
    size = _LARGE_SWING * float(np.ptp(u))
    pairs = zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)
    return [slice(a, b + 1) for a, b in pairs if abs(u[b] - u[a]) > size]


def butterfly(u: Array, y: Array, moves: Cycles) -> tuple[float, float, float] | None:
    """Find a turn of the output inside the range of the input, in both directions.

    A lag also delays the turn of the output after a turning point of the input, but upwards on the
    falling branch and downwards on the rising one. If the polarity of a drive changes, both
    branches have a minimum inside, or both a maximum. Returned: the input at which the rising
    branch turns, that of the falling branch, and the size of the turn.
    """
    low, high = moves.range
    middle = low + (high - low) * (np.arange(_INTERVALS) + 0.5) / _INTERVALS
    large = _swings(u, moves.turning)
    up, down = (
        _branch(u, y, [s for s in large if (u[s.stop - 1] > u[s.start]) == rises])
        for rises in (True, False)
    )
    if up is None or down is None:
        return None
    filled = np.isfinite(up) & np.isfinite(down)
    if filled.sum() < _INTERVALS // 2:
        return None
    size = float(np.ptp(np.concatenate((up[filled], down[filled]))))
    for sign in (1.0, -1.0):
        turns = [_turns_back(sign * branch[filled]) for branch in (up, down)]
        depth = min(t[1] for t in turns)
        if depth > _TURNS_BACK * size:
            at = middle[filled]
            return float(at[turns[0][0]]), float(at[turns[1][0]]), depth
    return None


def _branch(u: Array, y: Array, swings: Sequence[slice]) -> Array | None:
    """Mean of the output in intervals of the input; None if it does not follow the input."""
    if not swings:
        return None
    at, outputs = np.concatenate([u[s] for s in swings]), np.concatenate([y[s] for s in swings])
    low, high = float(u.min()), float(u.max())
    which = np.minimum((_INTERVALS * (at - low) / (high - low)).astype(int), _INTERVALS - 1)
    count = np.bincount(which, minlength=_INTERVALS)
    total = np.bincount(which, weights=outputs, minlength=_INTERVALS)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    # noise has a minimum as well
    return mean if np.var(outputs - mean[which]) < 0.5 * np.var(outputs) else None


def _turns_back(branch: Array) -> tuple[int, float]:
    """Minimum of a branch, and the rise to the lower of its two ends."""
    k = int(np.argmin(branch))
    return k, float(min(branch[: k + 1].max(), branch[k:].max()) - branch[k])


def butterfly_text(turn: tuple[float, float, float], unit: str) -> str:
    """Return the message about a change of polarity."""
    up, down = (readable(unit, value) for value in turn[:2])
    return (
        f"butterfly loop: the output turns back where the input rises through {up} and where it "
        f"falls through {down}: a piezo drive passes its coercive field there, and no model "
        "includes the change of polarity; keep the drive voltage unipolar"
    )


def record_faults(
    number: int,
    section: RecordSection,
    spikes: NDArray[np.intp],
    sign: float,
    units: tuple[str, str],
) -> tuple[RecordFault, ...]:
    """Return the faults of a record, from which the spikes are removed already.

    The sign is that of the recorded output over the input; units are of input and output.
    """
    u, y = section.u, section.y
    stroke = float(np.ptp(y[section.warm_up :]))
    faults: list[RecordFault] = []

    def add(kind: str, at: Sequence[float], size: float, text: str) -> None:
        percent = 100.0 * size / stroke
        faults.append(
            RecordFault(
                kind=kind, record=number, at=tuple(at), size=size, percent=percent, text=text
            )
        )

    if spikes.size:
        at = (spikes * section.dt).tolist()
        places = ", ".join(f"{t:.6g}" for t in at[:_TIMES]) + (", ..." if len(at) > _TIMES else "")
        add(
            "spikes", at, 0.0,
            f"{spikes.size} samples of the output are spikes (at {places} s): they were replaced "
            "by interpolation between their neighbours; check sensor and cable",
        )  # fmt: skip
    turn = butterfly(u, y, section.cycles)
    if turn is not None:
        add("butterfly", (), turn[2], butterfly_text(turn, units[0]))
        return tuple(faults)  # such an output has no end of range
    flat = clipped(u, y, section.cycles, section.noise, section.input_noise)
    if flat is not None:
        level, lost, count = flat
        stays = readable(units[1], sign * level, digits=4)
        add(
            "clipping", (), lost,
            f"the output is clipped at {stays} while the input still moves, in {count} samples "
            f"({100.0 * count / y.size:.1f} %), and loses about {100.0 * lost / stroke:.2g} % of "
            "the stroke: check for saturation of sensor or amplifier and for contact of the stage "
            "with a stop, and exclude that range of the input",
        )  # fmt: skip
    return tuple(faults)


def without_spikes(u: Array, y: Array) -> tuple[Array, NDArray[np.intp]]:
    """Replace isolated outliers of the output by interpolation.

    One to three samples are a spike if all deviate from the cubic through two samples before and
    two after by more than neighbourhood, converter, speed and the change of the input explain,
    and if the output continues after them undisturbed. So a jump is no spike, nor is ringing, whose
    neighbours deviate as well.
    """
    corrected = np.array(y, dtype=np.float64)
    spikes: list[int] = []
    floor = 0.4 * quantisation_step(y)
    explained = _explained_motion(u, y)
    for length in range(1, _LONGEST_SPIKE + 1):
        for first in _spikes(corrected, length, floor, explained):
            at = np.arange(first, first + length)
            around = [first - 2, first - 1, first + length, first + length + 1]
            corrected[at] = _cubic(length) @ corrected[around]
            spikes += at.tolist()
    return corrected, np.unique(np.array(spikes, dtype=np.intp))


def _spikes(y: Array, length: int, floor: float, explained: Array) -> list[int]:
    n = y.size - length - 3
    if n < 2 * _NEAR:
        return []
    before = np.arange(2, 2 + n)
    a0, a1 = y[before - 2], y[before - 1]
    b1, b0 = y[before + length], y[before + length + 1]
    between = np.stack((a0, a1, b1, b0))
    off = np.stack([y[before + j] for j in range(length)]) - _cubic(length) @ between
    least = np.abs(off).min(axis=0)
    # deviation of each sample from its neighbours
    near = np.abs(y[2:-2] - _cubic(1)[0] @ np.stack((y[:-4], y[1:-3], y[3:-1], y[4:])))
    typical = 1.4826 * median_filter(near, size=2 * _NEAR + 1, mode="nearest")
    typical = np.maximum(typical, max(1.4826 * float(np.median(near)), floor))[before - 2]
    gain = float(np.sqrt(np.sum(_cubic(length) ** 2, axis=1).max() + 1.0))
    typical *= gain / float(np.sqrt(np.sum(_cubic(1) ** 2) + 1.0))
    speed = np.maximum(np.abs(a1 - a0), np.abs(b0 - b1))
    continues = np.abs(b1 - a1 - 0.5 * (length + 1) * (a1 - a0 + b0 - b1)) < 0.5 * least
    one_side = np.all(off > 0.0, axis=0) | np.all(off < 0.0, axis=0)
    is_off = least > _SPIKE_RATIO * typical + speed + explained[before]
    starts: list[int] = []
    for k in before[is_off & one_side & continues].tolist():
        if not starts or k > starts[-1] + length + 1:
            starts.append(k)
    return starts


def _cubic(length: int) -> Array:
    """Weights of two samples before and two after for the samples between, shape (length, 4)."""
    x = np.array([-2.0, -1.0, length, length + 1.0])
    at = np.arange(length, dtype=np.float64)
    others = [np.delete(x, i) for i in range(4)]
    return np.stack(
        [np.prod([(at - o) / (x[i] - o) for o in others[i]], axis=0) for i in range(4)], axis=1
    )


def _explained_motion(u: Array, y: Array) -> Array:
    """Motion of the output that changes of the speed of the input explain, with their delay."""
    bend = np.abs(np.diff(u, 2, prepend=u[0], append=u[-1]))
    bend = np.maximum(bend - 5.0 * 1.4826 * float(np.median(bend)), 0.0)
    low, high = np.quantile(y, (0.005, 0.995))
    gain = float(high - low) / max(float(np.ptp(u)), 1e-300)
    return gain * maximum_filter1d(bend, size=2 * _NEAR + 1, origin=_NEAR - _LONGEST_SPIKE)


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
    size = 1.4826 * float(np.median(np.abs(quick)))
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
