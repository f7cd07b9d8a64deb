"""Faults of a record: noise of the input, spikes, clipping, a butterfly loop."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

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


@dataclass(frozen=True, slots=True)
class _EndThresholds:
    """Limits of the search for an end of the range that the output does not follow."""

    bands: tuple[float, ...] = tuple(np.geomspace(0.3, 0.02, 10).tolist())
    """Widths of the end, as shares of the range of the input: slow saturation of an amplifier, and
    an end that is reached in 1 % of the samples.
    """
    flat: float = 0.4
    """Largest slope there, as a share of the slope further inside."""
    near: float = 0.6
    """Width of the part of a branch that is fitted, as a share of the range, and ..."""
    after_turn: float = 0.1
    """... its smallest distance from the turning point before."""
    scatter: float = 0.01
    """Largest residual of a branch with a sharp bend, as a share of the stroke: a ferroelectric
    that saturates leaves more.
    """
    smooth: float = 0.04
    """Width of the end over which a cubic saturates, as a share of the range."""


_END = _EndThresholds()
#: A swing over this share of the range and more is a large one.
_LARGE_SWING = 0.5
#: Number of intervals of the input over which a branch is averaged.
_INTERVALS = 40
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
    """``spikes``, ``clipping``, ``saturation``, ``butterfly``, ``jump``, ``gain``,
    ``shift`` or ``drift``.
    """
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

    @classmethod
    def of(
        cls, kind: str, record: int, at: Sequence[float], size: float, stroke: float, text: str
    ) -> Self:
        """Return a fault of a record with this stroke."""
        percent = 100.0 * size / stroke
        return cls(kind=kind, record=record, at=tuple(at), size=size, percent=percent, text=text)


@dataclass(frozen=True, slots=True)
class RangeEnd:
    """End of the range at which an output stops, bends or turns back while the input moves."""

    kind: str
    """``clipping``, ``saturation`` or ``butterfly``."""
    at: float
    """Input at which it begins."""
    level: float
    """Output beyond that."""
    lost: float
    """Motion that is missing at the end."""
    samples: int
    """Number of samples concerned."""


def range_end(
    u: Array, y: Array, moves: Cycles, noise: float, input_noise: float = 0.0
) -> RangeEnd | None:
    """Find an end of the range at which the output does not follow the input.

    Only branches towards the end of the range are used, as every drive hesitates after a turning
    point. A parabola with a bend, at the input where it fits best, is compared with a cubic: noise
    does not hide a slope of many samples. The output is clipped beyond a sharp bend into a
    constant, saturates where the cubic fits better, and turns back where it then falls. Equal
    values at the end are clipped if noise would have changed them. The noise of the input is that
    removed from it.

    Validity: at most 30 % of the range beyond the bend; no bend within ten times the noise of the
    input, which reduces every slope there.
    """
    for sign in (1.0, -1.0):
        end = _upper_end(sign * u, sign * y, moves.turning, noise, input_noise)
        if end is not None:
            return replace(end, at=sign * end.at, level=sign * end.level)
    return None


def _upper_end(
    u: Array, y: Array, turning: NDArray[np.intp], noise: float, input_noise: float
) -> RangeEnd | None:
    high, span = float(u.max()), float(np.ptp(u))
    rising = [s for s in _swings(u, turning) if u[s.stop - 1] > u[s.start]]
    parts = [(u[s][at], y[s][at]) for s in rising if (at := _approach(u[s], high, span)).sum() > 5]
    if not parts:
        return None
    x, z = (np.concatenate(values) for values in zip(*parts, strict=True))
    x = (x - high) / span
    branch = np.repeat(np.arange(len(parts)), [part[0].size for part in parts])
    step, jitter = quantisation_step(y), max(difference_noise(u, 2), input_noise) / span

    def centred(values: Array) -> Array:
        return values - (np.bincount(branch, weights=values) / np.bincount(branch))[branch]

    target = centred(z)

    def fit(third: Array) -> tuple[float, Array, Array]:
        """Fit a parabola and a third column: mean square, coefficients, covariance."""
        columns = np.column_stack([centred(c) for c in (x, x**2, third)])
        inverse = np.asarray(np.linalg.pinv(columns), dtype=np.float64)
        c = inverse @ target
        return float(np.mean((target - columns @ c) ** 2)), c, inverse @ inverse.T

    levels, slope = saturation(y), float(centred(x) @ target / (centred(x) @ centred(x)))
    if levels.clipped_high and slope > 0.0:
        equal = [u[s][y[s] == levels.high] for s in rising]
        at_top = max((float(np.ptp(inputs)) for inputs in equal if inputs.size), default=0.0)
        lost = max(max(at_top / span - 3.0 * jitter, 0.0) * slope, noise)
        if lost > 2.0 * step:
            return RangeEnd("clipping", high - at_top, levels.high, lost, levels.at_high)
    bands = [b for b in _END.bands if b > 10.0 * jitter and np.sum(x > -b) > 4]
    if not bands:
        return None
    # a branch is curved: a bend is an excess over a parabola
    (square, c, spread), band = min(
        ((fit(np.maximum(x + b, 0.0)), b) for b in bands), key=lambda f: f[0][0]
    )
    smooth = fit(x**3)
    inside, outside = np.array([1.0, -2.0 * band, 0.0]), np.array([1.0, -band, 1.0])
    sharp = square < max(2.0 * noise**2, (_END.scatter * float(np.ptp(y))) ** 2)
    if smooth[0] < square:
        (square, c, spread), band, sharp = smooth, _END.smooth, False
        inside, outside = np.array([1.0, -1.0, 0.75]), np.array([1.0, -band, 0.75 * band**2])
    before, after = float(inside @ c), float(outside @ c)
    error = 3.0 * math.sqrt(max(noise**2, square) * float(outside @ spread @ outside))
    error += 2.0 * step / band  # a step of the converter is an error of all samples in it
    if before <= 0.0 or after + error > _END.flat * before:
        return None
    level, lost = float(np.median(z[x > -band])), (before - after) * band
    turns = after < -max(3.0 * error, 0.1 * before)
    return RangeEnd(
        "butterfly" if turns else "clipping" if sharp else "saturation",
        high - band * span, level, lost, int(np.sum(y > level - max(4.0 * noise, 0.05 * lost))),
    )  # fmt: skip


def _approach(u: Array, high: float, span: float) -> NDArray[np.bool_]:
    """Moving samples of a branch in the upper part of the range, well after its turning point."""
    step = np.abs(np.diff(u, prepend=u[0]))
    moves = (step > 0.0) & (step < 0.1 * span)
    return moves & (u > max(high - _END.near * span, u[0] + _END.after_turn * span))


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
    for sign, against_lag in ((1.0, 1), (-1.0, 0)):
        turns = [_turns_back(sign * branch[filled]) for branch in (up, down)]
        depth = turns[against_lag][1]
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
    if spikes.size:
        at = (spikes * section.dt).tolist()
        places = ", ".join(f"{t:.6g}" for t in at[:_TIMES]) + (", ..." if len(at) > _TIMES else "")
        text = (
            f"{spikes.size} samples of the output are spikes (at {places} s): they were replaced "
            "by interpolation between their neighbours; check sensor and cable"
        )
        faults.append(RecordFault.of("spikes", number, at, 0.0, stroke, text))
    turn = butterfly(u, y, section.cycles)
    if turn is not None:  # such an output has no end of range
        text = butterfly_text(turn, units[0])
        return (*faults, RecordFault.of("butterfly", number, (), turn[2], stroke, text))
    end = range_end(u, y, section.cycles, section.noise, section.input_noise)
    if end is not None:
        text = _range_end_text(end, sign, units, stroke, y.size)
        faults.append(RecordFault.of(end.kind, number, (), end.lost, stroke, text))
    return tuple(faults)


def _range_end_text(
    end: RangeEnd, sign: float, units: tuple[str, str], stroke: float, size: int
) -> str:
    """Return the message about an end of the range that the output does not follow."""
    at, level = readable(units[0], end.at), readable(units[1], sign * end.level, digits=4)
    lost = f"in {end.samples} samples ({100.0 * end.samples / size:.1f} %)"
    lost += f", and loses about {100.0 * end.lost / stroke:.2g} % of the stroke"
    if end.kind == "clipping":
        return (
            f"the output is clipped at {level} while the input still moves, {lost}: check for "
            "saturation of sensor or amplifier and for contact of the stage with a stop, and "
            "exclude that range of the input"
        )
    if end.kind == "saturation":
        return (
            f"the output saturates beyond an input of {at}, {lost}: its slope falls below "
            f"{100 * _END.flat:g} % without a sharp bend, as by a ferroelectric at high field or "
            "an amplifier that limits softly; exclude that range of the input unless it is used"
        )
    return (
        f"partial butterfly loop: the output turns back beyond an input of {at}, at {level}: the "
        "polarity of a piezo drive begins to change there, and no model includes that; exclude "
        "that range of the input"
    )


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
    around = np.array([-2.0, -1.0, length, length + 1.0])
    return np.vander(np.arange(length), 4) @ np.linalg.inv(np.vander(around))


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


def likely_shifts(u: Array, y: Array, least: int) -> tuple[int, ...]:
    """Return shifts [samples] at which an output may follow an input: the best and the smallest.

    The squared correlation with the middle half of the input has a maximum of at least 0.5 there.
    Shifts count from the maximum within the least shift, which is the lag of hysteresis and delay;
    where there is none, that lag is unknown, so that some are tried.
    """
    from scipy.signal import correlate, find_peaks

    middle = y.size // 4
    x = u[middle : u.size - middle] - u[middle : u.size - middle].mean()
    product = correlate(y - y.mean(), x, mode="valid", method="fft")
    sums = [np.cumsum(np.append(0.0, (y - y.mean()) ** k)) for k in (1, 2)]
    mean, square = (c[x.size :] - c[: -x.size] for c in sums)
    variance = np.maximum(square - mean**2 / x.size, 1e-300)
    share = product**2 / (variance * max(float(x @ x), 1e-300))
    # symmetric cycles fit half a cycle later with the other sign: no shift, if they fit already
    if share[middle] > 0.8:
        share = np.where(product * product[middle] > 0.0, share, 0.0)
    near = share[middle - least : middle + least + 1]
    usual = int(np.argmax(near)) - least if 0 < np.argmax(near) < near.size - 1 else 0
    peaks = [int(k) - middle - usual for k in find_peaks(share, height=0.5)[0]]
    peaks = [k for k in peaks if abs(k) > least]
    best = sorted(peaks, key=lambda k: -share[middle + usual + k])
    shifts = dict.fromkeys((*best[:4], *sorted(peaks, key=abs)[:8]))
    return tuple(
        lag - less for lag in shifts for less in sorted({-least // 5, 0, least // 4, least // 2})
    )


def shift_text(seconds: float) -> str:
    """Return the message about an output that is shifted in time."""
    return (
        f"the output moves about {readable('s', abs(seconds), digits=3)} "
        f"{'before' if seconds < 0.0 else 'after'} the input, by the best correlation: check that "
        "both were recorded with one clock and begin with the same sample"
    )
